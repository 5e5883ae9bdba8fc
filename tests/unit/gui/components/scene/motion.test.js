import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import { Motion } from "somrs-scene/motion.js";

const AHEAD = 100; // s that this clock is ahead of the server's

let motion;

beforeEach(() => {
  motion = new Motion();
  motion.set([{ name: "Robot1", numbers: 4 }, { name: "Jar001", numbers: 6 }]);
});

const hear = (clock, x, yaw = 0) => motion.hear(clock, [0], new Float32Array([x, 0, 0, yaw]), clock + AHEAD);

function drawn(now) {
  let found = null;
  motion.play(now, (name, pose) => (found = { name, x: pose[0], yaw: pose[3] }));
  return found;
}

test("a thing is drawn between its poses, a moment late", () => {
  hear(1, 0);
  hear(1.05, 1);
  const { name, x } = drawn(AHEAD + 1.125);
  assert.equal(name, "Robot1");
  assert.ok(Math.abs(x - 0.5) < 0.01, `${x}`);
});

test("it comes to rest where it was told to be last", () => {
  hear(1, 0);
  hear(1.05, 1);
  assert.equal(drawn(AHEAD + 2).x, 1);
  assert.equal(motion.active, false);
  assert.equal(drawn(AHEAD + 3), null, "nothing is drawn any more");
  assert.equal(motion.drawn("Robot1")[0], 1);
});

test("it turns the short way round", () => {
  hear(1, 0, 3);
  hear(1.05, 0, -3);
  assert.ok(Math.abs(drawn(AHEAD + 1.125).yaw) > 3);
});

test("what stood still begins to move when it does, not before", () => {
  hear(1, 0);
  hear(5, 1);
  assert.equal(drawn(AHEAD + 4).x, 0);
  assert.ok(drawn(AHEAD + 5.08).x > 0);
});

test("where poses come late, it is drawn later, but never backwards", () => {
  const times = [];
  for (let tick = 0; tick < 100; tick++) {
    const clock = tick * 0.05;
    motion.hear(clock, [0], new Float32Array([clock, 0, 0, 0]), clock + AHEAD + (tick % 10 === 9 ? 0.3 : 0));
    times.push(motion.time(clock + AHEAD));
  }
  for (let tick = 1; tick < times.length; tick++) assert.ok(times[tick] >= times[tick - 1]);
  assert.ok(motion.behind > 0.1 && motion.behind <= 0.6);
});

test("each mover has its own numbers, and those that stay are kept", () => {
  motion.hear(1, [0, 1], new Float32Array([1, 0, 0, 0, 7, 0, 0, 0, 0, 0]), AHEAD + 1);
  const seen = {};
  motion.play(AHEAD + 2, (name, pose) => (seen[name] = [pose[0], pose.length]));
  assert.deepEqual(seen, { Robot1: [1, 4], Jar001: [7, 6] });
  motion.set([{ name: "Jar001", numbers: 6 }]);
  assert.equal(motion.drawn("Jar001")[0], 7);
  assert.equal(motion.drawn("Robot1"), null);
});
