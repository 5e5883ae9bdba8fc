import { mounted, settled } from "../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import alert from "../../../../src/somrs/gui/components/alert.js";

let heard;

class Sound {
  state = "suspended";
  currentTime = 5;
  destination = "loudspeaker";

  resume() {
    this.state = "running";
  }

  createOscillator() {
    const tone = { frequency: {}, connect: (to) => (tone.to = to), start: (at) => heard.push([tone.frequency.value, at]), stop: () => {} };
    return tone;
  }
}

class Notice {
  static permission = "default";

  static requestPermission() {
    Notice.permission = "granted";
  }

  constructor(text) {
    heard.push(text);
  }
}

beforeEach(() => {
  heard = [];
  Notice.permission = "default";
  Object.assign(window, { AudioContext: Sound, Notification: Notice });
  window.navigator.vibrate = (pattern) => heard.push(pattern.length);
  const kept = new Map();
  globalThis.localStorage = { getItem: (key) => kept.get(key) ?? null, setItem: (key, value) => kept.set(key, value) };
  Object.defineProperty(document, "hidden", { configurable: true, value: false });
});

afterEach(() => delete window.AudioContext);

test("nothing is heard before alerts are turned on, and the browser remembers that they are", async () => {
  const one = await mounted(alert, {});
  one.shown.announce("Carry the jar");
  assert.deepEqual(heard, []);
  one.element.click();
  await settled();
  assert.equal(one.element.getAttribute("aria-pressed"), "true");
  assert.deepEqual(heard, [3, [660, 5], [880, 5.18]], "an example is heard at once");
  const again = await mounted(alert, {});
  assert.equal(again.shown.on, true);
  for (const shown of [again, one]) shown.leave();
});

test("a hidden page shows a notice, too", async () => {
  const one = await mounted(alert, {});
  one.element.click();
  heard = [];
  one.shown.announce("Carry the jar");
  assert.ok(!heard.includes("Carry the jar"));
  Object.defineProperty(document, "hidden", { configurable: true, value: true });
  one.shown.announce("Carry the jar");
  assert.ok(heard.includes("Carry the jar"));
  one.leave();
});

test("a browser without sound, vibration and notices stays silent", async () => {
  delete window.AudioContext;
  delete window.Notification;
  delete window.navigator.vibrate;
  const one = await mounted(alert, {});
  one.element.click();
  one.shown.announce("Carry the jar");
  assert.deepEqual(heard, []);
  one.leave();
});

test("after the page was loaded again, the first touch allows sound", async () => {
  localStorage.setItem("somrs-alerts", "on");
  const one = await mounted(alert, {});
  one.shown.announce("Carry the jar");
  assert.deepEqual(heard, [3]);
  document.body.dispatchEvent(new Event("pointerdown", { bubbles: true }));
  one.shown.announce("Carry the jar");
  assert.equal(heard.length, 4);
  one.leave();
});
