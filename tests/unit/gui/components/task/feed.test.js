import { clock } from "../../../../support/javascript/clock.js";
import { server } from "../../../../support/javascript/server.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import { feed } from "somrs-task/feed.js";

const PAGE = 2; // messages that the server gives at once

function message(number) {
  return { id: `m${number}`, at: number, type: "Execute", participant: `Robot1.Move#undo1.step${number}.2`, sender: "task-manager", relates_to: null, body: '{"type": "Execute", "precondition": "p"}' };
}

let messages, task, seen, leave;

beforeEach(() => {
  server.reset();
  messages = [message(1), message(2), message(3)];
  task = { view: { outcome: null }, events: [{ number: 1 }], contracts: [{ participant: "a", state: "New" }] };
  server.answers = {
    "/api/tasks/t1": () => task,
    "/api/tasks/t1/messages": ({ query }) => {
      const after = Number(query.get("after"));
      return { messages: messages.slice(after, after + PAGE), more: messages.length > after + PAGE };
    },
  };
  leave = feed("t1").listen((one) => (seen = one));
});

afterEach(() => leave());

async function opened() {
  server.socket("/api/live").open();
  await clock.pass(50);
}

const news = (value, more = {}) => server.socket("/api/live").say({ topic: "task t1", value, ...more });

test("all of the task is read, page by page", async () => {
  await opened();
  assert.deepEqual(server.socket("/api/live").sent, [{ follow: ["task t1"], confirm: 1 }]);
  assert.deepEqual(seen.messages.map((one) => one.id), ["m1", "m2", "m3"]);
  const { service, step, asked, body } = seen.messages[0];
  assert.deepEqual({ service, step, asked, body }, { service: "Robot1.Move", step: "undo1.step1", asked: true, body: { precondition: "p" } });
});

test("news are put to what is known", async () => {
  await opened();
  messages.push(message(4));
  news({ view: { outcome: "accomplished" }, events: [{ number: 1 }, { number: 2 }], contracts: [{ participant: "a", state: "Ended" }, { participant: "b" }] });
  await clock.pass(50);
  assert.equal(seen.view.outcome, "accomplished");
  assert.deepEqual(seen.events.map((event) => event.number), [1, 2]);
  assert.deepEqual(seen.contracts, [{ participant: "a", state: "Ended" }, { participant: "b" }]);
  assert.equal(seen.messages.length, 4);
  assert.equal(server.asked.filter((address) => address === "/api/tasks/t1").length, 1, "not all is read again");
});

test("where news were missed, all is read again", async () => {
  await opened();
  task.events.push({ number: 2 }, { number: 3 });
  news({ view: task.view, events: [{ number: 3 }] });
  await clock.pass(50);
  assert.deepEqual(seen.events.map((event) => event.number), [1, 2, 3]);
  news(null, { missed: true });
  await clock.pass(50);
  assert.equal(server.asked.filter((address) => address === "/api/tasks/t1").length, 3);
  assert.equal(seen.messages.length, 3, "messages are not doubled");
});

test("a task that began anew has another life", async () => {
  await opened();
  const { life } = seen;
  messages = [{ ...message(1), id: "other" }];
  news(null, { missed: true });
  await clock.pass(50);
  assert.ok(seen.life > life);
  assert.deepEqual(seen.messages.map((one) => one.id), ["other"]);
});

test("what could not be read is read later", async () => {
  server.away = true;
  seen = null;
  await opened();
  assert.equal(seen, null);
  server.away = false;
  await clock.pass(1600);
  assert.equal(seen.messages.length, 3);
});

test("parts of a page share what is read, and who comes later sees it at once", async () => {
  await opened();
  let other = null;
  const stop = feed("t1").listen((one) => (other = one));
  assert.equal(other, seen);
  assert.equal(server.sockets.length, 1);
  stop();
  assert.equal(server.sockets[0].closed, false);
});

test("when nobody looks any more, nothing is asked any more", async () => {
  server.away = true;
  await opened();
  leave();
  assert.equal(server.sockets[0].closed, true);
  const asked = server.asked.length;
  await clock.pass(10000);
  assert.equal(server.asked.length, asked);
});

test("nor when one leaves just while it is read", async () => {
  server.away = true;
  server.socket("/api/live").open();
  leave();
  const asked = server.asked.length;
  await clock.pass(10000);
  assert.equal(server.asked.length, asked);
});
