// The drawing of a storey: what is known of the map, the part of it that is in view, and the layers, names, links and frames that show it.
// `floorplan.js` is the element on the page, with its tools and what people do with their hands.

import { Frame } from "./frame.js";
import { Labels } from "./labels.js";
import { Layers } from "./layers.js";
import { arrow, Links } from "./links.js";
import { bounds, Model, reach } from "./model.js";
import { Motion } from "./motion.js";
import { pose } from "./shapes.js";
import { Sheets } from "./sheets.js";
import { View } from "./view.js";

const LABELS_REST = 120; // milliseconds between two times that all names are placed anew, while the plan is moved
const DOT = 1.5; // pixels; what is larger is not to be covered by the name of what it stands on
const PATIENCE = 15000; // milliseconds that a moved object waits for the answer whether it may stay there

export class Plan {
  constructor(element, asked) {
    this.model = new Model();
    this.view = new View();
    this.storey = null;
    this.selected = null;
    this.found = new Map(); // by name: what to write behind the name
    this.relations = [];
    this.arrows = [];
    this.ghost = null;
    this.target = null;
    this.turnable = () => false;
    this._asked = asked; // called when something is held in vain
    this._held = new Map(); // what was moved here, and not yet on the map: { version, since }
    this._later = null; // when it is looked whether something was held too long
    this._moving = new Map(); // what is seen elsewhere than the map has it, and where the map had it then
    this._sheets = new Sheets(element);
    this._layers = new Layers(this._sheets.groups);
    this._links = new Links(this._sheets.links);
    this._labels = new Labels(this._sheets.labels);
    this._frame = new Frame(this._sheets.marks, this._sheets.screen);
    this._motion = new Motion(
      (name, at) => this._layers.move(name, at),
      (names, still) => this._moved(names, still),
    );
    this._due = null;
    this._labelsAt = 0;
  }

  end() {
    this._motion.end();
    cancelAnimationFrame(this._due);
    clearTimeout(this._later);
    clearTimeout(this._relabel);
    this._sheets.end();
  }

  learn(definitions) {
    this.model.learn(definitions);
  }

  // The whole map anew. What is known stays drawn, and goes to where it is now.
  read(map, fit) {
    this.model.read(map);
    this.choose(this.storey, fit);
  }

  // Changes of the map, as they happen.
  apply(changes, version) {
    const touched = this.model.apply(changes, version);
    this.refresh(touched);
  }

  refresh(names) {
    const moves = this._layers.refresh(this.model, this.storey, names);
    this._release();
    for (const { name } of moves) if (this._moving.has(name) && this._moving.get(name) !== pose(this.model.solid(name))) this._moving.delete(name);
    this._motion.go(moves.filter((move) => !this._held.has(move.name) && !this._moving.has(move.name)));
    if (names === undefined || this.relations.length) this._links.show(this.model, this.relations, (name) => this.spot(name));
    this.draw();
  }

  // Show a storey; the first one, when there is none of that name.
  choose(storey, fit = true) {
    const known = this.model.storeys();
    const before = this.storey;
    this.storey = known.some((one) => one.name === storey) ? storey : (known.find((one) => one.elevation >= 0) ?? known[0])?.name ?? "";
    if (before !== this.storey) this._motion.end();
    this.refresh();
    if (fit || before !== this.storey) this.fit();
  }

  fit() {
    this.view.fit(this._bounds());
    this.draw();
  }

  _bounds() {
    let box = null;
    for (const name of this._layers.names()) {
      const solid = this.model.solid(name);
      const one = bounds(solid);
      box = box === null ? one : { left: Math.min(box.left, one.left), right: Math.max(box.right, one.right), bottom: Math.min(box.bottom, one.bottom), top: Math.max(box.top, one.top) };
    }
    return box;
  }

  // Have an object in view, on its storey; whether it is anywhere at all.
  reveal(name) {
    const storey = this.model.storeyOf(name);
    const spot = this.model.spot(name);
    if (spot === null || storey === null) return false;
    if (storey !== this.storey) this.choose(storey);
    this.view.reveal(spot.x, spot.y);
    if (this.view.scale < 12) this.view.zoom(30 / this.view.scale);
    this.draw();
    return true;
  }

  resize(width, height) {
    if (width === 0 || height === 0) return; // it is hidden, and will be seen again as it was
    this.view.size(width, height);
    if (this.view.fitted) this.fit();
    else this.draw();
  }

  // Where an object is drawn; for a room, its middle.
  spot(name) {
    return this._layers.at(name) ?? (this.model.storeyOf(name) === this.storey ? this.model.spot(name) : null);
  }

  at(name) {
    return this._layers.at(name);
  }

  names() {
    return [...this._layers.names()];
  }

  // Things are seen on their way: draw them there, until the map has them elsewhere than before.
  see(poses) {
    const moved = new Set();
    for (const [name, at] of poses) {
      if (!this._layers.has(name) || this._held.has(name)) continue;
      if (!this._moving.has(name)) this._moving.set(name, pose(this.model.solid(name)));
      this._motion.stop(name);
      this._layers.move(name, at);
      moved.add(name);
    }
    if (moved.size) this._moved(moved, false);
  }

  // Everything is where the map has it.
  forget() {
    const names = new Set(this._moving.keys());
    this._moving.clear();
    if (names.size) this.refresh(names);
  }

  // Draw an object, and all that goes along with it, elsewhere, until `settle` or `back` is told of them. What they came to.
  hold(name, at) {
    const from = this._layers.at(name);
    if (!from) return;
    const turn = at.turned - from.turned;
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    for (const rider of this.model.riders(name)) {
      const one = this._layers.at(rider);
      if (!one) continue;
      const [dx, dy] = [one.x - from.x, one.y - from.y];
      this._put(rider, { x: at.x + c * dx - s * dy, y: at.y + s * dx + c * dy, turned: one.turned + turn });
    }
    this._put(name, at);
    this._links.follow(new Set([name, ...this.model.riders(name)]), (one) => this.spot(one));
    this.draw();
  }

  _put(name, at) {
    this._motion.stop(name);
    this._layers.move(name, at);
    this._held.set(name, { version: Infinity, since: Infinity });
  }

  // What was moved was told: it waits for the answer, but not for ever.
  wait(name) {
    for (const one of this._group(name)) if (this._held.has(one)) this._held.get(one).since = performance.now();
    this._later ??= setTimeout(() => this._waitedLong(), PATIENCE);
  }

  // What was moved is on the map since the version: from then on it is where the map says.
  settle(name, version) {
    for (const one of this._group(name)) if (this._held.has(one)) this._held.get(one).version = version;
    this.refresh(new Set(this._group(name)));
  }

  // What was moved goes back to where the map says it is.
  back(name) {
    const group = [...new Set([...this._group(name), ...this._held.keys()])].filter((one) => this._held.has(one));
    for (const one of group) this._held.delete(one);
    this.refresh(new Set(group));
  }

  _group(name) {
    return [name, ...this.model.riders(name)];
  }

  _release() {
    for (const [name, held] of this._held)
      if (this.model.version >= held.version || !this.model.objects.has(name)) {
        this._held.delete(name);
        this._motion.go(this._layers.refresh(this.model, this.storey, new Set([name])));
      }
  }

  _waitedLong() {
    const now = performance.now();
    const late = [...this._held].filter(([, held]) => now - held.since >= PATIENCE - 100).map(([name]) => name);
    for (const name of late) this._held.delete(name);
    const next = Math.min(...[...this._held.values()].map((held) => held.since));
    this._later = Number.isFinite(next) ? setTimeout(() => this._waitedLong(), next + PATIENCE - now) : null;
    if (late.length) {
      this.refresh(new Set(late));
      this._asked(late);
    }
  }

  // Draw what depends on the view, soon, once.
  draw() {
    this._due ??= requestAnimationFrame(() => this._draw());
  }

  _draw() {
    this._due = null;
    const { view } = this;
    this._sheets.show(view, this._layers.size);
    this._links.moved(view);
    this._frame.show({
      model: this.model,
      view,
      at: (name) => this._layers.at(name),
      selected: this.selected,
      turnable: this.selected !== null && this.turnable(this.selected),
      target: this.target,
      found: this.found.keys(),
      ghost: this.ghost,
      moving: this._moving.keys(),
      unknown: this._layers.unknown,
    });
    this._sheets.arrows.replaceChildren(...this.arrows.filter((one) => one.from && one.to).map((one) => arrow(view.toScreen(one.from.x, one.from.y), view.toScreen(one.to.x, one.to.y))));
    this._label();
    this.drawn?.(view);
  }

  // All names anew, but not at every step of a movement: meanwhile they go along as they are.
  _label() {
    const { view } = this;
    const now = performance.now();
    const wait = LABELS_REST - (now - this._labelsAt);
    const group = this._sheets.labels;
    if (wait > 0 && this._labelled) {
      const p = view.toScreen(this._labelled.x, this._labelled.y);
      group.setAttribute("transform", `translate(${p.x - view.width / 2} ${p.y - view.height / 2})`);
      group.classList.toggle("fp-hidden", Math.abs(this._labelled.scale / view.scale - 1) > 0.05);
      this._relabel ??= setTimeout(() => {
        this._relabel = null;
        this._label();
      }, wait);
      return;
    }
    group.removeAttribute("transform");
    group.classList.remove("fp-hidden");
    const { wanted, taken } = this._wanted();
    this._labels.place(wanted, taken, view);
    this._labelled = { x: view.x, y: view.y, scale: view.scale };
    this._labelsAt = performance.now();
  }

  _wanted() {
    const { view, model } = this;
    const box = view.box();
    const wanted = [];
    const taken = [];
    for (const name of this._layers.names()) {
      const at = this._layers.at(name);
      if (at.x < box.left || at.x > box.right || at.y < box.bottom || at.y > box.top) continue;
      const kind = model.kind(name);
      if (!kind) continue;
      const special = name === this.selected || this.found.has(name);
      const solid = model.solid(name);
      const unknown = model.value(name, "Unknown") === true;
      if (solid && kind.layer !== "furniture" && kind.moves === "free" && reach(solid) * view.scale > DOT) taken.push(view.toScreen(at.x, at.y));
      if (!solid || (!special && !unknown && 2 * reach(solid) * view.scale < kind.from)) continue;
      const b = bounds({ ...solid, ...at });
      const half = { w: Math.max(((b.right - b.left) / 2) * view.scale, 5), h: Math.max(((b.top - b.bottom) / 2) * view.scale, 5) };
      const p = view.toScreen(at.x, at.y);
      const mark = this.found.get(name);
      wanted.push({
        name,
        text: name + (mark ? ` ${mark}` : ""),
        ...p,
        half,
        rank: name === this.selected ? 1000 : special ? 500 : unknown ? 300 : kind.label,
        always: name === this.selected,
        inside: kind.layer === "furniture",
        classes: `fp-label-${kind.id}${special ? " fp-label-found" : ""}`,
      });
    }
    for (const space of model.spaces(this.storey)) wanted.push(...this._spaceLabel(space));
    return { wanted, taken };
  }

  _spaceLabel(space) {
    const { view } = this;
    const b = bounds(space.floor);
    const size = (b.right - b.left) * view.scale;
    const special = space.name === this.selected || this.found.has(space.name);
    if (size < 50 && !special) return [];
    const mark = this.found.get(space.name);
    const p = view.toScreen(space.x, space.y);
    return [{ name: space.name, text: space.label + (mark ? ` ${mark}` : ""), ...p, half: { w: 0, h: 0 }, rank: special ? 600 : 65, always: special, classes: `fp-label-space${special ? " fp-label-found" : ""}` }];
  }

  _moved(names, still) {
    this._links.follow(names, (name) => this.spot(name));
    for (const name of names) {
      const at = this._layers.at(name);
      if (at) this._labels.follow(name, this.view.toScreen(at.x, at.y));
    }
    if (still || this._moving.size || names.has(this.selected) || this.found.size || this.relations.length) this.draw();
    else this._label();
  }

  // What physical objects have no place on the plan.
  unplaced() {
    return [...this.model.objects.values()].filter((one) => missed(this.model.kindOfType(one.type)) && this.model.solid(one.name) === null).map((one) => one.name);
  }
}

// Whether something is missed on the plan that is nowhere: people come and go.
function missed(kind) {
  return kind.layer && kind.id !== "person";
}
