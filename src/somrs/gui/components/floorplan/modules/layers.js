// The objects of one storey as SVG, by layer. Only changed objects are redrawn; an object that only moved keeps its drawing.

import { LAYERS, SHEETS } from "./kinds.js";
import { look, pose } from "./shapes.js";

export class Layers {
  // `sheets`: a group for each sheet, by name.
  constructor(sheets) {
    this._nodes = new Map(); // by name: { node, layer, classes, content, at }
    this._groups = new Map();
    this._shares = new Map(); // how far leaves are open, by the name of their object, if the simulator says so
    this.unknown = new Set(); // objects with unknown state
    for (const [sheet, layers] of Object.entries(SHEETS))
      for (const layer of layers) this._groups.set(layer, sheets.get(sheet).appendChild(svg("g", { class: `fp-layer fp-layer-${layer}` })));
  }

  get size() {
    return this._nodes.size;
  }

  // Draw these objects, or all of a storey; objects that moved are animated to their new pose.
  refresh(model, storey, names = new Set([...this._nodes.keys(), ...model.objects.keys()])) {
    const fresh = new Map(LAYERS.map((layer) => [layer, []]));
    const moved = [];
    for (const name of names) {
      const drawn = this._drawn(model, storey, name);
      const known = this._nodes.get(name);
      if (!drawn) this._drop(name);
      else if (!known) fresh.get(drawn.layer).push([name, drawn]);
      else if (known.layer !== drawn.layer) {
        this._drop(name);
        fresh.get(drawn.layer).push([name, drawn]);
      } else {
        if (pose(known.at) !== pose(drawn.at)) moved.push({ name, from: known.at, to: drawn.at });
        this._update(known, drawn);
      }
    }
    for (const [layer, these] of fresh) this._addAll(layer, these);
    return moved;
  }

  // The pose at which an object is drawn, which differs from its map pose during a drag or an animation.
  at(name) {
    return this._nodes.get(name)?.at ?? null;
  }

  move(name, at) {
    const known = this._nodes.get(name);
    if (!known) return;
    known.at = { x: at.x, y: at.y, turned: at.turned };
    known.node.setAttribute("transform", pose(known.at));
  }

  // Draw the leaves of an object as far open as `shares` say, from 0 to 1, until its drawing is dropped.
  swing(model, storey, name, shares) {
    this._shares.set(name, shares);
    const known = this._nodes.get(name);
    const drawn = known && this._drawn(model, storey, name);
    if (drawn) this._update(known, drawn);
  }

  // Draw leaves as the map says from the next refresh on. Returns the names of their objects.
  forgetShares() {
    const names = [...this._shares.keys()];
    this._shares.clear();
    return names;
  }

  has(name) {
    return this._nodes.has(name);
  }

  names() {
    return this._nodes.keys();
  }

  _drawn(model, storey, name) {
    const kind = model.kind(name);
    if (!kind?.layer) return null; // also for removed objects
    const solid = model.solid(name);
    if (!solid || !model.areLevel(model.storeyOf(name), storey)) return null;
    const seen = {
      color: kind.layer === "walls" || kind.layer === "floors" ? null : model.value(name, "Color"),
      open: this._shares.get(name) ?? [model.value(name, "Open") ? 1 : 0],
      range: model.value(name, "OperationRange"),
      view: model.value(name, "FieldOfView"),
      unknown: model.value(name, "Unknown") === true,
      broken: model.value(name, "Working") === false,
    };
    if (seen.unknown) this.unknown.add(name);
    else this.unknown.delete(name);
    return { layer: kind.layer, at: { x: solid.x, y: solid.y, turned: solid.turned }, z: solid.z, ...look(kind, solid, seen) };
  }

  _addAll(layer, these) {
    if (these.length === 0) return;
    these.sort((a, b) => a[1].z - b[1].z); // higher objects are drawn later
    const texts = these.map(([name, drawn]) => `<g data-name="${escape(name)}" class="${drawn.classes}" transform="${pose(drawn.at)}">${drawn.content}</g>`);
    const holder = svg("g");
    holder.innerHTML = texts.join(""); // parsing all at once is several times faster than one by one
    const nodes = [...holder.children];
    const group = this._groups.get(layer);
    these.forEach(([name, drawn], i) => {
      this._nodes.set(name, { ...drawn, node: nodes[i] });
      group.appendChild(nodes[i]);
    });
  }

  _update(known, drawn) {
    if (known.content !== drawn.content) known.node.innerHTML = drawn.content;
    if (known.classes !== drawn.classes) known.node.setAttribute("class", drawn.classes);
    [known.content, known.classes] = [drawn.content, drawn.classes];
  }

  _drop(name) {
    this._nodes.get(name)?.node.remove();
    this._nodes.delete(name);
    this.unknown.delete(name);
  }
}

export function svg(tag, attributes = {}) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  return node;
}

export function escape(text) {
  return String(text).replace(/[&<>"']/g, (one) => `&#${one.charCodeAt(0)};`);
}
