import { mounted } from "../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import storage from "../../../../src/somrs/gui/components/draft_storage.js";

let one;

beforeEach(async () => {
  sessionStorage.clear();
  document.body.innerHTML = '<div class="somrs-main"></div>';
  one = await mounted(storage, { shelf: "define" });
});

afterEach(() => one.leave());

const kept = (key) => JSON.parse(sessionStorage.getItem(`define ${key}`));

test("what was kept is found again, and nothing of other forms", async () => {
  one.shown.keep("task", { form: { formula: "Jar" } });
  sessionStorage.setItem("map x", '{"form": {}}');
  const again = await mounted(storage, { shelf: "define" });
  assert.deepEqual(again.told, [["found", [{ form: { formula: "Jar" } }]]]);
  again.leave();
  one.shown.forget("task");
  assert.equal(kept("task"), null);
  assert.deepEqual(one.told, [], "at first there was nothing");
});

test("an initial draft is kept from the start, and not found again until something is written", async () => {
  const initial = { task: { form: { formula: "" } } };
  const first = await mounted(storage, { shelf: "define", initial });
  first.shown.put("task", "formula", "J");
  assert.deepEqual([kept("task"), first.told], [{ form: { formula: "J" } }, []]);
  first.leave();
  const second = await mounted(storage, { shelf: "define", initial });
  assert.deepEqual(second.told, [["found", [{ form: { formula: "J" } }]]]);
  second.leave();
});

test("nothing can be typed before what was found is in the forms", async () => {
  one.shown.keep("task", { form: { formula: "Jar" } });
  const again = await mounted(storage, { shelf: "define" });
  assert.equal(again.shown.page().inert, true);
  again.shown.restored();
  assert.equal(again.shown.page().inert, false);
  again.leave();
});

test("a field is put where it is in the form", () => {
  one.shown.keep("task", { form: { values: { Color: "red" }, name: "a" } });
  one.shown.put("task", "values.Color", "blue");
  one.shown.put("task", "name", "b");
  assert.deepEqual(kept("task"), { form: { values: { Color: "blue" }, name: "b" } });
});

test("a field of what is not in the form, or of no form, is nowhere", () => {
  one.shown.keep("task", { form: { values: null } });
  one.shown.put("task", "values.Color", "blue");
  one.shown.put("task", "other.Color", "blue");
  one.shown.put("nothing", "name", "b");
  assert.deepEqual(kept("task"), { form: { values: null } });
  assert.equal(kept("nothing"), null);
});
