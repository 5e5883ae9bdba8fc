import { clock } from "../../../../support/javascript/clock.js";
import { server } from "../../../../support/javascript/server.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import { Feed } from "somrs-scene/feed.js";

let told, feed;

const CALLS = ["scene", "changed", "placed", "movers", "robots", "frame", "alive", "trouble"];
const hears = Object.fromEntries(CALLS.map((call) => [call, (...values) => told.push([call, ...values])]));
const calls = (name) => told.filter(([call]) => call === name).map(([, ...values]) => values);
const news = (changes, more = {}) => server.socket("/api/live").say({ topic: "map", value: { changes }, ...more });

async function begun(version = null) {
  feed = new Feed(hears, version);
  server.socket("/api/live")?.open();
  await clock.pass(50);
}

beforeEach(() => {
  server.reset();
  told = [];
  server.answers["/api/scene"] = ({ query }) => ({ names: query.get("names"), version: query.get("version") });
});

afterEach(() => feed.stop());

test("what there is is read once one is told what changes", async () => {
  await begun();
  assert.deepEqual(server.socket("/api/live").sent, [{ follow: ["map", "ontology"], confirm: 1 }]);
  assert.deepEqual(server.asked, ["/api/scene"]);
  assert.equal(calls("scene").length, 1);
});

test("what changes before one is told what changes is not missed", async () => {
  feed = new Feed(hears, null);
  server.socket("/api/live").open({ slow: true });
  await clock.pass(500);
  assert.deepEqual(server.asked, []);
  server.socket("/api/live").confirm();
  await clock.pass(50);
  assert.deepEqual(server.asked, ["/api/scene"]);
});

test("changes are gathered, and only what can be seen is asked for", async () => {
  await begun();
  feed.isMover = (name) => name === "Robot1";
  news([{ type: "ObjectAdded", object: { name: "Jar 1" } }, { type: "ObjectRemoved", name: "Jar2" }, { type: "ValueSet", object: "Robot1", path: "PositionX" }]);
  news([{ type: "ValueSet", object: "Robot2", path: "Charge" }, { type: "ValueSet", object: "Table1", path: "PositionX" }]);
  await clock.pass(200);
  assert.deepEqual(server.asked.slice(1), ["/api/scene?names=Jar%201%2CJar2%2CTable1"]);
  assert.deepEqual(calls("changed")[0][1], ["Jar 1", "Jar2", "Table1"]);
});

test("so much at once that no address would hold it is read as a whole", async () => {
  await begun();
  news(Array.from({ length: 101 }, (_, index) => ({ type: "ObjectRemoved", name: `Jar${index}` })));
  await clock.pass(200);
  assert.deepEqual(server.asked.slice(1), ["/api/scene"]);
});

test("what stands on what is told at once", async () => {
  await begun();
  const fact = { relation: "isOn", arguments: ["Jar1", "Table1"] };
  news([{ type: "FactAdded", fact }, { type: "FactRemoved", fact: { ...fact, relation: "isHeldBy" } }, { type: "FactAdded", fact: { ...fact, relation: "isNear" } }]);
  assert.deepEqual(calls("placed"), [["Jar1", "isOn", "Table1", true], ["Jar1", "isHeldBy", "Table1", false]]);
});

// A server that answers in the order in which the test has it answer: functions that answer the requests with what is so then.
function slowServer() {
  const answers = [];
  server.answers["/api/scene"] = ({ query }) =>
    new Promise((done) => {
      answers.push((content) => done({ names: query.get("names"), content }));
    });
  return answers;
}

test("of two readings, none is shown after a newer one", async () => {
  await begun();
  const answers = slowServer();
  news([{ type: "ValueSet", object: "Table1", path: "PositionX" }]);
  await clock.pass(200);
  news([{ type: "ValueSet", object: "Table1", path: "PositionX" }]);
  await clock.pass(200);
  assert.equal(answers.length, 1); // the second one begins when the first one is there
  answers[0]("old");
  await clock.pass(50);
  answers[1]("new");
  await clock.pass(50);
  assert.deepEqual(calls("changed").map(([found, names]) => [found.content, names]), [["old", ["Table1"]], ["new", ["Table1"]]]);
});

test("a change is shown although the whole scene is read meanwhile", async () => {
  const answers = slowServer();
  await begun();
  news([{ type: "ValueSet", object: "Table1", path: "PositionX" }]);
  await clock.pass(500);
  answers[0]("before the change");
  await clock.pass(50);
  answers[1]("after the change");
  await clock.pass(50);
  const shown = told.filter(([call]) => ["scene", "changed"].includes(call)).map(([call, found]) => [call, found.content]);
  assert.deepEqual(shown, [["scene", "before the change"], ["changed", "after the change"]]);
});

test("what is told while the scene is read is not undone by it", async () => {
  const answers = slowServer();
  await begun();
  news([{ type: "FactAdded", fact: { relation: "isOn", arguments: ["Jar1", "Table1"] } }]);
  await clock.pass(50);
  answers[0]("before the fact");
  await clock.pass(50);
  assert.deepEqual(told.map(([call]) => call).filter((call) => call !== "trouble"), ["scene", "placed"]);
});

test("a reading whose connection is lost does not hold up the next one, and is not shown", async () => {
  const answers = slowServer();
  await begun();
  server.socket("/api/live").close();
  await clock.pass(400);
  server.socket("/api/live").open();
  await clock.pass(50);
  answers[1]("new");
  await clock.pass(50);
  answers[0]("old");
  await clock.pass(50);
  assert.deepEqual(calls("scene").map(([found]) => found.content), ["new"]);
});

test("a lost connection is said, made again, and all is read anew", async () => {
  await begun();
  server.socket("/api/live").close();
  assert.match(calls("trouble").at(-1)[0], /connection to the server is lost/);
  await clock.pass(400);
  server.socket("/api/live").open();
  await clock.pass(50);
  assert.deepEqual(calls("trouble").at(-1), [null]);
  assert.equal(calls("scene").length, 2);
});

test("a server that does not answer is asked again, one that refuses is not", async () => {
  server.away = true;
  await begun();
  assert.match(calls("trouble").at(-1)[0], /does not answer/);
  server.away = false;
  server.answers["/api/scene"] = { status: 404, problem: "There is no such version." };
  await clock.pass(2100);
  assert.deepEqual(calls("trouble").at(-1), ["There is no such version."]);
  const asked = server.asked.length;
  await clock.pass(9000);
  assert.equal(server.asked.length, asked);
});

test("a map of the past is read once", async () => {
  await begun(12);
  assert.deepEqual([server.asked, server.sockets], [["/api/scene?version=12"], []]);
});

test("poses are for the movers that were told, and no others", async () => {
  await begun();
  const poses = server.socket("/api/poses");
  const frame = (table) => {
    const buffer = new ArrayBuffer(24 + 4 + 16);
    const head = new DataView(buffer);
    head.setFloat64(0, 2.5, true);
    head.setUint32(16, table, true);
    head.setUint32(20, 1, true);
    new Float32Array(buffer, 28).set([1, 2, 3, 4]);
    return buffer;
  };
  poses.say({ table: 3, movers: [{ name: "Robot1", numbers: 4 }], robots: { Robot1: {} }, alive: false });
  poses.say(frame(3));
  poses.say(frame(4));
  assert.deepEqual(calls("frame").map(([time, which, values]) => [time, [...which], [...values]]), [[2.5, [0], [1, 2, 3, 4]]]);
  assert.deepEqual([calls("movers").length, calls("robots").length, calls("alive")], [1, 1, [[false]]]);
});

test("while nobody looks, nothing comes", async () => {
  await begun();
  feed.rest();
  assert.equal(server.socket("/api/poses").closed, true);
  await clock.pass(9000);
  assert.equal(server.sockets.length, 2);
  feed.follow();
  assert.equal(server.sockets.length, 3);
});
