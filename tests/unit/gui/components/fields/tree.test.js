import { click, mounted, press, settled, text, write } from "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import tree from "../../../../../src/somrs/gui/components/fields/tree.js";

const node = (id, parent = null, more = {}) => ({ id, label: id, parent, count: 0, draft: false, problem: "", ...more });
const NODES = [
  node("Thing"), node("Device", "Thing"), node("Robot", "Device"), node("Mobile", "Robot"), node("Rover", "Mobile"), node("Furniture", "Thing"), node("Table", "Furniture", { count: 3 }),
];

let one;

beforeEach(async () => {
  one = await mounted(tree, { nodes: NODES, selected: "Thing", movable: true, name: "Types", placeholder: "Find a type" });
});

afterEach(() => one.leave());

const rows = () => [...one.element.querySelectorAll('[role="treeitem"]')];
const names = () => rows().map((row) => row.dataset.id);
const row = (id) => rows().find((found) => found.dataset.id === id);
const focused = () => document.activeElement.dataset.id;

test("at first two levels are open", () => {
  assert.deepEqual(names(), ["Thing", "Device", "Robot", "Mobile", "Furniture", "Table"]);
  assert.deepEqual([row("Mobile").getAttribute("aria-expanded"), row("Table").getAttribute("aria-expanded")], ["false", null]);
  assert.deepEqual(["aria-level", "aria-posinset", "aria-setsize"].map((name) => row("Furniture").getAttribute(name)), ["2", "2", "2"]);
  assert.match(text(row("Table")), /Table ?3$/);
});

test("a search shows what matches, and what is above it", async () => {
  const find = one.element.querySelector("input");
  await write(find, "rov");
  assert.deepEqual(names(), ["Thing", "Device", "Robot", "Mobile", "Rover"]);
  assert.deepEqual(rows().map((found) => found.classList.contains("somrs-tree-dim")), [true, true, true, true, false]);
  assert.equal(text(one.element.querySelector('[role="status"]')), "1 of 7");
  await press(find, "Enter");
  assert.deepEqual(one.told, [["pick", "Rover"]]);
  await write(find, "nobody");
  assert.equal(text(one.element.querySelector('[role="status"]')), "No match for “nobody”");
  await press(find, "Escape");
  assert.equal(names().length, 6);
});

test("one goes through the tree by arrow keys", async () => {
  await press(row("Thing"), "ArrowDown");
  assert.equal(focused(), "Device");
  await press(row("Device"), "ArrowLeft");
  assert.deepEqual(names(), ["Thing", "Device", "Furniture", "Table"]);
  await press(row("Device"), "ArrowLeft");
  assert.equal(focused(), "Thing");
  await press(row("Thing"), "End");
  assert.equal(focused(), "Table");
  await press(row("Table"), " ");
  assert.deepEqual(one.told, [["pick", "Table"]]);
  await press(row("Table"), "*");
  assert.ok(names().includes("Rover"));
});

test("letters go to the next name that begins so", async () => {
  await press(row("Thing"), "r");
  assert.equal(focused(), "Robot");
  await press(row("Robot"), "/");
  assert.equal(document.activeElement, one.element.querySelector("input"));
});

test("what is chosen elsewhere is shown", async () => {
  one.given.selected = "Rover";
  await settled();
  assert.equal(row("Rover").getAttribute("aria-selected"), "true");
  assert.equal(row("Rover").tabIndex, 0);
});

async function drag(from, to) {
  const fired = (type) => Object.assign(new Event(type, { bubbles: true, cancelable: true }), { dataTransfer: { setData() {} } });
  row(from).dispatchEvent(fired("dragstart"));
  const over = fired("dragover");
  row(to).dispatchEvent(over);
  row(to).dispatchEvent(fired("drop"));
  await settled();
  return over.defaultPrevented;
}

test("a type is moved by dragging, but not below itself", async () => {
  assert.equal(await drag("Robot", "Furniture"), true);
  assert.deepEqual(one.told, [["move", { id: "Robot", to: "Furniture" }]]);
  assert.deepEqual([await drag("Device", "Robot"), await drag("Robot", "Device"), await drag("Robot", "Robot")], [false, false, false]);
  assert.equal(one.told.length, 1);
});

test("a click chooses, a click at the sign only opens", async () => {
  await click(row("Mobile").querySelector(".somrs-tree-turn"));
  assert.ok(names().includes("Rover"));
  await click(row("Rover"));
  assert.deepEqual(one.told, [["pick", "Rover"]]);
});

test("parents that go round in a circle do not hang it", async () => {
  one.given.nodes = [node("A", "B"), node("B", "A"), node("C")];
  await settled();
  assert.deepEqual(names(), ["C"]);
});
