// The floor plan's model: ontology and map from the API, updated by news, and derived data: poses, sizes, supports and storeys. No drawing.

import { kindOf } from "./kinds.js";

const PLACED_BY = ["isOn", "isIn", "isHeldBy"];
const PART_OF = "isPartOf";
const FURNITURE = 3; // as `carries` of a kind
const RISING = new Set(["robot", "lift"]); // the kinds of objects that go to other storeys
const RISE = 0.05; // m that a robot has to rise or sink before its storey is found out again
const SOMEWHERE = 0.3; // m below a storey's floor at which an object still belongs to it

// Whether an object belongs to the map of a neighbour.
export function isOfNeighbour(name) {
  return name.includes(":");
}

export class Model {
  constructor() {
    this.version = -1;
    this.types = new Map();
    this.relations = new Map();
    this.objects = new Map();
    this._facts = new Map();
    this._about = new Map();
    this._heights = new Map(); // of robots that have moved, as the simulator says
    this._forget();
    this._ancestors = new Map();
    this._storeys = null;
  }

  learn(definitions) {
    this.types = new Map(definitions.types.map((one) => [one.name, one]));
    this.relations = new Map(definitions.relations.map((one) => [one.name, one]));
    this._ancestors.clear();
    this._forget();
  }

  read({ version, objects, facts }) {
    this.version = version;
    this.objects = new Map(objects.map((one) => [one.name, one]));
    this._facts.clear();
    this._about.clear();
    for (const fact of facts) this._add(fact);
    this._forget();
  }

  // Apply changes; returns the names of all objects whose look or pose changed.
  apply(changes, version) {
    const touched = new Set();
    for (const change of changes) {
      if (change.type === "ObjectAdded") {
        this.objects.set(change.object.name, change.object);
        touched.add(change.object.name);
      } else if (change.type === "ObjectRemoved") {
        for (const fact of [...this.factsAbout(change.name)]) this._remove(fact);
        this.objects.delete(change.name);
        touched.add(change.name);
      } else if (change.type === "ValueSet") {
        this._set(change.object, change.path, change.value);
        touched.add(change.object);
      } else if (change.type === "FactAdded") {
        this._add(change.fact);
        for (const name of change.fact.arguments) touched.add(name);
      } else if (change.type === "FactRemoved") {
        this._remove(change.fact);
        for (const name of change.fact.arguments) touched.add(name);
      }
    }
    this.version = version;
    if (changes.some((change) => change.type !== "ValueSet")) this._forget();
    else for (const name of touched) this._forgetOne(name);
    return touched;
  }

  ancestors(type) {
    let known = this._ancestors.get(type);
    if (known === undefined) {
      known = [];
      for (let at = type; at && this.types.has(at) && !known.includes(at); at = this.types.get(at).parent) known.push(at);
      this._ancestors.set(type, known);
    }
    return known;
  }

  isA(type, ancestor) {
    return this.ancestors(type).includes(ancestor);
  }

  kind(name) {
    const object = this.objects.get(name);
    return object ? this.kindOfType(object.type) : null;
  }

  kindOfType(type) {
    let known = this._kinds.get(type);
    if (known === undefined) this._kinds.set(type, (known = kindOf((ancestor) => this.isA(type, ancestor))));
    return known;
  }

  default(type, path) {
    for (const ancestor of this.ancestors(type)) {
      const value = this.types.get(ancestor).defaults?.[path];
      if (value !== undefined) return value;
    }
    return undefined;
  }

  value(name, path) {
    const object = this.objects.get(name);
    return object && (object.values[path] ?? this.default(object.type, path));
  }

  // The space of an object: position, heading (rad), form and sizes; null without a position.
  solid(name) {
    let known = this._solids.get(name);
    if (known === undefined) this._solids.set(name, (known = this._solid(name)));
    return known;
  }

  _solid(name) {
    const object = this.objects.get(name);
    const [x, y] = [this.value(name, "PositionX"), this.value(name, "PositionY")];
    if (!object || typeof x !== "number" || typeof y !== "number") return null;
    return { name, x, y, z: this.value(name, "PositionZ") ?? 0, turned: this.value(name, "RotationZ") ?? 0, ...this.form(name) };
  }

  form(name) {
    return formOf((path) => this.value(name, path));
  }

  // The form of a new object of the type, with these values.
  formOfType(type, values = {}) {
    return formOf((path) => values[path] ?? this.default(type, path));
  }

  factsAbout(name) {
    return [...(this._about.get(name) ?? [])].map((key) => this._facts.get(key));
  }

  *facts(relation) {
    for (const fact of this._facts.values()) if (fact.relation === relation) yield fact;
  }

  // The object that it stands on, is in, or is held by.
  under(name) {
    for (const fact of this.factsAbout(name))
      if (fact.arguments[0] === name && fact.arguments.length === 2 && PLACED_BY.includes(fact.relation)) return fact.arguments[1];
    return null;
  }

  // All objects that move with the object: those on it, in it, held by it or part of it, and those on these.
  riders(name) {
    const found = new Set();
    const waiting = [name];
    while (waiting.length) {
      const below = waiting.pop();
      for (const fact of this.factsAbout(below)) {
        const [above, on] = fact.arguments;
        if (on !== below || above === name || found.has(above)) continue;
        if (PLACED_BY.includes(fact.relation) || (fact.relation === PART_OF && this.kind(below)?.solid)) {
          found.add(above);
          waiting.push(above);
        }
      }
    }
    return found;
  }

  // All storeys, lowest first. A map without storeys has one without a name.
  storeys() {
    if (this._storeys === null) {
      const found = [...this.objects.values()].filter((one) => this.isA(one.type, "Storey"));
      this._storeys = found.map((one) => ({
        name: one.name,
        label: one.values.Label ? `${one.name} · ${one.values.Label}` : one.name,
        elevation: this.value(one.name, "Elevation") ?? 0,
      }));
      this._storeys.sort((a, b) => a.elevation - b.elevation || isOfNeighbour(a.name) - isOfNeighbour(b.name) || a.name.localeCompare(b.name));
      this._elevations = new Map(this._storeys.map((one) => [one.name, one.elevation]));
    }
    return this._storeys;
  }

  // Whether two storeys, of one building or of two, are at the same height.
  areLevel(first, second) {
    if (first === second) return first !== null;
    this.storeys();
    return Math.abs(this._elevations.get(first) - this._elevations.get(second)) < RISE; // of one that is none: false
  }

  // The storey on whose floor something of this height stands.
  storeyAt(height) {
    const storeys = this.storeys();
    return (storeys.findLast((storey) => storey.elevation <= height + SOMEWHERE) ?? storeys[0])?.name ?? "";
  }

  // A robot or the cabin of a lift is at this height now. Returns whether it has come to another storey.
  rise(name, height) {
    if (!RISING.has(this.kind(name)?.id)) return false;
    const known = this._heights.get(name) ?? this.solid(name)?.z ?? 0;
    if (Math.abs(height - known) < RISE) return false;
    const before = this.storeyOf(name);
    this._heights.set(name, height);
    this._of.delete(name);
    for (const rider of this.riders(name)) this._of.delete(rider);
    return this.storeyOf(name) !== before;
  }

  // All robots and cabins are where the map says.
  settle() {
    this._heights.clear();
    this._forget();
  }

  storeyOf(name) {
    let known = this._of.get(name);
    if (known === undefined) {
      this._of.set(name, null); // facts may form a cycle
      this._of.set(name, (known = this._storeyOf(name)));
    }
    return known;
  }

  _storeyOf(name) {
    const storeys = this.storeys();
    if (storeys.length === 0) return "";
    const object = this.objects.get(name);
    if (object && this.isA(object.type, "Storey")) return name;
    if (this._heights.has(name)) return this.storeyAt(this._heights.get(name));
    const above = this.factsAbout(name).find((fact) => fact.relation === PART_OF && fact.arguments[0] === name)?.arguments[1];
    if (above !== undefined && above !== name) {
      const found = this.storeyOf(above);
      if (found) return found;
    }
    const under = this.under(name);
    if (under !== null && this.objects.has(under)) {
      const found = this.storeyOf(under);
      if (found) return found;
    }
    const solid = this.solid(name);
    if (solid === null) return null; // a building or a site: on no storey
    const high = storeys.filter((storey) => storey.elevation <= solid.z + SOMEWHERE);
    const over = high.filter((storey) => this._floors(storey.name).some((floor) => contains(floor, solid.x, solid.y)));
    return (over.at(-1) ?? high.at(-1) ?? storeys[0]).name;
  }

  _floors(storey) {
    if (this._floorsOf === null) {
      this._floorsOf = new Map();
      for (const object of this.objects.values()) {
        if (this.kindOfType(object.type).id !== "floor") continue;
        let at = object.name;
        for (let depth = 0; at !== undefined && depth < 20; depth++) {
          if (this.isA(this.objects.get(at)?.type, "Storey")) break;
          at = this.factsAbout(at).find((fact) => fact.relation === PART_OF && fact.arguments[0] === at)?.arguments[1];
        }
        const solid = this.solid(object.name);
        if (at !== undefined && solid) this._floorsOf.set(at, [...(this._floorsOf.get(at) ?? []), solid]);
      }
    }
    return this._floorsOf.get(storey) ?? [];
  }

  // The rooms and other spaces of a storey, each at the centre of its largest floor.
  spaces(storey) {
    const found = [];
    for (const object of this.objects.values()) {
      if (!this.isA(object.type, "Space") || !this.areLevel(this.storeyOf(object.name), storey)) continue;
      let best = null;
      for (const fact of this.factsAbout(object.name)) {
        if (fact.relation !== PART_OF || fact.arguments[1] !== object.name || this.kind(fact.arguments[0])?.id !== "floor") continue;
        const solid = this.solid(fact.arguments[0]);
        if (solid && (best === null || area(solid) > area(best))) best = solid;
      }
      if (best) found.push({ name: object.name, label: object.values.Label || object.name, floor: best, ...middle(best) });
    }
    return found;
  }

  // The position of an object on the plan: its own, or that of its floor.
  spot(name) {
    const solid = this.solid(name);
    if (solid) return { x: solid.x, y: solid.y };
    const floor = this.factsAbout(name)
      .filter((fact) => fact.relation === PART_OF && fact.arguments[1] === name && this.kind(fact.arguments[0])?.id === "floor")
      .map((fact) => this.solid(fact.arguments[0]))
      .find((one) => one);
    return floor ? middle(floor) : null;
  }

  // Whether things can be put on an object, by preference; 0: they cannot. Furniture states it with Supporting. The ontology of an earlier
  // data folder does not have it; then the kind decides.
  carries(name) {
    const kind = this.kind(name), stated = this.value(name, "Supporting");
    if (stated === false) return 0;
    return kind.carries ?? (stated && kind.layer === "furniture" ? FURNITURE : 0);
  }

  // The support of a thing put down at this position: the highest support, else a place, else a floor.
  targetAt(x, y, storey, except = new Set()) {
    let best = null;
    for (const name of this.objects.keys()) {
      const carries = this.carries(name);
      if (!carries || except.has(name) || !this.areLevel(this.storeyOf(name), storey)) continue;
      const solid = this.solid(name);
      if (!solid || !contains(solid, x, y)) continue;
      const rank = carries * 1000 + solid.z + (solid.height || 0);
      if (best === null || rank > best.rank) best = { rank, name };
    }
    return best?.name ?? null;
  }

  _set(name, path, value) {
    const object = this.objects.get(name);
    if (!object) return;
    const values = { ...object.values };
    if (value === null || value === undefined) delete values[path];
    else values[path] = value;
    this.objects.set(name, { ...object, values });
  }

  _add(fact) {
    const key = keyOf(fact);
    this._facts.set(key, fact);
    for (const name of fact.arguments) {
      if (!this._about.has(name)) this._about.set(name, new Set());
      this._about.get(name).add(key);
    }
  }

  _remove(fact) {
    const key = keyOf(fact);
    this._facts.delete(key);
    for (const name of fact.arguments) this._about.get(name)?.delete(key);
  }

  _forget() {
    this._solids = new Map();
    this._of = new Map();
    this._kinds = new Map();
    this._storeys = null;
    this._floorsOf = null;
  }

  _forgetOne(name) {
    this._solids.delete(name);
    this._of.delete(name);
    for (const rider of this.riders(name)) this._of.delete(rider);
    const kind = this.kind(name);
    if (!kind?.solid || kind.id === "floor") this._forget(); // the storeys may have changed
  }
}

function keyOf(fact) {
  return `${fact.relation} ${fact.arguments.join(" ")}`;
}

function formOf(value) {
  const form = value("Shape.Form");
  const height = value("Shape.Height") ?? 0;
  if (form === "Cylinder") return { form, radius: value("Shape.Radius") ?? 0.1, height };
  if (form === "Polygon") {
    const outline = corners(value("Shape.Outline"));
    if (outline.length > 2) return { form, outline, height };
  }
  if (form === "Box") return { form, width: value("Shape.Width") ?? 0.1, depth: value("Shape.Depth") ?? 0.1, height };
  return { form: null, radius: 0.1, height };
}

function corners(text) {
  const found = String(text ?? "").trim().split(/\s+/).map((one) => one.split(",").map(Number));
  return found.filter((one) => one.length === 2 && one.every(Number.isFinite));
}

// Whether a point is inside an object, seen from above.
export function contains(solid, x, y) {
  const [c, s] = [Math.cos(solid.turned), Math.sin(solid.turned)];
  const [dx, dy] = [x - solid.x, y - solid.y];
  const [u, v] = [c * dx + s * dy, c * dy - s * dx];
  if (solid.form === "Box") return Math.abs(u) <= solid.width / 2 && Math.abs(v) <= solid.depth / 2;
  if (solid.form !== "Polygon") return Math.hypot(u, v) <= solid.radius;
  let inside = false;
  for (let i = 0, j = solid.outline.length - 1; i < solid.outline.length; j = i++) {
    const [[ax, ay], [bx, by]] = [solid.outline[i], solid.outline[j]];
    if (ay > v !== by > v && u < ((bx - ax) * (v - ay)) / (by - ay) + ax) inside = !inside;
  }
  return inside;
}

// The corners of an object's bounding box along the map's axes.
export function bounds(solid) {
  const [c, s] = [Math.cos(solid.turned), Math.sin(solid.turned)];
  if (solid.form !== "Box" && solid.form !== "Polygon") {
    const r = solid.radius;
    return { left: solid.x - r, right: solid.x + r, bottom: solid.y - r, top: solid.y + r };
  }
  const [w, d] = [(solid.width ?? 0) / 2, (solid.depth ?? 0) / 2];
  const points = solid.outline ?? [[w, d], [-w, d], [-w, -d], [w, -d]];
  const xs = points.map(([u, v]) => solid.x + c * u - s * v);
  const ys = points.map(([u, v]) => solid.y + s * u + c * v);
  return { left: Math.min(...xs), right: Math.max(...xs), bottom: Math.min(...ys), top: Math.max(...ys) };
}

function area(solid) {
  const box = bounds(solid);
  return (box.right - box.left) * (box.top - box.bottom);
}

function middle(solid) {
  const box = bounds(solid);
  return { x: (box.left + box.right) / 2, y: (box.bottom + box.top) / 2 };
}

// The radius of the smallest circle around its position that contains an object, seen from above.
export function reach(solid) {
  if (solid.form === "Box") return Math.hypot(solid.width, solid.depth) / 2;
  return solid.form === "Polygon" ? Math.max(...solid.outline.map(([x, y]) => Math.hypot(x, y))) : solid.radius;
}
