import "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import { Frame } from "somrs-floorplan/frame.js";
import { Labels } from "somrs-floorplan/labels.js";
import { arrow, Links } from "somrs-floorplan/links.js";
import { Model } from "somrs-floorplan/model.js";
import { Sheets } from "somrs-floorplan/sheets.js";
import { svg } from "somrs-floorplan/layers.js";
import { View } from "somrs-floorplan/view.js";
import { building, DEFINITIONS, fact, object } from "./building.js";

let layer, view, model;

beforeEach(() => {
  layer = svg("g");
  view = new View();
  view.size(800, 600);
  model = new Model();
  model.learn(DEFINITIONS);
  model.read(building());
});

const label = (name, x, y, rank, more = {}) => ({ name, text: name, x, y, half: { w: 5, h: 5 }, rank, classes: "", ...more });
const names = () => [...layer.children].map((one) => one.textContent);
const at = (name) => model.solid(name);

test("names do not cover each other; the important one stays", () => {
  const labels = new Labels(layer);
  const crowd = Array.from({ length: 9 }, (_, index) => label(`Jar00${index}`, 400, 300, index));
  labels.place(crowd, [], view);
  assert.ok(names().length < 9 && names().includes("Jar008"));
  assert.equal(new Set([...layer.children].map((one) => `${one.getAttribute("x")} ${one.getAttribute("y")}`)).size, names().length);
});

test("what is chosen has its name always, what is out of sight none", () => {
  const labels = new Labels(layer);
  labels.place([label("Robot1", 400, 300, 90), label("Chosen", 400, 300, 1000, { always: true }), label("Far", 4000, 300, 99)], [], view);
  assert.ok(names().includes("Chosen") && !names().includes("Far"));
  labels.place([label("Robot1", 400, 300, 90)], [], view);
  assert.deepEqual(names(), ["Robot1"]);
});

test("names keep off small things, and go along with what they name", () => {
  const labels = new Labels(layer);
  const below = { x: 400, y: 300 + 5 + 3 + 7 };
  labels.place([label("Jar", 400, 300, 1)], [below], view);
  assert.notEqual(layer.firstChild.getAttribute("y"), (below.y + 4).toFixed(1));
  labels.follow("Jar", { x: 410, y: 295 });
  assert.equal(layer.firstChild.getAttribute("transform"), "translate(10.0 -5.0)");
});

test("a large piece of furniture has its name inside", () => {
  new Labels(layer).place([label("Table", 400, 300, 1, { inside: true, half: { w: 60, h: 30 } })], [], view);
  assert.deepEqual([layer.firstChild.getAttribute("x"), layer.firstChild.getAttribute("y")], ["400.0", "304.0"]);
});

const shown = (more) => {
  const [world, screen] = [svg("g"), svg("g")];
  new Frame(world, screen).show({ model, view, at, selected: null, turnable: false, target: null, found: [], ghost: null, moving: [], unknown: [], ...more });
  return { world, screen };
};

test("what is chosen has a frame, and a handle where it may be turned", () => {
  const { world, screen } = shown({ selected: "Table001", turnable: true });
  assert.equal(world.querySelectorAll(".fp-chosen").length, 1);
  const [x, y] = /translate\(([\d.]+) ([\d.]+)\)/.exec(screen.querySelector("[data-handle]").getAttribute("transform")).slice(1).map(Number);
  assert.ok(x > view.toScreen(2.5, 3).x && y === view.toScreen(2, 3).y, "before its front");
  view.scale = 5;
  assert.equal(shown({ selected: "Jar001" }).screen.querySelectorAll(".fp-chosen-ring").length, 1, "what is small has a ring");
});

test("what was found is ringed, what is unknown has a question mark, what moved leaves its outline", () => {
  const { world, screen } = shown({
    found: ["Jar001", "Nowhere"], unknown: ["Robot1"], moving: ["Table001", "Jar001"], at: (name) => (name === "Table001" ? { ...at(name), x: 5 } : at(name)),
  });
  assert.deepEqual([world.querySelectorAll(".fp-found").length, screen.querySelectorAll(".fp-ring").length], [1, 1]);
  assert.equal(screen.querySelector(".fp-question").textContent, "?");
  assert.equal(world.querySelectorAll(".fp-known").length, 1);
});

test("relations are arrows between what is on the plan", () => {
  const links = new Links(layer);
  links.moved(view);
  model.apply([{ type: "ObjectAdded", object: object("<b>", "Jar", -2, -2) }, { type: "FactAdded", fact: fact("isOn", "<b>", "Table001") }], 8);
  links.show(model, ["isOn"], (name) => at(name));
  assert.deepEqual([...layer.querySelectorAll("title")].map((one) => one.textContent), ["Jar001 isOn Table001", "<b> isOn Table001"]);
  const before = layer.innerHTML;
  links.follow(new Set(["Robot1"]), at);
  assert.equal(layer.innerHTML, before);
  links.follow(new Set(["Table001"]), () => ({ x: 4, y: 4 }));
  assert.notEqual(layer.innerHTML, before);
  assert.match(arrow({ x: 0, y: 0 }, { x: 10, y: 0 }).innerHTML, /M0\.0 0\.0L10\.0 0\.0/);
});

test("a large plan is shifted while it is moved, and painted when it rests", () => {
  const sheets = new Sheets(document.body.appendChild(document.createElement("div")));
  const ground = sheets.groups.get("ground");
  sheets.show(view, 5000);
  const painted = ground.getAttribute("transform");
  view.pan(50, 0);
  sheets.show(view, 5000);
  assert.equal(ground.getAttribute("transform"), painted);
  assert.equal(ground.parentNode.style.transform, "translate(50px, 0px) scale(1)");
  sheets.end();
  sheets.show(view, 10);
  assert.notEqual(ground.getAttribute("transform"), painted);
  assert.equal(ground.parentNode.style.transform, "");
});
