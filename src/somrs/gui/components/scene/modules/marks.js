// Marks of selected or highlighted objects: a ring around the foot, and a pin above, visible from afar.
import { THREE } from "nicegui-scene";

const ABOVE = 0.05; // m between an object and its pin
const TALL = 0.2; // m, of a pin

function scaled(body) {
  return Math.min(2, Math.max(0.6, body.size / 0.2));
}

export function pinned(body) {
  // Height of the pin's end above the object.
  return ABOVE + TALL * scaled(body);
}

export class Marks {
  constructor(scene, world) {
    this.scene = scene;
    this.world = world;
    this.marks = new Map();
    this.ring = new THREE.RingGeometry(0.86, 1, 48);
    this.pin = new THREE.ConeGeometry(0.35 * TALL, TALL, 20).rotateX(-Math.PI / 2).translate(0, 0, TALL / 2);
    this.material = new THREE.MeshBasicMaterial({ side: THREE.DoubleSide });
  }

  color(hex) {
    this.material.color.set(hex);
  }

  set(names) {
    const wanted = new Set([...names].filter((name) => this.world.bodies.has(name)));
    for (const [name, mark] of this.marks) {
      if (wanted.has(name)) continue;
      this.scene.remove(mark);
      this.marks.delete(name);
    }
    for (const name of wanted) {
      if (this.marks.has(name)) continue;
      const mark = new THREE.Group();
      mark.add(new THREE.Mesh(this.ring, this.material), new THREE.Mesh(this.pin, this.material));
      this.marks.set(name, mark);
      this.scene.add(mark);
    }
  }

  place() {
    // Update the positions before each frame.
    for (const [name, mark] of this.marks) {
      const at = this.world.where(name);
      const body = this.world.bodies.get(name);
      mark.visible = Boolean(at) && this.world.visible(name);
      if (!mark.visible) continue;
      const [ring, pin] = mark.children;
      const size = body.kind === "floor" ? 0.3 : Math.max(1.35 * body.size, body.size + 0.05);
      mark.position.set(at.x, at.y, at.z);
      ring.scale.set(size, size, 1);
      ring.position.z = 0.012 + (body.kind === "floor" ? body.height : 0);
      pin.position.z = this.world.top(name) + ABOVE + (body.kind === "floor" ? body.height : 0);
      pin.scale.setScalar(scaled(body));
    }
  }

  dispose() {
    this.set([]);
    this.ring.dispose();
    this.pin.dispose();
    this.material.dispose();
  }
}
