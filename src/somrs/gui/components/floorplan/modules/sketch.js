// A zone that the user is drawing: its corners so far, and where the pointer is.

import { svg } from "./layers.js";

const NEAR = 12; // pixels from the first corner at which a click closes the zone

export class Sketch {
  constructor() {
    this.corners = [];
    this.pointer = null;
  }

  // Add a corner; returns whether the zone is closed instead, because the point is at the first corner.
  add(point, view) {
    if (this.corners.length > 2) {
      const [first, at] = [this.corners[0], point].map(({ x, y }) => view.toScreen(x, y));
      if (Math.hypot(first.x - at.x, first.y - at.y) < NEAR) return true;
    }
    this.corners.push(point);
    return false;
  }

  // The corners of the finished zone: two are those of a box. Null if they are too few.
  finished() {
    if (this.corners.length < 2) return null;
    const [a, b] = this.corners;
    const corners = this.corners.length > 2 ? this.corners : [a, { x: b.x, y: a.y }, b, { x: a.x, y: b.y }];
    return corners.map(({ x, y }) => [+x.toFixed(3), +y.toFixed(3)]);
  }

  draw(view) {
    const node = svg("g", { class: "fp-sketch" });
    const screen = (points) => points.map(({ x, y }) => view.toScreen(x, y)).map((p) => `${p.x.toFixed(1)} ${p.y.toFixed(1)}`);
    const open = screen(this.pointer ? [...this.corners, this.pointer] : this.corners);
    const dots = screen(this.corners).map((point) => `M${point}h0`).join("");
    node.innerHTML = open.length ? `<path class="fp-sketch-area" d="M${open.join("L")}Z"/><path class="fp-sketch-corner" d="${dots}"/>` : "";
    return node;
  }
}
