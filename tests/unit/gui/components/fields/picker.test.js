import { clock, mounted, press, server, settled, text, write } from "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import picker from "../../../../../src/somrs/gui/components/fields/picker.js";

const OPTIONS = [
  { value: "isOn", text: "is on", detail: "a support", group: "Places" }, { value: "isIn", text: "is in", detail: "a container", group: "Places" },
  { value: "sees", text: "sees", detail: "an object on the map", group: "Senses" },
];

let one;

const input = () => one.element.querySelector("input");
const options = () => [...one.element.querySelectorAll('[role="option"]')].map((found) => text(found.querySelector(".somrs-fe-word")));
const open = () => input().getAttribute("aria-expanded") === "true";

beforeEach(() => server.reset());
afterEach(() => one.leave());

async function choices() {
  one = await mounted(picker, { value: "isIn", options: OPTIONS, label: "Relation", id: "c1" });
  input().focus();
  await settled();
}

test("all there is to choose is shown, in its groups, with what is chosen", async () => {
  await choices();
  assert.equal(input().value, "is in");
  assert.deepEqual([open(), options()], [true, ["is on", "is in", "sees"]]);
  assert.deepEqual([...one.element.querySelectorAll(".somrs-pick-group")].map(text), ["Places", "Senses"]);
  assert.match(text(one.element.querySelector('[aria-selected="true"]')), /is in/);
});

test("typing narrows it; what begins so is first", async () => {
  await choices();
  await write(input(), "on");
  assert.deepEqual(options(), ["is on", "is in", "sees"], "names before what is told of them");
  await write(input(), "se");
  assert.deepEqual(options(), ["sees"]);
  await press(input(), "Enter");
  assert.deepEqual(one.told, [["pick", "sees"]]);
  assert.deepEqual([open(), input().value], [false, "sees"]);
});

test("Escape leaves what was chosen before", async () => {
  await choices();
  await write(input(), "sees");
  await press(input(), "Escape");
  assert.deepEqual([open(), input().value, one.told], [false, "is in", []]);
});

test("Tab takes what was typed, and goes on", async () => {
  await choices();
  await write(input(), "is o");
  const event = await press(input(), "Tab");
  assert.deepEqual([one.told, event.defaultPrevented], [[["pick", "isOn"]], false]);
});

test("nothing of that name, and no field to choose in", async () => {
  await choices();
  await write(input(), "xyz");
  assert.equal(text(one.element.querySelector(".somrs-pick-none")), "No matches.");
  await press(input(), "Escape");
  one.given.disable = true;
  await settled();
  await press(input(), "ArrowDown");
  assert.equal(open(), false);
});

test("of a large map, the server is asked, and the last answer counts", async () => {
  const things = { jar: [{ name: "Jar001", type: "Jar", symbol: "inventory", label: "", where: "Table001" }], "": [] };
  server.answers["/api/formulas/things"] = ({ query }) => ({ things: things[query.get("typed")] ?? [], more: query.get("typed") === "jar" });
  one = await mounted(picker, { value: "", source: { type: "Thing" }, label: "Thing", id: "c2" });
  input().focus();
  await write(input(), "ja");
  await write(input(), "jar");
  await clock.pass(100);
  assert.deepEqual(server.asked.filter((address) => address.includes("typed=ja&")), [], "not at each letter");
  assert.deepEqual(options(), ["Jar001"]);
  assert.match(text(one.element.querySelector('[role="listbox"]')), /Jar, at Table001.*More results/);
  server.away = true;
  await write(input(), "jars");
  await clock.pass(100);
  assert.equal(text(one.element.querySelector(".somrs-pick-none")), "The system does not answer.");
});

// A field whose server takes a second for an answer.
async function slowPicker(value = "") {
  const names = ["Chair001", "Jar001", "Jar002", "Jar003"];
  server.answers["/api/formulas/things"] = async ({ query }) => {
    await new Promise((answer) => {
      setTimeout(answer, 1000);
    });
    const typed = query.get("typed").toLowerCase();
    const things = (typed ? names : names.slice(0, 2)).filter((name) => name.toLowerCase().includes(typed));
    return { things: things.map((name) => ({ name, type: name.slice(0, -3), symbol: "inventory", label: "", where: "" })), more: false };
  };
  one = await mounted(picker, { value, source: { type: "Thing" }, label: "Thing", id: "c3" });
  await clock.pass(2000);
  input().focus();
  await settled();
}

test("a choice from an earlier list is not taken for what has been typed since", async () => {
  await slowPicker("Chair001");
  await clock.pass(1000);
  assert.match(text(one.element.querySelector('[aria-selected="true"]')), /Chair001/);
  await write(input(), "jar");
  assert.deepEqual(options(), ["Jar001"], "what fits of those that are known");
  await write(input(), "jar003");
  assert.equal(text(one.element.querySelector(".somrs-pick-none")), "Searching…");
  await press(input(), "Enter");
  assert.deepEqual(one.told, []);
});

for (const key of ["Enter", "Tab"])
  test(`${key} before the answer takes its first choice when it comes`, async () => {
    await slowPicker();
    await write(input(), "jar003");
    await press(input(), key);
    if (key === "Tab") input().blur();
    assert.deepEqual([input().value, one.told], ["jar003", []], "it stays until then");
    await clock.pass(500);
    assert.deepEqual([input().value, one.told], ["jar003", []], "also if the answer to an earlier question comes");
    await clock.pass(1000);
    assert.deepEqual([one.told, input().value, open()], [[["pick", "Jar003"]], "Jar003", false]);
  });

test("what nothing is found for is taken back when the answer comes", async () => {
  await slowPicker("Chair001");
  await write(input(), "jug");
  await press(input(), "Tab");
  input().blur();
  await clock.pass(1500);
  assert.deepEqual([one.told, input().value, open()], [[], "Chair001", false]);
});

test("whoever types on after Enter, or clicks elsewhere, gets no choice of its own", async () => {
  await slowPicker();
  await write(input(), "jar");
  await press(input(), "Enter");
  await write(input(), "jar00");
  await clock.pass(1500);
  assert.deepEqual([one.told, options()], [[], ["Jar001", "Jar002", "Jar003"]]);
  await write(input(), "jar003");
  input().blur();
  await clock.pass(1500);
  assert.deepEqual([one.told, input().value], [[], ""]);
});

test("the choice that somebody has moved to stays chosen when the answer comes", async () => {
  await slowPicker("Chair001");
  await write(input(), "a");
  await clock.pass(1500);
  await write(input(), "ar");
  await press(input(), "ArrowDown");
  await press(input(), "ArrowDown");
  await clock.pass(1500);
  await press(input(), "Enter");
  assert.deepEqual(one.told, [["pick", "Jar002"]]);
});
