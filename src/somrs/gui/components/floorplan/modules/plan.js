// The drawing of a storey: model, view, layers, labels, links and frames. `floorplan.js` is the element with its tools and input.

import { Corners } from "./corners.js";
import { Frame } from "./frame.js";
import { Held } from "./held.js";
import { Labels } from "./labels.js";
import { Lanes } from "./lanes.js";
import { Layers } from "./layers.js";
import { arrow, Links } from "./links.js";
import { bounds, isOfNeighbour, Model, reach } from "./model.js";
import { Motion } from "./motion.js";
import { pose } from "./shapes.js";
import { Sheets } from "./sheets.js";
import { RoadmapLayer, Ways } from "./traffic.js";
import { View } from "./view.js";

const LABELS_REST = 120; // milliseconds between two layouts of the labels while the plan is panned
const DOT = 1.5; // pixels; the label of a support must not cover larger objects

export class Plan {
  // `late(names)`: called with the objects whose moves are not on the map after a while, whenever these are others.
  constructor(element, late) {
    this.model = new Model();
    this.view = new View();
    this.storey = null;
    this.selected = null;
    this.found = new Map(); // by name: text to append to the label
    this.relations = [];
    this.arrows = [];
    this.ghost = null;
    this.sketch = null; // a zone that is being drawn
    this.target = null;
    this.corners = new Corners((name) => this._zone(name));
    this.cornered = () => false; // whether the user can move the corners of an object
    this.turnable = () => false;
    this.offered = () => false; // whether the user can drag it to state a goal, so that its name matters
    this._held = new Held(late);
    this._moving = new Map(); // objects displayed elsewhere than on the map, with their map pose at that time
    this._sheets = new Sheets(element);
    this._layers = new Layers(this._sheets.groups);
    this._lanes = new Lanes(this._sheets.groups.get("ground"));
    this._roads = new RoadmapLayer(this._sheets.groups.get("ground"));
    this._ways = new Ways(this._sheets.ways);
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
    this._held.end();
    clearTimeout(this._relabel);
    this._sheets.end();
  }

  learn(definitions) {
    this.model.learn(definitions);
  }

  // Replace the map. Known objects stay drawn and move to their new poses.
  read(map, fit) {
    this.model.read(map);
    this.choose(this.storey, fit);
  }

  // Apply changes of the map.
  apply(changes, version) {
    const touched = this.model.apply(changes, version);
    this.refresh(touched);
  }

  refresh(names) {
    const moves = this._layers.refresh(this.model, this.storey, names);
    this._release();
    for (const { name } of moves) if (this._moving.has(name) && this._moving.get(name) !== pose(this.model.solid(name))) this._moving.delete(name);
    this._motion.go(moves.filter((move) => !this._held.has(move.name) && !this._moving.has(move.name)));
    this._lanes.refresh(this.model, (name) => (this._isShown(name) ? this.model.spot(name) : null), names);
    if (names === undefined || this.relations.length) this._links.show(this.model, this.relations, (name) => this.spot(name));
    this.draw();
  }

  // Show a storey, with those of other buildings at the same height; if there is none with this name, the first own one.
  choose(storey, fit = true) {
    const known = this.model.storeys();
    const before = this.storey;
    const own = known.find((one) => one.elevation >= 0 && !isOfNeighbour(one.name)) ?? known.find((one) => one.elevation >= 0) ?? known[0];
    this.storey = known.some((one) => one.name === storey) ? storey : (own?.name ?? "");
    if (before !== this.storey) this._motion.end();
    this.refresh();
    if (this._roadmap) this.showRoads(this._roadmap);
    if (fit || before !== this.storey) this.fit();
  }

  // Draw the roadmap of traffic on the storey; null: none.
  showRoads(roadmap) {
    this._roadmap = roadmap;
    this._roads.show(roadmap, (height) => this._isHere(height));
  }

  // Draw the ways of robots in traffic.
  showWays(robots) {
    this._ways.set(robots);
    this.draw();
  }

  _isHere(height) {
    return this.model.areLevel(this.model.storeyAt(height), this.storey);
  }

  // Whether an object is on the storey, or on one of another building at the same height.
  _isShown(name) {
    return this.model.areLevel(this.model.storeyOf(name), this.storey);
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

  // Scroll an object into view, on its storey. Returns whether it has a position.
  reveal(name) {
    const storey = this.model.storeyOf(name);
    const spot = this.model.spot(name);
    if (spot === null || storey === null) return false;
    if (!this.model.areLevel(storey, this.storey)) this.choose(storey);
    this.view.reveal(spot.x, spot.y);
    if (this.view.scale < 12) this.view.zoom(30 / this.view.scale);
    this.draw();
    return true;
  }

  resize(width, height) {
    if (width === 0 || height === 0) return; // hidden; the view is restored later
    this.view.size(width, height);
    if (this.view.fitted) this.fit();
    else this.draw();
  }

  // The position at which an object is drawn; for a room, its centre.
  spot(name) {
    return this._layers.at(name) ?? (this._isShown(name) ? this.model.spot(name) : null);
  }

  at(name) {
    return this._layers.at(name);
  }

  // The shape of a zone where it is drawn; null for another object.
  _zone(name) {
    const at = this._layers.at(name);
    return at && this.model.kind(name)?.cornered ? { ...this.model.solid(name), ...at } : null;
  }

  names() {
    return [...this._layers.names()];
  }

  // Draw objects at their simulated poses until the map has new ones.
  see(poses) {
    const moved = new Set();
    const risen = [...poses].filter(([name, at]) => this.model.rise(name, at.z)).map(([name]) => name);
    if (risen.length) this.refresh(new Set(risen.flatMap((name) => this._group(name))));
    for (const [name, at] of poses) {
      if (!this._layers.has(name) || this._held.has(name) || this.model.kind(name)?.id === "lift") continue; // a cabin only rises and sinks
      if (!this._moving.has(name)) this._moving.set(name, pose(this.model.solid(name)));
      this._motion.stop(name);
      this._layers.move(name, at);
      moved.add(name);
    }
    if (moved.size) this._moved(moved, false);
  }

  // Draw the leaves of doors and cupboards as far open as they are.
  swing(shares) {
    for (const [name, open] of shares) this._layers.swing(this.model, this.storey, name, open);
  }

  // Draw all objects at their map poses, and the leaves as the map says.
  forget() {
    const names = new Set([...this._moving.keys(), ...this._layers.forgetShares()]);
    this._moving.clear();
    this.model.settle();
    if (names.size) this.refresh(names);
  }

  // Draw an object and those that move with it at another pose, until `settle` or `back` is called. Returns the poses.
  hold(name, at) {
    const from = this._layers.at(name);
    if (!from) return;
    const turn = at.turned - from.turned;
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    for (const rider of this.model.riders(name)) {
      const one = this._layers.at(rider);
      if (!one) continue;
      const [dx, dy] = [one.x - from.x, one.y - from.y];
      this._put(rider, { x: at.x + c * dx - s * dy, y: at.y + s * dx + c * dy, turned: one.turned + turn }, name);
    }
    this._put(name, at, name);
    this._links.follow(new Set([name, ...this.model.riders(name)]), (one) => this.spot(one));
    this.draw();
  }

  _put(name, at, mover) {
    this._motion.stop(name);
    this._layers.move(name, at);
    this._held.keep(name, mover);
  }

  // Draw a zone with one of its corners elsewhere, until `settle` or `back` is called. Returns all corners.
  moveCorner(name, index, to) {
    this._held.keep(name, name);
    const corners = this.corners.move(name, index, to);
    this.draw();
    return corners;
  }

  _letGo(name) {
    this._held.drop(name);
    this.corners.forget(name);
  }

  // Wait for the page's answer to a move.
  wait(name) {
    this._held.release(name, true);
  }

  // The map contains the move since this version: use the map's pose from then on.
  settle(name, version) {
    this._held.answered(name, version);
    this.refresh(new Set(this._held.movedWith(name)));
  }

  // A move was refused: without another one that is on its way, the object goes back to its map pose.
  back(name) {
    const group = this._held.movedWith(name);
    this._held.answered(name);
    this.refresh(new Set(group));
  }

  // The user has given up the move of an object, or of the corners of a zone, that is in the hand: draw it where it was before. That is
  // where an earlier move that is on its way leads, or else its map pose.
  giveBack(name, { from, outline }) {
    const group = this._held.movedWith(name);
    if (outline && this._held.isOnItsWay(name, this.model)) this.corners.restore(name, outline);
    else if (from && this._held.isOnItsWay(name, this.model)) this.hold(name, from);
    this._held.release(name, false);
    this.refresh(new Set(group));
  }

  // The connection to the page was lost, with moves that it was told of: draw everything as the map has it. Returns what was moved.
  giveUp() {
    const names = this._held.giveUp();
    const group = names.flatMap((name) => this._held.movedWith(name));
    this.refresh(new Set(group));
    return names;
  }

  _group(name) {
    return [name, ...this.model.riders(name)];
  }

  _release() {
    for (const name of this._held.settledBy(this.model)) {
      this._letGo(name);
      this._motion.go(this._layers.refresh(this.model, this.storey, new Set([name])));
    }
  }

  // Schedule one redraw of everything that depends on the view.
  draw() {
    this._due ??= requestAnimationFrame(() => this._draw());
  }

  _draw() {
    this._due = null;
    const { view } = this;
    this._sheets.show(view, this._layers.size);
    this._ways.draw(view, (name) => this.spot(name), (height) => this._isHere(height));
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
    if (this.selected !== null && this.cornered(this.selected)) this._sheets.screen.append(this.corners.draw(view, this.selected));
    this._sheets.arrows.replaceChildren(...this.arrows.filter((one) => one.from && one.to).map((one) => arrow(view.toScreen(one.from.x, one.from.y), view.toScreen(one.to.x, one.to.y))));
    if (this.sketch) this._sheets.arrows.append(this.sketch.draw(view));
    this._label();
    this.drawn?.(view);
  }

  // Place all labels again, but not at every step of a movement: meanwhile they move with their objects.
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
      const offered = this.offered(name);
      const solid = model.solid(name);
      const unknown = model.value(name, "Unknown") === true;
      if (solid && kind.layer !== "furniture" && ["free", "itself"].includes(kind.moves) && reach(solid) * view.scale > DOT) taken.push(view.toScreen(at.x, at.y));
      if (!solid || (!special && !unknown && !offered && 2 * reach(solid) * view.scale < kind.from)) continue;
      const b = bounds({ ...solid, ...at });
      const half = { w: Math.max(((b.right - b.left) / 2) * view.scale, 5), h: Math.max(((b.top - b.bottom) / 2) * view.scale, 5) };
      const p = view.toScreen(at.x, at.y);
      const mark = this.found.get(name);
      wanted.push({
        name,
        text: name + (mark ? ` ${mark}` : ""),
        ...p,
        half,
        rank: name === this.selected ? 1000 : special ? 500 : unknown ? 300 : offered ? 100 + kind.label : kind.label,
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

  // The physical objects without a position.
  unplaced() {
    return [...this.model.objects.values()].filter((one) => missed(this.model.kindOfType(one.type)) && this.model.solid(one.name) === null).map((one) => one.name);
  }
}

// Whether objects of the kind are listed when they have no position: people come and go.
function missed(kind) {
  return kind.layer && kind.id !== "person";
}
