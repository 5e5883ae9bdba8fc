import { clock } from "../../../../support/javascript/clock.js";
import { server } from "../../../../support/javascript/server.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import { get, Live } from "somrs-floorplan/live.js";

let told, live, map;

beforeEach(() => {
  server.reset();
  told = [];
  map = { version: 5 };
  server.answers = { "/api/ontology": { definitions: "all" }, "/api/map": () => map };
  live = new Live((news) => told.push(news));
});

afterEach(() => live.end());

const news = (version, more = {}) => server.socket("/api/live").say({ topic: "map", value: { version, changes: [version] }, ...more });

test("the map is read, and then its changes are told", async () => {
  server.sockets[0].open();
  await clock.pass();
  news(6);
  assert.deepEqual(told, [{ definitions: "all", map: { version: 5 } }, { changes: [6], version: 6 }]);
});

test("what comes while the map is read is told after it, if it is newer", async () => {
  server.sockets[0].open();
  news(5);
  news(6);
  await clock.pass();
  assert.deepEqual(told.map((one) => one.version ?? one.map.version), [5, 6]);
});

test("after a lost connection, and when news were missed, all is read again", async () => {
  server.sockets[0].open();
  await clock.pass();
  server.sockets[0].close();
  assert.deepEqual(told.at(-1), { lost: true });
  await clock.pass(400);
  map = { version: 9 };
  server.sockets[1].open();
  await clock.pass();
  assert.equal(told.at(-1).map.version, 9);
  map = { version: 12 };
  news(12, { missed: true });
  await clock.pass();
  assert.equal(told.at(-1).map.version, 12);
});

test("what could not be read is read later; when it is over, never", async () => {
  server.away = true;
  server.sockets[0].open();
  await clock.pass(100);
  assert.deepEqual(told, []);
  server.away = false;
  await clock.pass(2000);
  assert.equal(told.length, 1);
  live.end();
  const asked = server.asked.length;
  await clock.pass(9000);
  assert.equal(server.asked.length, asked);
});

test("what the server says is wrong is told in its words", async () => {
  server.answers["/api/map"] = { status: 404, problem: "There is no version 99." };
  await assert.rejects(get("/api/map?version=99"), { message: "There is no version 99." });
});
