// The chart, the graph, the timeline, the story and the terms, as they are on the page.

import { click, clock, mounted, page, press, server, settled, text } from "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import chart from "../../../../../src/somrs/gui/components/task/chart.js";
import graph from "../../../../../src/somrs/gui/components/task/graph.js";
import story from "../../../../../src/somrs/gui/components/task/story.js";
import terms from "../../../../../src/somrs/gui/components/task/terms.js";
import timeline from "../../../../../src/somrs/gui/components/task/timeline.js";

const TASK = "urn:uuid:0123456789ab";
const BASE = 1000;
const MOVE = "Robot1.Move#step1";
const GRIP = "Robot2.Grip#step2";

let messages, task, one;

function message(participant, type, at, body = {}, more = {}) {
  const id = `m${messages.length}`;
  messages.push({ id, at: BASE + at, type, participant, sender: "task-manager", relates_to: null, body: JSON.stringify({ type, ...body }), ...more });
  return id;
}

function step(name, after = [], more = {}) {
  return {
    step: name, service_type: name === "step1" ? "Move" : "Grip", inputs: { thing: "Jar001" }, after, because: after.map(() => "Robot1 isNear Jar001"), brought_by: after, state: "New", kind: "physical", learns: [], assumed: [], outputs: {}, foreseen: false,
    service: null, fraction: 0, price: null, duration: null, ...more,
  };
}

beforeEach(() => {
  server.reset();
  messages = [];
  const asked = message(MOVE, "Arrange", 0, { inputs: { thing: "Jar001" }, effect: "Robot1 isNear Jar001" });
  message(MOVE, "Terms", 1, { price: 4, currency: "EUR", duration: 20, valid_until: BASE + 60 }, { relates_to: asked });
  message(MOVE, "Execute", 2);
  message(MOVE, "Progress", 3, { fraction: 0.2, note: "on the way" });
  message(MOVE, "Progress", 4, { fraction: 0.5, note: "on the way" });
  task = {
    view: { submitted_at: BASE, outcome: null, ended_at: null, deadline: null, steps: [step("step1", [], { state: "Executing", fraction: 0.5, service: "Robot1.Move" }), step("step2", ["step1"])], work: [] },
    events: [{ number: 1, at: BASE, kind: "news", step: "", text: "A plan of 2 steps." }, { number: 2, at: BASE + 4, kind: "setback", step: "step1", text: "The drive <broke>." }],
    contracts: [{ participant: MOVE, service: "Robot1.Move", step: "step1", state: "Executing", accepted: true }],
  };
  server.answers[`/api/tasks/${encodeURIComponent(TASK)}`] = () => task;
  server.answers[`/api/tasks/${encodeURIComponent(TASK)}/messages`] = ({ query }) => ({ messages: messages.slice(Number(query.get("after"))), more: false });
});

afterEach(() => one.leave());

async function shown(component, properties) {
  one = await mounted(component, { task: TASK, empty: "Nothing yet.", ...properties });
  if (server.sockets.length) server.socket("/api/live").open();
  await clock.pass(200);
  return one.element;
}

async function news(view = {}) {
  Object.assign(task.view, view);
  server.socket("/api/live").say({ topic: `task ${TASK}`, value: { view: task.view, events: task.events, contracts: task.contracts } });
  await clock.pass(200);
}

const rows = (element) => [...element.querySelectorAll(".somrs-msg")];

test("the chart has a row for each message, but not for every sign of life", async () => {
  const element = await shown(chart);
  assert.equal(text(element.querySelector('[role="status"]')), "4 of 5 messages");
  assert.deepEqual(rows(element).map((row) => text(row.querySelector(".somrs-msg-type"))), ["Arrange", "Terms", "Execute", "Progress"]);
  assert.match(rows(element)[1].getAttribute("aria-label"), /s, Terms, 4 EUR, 20 s, Robot1.Move to Task Manager/);
  element.querySelector("input").click();
  await settled();
  assert.equal(rows(element).length, 5);
});

test("the chart grows, by lifelines too", async () => {
  const element = await shown(chart);
  message(GRIP, "Refuse", 5, { reason: "no <time>" });
  await news();
  assert.match(element.querySelector(".somrs-chart-heads").textContent, /Robot2/);
  const last = rows(element).at(-1);
  assert.ok(last.classList.contains("somrs-msg-bad"));
  assert.equal(text(last.querySelector(".somrs-msg-note")), "no <time>", "what services say is shown as text");
});

test("a message of the chart opens, and leads to the one that it answers", async () => {
  const element = await shown(chart);
  await click(rows(element)[1]);
  const body = () => element.querySelector(".somrs-chart-body");
  assert.match(text(body()), /Terms Robot1.Move → Task Manager/);
  assert.match(text(body()), /currency\s?EUR/);
  assert.equal(rows(element)[1].getAttribute("aria-selected"), "true");
  await click(body().querySelector(".somrs-link"));
  assert.match(text(body()), /Arrange Task Manager → Robot1.Move/);
  assert.equal(rows(element)[1].getAttribute("aria-selected"), "false");
  await press(element.querySelector(".somrs-chart-view"), "Escape");
  assert.equal(body(), null);
});

test("one goes through the chart by keys", async () => {
  const element = await shown(chart);
  const view = element.querySelector(".somrs-chart-view");
  const current = () => rows(element).findIndex((row) => row.getAttribute("aria-selected") === "true");
  await press(view, "End");
  assert.equal(current(), 3);
  await press(view, "ArrowUp");
  assert.equal(current(), 2);
  await press(view, "ArrowDown");
  await press(view, "ArrowDown");
  assert.equal(current(), 3, "it ends at the last one");
  assert.equal(view.getAttribute("aria-activedescendant"), rows(element)[3].id);
});

test("an empty chart says so", async () => {
  messages.length = 0;
  assert.match(text(await shown(chart)), /Nothing yet\./);
});

test("the graph tells how each step goes", async () => {
  const element = await shown(graph, { label: "The plan" });
  const boxes = [...element.querySelectorAll(".somrs-node")];
  assert.equal(boxes[0].getAttribute("aria-label"), "Move, step1, Jar001, at work 50 % · Robot1");
  assert.equal(boxes[1].getAttribute("aria-label"), "Grip, step2, Jar001, not arranged yet");
  assert.equal(element.querySelectorAll(".somrs-edge").length, 1);
  task.view.steps[0] = step("step1", [], { state: "Completed", service: "Robot1.Move" });
  await news();
  assert.equal(element.querySelector(".somrs-node"), boxes[0], "what stays is not drawn anew");
  assert.match(boxes[0].getAttribute("class"), /somrs-is-good/);
});

test("the graph tells what a step finds out, and which steps are only foreseen", async () => {
  task.view.steps = [
    step("step1", [], { kind: "cognitive", learns: ["Jar001"], assumed: ["Jar001 isOn Somewhere"] }),
    step("step2", ["step1"], { foreseen: true }),
  ];
  const boxes = [...(await shown(graph)).querySelectorAll(".somrs-node")];
  assert.equal(boxes[0].querySelector(".somrs-node-what").textContent, "finds out Jar001");
  assert.match(boxes[1].getAttribute("class"), /somrs-node-foreseen/);
  assert.match(boxes[1].getAttribute("aria-label"), /foreseen/);
});

test("the name of a step begins with the text that is seen, also where this is cut", async () => {
  const inputs = { thing: "TheJarWithTheVeryVeryLongName001" };
  task.view.steps = [step("step1", [], { inputs })];
  task.view.work = [{ step: "step1", service_type: "Move", inputs, service: "Robot2.Move", state: "Failed", result: "Failed", situation: "", note: "", began: 1 }];
  const box = (await shown(graph)).querySelector(".somrs-node");
  const words = (phrase) => phrase.match(/\w+/g);
  const seen = words(box.textContent);
  assert.deepEqual(seen.slice(-2), ["1", "failed"]);
  assert.match(box.textContent, /TheJar\w+…/, "it is cut");
  const name = words(box.getAttribute("aria-label"));
  assert.deepEqual(name.slice(0, seen.length), seen);
  assert.ok(name.includes(inputs.thing));
});

test("the graph counts what failed, and shows work beside the plan", async () => {
  const work = { step: "step1", service_type: "Move", inputs: { thing: "Jar001" }, service: "Robot2.Move", state: "Failed", result: "Failed", situation: "", note: "", began: 1 };
  task.view.work = [work, { ...work, step: "look1.step1", service_type: "Look", state: "Completed", began: 2 }];
  const element = await shown(graph);
  assert.match(text(element.querySelector(".somrs-node-tries")), /1 failed/);
  assert.match(text(element.querySelector(".somrs-beside")), /Observation: Look Jar001 Robot2done/);
});

test("a step of the graph is chosen by mouse and by keys, and told in full", async () => {
  const element = await shown(graph);
  const [first, second] = element.querySelectorAll(".somrs-node");
  await click(second);
  assert.deepEqual(one.told, [["step", "step2"]]);
  assert.match(text(element.querySelector(".somrs-graph-told")), /After\s?step1 \(Robot1 isNear Jar001\)/);
  await press(second, "ArrowUp");
  assert.equal(document.activeElement, first);
  await press(first, "Enter");
  assert.match(text(element.querySelector(".somrs-graph-told")), /Enables\s?step2/);
  await press(first, "Escape");
  assert.deepEqual(one.told.map(([, name]) => name), ["step2", "step1", null]);
});

test("a step tells who demanded what", async () => {
  task.view.steps[1] = step("step2", ["step1"], { condition: "Door001.Open = TRUE", demanded_by: ["Robot1.Grip", "Robot2.Grip"] });
  const element = await shown(graph);
  await click(element.querySelectorAll(".somrs-node")[1]);
  assert.match(text(element.querySelector(".somrs-graph-told")), /Demanded\s?Door001.Open = TRUE, by Robot1, Robot2/);
});

test("a mere plan has no states", async () => {
  one = await mounted(graph, { plan: [step("step1")], label: "The plan", empty: "No plan." });
  assert.equal(text(one.element.querySelector(".somrs-node-sign")), "");
  assert.equal(one.element.querySelector(".somrs-legend"), null);
  one.given.plan = [];
  await settled();
  assert.equal(text(one.element), "No plan.");
});

test("the timeline has a lane for each device, and says how long it took", async () => {
  const element = await shown(timeline);
  assert.match(text(element.querySelector(".somrs-times-who")), /Robot1/);
  assert.match(text(element.querySelector(".somrs-times-told")), /^So far/);
  message(MOVE, "Completed", 9);
  message(GRIP, "Execute", 10);
  message(GRIP, "Completed", 12);
  await news({ outcome: "accomplished", ended_at: BASE + 12 });
  assert.equal(element.querySelectorAll(".somrs-bar").length, 2);
  assert.match(text(element.querySelector(".somrs-times-told")), /^Took 12 s\./);
  assert.equal(element.querySelector(".somrs-times-now"), null);
});

test("the bars of the timeline are told one after another by keys, and events are marked", async () => {
  const element = await shown(timeline);
  await press(element.querySelector(".somrs-times-view"), "ArrowRight");
  assert.match(text(element.querySelector(".somrs-times-told")), /^Robot1.Move, step1 \(Jar001\): at work 50 %/);
  assert.equal(element.querySelector(".somrs-mark-setback").getAttribute("aria-label"), "4.00 s: step1: The drive <broke>.");
});

test("the story tells its chapters, and all events when asked", async () => {
  const chapter = { tone: "bad", icon: "error", failure: true, title: "The drive broke", text: "On the way.", left: "", moment: "+4 s", clock: "", lines: [], result: "Replaced", result_icon: "sync", result_tone: "good", took: "2 s" };
  const element = await shown(story, { chapters: [chapter] });
  assert.match(text(element.querySelector(".somrs-story")), /The drive broke ?\+4 s ?On the way\..*Replaced ?2 s/);
  const [first, second] = element.querySelectorAll('[role="tab"]');
  assert.equal(text(second), "listAll events (2)");
  await press(first, "ArrowRight");
  const events = [...element.querySelectorAll(".somrs-event")].map(text);
  assert.match(events[1], /\+4\.00 s ?error ?step1: The drive <broke>\./);
  assert.equal(document.activeElement, second);
});

test("a chapter of waiting links to the task that has reserved the objects", async () => {
  const waits = [{ goal: "Jar002 isOn Table001", href: "/tasks/1a2b", reserved: "has reserved Jar002" }];
  const chapter = { tone: "busy", icon: "hourglass_empty", failure: false, title: "Waiting", text: "", waits, left: "", moment: "+4 s", clock: "", lines: [] };
  const element = await shown(story, { chapters: [chapter] });
  assert.match(text(element.querySelector(".somrs-waits")), /^Waits for\s+Jar002 isOn Table001, which has reserved Jar002\.$/);
  assert.equal(element.querySelector(".somrs-waits a").getAttribute("href"), "/tasks/1a2b");
});

test("of very many events, the latest are shown at first", async () => {
  task.events = Array.from({ length: 305 }, (_, index) => ({ number: index + 1, at: BASE + index, kind: "news", step: "", text: `event ${index + 1}` }));
  const element = await shown(story, { chapters: [] });
  await click(element.querySelectorAll('[role="tab"]')[1]);
  assert.equal(element.querySelectorAll(".somrs-event").length, 300);
  assert.match(text(element.querySelector(".somrs-event")), /event 6$/);
  await click(element.querySelector(".somrs-link"));
  assert.equal(element.querySelectorAll(".somrs-event").length, 305);
});

test("terms are told by step", async () => {
  const row = (key, name, service) => ({ key, step: name, service, tone: "good", icon: "check", word: "chosen", why: "", price: "4 EUR", takes: "20 s", window: "", valid: "", chosen: true });
  one = await mounted(terms, { rows: [row(1, "step1", "Robot1.Move"), row(2, "step2", "Robot2.Grip"), row(3, "step1", "Robot2.Move")] });
  const groups = [...one.element.querySelectorAll("tbody")].map((body) => [text(body.querySelector("th")), body.querySelectorAll(".somrs-terms-service").length]);
  assert.deepEqual(groups, [["step1", 2], ["step2", 1]]);
  one.given.rows = Array.from({ length: 203 }, (_, index) => row(index, "step1", "Robot1.Move"));
  await settled();
  assert.equal(text(one.element.querySelector(".somrs-link")), "Show 3 more");
  one.given.rows = [];
  await settled();
  assert.equal(text(one.element), "No service was asked for terms.");
});

test("the chart follows its end only while that is in sight", async () => {
  const element = await shown(chart);
  const view = element.querySelector(".somrs-chart-view");
  Object.defineProperties(view, { clientHeight: { value: 100 }, scrollHeight: { value: 1000 } });
  view.scrollTop = 0;
  view.dispatchEvent(new Event("scroll"));
  message(GRIP, "Refuse", 5, { reason: "no" });
  await news();
  assert.equal(text(element.querySelector(".somrs-chart-behind")), "1 new ↓");
  assert.equal(view.scrollTop, 0);
  await click(element.querySelector(".somrs-chart-behind"));
  assert.equal(view.scrollTop, 1000);
  assert.ok(page.sized.has(view));
});
