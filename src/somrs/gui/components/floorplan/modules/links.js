// Relations drawn as links: an arrow from the first object to each of the others, curved so that two directions do not overlap.

import { escape, svg } from "./layers.js";

const MOST = 3000;
const NAMED = 60; // with more links, their names would cover the plan

export class Links {
  constructor(layer) {
    this._layer = layer;
    this._shown = [];
  }

  // Draw the links between objects on the plan; `spot(name)` is an object's position, or null.
  show(model, relations, spot) {
    this._shown = [];
    for (const relation of relations)
      for (const fact of model.facts(relation)) {
        const [first, ...others] = fact.arguments;
        for (const other of others) {
          const [from, to] = [spot(first), spot(other)];
          if (from && to && this._shown.length < MOST) this._shown.push({ relation, first, other, from, to });
        }
      }
    this.draw();
  }

  // Redraw the links of the objects at their current positions.
  follow(names, spot) {
    let any = false;
    for (const link of this._shown)
      if (names.has(link.first) || names.has(link.other)) {
        [link.from, link.to] = [spot(link.first) ?? link.from, spot(link.other) ?? link.to];
        any = true;
      }
    if (any) this.draw();
  }

  draw() {
    const view = this._view;
    if (!view) return;
    const parts = this._shown.map((link) => {
      const [a, b] = [view.toScreen(link.from.x, link.from.y), view.toScreen(link.to.x, link.to.y)];
      const [dx, dy] = [b.x - a.x, b.y - a.y];
      const length = Math.hypot(dx, dy);
      if (length < 3 || outside(a, b, view)) return "";
      const bend = Math.min(24, length * 0.15);
      const [mx, my] = [(a.x + b.x) / 2 - (dy / length) * bend, (a.y + b.y) / 2 + (dx / length) * bend];
      const [tx, ty] = [a.x / 4 + mx / 2 + b.x / 4, a.y / 4 + my / 2 + b.y / 4];
      const angle = (Math.atan2(dy, dx) * 180) / Math.PI;
      const named = this._shown.length <= NAMED && length > 70;
      return (
        `<g class="fp-link"><title>${escape(`${link.first} ${link.relation} ${link.other}`)}</title>` +
        `<path d="M${f(a.x)} ${f(a.y)}Q${f(mx)} ${f(my)} ${f(b.x)} ${f(b.y)}"/>` +
        `<path class="fp-tip" transform="translate(${f(tx)} ${f(ty)}) rotate(${f(angle)})" d="M5 0L-4 4V-4Z"/>` +
        (named ? `<text x="${f(tx)}" y="${f(ty - 7)}">${escape(link.relation)}</text>` : "") +
        "</g>"
      );
    });
    this._layer.innerHTML = parts.join("");
  }

  moved(view) {
    this._view = view;
    if (this._shown.length) this.draw();
    else if (this._layer.firstChild) this._layer.replaceChildren();
  }
}

const f = (value) => value.toFixed(1);

function outside(a, b, view) {
  return Math.max(a.x, b.x) < -50 || Math.max(a.y, b.y) < -50 || Math.min(a.x, b.x) > view.width + 50 || Math.min(a.y, b.y) > view.height + 50;
}

// An arrow from a thing to its destination.
export function arrow(from, to) {
  const group = svg("g", { class: "fp-arrow" });
  const angle = (Math.atan2(to.y - from.y, to.x - from.x) * 180) / Math.PI;
  group.innerHTML = `<path d="M${f(from.x)} ${f(from.y)}L${f(to.x)} ${f(to.y)}"/><path class="fp-tip" transform="translate(${f(to.x)} ${f(to.y)}) rotate(${f(angle)})" d="M0 0L-11 6V-6Z"/><circle cx="${f(to.x)}" cy="${f(to.y)}" r="9"/>`;
  return group;
}
