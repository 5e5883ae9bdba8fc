// The camera of the 3D view: it frames what is there, however large it is.

import "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test from "node:test";
import { THREE } from "nicegui-scene";
import { Pilot } from "somrs-scene/pilot.js";

// How the building of this size is seen: the sides of the picture that it takes up, of -1 to 1, and how far away it is.
function seen([width, depth, height], aspect, how = {}) {
  const camera = new THREE.PerspectiveCamera(38, aspect, 0.05, 10000);
  camera.up.set(0, 0, 1);
  const pilot = new Pilot({ camera, shine() {}, want() {} }, document.createElement("div"), () => {});
  const box = new THREE.Box3(new THREE.Vector3(-20, -30, 0), new THREE.Vector3(width - 20, depth - 30, height));
  pilot.fit(box, { ...how, at_once: true });
  camera.updateMatrixWorld();
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => new THREE.Vector3(i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z).project(camera));
  const [xs, ys] = [corners.map(({ x }) => x), corners.map(({ y }) => y)];
  return { left: Math.min(...xs), right: Math.max(...xs), bottom: Math.min(...ys), top: Math.max(...ys), distance: camera.position.distanceTo(pilot.controls.target) };
}

const SIZES = [[8, 6, 2.5], [282, 64, 2.5], [64, 282, 2.5], [40, 40, 30], [3000, 200, 20]];

for (const aspect of [0.6, 1, 1.4, 2.2])
  for (const how of [{}, { fromAbove: true }])
    test(`all of a building is in the picture, and fills it: aspect ${aspect}${how.fromAbove ? ", from above" : ""}`, () => {
      for (const size of SIZES) {
        const { left, right, bottom, top } = seen(size, aspect, how);
        const text = `${size.join(" x ")} m: ${[left, right, bottom, top].map((side) => side.toFixed(2)).join(", ")}`;
        assert.ok(left >= -1 && right <= 1 && bottom >= -1 && top <= 1, `in the picture: ${text}`);
        assert.ok(right - left > 1.6 || top - bottom > 1.6, `it fills the picture: ${text}`);
      }
    });

test("on a telephone, a building that is long to the east is seen along its length", () => {
  const alongWidth = 282 / 2 / (Math.tan((19 * Math.PI) / 180) * 0.6);
  assert.ok(seen([282, 64, 2.5], 0.6).distance < 0.8 * alongWidth);
});
