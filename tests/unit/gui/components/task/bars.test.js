import assert from "node:assert/strict";
import test from "node:test";
import { drawn, lanes, ticks, works } from "somrs-task/bars.js";

const BASE = 1000;
const view = { submitted_at: BASE, outcome: null };

function message(participant, type, at, body = {}) {
  const service = participant.split("#")[0];
  return { participant, service, step: "step1", type, at: BASE + at, body };
}

const contract = (participant, more) => ({ participant, service: participant.split("#")[0], step: "step1", state: "Executing", accepted: true, ...more });

const one = "Robot1.Move#step1";
const arranged = [message(one, "Arrange", 1, { inputs: { thing: "Jar001" } }), message(one, "Terms", 2, { duration: 20 })];

test("work is from when it was begun until it was done", () => {
  const [work] = works({ view, contracts: [], messages: [...arranged, message(one, "Execute", 5), message(one, "Completed", 15)] });
  assert.deepEqual([work.device, work.what, work.start - BASE, work.ended - BASE, work.until - BASE, work.state], ["Robot1", "Jar001", 5, 15, 25, "Completed"]);
});

test("what goes on has how far it is, and no end", () => {
  const messages = [...arranged, message(one, "Execute", 5), message(one, "Progress", 8, { fraction: 0.4 }), message(one, "Execute", 9)];
  const found = works({ view, contracts: [], messages });
  assert.equal(found.length, 1, "an order that is said again is no other work");
  assert.deepEqual([found[0].ended, found[0].fraction, found[0].start - BASE], [null, 0.4, 5]);
});

test("undoing is work of its own", () => {
  const messages = [...arranged, message(one, "Execute", 5), message(one, "Completed", 9), message(one, "Compensate", 12), message(one, "Compensated", 14)];
  assert.deepEqual(works({ view, contracts: [], messages }).map(({ kind, state, until }) => [kind, state, until !== null]), [["does", "Completed", true], ["undoes", "Compensated", false]]);
});

test("who fell silent worked until it was heard last", () => {
  const messages = [...arranged, message(one, "Execute", 5), message(one, "Progress", 7, { fraction: 0.2 })];
  const silent = works({ view, contracts: [contract(one, { state: "Unreachable" })], messages });
  assert.deepEqual([silent[0].state, silent[0].ended - BASE], ["Unreachable", 7]);
  const left = works({ view: { ...view, outcome: "failed" }, contracts: [contract(one)], messages });
  assert.equal(left[0].state, "Unreachable");
});

test("what is arranged and not begun waits, as long as the task goes on", () => {
  const contracts = [contract(one, { state: "Committed", start: BASE + 30, finish: BASE + 50 })];
  const [work] = works({ view, contracts, messages: arranged });
  assert.deepEqual([work.kind, work.start - BASE, work.until - BASE], ["waits", 30, 50]);
  assert.deepEqual(works({ view: { ...view, outcome: "cancelled" }, contracts, messages: arranged }), []);
});

test("bars of one device that would overlap are in rows of their own", () => {
  const bar = (device, start, ended) => ({ device, start, ended, kind: "does" });
  const found = [bar("A", 0, 10), bar("B", 1, 2), bar("A", 5, 12), bar("A", 10, null)];
  const { row, names, count } = lanes(found, 20);
  assert.equal(count, 3);
  assert.deepEqual(names, [["A", 0, 2], ["B", 2, 1]]);
  assert.deepEqual(found.map((work) => row.get(work)), [0, 2, 1, 0]);
});

test("there are never more lines than asked for", () => {
  assert.deepEqual(ticks(9, 10), [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
  assert.deepEqual(ticks(60, 4), [0, 20, 40, 60]);
  assert.equal(ticks(7199, 8).at(-1), 5400);
});

test("a bar says all in words", () => {
  const [work] = works({ view, contracts: [], messages: [...arranged, message(one, "Execute", 5), message(one, "Progress", 8, { fraction: 0.4 })] });
  const text = drawn(work, 7, 0, (at) => (at - BASE) * 10, BASE + 15, 900);
  assert.match(text, /data-bar="7"/);
  assert.match(text, /aria-label="Robot1.Move, step1 \(Jar001\): at work 40 %, from 5.00 s to 15.0 s, promised until 25.0 s"/);
  assert.match(text, /class="somrs-times-promised" x="50" y="0" width="200"/);
  assert.match(text, /class="somrs-bar-fill" x="50" y="2" width="100"/);
});

test("a bar without room has neither text nor sign beside it", () => {
  const [work] = works({ view, contracts: [], messages: [...arranged, message(one, "Execute", 5), message(one, "Failed", 6)] });
  const text = drawn(work, 0, 0, (at) => (at - BASE) * 10, BASE + 15, 70);
  assert.doesNotMatch(text, /<text|somrs-sign/);
  assert.match(text, /failed, from 5.00 s to 6.00 s/);
});
