// Labels beside objects, as HTML for sharp text: the most important first, without overlaps.
import { THREE } from "nicegui-scene";
import { pinned } from "./marks.js";

const MOST = 90; // labels at once
const KEPT = 400; // labels kept for reuse
const GAP = 3; // px
const BELOW = new Set(["furniture", "place"]);
// Positions of a label, best first: the offset of its upper left corner from its point, in label widths and heights.
const PLACES = {
  floor: [[-0.5, -0.5]],
  furniture: [[-0.5, 0]],
  place: [[-0.5, 0]],
  other: [[-0.5, -1], [-0.2, -1], [-0.8, -1], [0.08, -0.3], [-1.08, -0.3]],
};
const FAULTS = { drive: "drive broken", gripper: "gripper stuck", silent: "silent", link: "link cut" };

export function faultText(work) {
  return (work?.faults ?? []).map((fault) => FAULTS[fault] ?? fault).join(", ");
}

function reach(body, { x, y }) {
  // Its extent in this direction, seen from above.
  if (body.form !== "Box") return body.size;
  const angle = Math.atan2(y, x) - body.yaw;
  return (Math.abs(Math.cos(angle)) * body.width + Math.abs(Math.sin(angle)) * body.depth) / 2;
}

export class Labels {
  constructor(layer, stage, world) {
    this.layer = layer;
    this.stage = stage;
    this.world = world;
    this.on = true;
    this.marked = new Map(); // highlighted objects: the text to append, by name
    this.selected = null;
    this.known = new Map(); // name: { element, width, height, text, shown }
    this.point = new THREE.Vector3();
  }

  changed(name) {
    const one = this.known.get(name);
    if (!one) return;
    one.element.remove();
    this.known.delete(name);
  }

  clear() {
    this.layer.replaceChildren();
    this.known.clear();
  }

  weight(body, name, pixels) {
    // The priority of the label; 0: none. `pixels`: size of the object on the screen.
    if (name === this.selected || this.marked.has(name)) return 1000;
    if (!this.on) return this.world.works.get(name)?.faults?.length ? 900 : 0;
    if (body.kind === "robot") return this.world.works.get(name)?.faults?.length ? 900 : 500;
    if (body.kind === "thing") return pixels > 5 || this.few ? 300 + pixels : 0;
    if (body.kind === "place") return pixels > 22 ? 150 : 0;
    if (body.kind === "floor") return body.label && pixels > 150 ? 250 : 0;
    if (body.kind === "camera") return pixels > 4 ? 160 : 0;
    if (body.kind === "furniture") return pixels > (this.world.isA(body, "Obstacle") ? 110 : 44) ? 100 + pixels / 10 : 0;
    return 0;
  }

  draw(width, height) {
    const { camera } = this.stage;
    const scale = height / 2 / Math.tan(THREE.MathUtils.degToRad(camera.fov) / 2);
    this.few = this.world.drawn.size < 60;
    const looking = camera.getWorldDirection(new THREE.Vector3());
    const above = Math.abs(looking.z); // 1: seen from straight above
    const found = [];
    for (const [name, body] of this.world.bodies) {
      if (body.kind === "wall" || body.kind === "door" || !this.world.visible(name)) continue;
      const { x, y, z } = this.world.where(name);
      const foot = this.point.set(x, y, z + (body.kind === "floor" ? body.height : 0)).applyMatrix4(camera.matrixWorldInverse);
      const depth = -foot.z;
      if (depth < camera.near) continue;
      const pixels = (2 * Math.max(body.size, 0.05) * scale) / depth;
      let weight = this.weight(body, name, pixels);
      if (!weight) continue;
      const left = width / 2 + (foot.x * scale) / depth;
      let top = height / 2 - (foot.y * scale) / depth;
      if (BELOW.has(body.kind)) {
        // In front of its foot, so that things on it stay visible.
        top += (reach(body, looking) * scale * above) / depth + 3;
      } else if (body.kind !== "floor") {
        const pin = name === this.selected || this.marked.has(name) ? pinned(body) : 0;
        const head = this.point.set(x, y, z + this.world.top(name) + pin).applyMatrix4(camera.matrixWorldInverse);
        top = Math.min(top - 0.5 * pixels * above, height / 2 + (head.y * scale) / head.z) - 4;
      }
      if (left < 0 || left > width || top < 0 || top > height) continue;
      if (this.known.get(name)?.shown) weight += 20; // visible labels stay if possible
      found.push({ name, body, left, top, weight: weight - 0.01 * depth });
    }
    found.sort((a, b) => b.weight - a.weight);
    const taken = [];
    const shown = new Set();
    for (const { name, body, left, top, weight } of found.slice(0, 3 * MOST)) {
      if (shown.size >= MOST) break;
      const label = this.label(name, body);
      const free = (area) =>
        !taken.some((one) => area.left < one.right && area.right > one.left && area.top < one.bottom && area.bottom > one.top);
      const places = (PLACES[body.kind] ?? PLACES.other).map(([across, down]) => {
        const x = Math.round(Math.min(Math.max(left + across * label.width, 2), width - label.width - 2));
        const y = Math.round(Math.min(Math.max(top + down * label.height, 2), height - label.height - 2));
        return { x, y, left: x - GAP, top: y - GAP, right: x + label.width + GAP, bottom: y + label.height + GAP };
      });
      const spot = places.find(free) ?? (weight < 800 ? null : places[0]);
      if (!spot) continue;
      taken.push(spot);
      shown.add(name);
      label.element.style.transform = `translate(${spot.x}px, ${spot.y}px)`;
      if (!label.shown) label.element.style.visibility = "visible";
      label.shown = true;
    }
    for (const [name, label] of this.known) {
      if (!shown.has(name) && this.known.size > KEPT) this.changed(name);
      else if (label.shown && !shown.has(name)) {
        label.element.style.visibility = "hidden";
        label.shown = false;
      }
    }
  }

  label(name, body) {
    const known = this.known.get(name);
    if (known) return known;
    const element = document.createElement("div");
    element.className = `somrs-scene-label somrs-scene-label-${body.kind}`;
    if (this.marked.has(name)) element.classList.add("somrs-scene-label-marked");
    if (name === this.selected) element.classList.add("somrs-scene-label-selected");
    element.append(body.kind === "floor" ? body.label : (body.label ?? name));
    if (this.marked.get(name)) element.append(this.badge("", this.marked.get(name)));
    if (body.unknown) element.append(this.badge("?", "whereabouts unknown"));
    const faults = faultText(this.world.works.get(name));
    if (faults) element.append(this.badge("⚠", faults, "somrs-scene-badge-bad"));
    const { holding } = this.world.works.get(name) ?? {};
    if (holding) element.append(this.badge("↑", holding));
    this.layer.append(element);
    const label = { element, width: element.offsetWidth, height: element.offsetHeight, shown: false };
    this.known.set(name, label);
    return label;
  }

  badge(sign, text, style = "") {
    const badge = document.createElement("span");
    badge.className = `somrs-scene-badge ${style}`;
    badge.textContent = `${sign} ${text}`.trim();
    return badge;
  }
}
