// All objects by name, and their drawings: building and furniture as a few geometries, moving objects one by one.
import { THREE } from "nicegui-scene";
import { shell } from "./building.js";
import { Crowd } from "./crowd.js";
import { form } from "./forms.js";
import { leavesOf } from "./leaves.js";
import { ownerOf, Pieces } from "./pieces.js";
import { RobotBody } from "./robots.js";

const BUILDING = new Set(["floor", "wall", "door"]);
const MOVING = new Set(["robot", "thing", "lift"]);
const LEAVES = 2; // numbers of a pose up to which it is that of leaves

function gridded(material) {
  // A grid of fine lines at each metre on upward faces, in map coordinates, which shows the scale.
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nvarying vec3 onMap;\nvarying float upward;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\nonMap = position;\nupward = normal.z;");
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", "#include <common>\nvarying vec3 onMap;\nvarying float upward;")
      .replace(
        "#include <color_fragment>",
        `#include <color_fragment>
        vec2 cell = abs(fract(onMap.xy - 0.5) - 0.5) / max(fwidth(onMap.xy), vec2(1e-5));
        float line = (1.0 - min(min(cell.x, cell.y), 1.0)) * step(0.5, upward);
        diffuseColor.rgb *= 1.0 - 0.13 * line * (1.0 - smoothstep(0.04, 0.16, max(fwidth(onMap.x), fwidth(onMap.y))));`,
      );
  };
  return material;
}

export class World {
  constructor(scene) {
    this.scene = scene;
    this.bodies = new Map();
    this.types = {};
    this.drawn = new Map(); // moving objects by name: { object, set(pose), top }
    this.crowds = new Map(); // things that look the same
    this.works = new Map();
    this.low = true;
    this.level = null; // the level shown alone; null: all
    this.levels = [];
    this.storeys = []; // labels of the storeys with their levels, lowest first; several may have one level
    this.colors = { cap: "#5b7083" };
    this.group = new THREE.Group();
    scene.add(this.group);
    this.still = new THREE.Group();
    this.leaves = new THREE.Group();
    this.shares = new Map(); // how far the leaves of an object are open, by its name, if the simulator says so
    this.swung = new Map(); // the drawn leaves by the name of their object: functions of the shares
    this.group.add(this.still, this.leaves);
    const vertexColors = true;
    this.materials = {
      solid: new THREE.MeshLambertMaterial({ vertexColors }),
      floor: gridded(new THREE.MeshLambertMaterial({ vertexColors })),
      glass: new THREE.MeshLambertMaterial({ vertexColors, transparent: true, opacity: 0.4, depthWrite: false }),
      mark: new THREE.MeshLambertMaterial({ vertexColors, polygonOffset: true, polygonOffsetFactor: -2, polygonOffsetUnits: -2 }),
      ghost: new THREE.MeshLambertMaterial({ vertexColors, transparent: true, opacity: 0.35, depthWrite: false }),
    };
  }

  // Objects

  show({ bodies, types }) {
    this.types = types;
    this.bodies = new Map(bodies.map((body) => [body.name, this.prepared(body)]));
    for (const name of [...this.drawn.keys()]) this.undraw(name);
    this.shares.clear();
    for (const body of this.bodies.values()) if (MOVING.has(body.kind)) this.draw(body);
    this.findLevels();
    this.build();
  }

  change({ bodies, types }, names) {
    Object.assign(this.types, types);
    let still = false;
    for (const name of names) {
      const before = this.bodies.get(name);
      if (before && !MOVING.has(before.kind)) still = true;
      this.bodies.delete(name);
      this.undraw(name);
    }
    for (const body of bodies.map((one) => this.prepared(one))) {
      this.bodies.set(body.name, body);
      if (MOVING.has(body.kind)) this.draw(body);
      else still = true;
    }
    if (still) {
      this.findLevels();
      this.build();
    }
  }

  prepared(body) {
    const full = { yaw: 0, width: 0, depth: 0, height: 0, radius: 0, color: "#999999", outline: [], open: false, ...body };
    full.window = this.isA(full, "Window");
    full.size = full.form === "Box" ? Math.hypot(full.width, full.depth) / 2 : full.radius;
    if (full.form === "Polygon") full.size = Math.max(...full.outline.map(([x, y]) => Math.hypot(x, y)));
    return full;
  }

  isA(body, type) {
    return (this.types[body.type] ?? []).includes(type);
  }

  // Levels: the heights of floors; one can be shown alone

  findLevels() {
    const floors = [...this.bodies.values()].filter((body) => body.kind === "floor");
    const top = (floor) => Math.round((floor.z + floor.height) * 10) / 10;
    const tops = [...new Set(floors.map(top))].sort((a, b) => a - b);
    const before = this.levels.join();
    this.levels = tops.filter((z, i) => i === 0 || z - tops[i - 1] > 1.5);
    this.storeys = this.levels.flatMap((z, i) => {
      const names = new Set(floors.filter((floor) => floor.storey && this.levelAt(top(floor)) === z).map((floor) => floor.storey));
      return (names.size ? [...names] : [`Storey ${i + 1}`]).map((name) => ({ z, name }));
    });
    // With several storeys, one is shown, at first the one with the most moving objects: the others would hide it.
    if (before !== this.levels.join() && this.levels.length > 1) {
      const movers = (z) => [...this.bodies.values()].filter((body) => MOVING.has(body.kind) && this.levelAt(body.z) === z).length;
      this.level = this.levels.reduce((best, z) => (movers(z) > movers(best) ? z : best));
    } else if (!this.levels.includes(this.level)) this.level = null;
  }

  levelAt(z) {
    return this.levels.filter((top) => top <= z + 0.4).at(-1) ?? this.levels[0] ?? 0;
  }

  seen(body, z = body.z) {
    return this.level === null || this.levelAt(body.kind === "floor" ? z + body.height : z) === this.level;
  }

  // Static objects

  build() {
    for (const mesh of [...this.still.children, ...this.leaves.children]) mesh.geometry.dispose();
    this.still.clear();
    this.leaves.clear();
    this.swung.clear();
    const bodies = [...this.bodies.values()].filter((body) => !MOVING.has(body.kind) && this.seen(body));
    const made = shell(bodies.filter((body) => BUILDING.has(body.kind)), this.low, this.colors);
    const around = new Pieces();
    const marks = new Pieces();
    for (const body of bodies) {
      this.hang(body);
      if (BUILDING.has(body.kind)) continue;
      const into = body.kind === "place" ? marks : around;
      into.owner(body.name).frame(body.x, body.y, body.z, body.yaw);
      form(into, body, this.types[body.type] ?? []);
    }
    this.mesh(made.floors, this.materials.floor, { cast: false });
    this.mesh(made.walls, this.materials.solid);
    this.mesh(around, this.materials.solid);
    this.mesh(marks, this.materials.mark, { cast: false });
    this.mesh(made.glass, this.materials.glass, { cast: false });
    for (const name of this.drawn.keys()) this.hide(name);
  }

  mesh(pieces, material, { cast = true } = {}) {
    if (pieces.empty) return;
    const mesh = new THREE.Mesh(pieces.geometry(), material);
    mesh.castShadow = cast;
    mesh.receiveShadow = true;
    mesh.userData.owners = pieces.owners;
    this.still.add(mesh);
  }

  hang(body) {
    // The leaves of a door or cupboard, as far open as is known.
    const places = leavesOf(body, this.isA(body, "Cupboard"), this.low).map(({ pieces, place }) => {
      const mesh = new THREE.Mesh(pieces.geometry(), this.materials.solid);
      mesh.castShadow = mesh.receiveShadow = true;
      mesh.userData.name = body.name;
      this.leaves.add(mesh);
      const [c, s] = [Math.cos(body.yaw), Math.sin(body.yaw)];
      return (share) => {
        const { x, y, yaw } = place(share);
        mesh.position.set(body.x + c * x - s * y, body.y + s * x + c * y, body.z);
        mesh.rotation.z = body.yaw + yaw;
      };
    });
    if (!places.length) return;
    this.swung.set(body.name, (shares) => places.forEach((place, i) => place(shares[i] ?? shares[0])));
    this.swing(body.name, this.shares.get(body.name) ?? [body.open ? 1 : 0]);
  }

  swing(name, shares) {
    this.swung.get(name)?.(shares);
  }

  // Moving objects

  draw(body) {
    let one;
    if (body.kind === "robot") {
      const robot = new RobotBody(body.radius ? body : { ...body, radius: body.size }, this.materials.solid);
      one = { object: robot.group, set: (pose) => robot.set(pose), dispose: () => robot.dispose(), top: () => robot.top };
      this.group.add(robot.group);
    } else {
      one = this.thing(body);
    }
    this.drawn.set(body.name, one);
  }

  thing(body) {
    const crowd = this.crowdOf(body);
    const object = crowd.enter(body.name);
    const set = ([x, y, z, yaw, pitch = 0, roll = 0]) => {
      object.position.set(x, y, z);
      object.rotation.set(roll, pitch, yaw);
      object.place();
    };
    set([body.x, body.y, body.z, body.yaw]);
    return { object, set, crowd, top: () => body.height };
  }

  crowdOf(body) {
    const { type, form: shape, width, depth, height, radius, outline, color, unknown = false } = body;
    const key = JSON.stringify([type, shape, width, depth, height, radius, outline, color, unknown]);
    if (!this.crowds.has(key)) {
      const pieces = new Pieces();
      form(pieces, body, this.types[type] ?? []);
      const clear = this.isA(body, "Lift"); // so that robots are seen in lifts
      const material = unknown ? this.materials.ghost : clear ? this.materials.glass : this.materials.solid;
      const crowd = new Crowd(this.group, pieces.geometry(), material, !unknown && !clear);
      crowd.key = key;
      this.crowds.set(key, crowd);
    }
    return this.crowds.get(key);
  }

  undraw(name) {
    const one = this.drawn.get(name);
    if (!one) return;
    this.drawn.delete(name);
    if (!one.crowd) {
      this.group.remove(one.object);
      one.dispose();
      return;
    }
    one.crowd.leave(one.object);
    if (one.crowd.empty) {
      one.crowd.dispose();
      this.crowds.delete(one.crowd.key);
    }
  }

  move(name, pose) {
    if (pose.length <= LEAVES) {
      this.shares.set(name, pose);
      this.swing(name, pose);
      return;
    }
    const one = this.drawn.get(name);
    if (!one) return;
    one.set(pose);
    if (this.level !== null) this.hide(name);
  }

  hide(name) {
    // Whether it is on the level that is shown.
    const { object } = this.drawn.get(name);
    const visible = this.seen(this.bodies.get(name), object.position.z);
    if (visible === object.visible) return;
    object.visible = visible;
    object.place?.();
  }

  // Queries

  where(name) {
    // The pose drawn now: centre of the underside, and heading.
    const body = this.bodies.get(name);
    if (!body) return null;
    const object = this.drawn.get(name)?.object;
    if (!object) return { x: body.x, y: body.y, z: body.z, yaw: body.yaw };
    return { x: object.position.x, y: object.position.y, z: object.position.z, yaw: object.rotation.z };
  }

  top(name) {
    // The height of its top above its underside.
    const body = this.bodies.get(name);
    if (BUILDING.has(body.kind)) return 0;
    return this.drawn.get(name)?.top() ?? body.height;
  }

  visible(name) {
    const one = this.drawn.get(name);
    return one ? one.object.visible : this.seen(this.bodies.get(name));
  }

  room(x, y, z) {
    // The label of the floor at a point.
    let found = null;
    for (const body of this.bodies.values()) {
      if (body.kind !== "floor" || !body.label || Math.abs(this.levelAt(z) - body.z - body.height) > 0.5) continue;
      if (inside(body, x, y)) found = body.label;
    }
    return found;
  }

  bounds() {
    const box = new THREE.Box3().setFromObject(this.still);
    const corner = new THREE.Vector3();
    for (const [name, { object }] of this.drawn) {
      const { x, y, z } = object.position;
      if (object.visible) box.expandByPoint(corner.set(x, y, z)).expandByPoint(corner.set(x, y, z + this.top(name)));
    }
    return box.isEmpty() ? new THREE.Box3(new THREE.Vector3(-2, -2, 0), new THREE.Vector3(2, 2, 1)) : box;
  }

  pick(raycaster) {
    // The nearest visible object on the ray.
    for (const hit of raycaster.intersectObjects([this.group], true)) {
      const { name, names, owners } = hit.object.userData;
      const found = name ?? names?.(hit.instanceId) ?? (owners ? ownerOf(owners, hit.faceIndex) : null);
      if (found && this.visible(found)) return found;
    }
    return null;
  }

  dispose() {
    for (const name of [...this.drawn.keys()]) this.undraw(name);
    for (const mesh of [...this.still.children, ...this.leaves.children]) mesh.geometry.dispose();
    for (const material of Object.values(this.materials)) material.dispose();
  }
}

function inside(body, x, y) {
  const c = Math.cos(body.yaw);
  const s = Math.sin(body.yaw);
  const u = c * (x - body.x) + s * (y - body.y);
  const v = c * (y - body.y) - s * (x - body.x);
  if (body.form === "Box") return Math.abs(u) <= body.width / 2 && Math.abs(v) <= body.depth / 2;
  if (body.form !== "Polygon") return Math.hypot(u, v) <= body.radius;
  let within = false;
  body.outline.forEach(([ax, ay], i) => {
    const [bx, by] = body.outline[(i + 1) % body.outline.length];
    if (ay > v !== by > v && u < ax + ((v - ay) / (by - ay)) * (bx - ax)) within = !within;
  });
  return within;
}
