import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import { View } from "somrs-floorplan/view.js";

let view;

beforeEach(() => {
  view = new View();
  view.size(800, 600);
});

const near = (one, other) => assert.ok(Math.abs(one.x - other.x) < 1e-9 && Math.abs(one.y - other.y) < 1e-9, `${JSON.stringify(one)} is ${JSON.stringify(other)}`);

test("north is up, and the way back is the same", () => {
  assert.deepEqual(view.toScreen(1, 2), { x: 450, y: 200 });
  near(view.toMap(450, 200), { x: 1, y: 2 });
});

test("zooming keeps what is under the pointer, within limits", () => {
  const before = view.toMap(100, 50);
  view.zoom(1.5, 100, 50);
  near(view.toMap(100, 50), before);
  view.zoom(1e9);
  assert.equal(view.scale, 2500);
  view.zoom(1e-9);
  assert.equal(view.scale, 0.5);
});

test("the plan goes along with the hand that moves it", () => {
  const before = view.toMap(100, 100);
  view.pan(30, -20);
  near(view.toMap(130, 80), before);
  assert.equal(view.fitted, false);
});

test("all of a box is seen, beside the tools", () => {
  const box = { left: -30, right: 30, bottom: 0, top: 10 };
  view.fit(box);
  const [low, high] = [view.toScreen(box.left, box.bottom), view.toScreen(box.right, box.top)];
  assert.ok(low.x >= 0 && high.x <= 800 - 40 && high.y >= 0 && low.y <= 600 - 26);
  assert.equal(view.fitted, true);
  view.fit(null);
});

test("what is out of sight is brought into view, what is in sight stays", () => {
  assert.equal(view.reveal(1, 1), false);
  assert.deepEqual([view.x, view.y], [0, 0]);
  assert.equal(view.reveal(100, 1), true);
  near(view.toScreen(100, 1), { x: 400, y: 300 });
});

test("the scale bar is a round length", () => {
  const at = (scale) => Object.assign(view, { scale }).bar().text;
  assert.deepEqual([at(50), at(2500), at(0.5), at(0.05)], ["2 m", "5 cm", "200 m", "2 km"]);
  Object.assign(view, { scale: 30 });
  const { pixels } = view.bar();
  assert.ok(pixels >= 60 && pixels <= 150);
});
