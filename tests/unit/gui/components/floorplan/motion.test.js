import { clock, page } from "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import { Motion } from "somrs-floorplan/motion.js";

const at = (x, turned = 0) => ({ x, y: 0, turned });

let put, ended, motion;

beforeEach(() => {
  page.calm = false;
  put = [];
  ended = 0;
  motion = new Motion((name, where) => put.push({ name, ...where }), (_, still) => (ended += still ? 1 : 0));
});

test("a thing goes smoothly to where it is now", async () => {
  motion.go([{ name: "Jar", from: at(0), to: at(10) }]);
  await clock.pass(1000);
  const xs = put.map((one) => one.x);
  assert.ok(xs.length > 10);
  assert.deepEqual(xs, [...xs].sort((a, b) => a - b));
  assert.deepEqual([xs.at(-1), ended], [10, 1]);
});

test("it turns the short way round", async () => {
  motion.go([{ name: "Robot", from: at(0, 3), to: at(0, -3) }]);
  await clock.pass(200);
  assert.ok(put.every((one) => Math.abs(one.turned) >= 3 - 1e-9));
  motion.end();
});

test("what is sent elsewhere on its way goes on from where it is", async () => {
  motion.go([{ name: "Jar", from: at(0), to: at(10) }]);
  await clock.pass(100);
  const here = put.at(-1).x;
  motion.go([{ name: "Jar", from: at(here), to: at(0) }]);
  await clock.pass(1000);
  assert.ok(Math.max(...put.map((one) => one.x)) <= here + 1e-9);
  assert.equal(put.at(-1).x, 0);
});

test("who wants less motion, and very many things, jump", () => {
  motion.go(Array.from({ length: 301 }, (_, index) => ({ name: `Jar${index}`, from: at(0), to: at(1) })));
  assert.deepEqual([put.length, ended], [301, 1]);
  page.calm = true;
  motion.go([{ name: "Jar", from: at(0), to: at(1) }]);
  assert.deepEqual([put.length, ended], [302, 2]);
});

test("what is taken in hand stops", async () => {
  motion.go([{ name: "Jar", from: at(0), to: at(10) }]);
  await clock.pass(50);
  motion.stop("Jar");
  const { length } = put;
  await clock.pass(1000);
  assert.equal(put.length, length);
});
