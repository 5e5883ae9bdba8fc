import assert from "node:assert/strict";
import test from "node:test";
import { escaped, fitting, look, sign, word } from "somrs-task/marks.js";
import { clock, said, saidOf, since, span } from "somrs-task/messages.js";

test("what a message says, in few words", () => {
  assert.equal(said({ type: "Terms", body: { price: 4.499, currency: "EUR", duration: 12.6 } }), "4.5 EUR, 13 s");
  assert.equal(said({ type: "Arrange", body: { precondition: "", effect: "Jar isOn Table" } }), "Jar isOn Table");
  assert.equal(said({ type: "Progress", body: { fraction: 0.254 } }), "25 %");
  assert.equal(said({ type: "Progress", body: { fraction: 0.254, note: "at the door" } }), "at the door");
  assert.equal(said({ type: "Failed", body: { situation: "the jar lies on the floor", description: "" } }), "the jar lies on the floor");
  assert.equal(said({ type: "Refuse", body: { reason: "too heavy" } }), "too heavy");
  assert.equal(said({ type: "Accept", body: {} }), "");
});

test("a message as a sentence says who told whom", () => {
  const message = { service: "Robot1.Move", at: 103.5, type: "Execute", body: {} };
  assert.equal(saidOf({ ...message, asked: true }, 100), "3.50 s, Execute, Task Manager to Robot1.Move");
  assert.equal(saidOf({ ...message, type: "Status", body: { state: "Executing" } }, 100), "3.50 s, Status, Executing, Robot1.Move to Task Manager");
  const cut = { ...message, asked: true, body: { precondition: "Jar001 isOn Table001" } };
  assert.equal(saidOf(cut, 100, "Jar001…"), "3.50 s, Execute, Jar001…, Jar001 isOn Table001, Task Manager to Robot1.Move");
});

test("spans of time have as many digits as they need", () => {
  assert.deepEqual([0.123, 9.994, 9.996, 119.9, 120, 3725].map(since), ["0.12 s", "9.99 s", "10.0 s", "119.9 s", "2:00", "1:02:05"]);
  assert.deepEqual([0, 59.6, 119.6, 3599.6].map(span), ["0 s", "60 s", "2:00", "1:00:00"]);
});

test("a moment is told as a watch does", () => {
  assert.equal(clock(new Date(2024, 4, 6, 7, 8, 9, 456).getTime() / 1000), "07:08:09.45");
});

test("states have words and signs, also those that nobody knows", () => {
  assert.deepEqual([word("Executing"), word("Unreachable"), word("Puzzled")], ["at work", "stopped responding", "Puzzled"]);
  assert.deepEqual([look("Failed"), look("Puzzled")], ["somrs-is-bad", "somrs-is-open"]);
  assert.match(sign("Completed", 3, 4), /translate\(3 4\).*stroke-width="2.2"/);
  assert.match(sign("Puzzled"), /^<path/);
});

test("names cannot break the picture, and are cut where there is no room", () => {
  assert.equal(escaped('<b>"R&D\'s"</b>'), "&lt;b&gt;&quot;R&amp;D&#39;s&quot;&lt;/b&gt;");
  assert.deepEqual([fitting("Cupboard", 80, 10), fitting("Cupboard", 50, 10), fitting("Cupboard", 0)], ["Cupboard", "Cupb…", "…"]);
});
