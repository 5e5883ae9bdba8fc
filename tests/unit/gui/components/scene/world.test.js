import { page } from "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import { THREE } from "nicegui-scene";
import { described, Labels, listed, Marks, Pilot, summary, World } from "somrs-scene";
import { form } from "somrs-scene/forms.js";
import { ownerOf, Pieces, shade } from "somrs-scene/pieces.js";

const TYPES = { Jar: ["Jar", "Graspable"], Table: ["Table", "Support"], Floor: ["Floor"], Wall: ["Wall"], Robot: ["MobileRobot"] };

const floor = (name, z, more = {}) => ({ name, type: "Floor", kind: "floor", form: "Box", x: 0, y: 0, z, width: 10, depth: 10, height: 0.1, label: name, storey: `Storey ${name}`, ...more });
const jar = (name, x, y, z = 0.85, more = {}) => ({ name, type: "Jar", kind: "thing", form: "Cylinder", x, y, z, radius: 0.05, height: 0.1, color: "#ff0000", at: { relation: "isOn", object: "Table001" }, ...more });

let world, scene;

beforeEach(() => {
  page.calm = true;
  scene = new THREE.Scene();
  world = new World(scene);
  world.show({
    types: TYPES,
    bodies: [
      floor("Hall", -0.1), { name: "Wall001", type: "Wall", kind: "wall", form: "Box", x: 5, y: 0, z: 0, width: 0.2, depth: 10, height: 2.5 },
      { name: "Table001", type: "Table", kind: "furniture", form: "Box", x: 2, y: 2, z: 0, width: 1, depth: 1, height: 0.75 },
      jar("Jar001", 2, 2), jar("Jar002", 3, 2), jar("Jar010", 0, 0, 0, { unknown: true }),
      { name: "Robot1", type: "Robot", kind: "robot", form: "Cylinder", x: -2, y: -2, z: 0, radius: 0.25, height: 0.4, color: "#00ff00" },
    ],
  });
});

test("things that look the same are drawn in one call, however many they are", () => {
  assert.equal(world.crowds.size, 2, "those of which nobody knows look otherwise");
  world.change({ types: {}, bodies: Array.from({ length: 20 }, (_, index) => jar(`New${index}`, index, 0)) }, []);
  assert.equal(world.crowds.size, 2);
  assert.deepEqual([world.where("New19").x, world.where("Jar001").x], [19, 2]);
});

test("what is taken away is gone, and the others stay where they are", () => {
  world.change({ types: {}, bodies: [] }, ["Jar001", "Jar010"]);
  assert.equal(world.where("Jar001"), null);
  assert.equal(world.where("Jar002").x, 3);
  assert.equal(world.crowds.size, 1);
});

test("what moves is where it was told to be", () => {
  world.move("Robot1", [1, 2, 0, 0.5]);
  world.move("Nobody", [0, 0, 0, 0]);
  assert.deepEqual(world.where("Robot1"), { x: 1, y: 2, z: 0, yaw: 0.5 });
});

test("a click finds what is nearest to the eye", () => {
  const down = (x, y) => world.pick(new THREE.Raycaster(new THREE.Vector3(x, y, 10), new THREE.Vector3(0, 0, -1)));
  scene.updateMatrixWorld(true);
  assert.deepEqual([down(2, 2), down(2.4, 2.4), down(-4, 4), down(50, 50)], ["Jar001", "Table001", "Hall", null]);
});

test("of several storeys one is looked at, where most can move", () => {
  assert.deepEqual(world.levels, [0]);
  world.change({ types: {}, bodies: [floor("Attic", 2.9), jar("High", 0, 0, 3)] }, []);
  assert.deepEqual([world.levels, world.level, world.storeys[1]], [[0, 3], 0, { z: 3, name: "Storey Attic" }]);
  assert.deepEqual([world.visible("Jar001"), world.visible("High"), world.visible("Attic")], [true, false, false]);
  world.level = null;
  world.build();
  assert.equal(world.visible("High"), true);
});

test("storeys of one height are each in the list, and shown together", () => {
  world.change({ types: {}, bodies: [floor("Barn", -0.1, { x: 20 }), floor("Attic", 2.9), jar("Far", 20, 0, 0)] }, []);
  assert.deepEqual(world.storeys, [{ z: 0, name: "Storey Hall" }, { z: 0, name: "Storey Barn" }, { z: 3, name: "Storey Attic" }]);
  assert.deepEqual([world.level, world.visible("Far"), world.visible("Jar001")], [0, true, true]);
});

test("all there is fits into the picture", () => {
  const { min, max } = world.bounds();
  assert.ok(min.x <= -5 && max.x >= 5 && max.z >= 0.6, "walls are cut low at first");
  world.low = false;
  world.build();
  assert.ok(world.bounds().max.z >= 2.5);
});

test("where things are, in words", () => {
  assert.equal(described(world, "Jar001"), "on Table001");
  assert.equal(described(world, "Jar010"), "position unknown; shown at its last known position");
  assert.equal(described(world, "Robot1"), "at -2.0, -2.0 in Hall");
  world.works.set("Robot1", { holding: "Jar001", doing: "DriveTo", faults: ["drive", "odd"] });
  assert.equal(described(world, "Robot1"), "at -2.0, -2.0 in Hall; carries Jar001; drives; drive broken, odd");
  assert.equal(described(world, "Jar001"), "held by Robot1");
  assert.equal(described(world, "Nobody"), "");
});

test("the picture in a sentence", () => {
  assert.equal(summary("Office", world), "3D view of Office: 1 robot, 3 things, 1 piece of furniture.");
  world.works.set("Robot1", { faults: ["gripper"] });
  assert.match(summary("Office", world), /Robot1: at -2\.0, -2\.0 in Hall; gripper stuck\.$/);
  assert.equal(summary("Void", new World(new THREE.Scene())), "3D view of Void: nothing to see.");
});

test("things are listed, robots first, numbers by their size", () => {
  const names = (wanted, most = 10) => listed(world, wanted, most).rows.map((row) => row.name);
  assert.deepEqual(names(""), ["Robot1", "Jar001", "Jar002", "Jar010"]);
  assert.deepEqual(names(" TABLE "), ["Table001"], "furniture only when it is looked for");
  assert.deepEqual([names("jar", 2), listed(world, "jar", 2).more], [["Jar001", "Jar002"], 1]);
});

test("everything is drawn over every form, in full", () => {
  const shapes = [{ form: "Box", width: 1, depth: 0.6 }, { form: "Cylinder", radius: 0.5, width: 0, depth: 0 }, { form: "Polygon", radius: 0, width: 0, depth: 0, outline: [[0.5, 0], [0, 0.5], [-0.5, 0]] }];
  for (const type of ["Table", "Cupboard", "Shelf", "Platform", "Chair", "Plant", "Bin", "Jar", "Can", "Bottle", "Cup", "Carton", "Camera", "Person", "Unheard"])
    for (const shape of shapes) {
      const pieces = new Pieces().frame(0, 0, 0, 0);
      form(pieces, { type, height: 0.8, color: "#808080", ...shape }, [type]);
      const box = pieces.geometry().boundingSphere;
      assert.ok(Number.isFinite(box.radius), `${type} over ${shape.form}`);
      assert.ok(box.radius > 0.3, `${type} over ${shape.form} is as large as it is: ${box.radius}`);
      const across = Math.max(...pieces.position.filter((_, index) => index % 3 === 0)) - Math.min(...pieces.position.filter((_, index) => index % 3 === 0));
      assert.ok(across > 0.3, `${type} over ${shape.form} is as wide as it is: ${across}`);
    }
});

test("a piece is known by its owner", () => {
  const owners = [{ from: 0, name: "A" }, { from: 12, name: "B" }, { from: 24, name: "C" }];
  assert.deepEqual([0, 11, 12, 23, 99].map((face) => ownerOf(owners, face)), ["A", "A", "B", "B", "C"]);
  assert.equal(ownerOf([], 3), null);
  assert.deepEqual([shade("#808080", 1), shade("#ffffff", 0)], ["#808080", "#000000"]);
});

test("what is chosen has a ring and a pin, as long as it is seen", () => {
  const marks = new Marks(scene, world);
  marks.set(["Jar001", "Nobody"]);
  marks.place();
  const [[name, mark]] = [...marks.marks];
  assert.deepEqual([name, mark.visible, mark.position.x], ["Jar001", true, 2]);
  assert.ok(mark.children[1].position.z > 0.1, "the pin is above it");
  marks.set([]);
  assert.equal(marks.marks.size, 0);
});

function stage() {
  const camera = new THREE.PerspectiveCamera(38, 4 / 3, 0.05, 500);
  camera.up.set(0, 0, 1);
  return { camera, want() {}, shine() {} };
}

test("the camera sees all, from each side from which it looks", () => {
  const pilot = new Pilot(stage(), document.createElement("div"));
  const { camera } = pilot;
  const box = world.bounds();
  for (const how of [{}, { fromAbove: true }]) {
    pilot.fit(box, { ...how, at_once: true });
    camera.updateMatrixWorld();
    for (const x of [box.min.x, box.max.x])
      for (const y of [box.min.y, box.max.y]) {
        const seen = new THREE.Vector3(x, y, box.min.z).project(camera);
        assert.ok(Math.abs(seen.x) <= 1 && Math.abs(seen.y) <= 1, `${seen.x} ${seen.y}`);
      }
  }
  pilot.dispose();
});

test("keys turn, move and zoom the camera; others are left alone", () => {
  const pilot = new Pilot(stage(), document.createElement("div"));
  pilot.fit(world.bounds(), { at_once: true });
  const distance = () => pilot.camera.position.distanceTo(pilot.controls.target);
  const before = distance();
  assert.equal(pilot.key({ key: "+" }), true);
  assert.ok(distance() < before);
  const target = pilot.controls.target.clone();
  pilot.key({ key: "ArrowLeft" });
  assert.ok(pilot.controls.target.equals(target), "turning looks at the same");
  pilot.key({ key: "ArrowRight", shiftKey: true });
  assert.ok(pilot.controls.target.x > target.x);
  assert.deepEqual([pilot.key({ key: "x" }), pilot.key({ key: "+", ctrlKey: true })], [false, false]);
  pilot.dispose();
});

test("names in the picture do not cover each other, and say what is wrong", () => {
  const pilot = new Pilot(stage(), document.createElement("div"));
  pilot.fit(world.bounds(), { at_once: true });
  pilot.camera.updateMatrixWorld();
  const layer = document.createElement("div");
  Object.defineProperties(window.HTMLElement.prototype, { offsetWidth: { value: 60, configurable: true }, offsetHeight: { value: 16, configurable: true } });
  const labels = new Labels(layer, pilot, world);
  world.works.set("Robot1", { faults: ["drive"], holding: "Jar009" });
  labels.draw(800, 600);
  const robot = [...layer.children].find((one) => one.textContent.startsWith("Robot1"));
  assert.equal(robot.textContent, "Robot1⚠ drive broken↑ Jar009");
  const shown = [...layer.children].filter((one) => one.style.visibility === "visible").map((one) => one.style.transform.match(/-?\d+/g).map(Number));
  assert.ok(shown.length >= 3);
  for (const [index, [x, y]] of shown.entries()) for (const [u, v] of shown.slice(index + 1)) assert.ok(Math.abs(x - u) >= 60 || Math.abs(y - v) >= 16);
  delete window.HTMLElement.prototype.offsetWidth;
  delete window.HTMLElement.prototype.offsetHeight;
  pilot.dispose();
});
