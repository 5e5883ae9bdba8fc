// The camera and its controls: mouse and touch (orbit, zoom, pan), keys, and the views of the whole scene, from above, and following an
// object.
import { OrbitControls, THREE } from "nicegui-scene";

const TURN = Math.PI / 24;
const ZOOM = 1.18;
const FARTHEST = 400; // m, largest distance of the camera, but for buildings that need more
const SIDES = [0, Math.PI / 2]; // from the south, and from the east
const MUCH = 0.8; // how much nearer the camera has to be for the second side
const GLIDE = 0.35; // s, duration of a change of view

export class Pilot {
  constructor(stage, element, changed) {
    this.stage = stage;
    this.camera = stage.camera;
    this.changed = changed;
    this.followed = null;
    this.controls = new OrbitControls(this.camera, element);
    Object.assign(this.controls, { enableDamping: false, maxPolarAngle: 0.495 * Math.PI, minDistance: 0.4, maxDistance: FARTHEST, screenSpacePanning: false });
    this.controls.addEventListener("change", () => {
      stage.shine(this.controls.target);
      stage.want();
    });
    this.controls.addEventListener("start", () => {
      this.glide = null;
      this.moved = true;
    });
  }

  // Views

  fit(box, { fromAbove = false, at_once = false } = {}) {
    // As near as all corners fit into the picture, and as steep as possible at this size; from the east only if that is much nearer,
    // because the building is long in one direction and the picture in another.
    this.moved = false;
    const [south, east] = SIDES.map((turned) => {
      const views = (fromAbove ? [90] : [66, 60, 54, 48, 42]).map((degrees) => this.framing(box, THREE.MathUtils.degToRad(degrees), turned));
      const nearest = Math.min(...views.map((view) => view.distance));
      return views.find((view) => view.distance <= 1.04 * nearest);
    });
    const { target, position, distance } = east.distance < MUCH * south.distance ? east : south;
    this.controls.maxDistance = Math.max(FARTHEST, 2 * distance);
    this.go(target, position, at_once);
  }

  framing(box, elevation, turned) {
    const toward = new THREE.Vector3(elevation > 1.5 ? 0 : -0.06, -1, 0).setLength(Math.cos(elevation) + 1e-3).setZ(Math.sin(elevation)).normalize();
    toward.applyAxisAngle(new THREE.Vector3(0, 0, 1), turned);
    const right = new THREE.Vector3().crossVectors(new THREE.Vector3(0, 0, 1), toward).normalize();
    const up = new THREE.Vector3().crossVectors(toward, right);
    const high = Math.tan(THREE.MathUtils.degToRad(this.camera.fov) / 2) * 0.94;
    const wide = high * this.camera.aspect;
    const target = box.getCenter(new THREE.Vector3());
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map(
      (i) => new THREE.Vector3(i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z),
    );
    let distance = 1;
    for (let round = 0; round < 8; round++) {
      // The target depends on the distance, because of perspective.
      const seen = corners.map((corner) => {
        const v = corner.clone().sub(target);
        return { x: v.dot(right), y: v.dot(up), z: v.dot(toward) };
      });
      distance = Math.max(1, ...seen.map(({ x, y, z }) => Math.max(Math.abs(x) / wide, Math.abs(y) / high) + z));
      const ys = seen.map(({ y, z }) => y / (distance - z));
      const xs = seen.map(({ x, z }) => x / (distance - z));
      target.addScaledVector(up, ((Math.max(...ys) + Math.min(...ys)) / 2) * distance * 0.8);
      target.addScaledVector(right, ((Math.max(...xs) + Math.min(...xs)) / 2) * distance * 0.8);
    }
    return { target, distance, position: target.clone().addScaledVector(toward, distance) };
  }

  look(at, distance) {
    // Move to a point, from the current direction, but neither from far away nor from straight above.
    const offset = this.camera.position.clone().sub(this.controls.target);
    const polar = Math.min(Math.max(offset.angleTo(new THREE.Vector3(0, 0, 1)), 0.8), 1.2);
    const around = Math.atan2(offset.y, offset.x);
    const flat = distance * Math.sin(polar);
    const from = new THREE.Vector3(flat * Math.cos(around), flat * Math.sin(around), distance * Math.cos(polar));
    this.go(at.clone(), at.clone().add(from));
  }

  go(target, position, at_once = false) {
    if (at_once || matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.glide = null;
      this.controls.target.copy(target);
      this.camera.position.copy(position);
      this.controls.update();
    } else {
      const { target: from } = this.controls;
      this.glide = { began: performance.now() / 1000, from: from.clone(), at: this.camera.position.clone(), target, position };
    }
    this.stage.want();
  }

  follow(at) {
    // `at`: returns the position of the followed object; null: stop following.
    this.followed = at;
    const point = at?.();
    if (point) this.look(point, Math.min(Math.max(this.camera.position.distanceTo(this.controls.target), 2.5), 5));
  }

  step(now) {
    // Before each frame. Returns whether the camera continues to move.
    const point = this.followed?.();
    if (this.glide) {
      const { began, from, at, target, position } = this.glide;
      const share = Math.min(1, (now - began) / GLIDE);
      const soft = share * share * (3 - 2 * share);
      if (point) {
        position.add(point).sub(target);
        target.copy(point);
      }
      this.controls.target.lerpVectors(from, target, soft);
      this.camera.position.lerpVectors(at, position, soft);
      if (share === 1) this.glide = null;
      this.controls.update();
      return share < 1;
    }
    if (point && point.distanceToSquared(this.controls.target) > 1e-8) {
      this.camera.position.add(point).sub(this.controls.target);
      this.controls.target.copy(point);
      this.controls.update();
    }
    return false;
  }

  // Keys

  key(event) {
    // Returns whether the key moved the camera.
    if (event.ctrlKey || event.metaKey || event.altKey) return false;
    const around = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (around && event.shiftKey) this.pan(...around);
    else if (around) this.orbit(...around);
    else if (event.key === "+" || event.key === "=") this.zoom(1 / ZOOM);
    else if (event.key === "-" || event.key === "_") this.zoom(ZOOM);
    else return false;
    return true;
  }

  orbit(sideways, down) {
    this.glide = null;
    const offset = this.camera.position.clone().sub(this.controls.target);
    offset.applyAxisAngle(new THREE.Vector3(0, 0, 1), sideways * TURN);
    const polar = offset.angleTo(new THREE.Vector3(0, 0, 1));
    const wanted = Math.min(Math.max(polar + down * TURN, 0.02), this.controls.maxPolarAngle);
    const side = new THREE.Vector3().crossVectors(new THREE.Vector3(0, 0, 1), offset).normalize();
    offset.applyAxisAngle(side, wanted - polar);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
  }

  pan(sideways, down) {
    if (this.followed) return;
    this.glide = null;
    const offset = this.camera.position.clone().sub(this.controls.target);
    const step = 0.06 * offset.length();
    const ahead = offset.clone().setZ(0).normalize().negate();
    const right = new THREE.Vector3(ahead.y, -ahead.x, 0);
    const way = right.multiplyScalar(sideways * step).addScaledVector(ahead, -down * step);
    this.controls.target.add(way);
    this.camera.position.add(way);
    this.controls.update();
  }

  zoom(factor) {
    this.glide = null;
    const offset = this.camera.position.clone().sub(this.controls.target);
    const length = Math.min(Math.max(offset.length() * factor, this.controls.minDistance), this.controls.maxDistance);
    this.camera.position.copy(this.controls.target).add(offset.setLength(length));
    this.controls.update();
  }

  dispose() {
    this.controls.dispose();
  }
}
