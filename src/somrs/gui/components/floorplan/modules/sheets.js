// The sheets that objects are painted on. They are larger than the visible part: while a large map is panned or zoomed, its sheets are only
// moved and scaled, which is cheap, and repainted when the movement ends. Labels, frames and links are above them, in pixels.

import { SHEETS } from "./kinds.js";
import { svg } from "./layers.js";

const OVER = 0.3; // margin of a sheet beyond the visible part, as a share of its size on each side
const MANY = 700; // objects; smaller maps are repainted at every step
const REST = 140; // milliseconds without a step after which a movement has ended
const AGAIN = 350; // milliseconds between two repaints of large sheets during a movement
const STRETCH = 2.5; // maximum scaling of a sheet
const FAR = 14; // pixels per metre; below, details inside objects are left out

export class Sheets {
  constructor(element) {
    const root = shaded(element);
    this._sheets = [];
    this.groups = new Map();
    for (const name of Object.keys(SHEETS)) {
      const sheet = root.appendChild(svg("svg", { class: `fp-sheet fp-sheet-${name}`, "aria-hidden": "true" }));
      this._sheets.push(sheet);
      this.groups.set(name, sheet.appendChild(svg("g")));
    }
    const top = root.appendChild(svg("svg", { class: "fp-top", "aria-hidden": "true" }));
    const group = (cls) => top.appendChild(svg("g", { class: cls }));
    [this.ways, this.marks, this.links, this.labels, this.arrows, this.screen] = ["fp-ways", "fp-marks", "fp-links", "fp-labels", "fp-arrows", "fp-screen"].map(group);
    this._painted = null; // the view for which the sheets are painted
    this._paintedAt = 0;
  }

  end() {
    clearTimeout(this._resting);
  }

  // Show the view; `count`: number of objects.
  show(view, count) {
    this.marks.setAttribute("transform", view.transform());
    this.marks.style.fontSize = `${1 / view.scale}px`; // an em is a pixel: strokes keep their width
    const now = performance.now();
    clearTimeout(this._resting);
    if (count < MANY || !this._painted || (!this._covers(view) && now - this._paintedAt > AGAIN)) return this._paint(view);
    this._shift(view);
    this._resting = setTimeout(() => this._paint(view), REST);
  }

  _paint(view) {
    const key = `${view.x} ${view.y} ${view.scale} ${view.width} ${view.height}`;
    if (this._painted?.key !== key) {
      const transform = view.transform(OVER);
      for (const group of this.groups.values()) {
        group.setAttribute("transform", transform);
        group.style.fontSize = `${1 / view.scale}px`;
      }
      this._painted = { key, x: view.x, y: view.y, scale: view.scale, width: view.width, height: view.height };
      this._paintedAt = performance.now();
    }
    for (const sheet of this._sheets) {
      sheet.style.transform = "";
      sheet.classList.toggle("fp-far", view.scale < FAR);
    }
  }

  _shift(view) {
    const { dx, dy, stretch } = this._moved(view);
    for (const sheet of this._sheets) sheet.style.transform = `translate(${dx}px, ${dy}px) scale(${stretch})`;
  }

  _moved(view) {
    const before = this._painted;
    return { dx: (before.x - view.x) * view.scale, dy: (view.y - before.y) * view.scale, stretch: view.scale / before.scale };
  }

  // Whether the painted area covers the visible part and is not scaled too much.
  _covers(view) {
    const before = this._painted;
    if (before.width !== view.width || before.height !== view.height) return false;
    const { dx, dy, stretch } = this._moved(view);
    const [w, h] = [(0.5 + OVER) * view.width * stretch, (0.5 + OVER) * view.height * stretch];
    return Math.abs(dx) + view.width / 2 <= w && Math.abs(dy) + view.height / 2 <= h && stretch < STRETCH && stretch > 1 / STRETCH;
  }
}

// A shadow root with the page's own styles. Other style sheets and their changes (every new class changes them) then do not affect
// thousands of shapes.
function shaded(element) {
  const root = element.attachShadow({ mode: "open" });
  const holder = document.createElement("div");
  const look = document.querySelector('link[rel="stylesheet"][href*="look.css"]').cloneNode();
  holder.style.visibility = "hidden";
  look.onload = look.onerror = () => (holder.style.visibility = "");
  root.append(look, holder);
  return holder;
}
