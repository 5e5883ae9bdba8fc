// The 3D view where there is no WebGL: then it is told in words.

import { clock, mounted, page, server, text, write } from "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import scene3d from "../../../../../src/somrs/gui/components/scene/scene3d.js";

const body = (name, type, kind, x) => ({ name, type, kind, form: "Cylinder", x, y: 0, z: 0, radius: 0.1, height: 0.2, at: null });

let one;

beforeEach(async () => {
  server.reset();
  page.calm = true;
  server.answers["/api/scene"] = { title: "Office", problems: ["Odd: it has no form"], types: { Jar: ["Jar"] }, bodies: [body("Jar001", "Jar", "thing", 1), body("Robot1", "Rover", "robot", 2)] };
  one = await mounted(scene3d);
  server.socket("/api/live").open();
  await clock.pass(50);
});

afterEach(() => one.leave());

const rows = () => [...one.element.querySelectorAll("li button")].map(text);

test("it is said that there is no picture, and told where things are", async () => {
  assert.match(text(one.element.querySelector('[role="alert"]')), /WebGL is missing/);
  assert.deepEqual(rows(), ["Robot1 at 2.0, 0.0", "Jar001 at 1.0, 0.0"]);
  assert.match(text(one.element.querySelector(".somrs-scene-notes")), /^1 not drawn: Odd: it has no form$/);
});

test("one finds and chooses in the list", async () => {
  await write(one.element.querySelector("input"), "jar");
  assert.deepEqual(rows(), ["Jar001 at 1.0, 0.0"]);
  one.element.querySelector("li button").click();
  await clock.pass(10);
  assert.deepEqual(one.told, [["select", { name: "Jar001" }]]);
  assert.match(text(one.element.querySelector(".somrs-scene-card")), /^Jar001 Jar ?at 1\.0, 0\.0/);
});

test("storeys of one height are all there to be chosen, also by the page", async () => {
  const floor = (name, z) => ({ ...body(name, "Floor", "floor", 0), z, height: 0.1, storey: `${name} floor` });
  one.leave();
  server.reset();
  server.answers["/api/scene"] = { title: "Yard", problems: [], types: {}, bodies: [floor("House", -0.1), floor("Barn", -0.1), floor("Attic", 2.9)] };
  one = await mounted(scene3d, { storey: "Barn floor" });
  server.socket("/api/live").open();
  await clock.pass(50);
  const options = () => [...one.element.querySelectorAll("select")[0].options];
  assert.deepEqual(options().map(text), ["All storeys", "House floor", "Barn floor", "Attic floor"]);
  assert.equal(text(options().find((option) => option.selected)), "Barn floor");
});

test("the words keep up with what happens", async () => {
  server.socket("/api/poses").say({ robots: { Robot1: { holding: "Jar001", faults: [] } } });
  await clock.pass(600);
  assert.deepEqual(rows(), ["Robot1 at 2.0, 0.0; carries Jar001", "Jar001 held by Robot1"]);
});
