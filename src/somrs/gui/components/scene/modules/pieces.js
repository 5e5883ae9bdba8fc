// Solid pieces of one colour each, merged into one geometry: a whole building is drawn in a few calls.
import { THREE } from "nicegui-scene";

const colour = new THREE.Color();
const matrix = new THREE.Matrix4();
const normalMatrix = new THREE.Matrix3();
const vector = new THREE.Vector3();
const turned = new THREE.Quaternion();
const UP = new THREE.Vector3(0, 0, 1);
const ONE = new THREE.Vector3(1, 1, 1);

// Shapes by size, shared by robots and chairs with hundreds of equal pieces.
const shapes = new Map();

function shape(key, make) {
  if (!shapes.has(key)) shapes.set(key, make());
  return shapes.get(key);
}

export function shade(hex, factor) {
  // The colour, darker or lighter.
  colour.set(hex);
  if (factor <= 1) colour.multiplyScalar(factor);
  else colour.lerp(new THREE.Color("#ffffff"), Math.min(1, factor - 1));
  return `#${colour.getHexString()}`;
}

export class Pieces {
  // Coordinates are in the frame set by `frame`; z is of a piece's centre unless stated otherwise.
  constructor() {
    this.position = [];
    this.normal = [];
    this.color = [];
    this.index = [];
    this.owners = [];
    this.frameMatrix = new THREE.Matrix4();
  }

  frame(x, y, z, yaw) {
    this.frameMatrix.compose(vector.set(x, y, z), turned.setFromAxisAngle(UP, yaw), ONE);
    return this;
  }

  owner(name) {
    // The owner of the following pieces, for clicks.
    this.owners.push({ from: this.index.length / 3, name });
    return this;
  }

  box(width, depth, height, x, y, z, hex, turn = [0, 0, 0]) {
    const geometry = shape("box", () => new THREE.BoxGeometry(1, 1, 1));
    return this.add(geometry, hex, x, y, z, [width, depth, height], turn);
  }

  cylinder(radius, height, x, y, z, hex, { top = 1, turn = [0, 0, 0], sides = 24 } = {}) {
    // `top`: the upper radius as a share of the lower one.
    const geometry = shape(`cylinder ${top} ${sides}`, () => new THREE.CylinderGeometry(top, 1, 1, sides).rotateX(Math.PI / 2));
    return this.add(geometry, hex, x, y, z, [radius, radius, height], turn);
  }

  ball(x, y, z, [rx, ry, rz], hex) {
    const geometry = shape("ball", () => new THREE.SphereGeometry(1, 16, 10));
    return this.add(geometry, hex, x, y, z, [rx, ry, rz], [0, 0, 0]);
  }

  lathe(points, x, y, z, hex, sides = 20) {
    // A body of revolution from an outline of [radius, height]; z is of its underside.
    const outline = points.map(([radius, height]) => new THREE.Vector2(Math.max(radius, 1e-4), height));
    const geometry = new THREE.LatheGeometry(outline, sides).rotateX(Math.PI / 2);
    return this.add(geometry, hex, x, y, z, [1, 1, 1], [0, 0, 0]);
  }

  ring(radius, width, z, hex, sides = 48) {
    const geometry = new THREE.RingGeometry(Math.max(radius - width, 0.001), radius, sides);
    return this.add(geometry, hex, 0, 0, z, [1, 1, 1], [0, 0, 0]);
  }

  prism(outline, height, z, hex) {
    // A prism over a polygon; z is of its underside.
    const form = new THREE.Shape(outline.map(([x, y]) => new THREE.Vector2(x, y)));
    const geometry = new THREE.ExtrudeGeometry(form, { depth: height, bevelEnabled: false });
    return this.add(geometry, hex, 0, 0, z, [1, 1, 1], [0, 0, 0]);
  }

  add(geometry, hex, x, y, z, scale, turn) {
    matrix.compose(vector.set(x, y, z), turned.setFromEuler(new THREE.Euler(...turn, "ZYX")), new THREE.Vector3(...scale));
    matrix.premultiply(this.frameMatrix);
    normalMatrix.getNormalMatrix(matrix);
    colour.set(hex);
    const { position, normal } = geometry.attributes;
    const first = this.position.length / 3;
    for (let i = 0; i < position.count; i++) {
      vector.fromBufferAttribute(position, i).applyMatrix4(matrix);
      this.position.push(vector.x, vector.y, vector.z);
      vector.fromBufferAttribute(normal, i).applyMatrix3(normalMatrix).normalize();
      this.normal.push(vector.x, vector.y, vector.z);
      this.color.push(colour.r, colour.g, colour.b);
    }
    if (geometry.index) for (let i = 0; i < geometry.index.count; i++) this.index.push(first + geometry.index.getX(i));
    else for (let i = 0; i < position.count; i++) this.index.push(first + i);
    return this;
  }

  get empty() {
    return !this.index.length;
  }

  geometry() {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(this.position, 3));
    geometry.setAttribute("normal", new THREE.Float32BufferAttribute(this.normal, 3));
    geometry.setAttribute("color", new THREE.Float32BufferAttribute(this.color, 3));
    geometry.setIndex(this.index);
    geometry.computeBoundingSphere();
    return geometry;
  }
}

export function ownerOf(owners, face) {
  // The owner of a triangle: the last one that begins before it.
  let low = 0;
  let high = owners.length - 1;
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (owners[middle].from <= face) low = middle;
    else high = middle - 1;
  }
  return owners[low]?.name ?? null;
}
