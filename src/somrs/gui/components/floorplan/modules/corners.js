// The corners of the selected zone, which the user drags, or chooses and moves by keys. Until the map has them where they were moved to, the
// zone is outlined there.

import { svg } from "./layers.js";
import { reach } from "./model.js";

const LEAST = 28; // pixels; the corners of a smaller zone would cover it

// Where the corners of an object are on the map, as [x, y]; null if its shape has none.
export function cornersOf(solid) {
  const [w, d] = [solid.width / 2, solid.depth / 2];
  const own = { Polygon: solid.outline, Box: [[-w, -d], [w, -d], [w, d], [-w, d]] }[solid.form];
  const [c, s] = [Math.cos(solid.turned), Math.sin(solid.turned)];
  return own?.map(([u, v]) => [solid.x + c * u - s * v, solid.y + s * u + c * v]) ?? null;
}

export class Corners {
  // `solid(name)`: the shape of an object, and the pose at which it is drawn; null if it has none.
  constructor(solid) {
    this._solid = solid;
    this._moved = null; // { name, corners }: a zone that has other corners than on the map
    this._chosen = null; // { name, index }: the corner that keys move
  }

  // The corners of a zone as they are to be; null for another object.
  of(name) {
    if (this._moved?.name === name) return this._moved.corners;
    const solid = name === null ? null : this._solid(name);
    return solid && cornersOf(solid);
  }

  // Draw the zone with one of its corners elsewhere. Returns all corners.
  move(name, index, to) {
    const corners = this.of(name).map((corner, place) => (place === index ? to : corner));
    this._moved = { name, corners };
    return corners;
  }

  // Draw the zone with these corners, as before it was in the hand.
  restore(name, corners) {
    this._moved = { name, corners };
  }

  // Draw the zone as it is on the map.
  forget(name) {
    if (this._moved?.name === name) this._moved = null;
  }

  choose(name, index) {
    this._chosen = index === null ? null : { name, index };
  }

  // The position of the chosen corner among those of the zone; null if none of them is chosen.
  chosen(name) {
    return this._chosen?.name === name && this._chosen.index < (this.of(name)?.length ?? 0) ? this._chosen.index : null;
  }

  draw(view, name) {
    const node = svg("g", { class: "fp-corners" });
    const corners = this.of(name);
    if (!corners || (reach(this._solid(name)) * view.scale < LEAST && this._moved === null)) return node;
    const points = corners.map(([x, y]) => view.toScreen(x, y)).map((at) => `${at.x.toFixed(1)} ${at.y.toFixed(1)}`);
    const area = this._moved?.name === name ? `<path class="fp-sketch-area" d="M${points.join("L")}Z"/>` : "";
    const handles = points.map((point, index) => {
      const look = index === this.chosen(name) ? " fp-corner-chosen" : "";
      return `<g class="fp-handle fp-corner${look}" data-handle="corner" data-corner="${index}" transform="translate(${point})"><title>Drag the corner</title><circle class="fp-grip" r="15"/><circle r="6"/></g>`;
    });
    node.innerHTML = area + handles.join("");
    return node;
  }
}
