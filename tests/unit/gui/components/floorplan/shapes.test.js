import assert from "node:assert/strict";
import test from "node:test";
import { kindById, kindOf, LAYERS, LEGEND } from "somrs-floorplan/kinds.js";
import { look, outline, pose, sample } from "somrs-floorplan/shapes.js";

const BOX = { form: "Box", width: 1, depth: 2 };

test("outlines are in metres", () => {
  assert.equal(outline(BOX), "M-0.5 -1H0.5V1H-0.5Z");
  assert.equal(outline({ form: "Polygon", outline: [[0, 0], [1, 0], [0, 1]] }), "M0 0L1 0L0 1Z");
  assert.match(outline({ form: "Cylinder", radius: 0 }), /^M-0\.01 0A/, "what is tiny is there all the same");
});

test("an open door looks otherwise than a closed one", () => {
  const door = kindById("door");
  const solid = { form: "Box", width: 0.1, depth: 0.9 };
  assert.match(look(door, solid, { open: [1] }).content, /fp-gap/);
  assert.doesNotMatch(look(door, solid, { open: [0] }).content, /fp-gap/);
});

test("a leaf is drawn where it is", () => {
  const at = (id, solid, open) => look(kindById(id), solid, { open }).content;
  const door = { form: "Box", width: 0.1, depth: 1 };
  assert.match(at("door", door, [0.5]), /M0 -0\.5L0\.7071 0\.2071/, "half open: at 45 degrees to the wall");
  assert.match(at("door", door, [1]), /M0 -0\.5L1 -0\.5/);
  const cupboard = { form: "Box", width: 0.5, depth: 1.2 };
  assert.equal(at("cupboard", cupboard, [0, 0]), look(kindById("support"), cupboard, { open: [0] }).content, "shut, it looks like other furniture");
  assert.match(at("cupboard", cupboard, [1, 0]), /M0 -0\.6L0\.6 -0\.6/, "one of two leaves is open");
  assert.match(at("cupboard", cupboard, [1]), /M0 0\.6L0\.6 0\.6/, "both, as the map says");
});

test("what nobody knows, and what is broken, are marked", () => {
  const { classes } = look(kindById("thing"), BOX, { color: "Red", unknown: true, broken: true });
  assert.equal(classes, "fp-object fp-thing fp-c-red fp-unknown fp-broken");
});

test("every kind can be drawn, over every form", () => {
  for (const solid of [BOX, { form: "Cylinder", radius: 0.4 }, { form: "Polygon", outline: [[1, 0], [0, 1], [-1, 0]] }, { form: null, radius: 0.1 }])
    for (const id of [...LEGEND, "floor", "opening", "pillar"]) {
      const kind = kindById(id);
      assert.ok(LAYERS.includes(kind.layer), id);
      assert.doesNotMatch(look(kind, solid, { open: [1], range: 2, view: 1 }).content, /NaN|undefined/, `${id} over ${solid.form}`);
    }
});

test("the legend has a picture of each kind", () => {
  for (const id of LEGEND) assert.doesNotMatch(sample(kindById(id)), /NaN|undefined/, id);
  assert.notEqual(sample(kindById("door")), sample(kindById("door"), { open: [0] }));
});

test("special kinds come before general ones", () => {
  const known = (...types) => kindOf((type) => types.includes(type)).id;
  assert.deepEqual([known("Charger", "Place"), known("Wall", "BuildingElement", "PhysicalObject"), known("AbstractObject"), known()], ["charger", "wall", "none", "obstacle"]);
});

test("a pose is where a thing stands and where it looks", () => {
  assert.equal(pose({ x: 1.23456, y: 2, turned: Math.PI / 2 }), "translate(1.2346 2) rotate(90)");
});

test("the lines of a zone are inside it", () => {
  const kind = kindById("nogo");
  const zone = { form: "Polygon", outline: [[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3]] };
  const { content } = look(kind, zone, { open: [1] });
  const points = [...content.matchAll(/class="fp-mark" d="([^"]*)"/g)].flatMap(([, d]) => [...d.matchAll(/[ML](-?[\d.]+) (-?[\d.]+)/g)].map(([, x, y]) => [+x, +y]));
  assert.ok(points.length > 20);
  const inside = ([x, y]) => x >= -0.01 && y >= -0.01 && ((x <= 4.01 && y <= 1.01) || (x <= 1.01 && y <= 3.01));
  assert.deepEqual(points.filter((point) => !inside(point)), []);
});
