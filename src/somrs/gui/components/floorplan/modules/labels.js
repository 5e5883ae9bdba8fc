// Labels on the plan: as many as fit, the most important first. They are drawn in pixels, so their size does not depend on the zoom.

import { svg } from "./layers.js";

const HEIGHT = 14;
const GAP = 3;
const DOT = 6; // pixels from the centre of a small object to its label
const CELL = 64; // pixels: cell size of the grid used to find overlaps
const MOST = 220;

export class Labels {
  constructor(layer) {
    this._layer = layer;
    this._nodes = new Map();
    this._widths = new Map();
    this._from = new Map();
    this._pen = document.createElement("canvas").getContext("2d");
    this._pen.font = "12px system-ui, 'Segoe UI', Roboto, sans-serif";
  }

  // A label: { name, text, x, y (centre of the object, pixels), half ({ w, h }: half its size, pixels), rank, inside, classes }. `spots`:
  // areas that labels must not cover.
  place(labels, spots, view) {
    const taken = new Taken();
    for (const { x, y } of spots) taken.take(x - DOT, y - HEIGHT / 2, 2 * DOT);
    const kept = new Map();
    for (const label of labels.sort((a, b) => b.rank - a.rank)) {
      if (kept.size >= MOST) break;
      const width = this._width(label.text);
      const spot = ways(label, width).find((one) => inView(one, width, view) && (label.always || taken.free(one.x - width / 2, one.y - HEIGHT / 2, width)));
      if (!spot) continue;
      taken.take(spot.x - width / 2, spot.y - HEIGHT / 2, width);
      kept.set(label.name, { ...label, at: spot });
    }
    for (const [name, node] of this._nodes)
      if (!kept.has(name)) {
        node.remove();
        this._nodes.delete(name);
      }
    this._from = new Map([...kept].map(([name, { x, y }]) => [name, { x, y }]));
    for (const [name, label] of kept) this._write(name, label);
  }

  // Move a label with its object until all labels are placed again.
  follow(name, { x, y }) {
    const [node, from] = [this._nodes.get(name), this._from.get(name)];
    if (node && from) node.setAttribute("transform", `translate(${(x - from.x).toFixed(1)} ${(y - from.y).toFixed(1)})`);
  }

  _write(name, label) {
    let node = this._nodes.get(name);
    if (!node) {
      node = svg("text", { "data-label": name });
      this._layer.appendChild(node);
      this._nodes.set(name, node);
    }
    const classes = `fp-label ${label.classes ?? ""}`;
    if (node.textContent !== label.text) node.textContent = label.text;
    if (node.getAttribute("class") !== classes) node.setAttribute("class", classes);
    node.setAttribute("x", label.at.x.toFixed(1));
    node.setAttribute("y", (label.at.y + 4).toFixed(1));
    node.removeAttribute("transform");
  }

  _width(text) {
    let width = this._widths.get(text);
    if (width === undefined) this._widths.set(text, (width = this._pen.measureText(text).width + 6));
    return width;
  }
}

function ways(label, width) {
  const { x, y, half } = label;
  if (label.centred) return [{ x, y }];
  const below = { x, y: y + half.h + GAP + HEIGHT / 2 };
  const above = { x, y: y - half.h - GAP - HEIGHT / 2 };
  const right = { x: x + half.w + GAP + width / 2, y };
  const left = { x: x - half.w - GAP - width / 2, y };
  const fits = label.inside && 2 * half.w > width && 2 * half.h > HEIGHT;
  return fits ? [{ x, y }, below, above] : [below, right, above, left];
}

function inView({ x, y }, width, view) {
  return x - width / 2 > 0 && x + width / 2 < view.width && y - HEIGHT / 2 > 0 && y + HEIGHT / 2 < view.height;
}

// The occupied boxes, by grid cell.
class Taken {
  constructor() {
    this._cells = new Map();
  }

  free(x, y, width) {
    for (const key of cells(x, y, width))
      for (const [ax, ay, aw] of this._cells.get(key) ?? []) if (x < ax + aw && ax < x + width && y < ay + HEIGHT && ay < y + HEIGHT) return false;
    return true;
  }

  take(x, y, width) {
    for (const key of cells(x, y, width)) {
      if (!this._cells.has(key)) this._cells.set(key, []);
      this._cells.get(key).push([x, y, width]);
    }
  }
}

function* cells(x, y, width) {
  for (let i = Math.floor(x / CELL); i <= Math.floor((x + width) / CELL); i++)
    for (let j = Math.floor(y / CELL); j <= Math.floor((y + HEIGHT) / CELL); j++) yield i * 10000 + j;
}
