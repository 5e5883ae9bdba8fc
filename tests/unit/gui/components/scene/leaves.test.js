import assert from "node:assert/strict";
import test from "node:test";
import { leavesOf } from "somrs-scene/leaves.js";

const near = (at, expected) => {
  for (const [key, value] of Object.entries(expected)) assert.ok(Math.abs(at[key] - value) < 1e-9, `${key}: ${at[key]}, not ${value}`);
};

test("the leaf of a door slides along its longer side, and a strip of it stays", () => {
  const along = (width, depth) => leavesOf({ kind: "door", form: "Box", width, depth, height: 2, color: "#ffffff" }, false, false)[0].place;
  near(along(0.1, 1.4)(0), { x: 0, y: 0 });
  near(along(0.1, 1.4)(1), { x: 0, y: 0.14 - 1.4 });
  near(along(1.4, 0.1)(1), { x: 0.14 - 1.4, y: 0 });
});

test("the leaves of a cupboard are hinged at the ends of its front and swing out by a quarter turn", () => {
  const cupboard = { kind: "furniture", form: "Box", width: 0.5, depth: 1.2, height: 0.9, color: "#ffffff" };
  const [right, left] = leavesOf(cupboard, true, false).map(({ place }) => place);
  near(right(0), { x: 0.24, y: -0.6, yaw: Math.PI / 2 });
  near(left(0), { x: 0.24, y: 0.6, yaw: -Math.PI / 2 });
  near(right(1), { y: -0.6, yaw: 0 });
  near(left(0.5), { yaw: -Math.PI / 4 });
  assert.equal(leavesOf({ ...cupboard, depth: 0.6 }, true, false).length, 1);
  assert.deepEqual(leavesOf(cupboard, false, false), [], "other furniture has none");
});
