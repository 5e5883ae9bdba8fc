import { clock } from "../../../support/javascript/clock.js";
import { server } from "../../../support/javascript/server.js";
import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import { follow } from "live";

let heard, stop;

beforeEach(() => {
  server.reset();
  heard = [];
  stop = follow(["map"], { news: (news) => heard.push(news), open: () => heard.push("open"), lost: () => heard.push("lost") });
});

test("one says what one wants to hear of, and hears it", () => {
  const socket = server.socket("/api/live");
  assert.equal(socket.url, "ws://somrs.test/api/live");
  socket.open();
  socket.say({ topic: "map" });
  assert.deepEqual(socket.sent, [{ follow: ["map"], confirm: 1 }]);
  assert.deepEqual(heard, ["open", { topic: "map" }]);
  stop();
});

test("nothing is read before it is followed, since changes in between would be missed", () => {
  const socket = server.socket("/api/live");
  socket.open({ slow: true });
  assert.deepEqual(heard, []);
  socket.confirm();
  assert.deepEqual(heard, ["open"]);
  stop();
});

test("a connection that is lost is made again, the longer it fails the less often", async () => {
  const tried = [];
  for (let at = 0; at < 8000; at += 100) {
    const socket = server.sockets.at(-1);
    if (!socket.closed) {
      tried.push(at);
      socket.close();
    }
    await clock.pass(100);
  }
  assert.deepEqual(tried, [0, 300, 900, 2100, 4600, 7100]);
  server.sockets.at(-1).open();
  assert.equal(heard.at(-1), "open");
  stop();
});

test("who does not want to hear any more is left alone", async () => {
  server.sockets[0].open();
  stop();
  await clock.pass(5000);
  assert.equal(server.sockets.length, 1);
  assert.deepEqual(heard, ["open"], "nothing was lost");
});
