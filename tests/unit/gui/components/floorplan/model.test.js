import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import { bounds, contains, Model, reach } from "somrs-floorplan/model.js";
import { building, DEFINITIONS, fact, object } from "./building.js";

let model;

beforeEach(() => {
  model = new Model();
  model.learn(DEFINITIONS);
  model.read(building());
});

test("values are the object's own, or those of its type", () => {
  assert.deepEqual(model.solid("Table001"), { name: "Table001", x: 2, y: 3, z: 0, turned: 0, form: "Box", width: 1, depth: 2, height: 0.75 });
  assert.equal(model.value("Jar001", "Color"), "Red");
  assert.equal(model.solid("Nowhere"), null);
  assert.equal(model.formOfType("Jar", { "Shape.Radius": 0.2 }).radius, 0.2);
});

test("storeys are known, lowest first, and on which one a thing is", () => {
  assert.deepEqual(model.storeys().map((one) => one.label), ["Ground", "Upper · First floor"]);
  assert.deepEqual(["Jar001", "Jar002", "Robot1", "Floor1", "Hall", "Nowhere"].map((name) => model.storeyOf(name)), ["Ground", "Upper", "Ground", "Upper", "Ground", null]);
});

test("storeys of two buildings at one height are level, the own ones first", () => {
  model.apply([{ type: "ObjectAdded", object: object("Barn:Ground", "Storey", 0, 0, { Elevation: 0 }) }], 8);
  assert.deepEqual(model.storeys().map((one) => one.name), ["Ground", "Barn:Ground", "Upper"]);
  assert.equal(model.areLevel("Ground", "Barn:Ground"), true);
  assert.equal(model.areLevel("Ground", "Ground"), true);
  assert.equal(model.areLevel("Ground", "Upper"), false);
  assert.equal(model.areLevel(null, "Ground"), false);
  assert.equal(model.areLevel(null, null), false);
});

test("a thing is on the storey of what it stands on", () => {
  model.apply([{ type: "FactAdded", fact: fact("isOn", "Nowhere", "Jar002") }], 8);
  assert.equal(model.storeyOf("Nowhere"), "Upper");
  assert.equal(model.version, 8);
});

test("facts that go round in a circle do not hang it", () => {
  model.apply([{ type: "FactAdded", fact: fact("isOn", "Table001", "Jar001") }], 8);
  assert.equal(model.storeyOf("Jar001"), "Ground");
  assert.deepEqual([...model.riders("Table001")], ["Jar001"]);
});

test("what stands on something goes along with it", () => {
  assert.deepEqual([...model.riders("Table001")], ["Jar001"]);
  assert.deepEqual([...model.riders("Jar001")], []);
  assert.equal(model.under("Jar001"), "Table001");
});

test("a thing is put on the table, not through it on the floor", () => {
  assert.equal(model.targetAt(2, 3.9, "Ground"), "Table001");
  assert.equal(model.targetAt(8, 2, "Ground"), "Floor0");
  assert.equal(model.targetAt(2, 3.9, "Ground", new Set(["Table001"])), "Floor0");
  assert.equal(model.targetAt(2, 3.9, "Upper"), "Floor1");
  assert.equal(model.targetAt(50, 50, "Ground"), null);
});

test("a thing is put where the map says that things can be put", () => {
  const state = (value) => model.apply([{ type: "ValueSet", object: "Table001", path: "Supporting", value }], 8);
  state(false);
  assert.equal(model.targetAt(2, 3.9, "Ground"), "Floor0");
  state(null);
  assert.equal(model.targetAt(2, 3.9, "Ground"), "Table001");
  model.apply([{ type: "ObjectAdded", object: object("Rack001", "Rack", 8, 2, { "Shape.Form": "Box", "Shape.Width": 1, "Shape.Depth": 1, "Shape.Height": 1 }) }], 9);
  assert.equal(model.targetAt(8, 2, "Ground"), "Floor0");
  model.apply([{ type: "ValueSet", object: "Rack001", path: "Supporting", value: true }], 10);
  assert.equal(model.targetAt(8, 2, "Ground"), "Rack001");
});

test("changes say what looks otherwise now", () => {
  const changes = [
    { type: "ValueSet", object: "Table001", path: "PositionX", value: 4 }, { type: "ObjectAdded", object: object("Jar003", "Jar", 1, 1) },
    { type: "FactRemoved", fact: fact("isOn", "Jar001", "Table001") }, { type: "ObjectRemoved", name: "Robot1" },
  ];
  assert.deepEqual([...model.apply(changes, 9)].sort(), ["Jar001", "Jar003", "Robot1", "Table001"]);
  assert.deepEqual([model.solid("Table001").x, model.solid("Jar003").x, model.kind("Robot1"), model.under("Jar001")], [4, 1, null, null]);
});

test("a value that is taken away is the type's again", () => {
  model.apply([{ type: "ValueSet", object: "Jar001", path: "Color", value: "Blue" }], 8);
  assert.equal(model.value("Jar001", "Color"), "Blue");
  model.apply([{ type: "ValueSet", object: "Jar001", path: "Color", value: null }], 9);
  assert.equal(model.value("Jar001", "Color"), "Red");
});

test("a thing that is carried upstairs is on that storey", () => {
  assert.equal(model.storeyOf("Robot1"), "Ground");
  model.apply([{ type: "ValueSet", object: "Robot1", path: "PositionZ", value: 3 }], 8);
  assert.equal(model.storeyOf("Robot1"), "Upper");
});

test("rooms have their names in the middle of their floors", () => {
  const [hall] = model.spaces("Ground");
  assert.deepEqual([hall.name, hall.label, hall.x, hall.y], ["Hall", "The hall", 5, 5]);
  assert.deepEqual(model.spaces("Upper"), []);
  assert.deepEqual(model.spot("Hall"), { x: 5, y: 5 });
});

test("kinds are told by type, also those that nobody knows", () => {
  assert.deepEqual(["Table001", "Jar001", "Robot1", "Wall001", "Ground"].map((name) => model.kind(name).id), ["support", "thing", "robot", "wall", "none"]);
  assert.equal(model.kindOfType("Unheard").title, "Other");
});

test("what is inside of a thing that is turned, and of a polygon", () => {
  const table = { form: "Box", x: 0, y: 0, turned: Math.PI / 2, width: 1, depth: 4 };
  assert.deepEqual([contains(table, 1.9, 0), contains(table, 0, 1.9)], [true, false]);
  const corner = { form: "Polygon", x: 0, y: 0, turned: 0, outline: [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]] };
  assert.deepEqual([contains(corner, 0.5, 1.5), contains(corner, 1.5, 1.5)], [true, false]);
  const around = bounds(table);
  assert.deepEqual(Object.values(around).map((value) => Math.round(value * 100) / 100), [-2, 2, -0.5, 0.5]);
  assert.equal(reach({ form: "Box", width: 3, depth: 4 }), 2.5);
});

test("an outline that is none is a small disc", () => {
  model.apply([{ type: "ObjectAdded", object: object("Odd", "Table", 1, 1, { "Shape.Form": "Polygon", "Shape.Outline": "0,0 1,x 2" }) }], 8);
  assert.deepEqual([model.solid("Odd").form, model.solid("Odd").radius], [null, 0.1]);
});
