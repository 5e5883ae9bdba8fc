import { clock, mounted, press, server, settled, text, write } from "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import formula from "../../../../../src/somrs/gui/components/formula/formula.js";

const GOOD = { ok: true, unfinished: false, problems: [] };

let field, area, checks, offers;

beforeEach(async () => {
  server.reset();
  checks = { "": { ok: false, unfinished: true, problems: [] } };
  offers = { start: 0, end: 0, items: [] };
  server.answers = {
    "/api/formulas/check": ({ body }) => checks[body.text] ?? GOOD,
    "/api/formulas/complete": () => offers,
  };
  document.execCommand = () => false;
  field = await mounted(formula, { value: "", label: "Wish", good: "That can be planned.", rows: 2, id: "c7" });
  area = field.element.querySelector("textarea");
  area.focus();
});

afterEach(() => field.leave());

const said = () => text(field.element.querySelector(".somrs-fe-said"));
const list = () => [...field.element.querySelectorAll('[role="option"]')].map((one) => text(one.querySelector(".somrs-fe-word")));
const open = () => field.element.querySelector('[role="listbox"]').style.display !== "none";

async function type(words) {
  area.value = words;
  area.setSelectionRange(words.length, words.length);
  await write(area, words);
}

test("what is right is said to be", async () => {
  await type("Jar isOn Table");
  await clock.pass(200);
  assert.match(said(), /That can be planned\.$/);
  assert.equal(field.told.findLast(([event]) => event === "update:value")[1], "Jar isOn Table");
  assert.equal(field.told.findLast(([event]) => event === "checked")[1].ok, true);
});

test("what the server writes is shown, and not told to it again", async () => {
  await type("Jar isOn Table");
  field.shown.write("Jar isOn Shelf", "Jar isOn Table");
  field.shown.write("Jar isIn Shelf", "Jar isOn Shelf");
  await settled();
  assert.equal(area.value, "Jar isIn Shelf");
  assert.deepEqual(field.told.filter(([event]) => event === "update:value"), [["update:value", "Jar isOn Table"]]);
  await type("Jar isOn Shelf");
  assert.deepEqual(field.told.findLast(([event]) => event === "update:value"), ["update:value", "Jar isOn Shelf"]);
});

test("what the user has typed before the server wrote is not lost", async () => {
  await type("Jar isOn Table");
  field.shown.write("Jar isIn Shelf", "");
  field.shown.write("Jar isIn Shelf AND Door.Open", "Jar isIn Shelf");
  await settled();
  assert.equal(area.value, "Jar isOn Table");
  assert.deepEqual(field.told.filter(([event]) => event === "update:value"), [["update:value", "Jar isOn Table"]]);
});

test("what is wrong is underlined, said, and mended by a click", async () => {
  checks["Jar isAt Table"] = { ok: false, unfinished: false, problems: [{ problem: "There is no relation isAt", position: 4, end: 8, hint: "did you mean isOn?" }] };
  await type("Jar isAt Table");
  await clock.pass(200);
  assert.equal(area.getAttribute("aria-invalid"), "true");
  assert.equal(text(field.element.querySelector(".somrs-fe-wrong")), "isAt");
  assert.match(said(), /There is no relation isAt; ?did you mean isOn\?/);
  field.element.querySelector(".somrs-fe-use").click();
  await clock.pass(200);
  assert.equal(area.value, "Jar isOn Table");
  assert.equal(area.getAttribute("aria-invalid"), "false");
});

test("what is not finished is not wrong", async () => {
  checks["Jar isOn"] = { ok: false, unfinished: true, problems: [{ problem: "It ends", position: 8, end: 8, hint: "an object is expected" }] };
  await type("Jar isOn");
  await clock.pass(200);
  assert.match(said(), /Incomplete: an object is expected\./);
  assert.equal(area.getAttribute("aria-invalid"), "false");
});

test("where the server does not answer, that is said, and asked again", async () => {
  server.away = true;
  await type("Jar isOn Table");
  await clock.pass(200);
  assert.match(said(), /Not checked: the system does not answer/);
  server.away = false;
  await clock.pass(2100);
  assert.match(said(), /That can be planned/);
});

test("what can come is offered, and taken by Enter", async () => {
  offers = { start: 0, end: 1, items: [{ text: "Jar001", kind: "object", detail: "Jar", after: " " }, { text: "Jar002", kind: "object", detail: "Jar", after: " " }] };
  await type("J");
  assert.deepEqual([open(), list()], [true, ["Jar001", "Jar002"]]);
  assert.equal(field.element.querySelector('[aria-selected="true"]').textContent.includes("Jar001"), true);
  await press(area, "ArrowDown");
  offers = { start: 7, end: 7, items: [] };
  const event = await press(area, "Enter");
  assert.equal(event.defaultPrevented, true);
  assert.equal(area.value, "Jar002 ");
  assert.equal(open(), false);
});

test("what was chosen stays chosen when a late answer comes", async () => {
  const jars = ["Jar001", "Jar002"].map((name) => ({ text: name, kind: "object", detail: "Jar", after: " " }));
  offers = { start: 0, end: 1, items: jars };
  await type("J");
  let answer;
  server.answers["/api/formulas/complete"] = () =>
    new Promise((done) => {
      answer = done;
    });
  await type("Ja");
  await press(area, "ArrowDown");
  answer({ start: 0, end: 2, items: jars });
  await settled();
  offers = { start: 7, end: 7, items: [] };
  await press(area, "Enter");
  assert.equal(area.value, "Jar002 ");
});

test("where nothing was begun, Enter takes nothing", async () => {
  offers = { start: 1, end: 1, items: [{ text: "isOn", kind: "relation", detail: "", after: " " }] };
  area.value = "J";
  area.setSelectionRange(1, 1);
  await press(area, " ", { ctrlKey: true });
  assert.equal(open(), true);
  const event = await press(area, "Enter");
  assert.equal(event.defaultPrevented, false);
});

test("Escape closes what is offered; Control Enter hands in", async () => {
  offers = { start: 0, end: 1, items: [{ text: "Jar001", kind: "object", detail: "Jar", after: " " }] };
  await type("J");
  await press(area, "Escape");
  assert.equal(open(), false);
  await press(area, "Enter", { ctrlKey: true });
  assert.deepEqual(field.told.findLast(([event]) => event === "submit"), ["submit", "J"]);
});

test("it is checked again when what there is has changed, not when things move", async () => {
  await type("Jar isOn Table");
  await clock.pass(200);
  const socket = server.socket("/api/live");
  socket.open();
  await clock.pass(300);
  const checked = () => server.asked.filter((address) => address.endsWith("/check")).length;
  const before = checked();
  socket.say({ topic: "map", value: { changes: [{ type: "ValueSet" }] } });
  await clock.pass(300);
  assert.equal(checked(), before);
  socket.say({ topic: "map", value: { changes: [{ type: "ObjectRemoved" }] } });
  await clock.pass(300);
  assert.equal(checked(), before + 1);
});
