// Robots: a base with wheels and an arrow that shows the heading, and an arm, if there is one, with the joint angles of the real arm.
import { THREE } from "nicegui-scene";
import { Pieces } from "./pieces.js";

const DARK = "#23272d";
const STEEL = "#b9bec5";
const RUBBER = "#15171a";
const TIP = "#f28c1a";
const ARROW = [[1, 0], [-0.5, 0.72], [-0.2, 0], [-0.5, -0.72]];

function base(body) {
  const { radius: r, height: h, color } = body;
  const pieces = new Pieces();
  const wheel = Math.min(0.0975, 0.4 * h);
  pieces.cylinder(r - 0.03, h - 0.09, 0, 0, (h - 0.03) / 2 + 0.02, DARK, { sides: 32 });
  pieces.cylinder(r, 0.09, 0, 0, h - 0.07, color, { sides: 40 });
  pieces.cylinder(r - 0.012, 0.025, 0, 0, h - 0.0125, DARK, { sides: 32 });
  pieces.box(0.03, r, 0.04, r - 0.012, 0, h - 0.07, STEEL);
  for (const side of [-1, 1]) {
    const turn = [Math.PI / 2, 0, 0];
    pieces.cylinder(wheel, 0.048, 0, side * (r - 0.024), wheel, RUBBER, { turn });
    pieces.cylinder(0.5 * wheel, 0.052, 0, side * (r - 0.024), wheel, STEEL, { turn, sides: 16 });
  }
  const arrow = 0.42 * r;
  pieces.prism(ARROW.map(([x, y]) => [0.42 * r + x * arrow, y * arrow]), 0.006, h, "#f2f2ec");
  return pieces;
}

function tower(body) {
  // A tall mobile robot without an arm: a column with a camera on top.
  const { radius: r, height: h, color } = body;
  const foot = Math.min(0.28, 0.4 * h);
  const pieces = base({ ...body, height: foot });
  pieces.cylinder(0.05, h - foot - 0.12, -0.3 * r, 0, (h + foot - 0.12) / 2, STEEL);
  pieces.box(0.14, 0.22, 0.12, -0.2 * r, 0, h - 0.06, color);
  pieces.cylinder(0.035, 0.04, -0.2 * r + 0.08, 0, h - 0.06, DARK, { turn: [0, Math.PI / 2, 0] });
  return pieces;
}

export class RobotBody {
  // `group` is drawn; `set` takes the server's numbers: x, y, z, yaw, and five more with an arm.
  constructor(body, material) {
    this.body = body;
    this.group = new THREE.Group();
    this.material = material;
    this.parts = [];
    const { radius: r, height: h, arm } = body;
    this.part(this.group, !arm && h > 2 * r ? tower(body) : base(body));
    if (arm) this.build(r, h, arm);
    this.set([body.x, body.y, body.z, body.yaw]);
  }

  part(parent, pieces) {
    const mesh = new THREE.Mesh(pieces.geometry(), this.material);
    mesh.castShadow = mesh.receiveShadow = true;
    mesh.userData.name = this.body.name;
    parent.add(mesh);
    this.parts.push(mesh);
    return mesh;
  }

  build(r, h, arm) {
    const mast = -(r - 0.07);
    const drop = arm.hang - arm.finger;
    const group = (parent) => parent.add(new THREE.Group()).children.at(-1);
    this.turret = group(this.group);
    const column = new Pieces().cylinder(0.05, 0.016, mast, 0, h + 0.006, STEEL);
    this.part(this.turret, column.cylinder(0.024, 1.0 - h, mast, 0, (1.0 + h) / 2, STEEL));
    this.lift = group(this.turret);
    const carriage = new Pieces().cylinder(0.016, 0.74, mast, 0, -0.37, "#8c9198").box(0.08, 0.08, 0.07, mast, 0, 0, DARK);
    this.part(this.lift, carriage.box(r + 0.035 - mast, 0.04, 0.036, (r + 0.035 + mast) / 2, 0, 0, STEEL));
    this.reach = group(this.lift);
    const boom = new Pieces().box(0.36, 0.026, 0.024, -0.18, 0, 0, "#80858c");
    this.part(this.reach, boom.cylinder(0.02, drop, 0, 0, -drop / 2 + 0.01, DARK));
    this.wrist = group(this.reach);
    this.wrist.position.z = -drop;
    this.part(this.wrist, new Pieces().box(0.036, 0.2, 0.024, 0, 0, 0.012, DARK));
    this.fingers = [1, -1].map((side) => {
      const finger = group(this.wrist);
      this.part(finger, new Pieces().box(0.028, 0.012, arm.finger, 0, side * 0.006, -arm.finger / 2, TIP));
      return finger;
    });
    this.set([0, 0, 0, 0, 0, arm.lift, arm.reach, 0, 0.05]);
  }

  set([x, y, z, yaw, turret, lift, reach, wrist, open]) {
    this.group.position.set(x, y, z);
    this.group.rotation.z = yaw;
    if (this.turret && lift !== undefined) {
      this.turret.rotation.z = turret;
      this.lift.position.z = lift;
      this.reach.position.x = reach;
      this.wrist.rotation.z = wrist;
      this.fingers[0].position.y = open;
      this.fingers[1].position.y = -open;
    }
  }

  get top() {
    return this.body.arm ? Math.max(1.0, this.lift.position.z + 0.04) : this.body.height;
  }

  dispose() {
    for (const mesh of this.parts) mesh.geometry.dispose();
  }
}
