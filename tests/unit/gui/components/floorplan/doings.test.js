// What people do on a floor plan, as the page hears of it.

import assert from "node:assert/strict";
import { test } from "node:test";

import { doings } from "somrs-floorplan/doings.js";

test("a thing lands on what it was held above, whatever the page says meanwhile", () => {
  const told = [];
  const plan = {
    target: null,
    selected: "Jar001",
    model: { version: 3, targetAt: () => "Table001", riders: () => [], kind: () => ({ id: "thing" }) },
    at: () => ({ x: 0, y: 0, turned: 0 }),
    hold() {},
    wait() {},
    draw() {},
  };
  const element = { ...doings, plan, asked: [], doing: "edit", mode: "edit", snap: 0, $emit: (event, what) => told.push([event, what]) };
  element.take("Jar001", { x: 0, y: 0 });
  element.drag({ x: 1, y: 2 });
  plan.target = null;
  element.release();
  assert.deepEqual(told, [["moved", { name: "Jar001", x: 1, y: 2, turned: 0, target: "Table001", version: 3 }]]);
});
