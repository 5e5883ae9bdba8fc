// The look of furniture, things and marks, by the nearest ancestor type that has one here; others are drawn by their plain shape. Bodies
// are upright; their origin is the centre of the underside, the front is +x.
import { shade } from "./pieces.js";

export const METAL = "#6b7178";
const POT = "#a5644a";

export function plain(pieces, body, color = body.color) {
  if (body.form === "Polygon") pieces.prism(body.outline, body.height, 0, color);
  else if (body.form === "Cylinder") pieces.cylinder(body.radius, body.height, 0, 0, body.height / 2, color, { sides: 32 });
  else pieces.box(body.width, body.depth, body.height, 0, 0, body.height / 2, color);
}

function table(pieces, { width: w, depth: d, height: h, color }) {
  const board = Math.min(0.04, h / 4);
  const leg = Math.min(0.05, w / 6);
  pieces.box(w, d, board, 0, 0, h - board / 2, color);
  pieces.box(w - 2.6 * leg, d - 2.6 * leg, 0.06, 0, 0, h - board - 0.03, shade(color, 0.75));
  for (const x of [-1, 1]) {
    for (const y of [-1, 1]) {
      pieces.box(leg, leg, h - board, x * (w / 2 - leg), y * (d / 2 - leg), (h - board) / 2, METAL);
    }
  }
}

function cupboard(pieces, { width: w, depth: d, height: h, color }) {
  // The case; `leaves.js` has the leaves.
  const plinth = Math.min(0.06, h / 6);
  const top = Math.min(0.03, h / 6);
  const tall = h - plinth - top;
  const middle = plinth + tall / 2;
  const thick = 0.02;
  pieces.box(w - thick, d, plinth, -thick / 2, 0, plinth / 2, shade(color, 0.6));
  pieces.box(w, d, top, 0, 0, h - top / 2, shade(color, 1.15));
  for (const side of [-1, 1]) pieces.box(w - thick, 0.03, tall, -thick / 2, (side * (d - 0.03)) / 2, middle, color);
  pieces.box(0.03, d, tall, -(w - 0.03) / 2, 0, middle, shade(color, 0.8));
}

function shelf(pieces, { width: w, depth: d, height: h, color }) {
  const levels = Math.max(1, Math.round(h / 0.35));
  for (let i = 0; i <= levels; i++) pieces.box(w, d, 0.025, 0, 0, 0.0125 + ((h - 0.025) * i) / levels, color);
  for (const side of [-1, 1]) pieces.box(w - 0.01, 0.025, h - 0.01, 0, (side * (d - 0.025)) / 2, h / 2, shade(color, 0.8));
  pieces.box(0.01, d - 0.02, h - 0.02, -w / 2 + 0.01, 0, h / 2, shade(color, 0.65));
}

function platform(pieces, { width: w, depth: d, height: h, color }) {
  const top = Math.min(0.05, h / 3);
  pieces.box(w - 0.06, d - 0.06, h - top, 0, 0, (h - top) / 2, shade(color, 0.4));
  pieces.box(w, d, top, 0, 0, h - top / 2, color);
}

function chair(pieces, { width: w, depth: d, height: h, color }) {
  const seat = 0.52 * h;
  const leg = 0.03;
  pieces.box(w, d, 0.045, 0, 0, seat, color);
  pieces.box(0.03, 0.95 * d, 0.36 * h, -w / 2 + 0.02, 0, 0.82 * h, color);
  for (const x of [-1, 1]) {
    for (const y of [-1, 1]) {
      const tall = x < 0 ? 0.95 * h : seat;
      pieces.box(leg, leg, tall, x * (w / 2 - leg), y * (d / 2 - leg), tall / 2, METAL);
    }
  }
}

function plant(pieces, body) {
  if (body.form === "Polygon") return plain(pieces, body);
  const { width, depth, radius, height: h, color } = body;
  const r = body.form === "Box" ? 0.4 * Math.min(width, depth) : radius;
  const pot = Math.min(0.35 * h, 0.4);
  pieces.cylinder(0.6 * r, pot, 0, 0, pot / 2, POT, { top: 1.25 });
  for (let i = 0; i < 7; i++) {
    const angle = 2.4 * i;
    const ring = i === 6 ? 0 : 0.45 * r;
    const z = pot + (h - pot) * (0.3 + 0.07 * i);
    pieces.ball(ring * Math.cos(angle), ring * Math.sin(angle), z, [0.55 * r, 0.55 * r, 0.28 * (h - pot)], shade(color, 0.8 + 0.08 * (i % 4)));
  }
}

function bin(pieces, body) {
  if (body.form === "Polygon") return plain(pieces, body);
  const r = body.form === "Box" ? Math.min(body.width, body.depth) / 2 : body.radius;
  pieces.cylinder(0.85 * r, body.height, 0, 0, body.height / 2, body.color, { top: 1.17 });
  pieces.cylinder(0.9 * r, 0.01, 0, 0, body.height + 0.001, shade(body.color, 0.3));
}

function jar(pieces, body) {
  if (body.form !== "Cylinder") return plain(pieces, body);
  const { radius: r, height: h, color } = body;
  pieces.lathe([[0, 0], [0.92 * r, 0], [r, 0.05 * h], [r, 0.72 * h], [0.86 * r, 0.82 * h], [0.86 * r, 0.84 * h], [0, 0.84 * h]], 0, 0, 0, color);
  pieces.cylinder(0.94 * r, 0.16 * h, 0, 0, 0.92 * h, shade(color, 0.4));
}

function can(pieces, body) {
  if (body.form !== "Cylinder") return plain(pieces, body);
  const { radius: r, height: h, color } = body;
  pieces.cylinder(r, 0.9 * h, 0, 0, 0.5 * h, color);
  pieces.cylinder(0.93 * r, h, 0, 0, 0.5 * h, "#c9ced3");
}

function bottle(pieces, body) {
  if (body.form !== "Cylinder") return plain(pieces, body);
  const { radius: r, height: h, color } = body;
  const outline = [[0, 0], [0.9 * r, 0], [r, 0.04 * h], [r, 0.6 * h], [0.75 * r, 0.7 * h], [0.4 * r, 0.78 * h], [0.36 * r, 0.92 * h], [0, 0.92 * h]];
  pieces.lathe(outline, 0, 0, 0, color);
  pieces.cylinder(0.42 * r, 0.09 * h, 0, 0, 0.955 * h, shade(color, 0.45));
}

function cup(pieces, body) {
  if (body.form !== "Cylinder") return plain(pieces, body);
  const { radius: r, height: h, color } = body;
  pieces.lathe([[0, 0], [0.7 * r, 0], [0.95 * r, h], [0.85 * r, h], [0.62 * r, 0.1 * h], [0, 0.1 * h]], 0, 0, 0, color);
  pieces.box(0.25 * r, 0.2 * r, 0.5 * h, r, 0, 0.55 * h, shade(color, 0.85));
}

function carton(pieces, body) {
  if (body.form !== "Box") return plain(pieces, body);
  const { width: w, depth: d, height: h, color } = body;
  pieces.box(w, d, h, 0, 0, h / 2, color);
  pieces.box(0.18 * w, d + 0.002, h + 0.002, 0, 0, h / 2, shade(color, 1.35));
}

function camera(pieces, { width: w, depth: d, height: h, color, pitch = 0 }) {
  // It hangs at its position; the lens is tilted down by the pitch.
  const middle = h / 2;
  const at = (along) => [along * Math.cos(pitch), middle - along * Math.sin(pitch)];
  const [bx, bz] = at(-0.1 * w);
  const [lx, lz] = at(0.42 * w);
  pieces.box(0.8 * w, d, h, bx, 0, bz, color, [0, pitch, 0]);
  pieces.cylinder(0.36 * h, 0.25 * w, lx, 0, lz, "#22262b", { turn: [0, pitch + Math.PI / 2, 0] });
  pieces.cylinder(0.02, 0.25, -0.3 * w, 0, h + 0.1, METAL);
}

function place(pieces, { radius, width = 0, depth = 0, color }) {
  const r = Math.max(radius || Math.max(width, depth) / 2, 0.1);
  pieces.ring(r, 0.05, 0.004, color);
}

function charger(pieces, body) {
  place(pieces, body);
  // A lightning symbol.
  const s = 0.45 * Math.max(body.radius || 0.3, 0.1);
  const flash = [[0.1, 0.9], [-0.45, -0.1], [-0.05, -0.1], [-0.15, -0.9], [0.45, 0.15], [0.05, 0.15], [0.25, 0.9]];
  pieces.prism(flash.map(([x, y]) => [x * s, y * s]), 0.003, 0.001, body.color);
}

function person(pieces, { height: h = 1.7, color }) {
  const tall = Math.max(h, 1.2);
  pieces.cylinder(0.2, 0.55 * tall, 0, 0, 0.3 * tall, color, { top: 0.8 });
  pieces.ball(0, 0, 0.88 * tall, [0.11, 0.11, 0.13], "#d9b08c");
}

const FORMS = {
  Table: table,
  Cupboard: cupboard,
  Shelf: shelf,
  Platform: platform,
  Chair: chair,
  Plant: plant,
  Bin: bin,
  Jar: jar,
  Can: can,
  Bottle: bottle,
  Cup: cup,
  Carton: carton,
  Camera: camera,
  Charger: charger,
  Place: place,
  Person: person,
};
const BOXES = new Set(["Table", "Cupboard", "Shelf", "Platform", "Chair", "Camera"]);

export function form(pieces, body, ancestors) {
  const known = ancestors.find((type) => type in FORMS);
  const draw = known && (body.form === "Box" || !BOXES.has(known)) ? FORMS[known] : plain;
  draw(pieces, body);
}
