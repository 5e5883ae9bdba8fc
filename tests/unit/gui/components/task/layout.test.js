import assert from "node:assert/strict";
import test from "node:test";
import { curve, layered } from "somrs-task/layout.js";

const boxes = (...ids) => ids.map((id) => ({ id, width: 100, height: 40 }));
const arrows = (...pairs) => pairs.map((pair) => ({ from: pair[0], to: pair[1] }));

test("a step stands below what comes before it", () => {
  const { places, height, width } = layered(boxes("a", "b", "c"), arrows("ab", "bc"));
  assert.ok(places.get("a")[1] < places.get("b")[1] && places.get("b")[1] < places.get("c")[1]);
  assert.equal(new Set([...places.values()].map(([x]) => x)).size, 1, "a chain is a straight line");
  assert.deepEqual([width, height], [100, 3 * 40 + 2 * 44]);
});

test("a plan to the right is the same, turned", () => {
  const { places, width } = layered(boxes("a", "b"), arrows("ab"), { right: true });
  assert.ok(places.get("a")[0] < places.get("b")[0]);
  assert.equal(places.get("a")[1], places.get("b")[1]);
  assert.equal(width, 2 * 100 + 44);
});

test("no two boxes overlap, and all are in the picture", () => {
  const ids = [..."abcdefghij"];
  const { places, width, height } = layered(boxes(...ids), arrows("ae", "be", "ce", "de", "af", "eg", "eh", "ei", "fj", "gj"));
  for (const one of ids) {
    const [x, y] = places.get(one);
    assert.ok(x >= 50 && x <= width - 50 && y >= 20 && y <= height - 20, `${one} is in the picture`);
    for (const other of ids)
      if (one < other) {
        const [u, v] = places.get(other);
        assert.ok(Math.abs(x - u) >= 100 || Math.abs(y - v) >= 40, `${one} and ${other} are apart`);
      }
  }
});

test("arrows do not cross where they need not", () => {
  const { places } = layered(boxes("a", "b", "x", "y"), arrows("ay", "bx"));
  const side = (one, other) => Math.sign(places.get(one)[0] - places.get(other)[0]);
  assert.equal(side("a", "b"), side("y", "x"));
});

test("an arrow over a layer goes beside the box that is there", () => {
  const { places, paths } = layered(boxes("a", "b", "c"), arrows("ab", "bc", "ac"));
  const long = paths.find(({ from, to }) => from === "a" && to === "c");
  const [x, y] = places.get("b");
  for (const [u, v] of long.points) assert.ok(Math.abs(u - x) > 50 || Math.abs(v - y) > 20, "it keeps out of the box");
  assert.ok(long.points[0][1] >= places.get("a")[1] + 20 && long.points.at(-1)[1] <= places.get("c")[1] - 20);
});

test("a first step stands right before what it is for", () => {
  const { places } = layered(boxes("a", "b", "c", "late"), arrows("ab", "bc", ["late", "c"]));
  assert.equal(places.get("late")[1], places.get("b")[1]);
});

test("arrows from nowhere, and a plan without steps, do no harm", () => {
  const { paths, places } = layered(boxes("a"), arrows("xa", "aa"));
  assert.deepEqual([paths.length, places.size], [0, 1]);
  assert.deepEqual(layered([], []), { places: new Map(), paths: [], width: 0, height: 0 });
});

test("a curve goes from the first point to the last", () => {
  assert.equal(curve([[0, 0], [10, 40]]), "M0 0 C0 20 10 20 10 40");
  assert.equal(curve([[0, 0], [40, 10]], true), "M0 0 C20 0 20 10 40 10");
});
