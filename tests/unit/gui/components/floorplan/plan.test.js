// The floor plan as it is on the page.

import { clock, mounted, page, press, server, settled, text } from "../../../../support/javascript/page.js";
import assert from "node:assert/strict";
import test, { afterEach, beforeEach } from "node:test";
import floorplan from "../../../../../src/somrs/gui/components/floorplan/floorplan.js";
import { building, DEFINITIONS, fact, object } from "./building.js";

let one, pad, drawing;

beforeEach(async () => {
  server.reset();
  sessionStorage.clear();
  page.calm = true;
  server.answers = { "/api/ontology": { definitions: DEFINITIONS }, "/api/map": () => building() };
  one = await mounted(floorplan, { mode: "edit", snap: 0.5 });
  pad = one.element.querySelector(".fp-pad");
  drawing = pad.shadowRoot;
  page.sized.get(pad)(800, 600);
  server.socket("/api/live").open();
  await clock.pass(200);
});

afterEach(() => one.leave());

const view = () => one.shown.plan.view;
const drawn = (name) => drawing.querySelector(`[data-name="${name}"]`);
const spot = (name) => view().toScreen(one.shown.plan.at(name).x, one.shown.plan.at(name).y);
const told = (event) => one.told.filter(([name]) => name === event).map(([, value]) => value);
const changed = (changes, version) => server.socket("/api/live").say({ topic: "map", value: { changes, version } });

async function pointer(type, { x, y }, on = pad, more = {}) {
  const event = Object.assign(new MouseEvent(type, { bubbles: true, cancelable: true, composed: true, clientX: x, clientY: y, ...more }), { pointerId: 1 });
  on.dispatchEvent(event);
  await settled();
}

async function drag(name, to, more) {
  const from = spot(name);
  await pointer("pointerdown", from, drawn(name));
  await pointer("pointermove", { x: from.x + 6, y: from.y }, pad, more);
  await pointer("pointermove", to, pad, more);
  await pointer("pointerup", to, pad, more);
}

async function clicked(name) {
  await pointer("pointerdown", spot(name), drawn(name));
  await pointer("pointerup", spot(name));
}

test("one storey is seen, with all that is on it, and what is nowhere is named", () => {
  assert.deepEqual(["Table001", "Jar001", "Robot1", "Wall001"].map((name) => drawn(name) !== null), [true, true, true, true]);
  assert.deepEqual([drawn("Jar002"), drawn("Nowhere")], [null, null]);
  assert.match(text(one.element.querySelector(".fp-unplaced")), /Without a position: ?Nowhere$/);
  assert.deepEqual(told("loaded"), [{ version: 7, objects: 13 }]);
  assert.deepEqual([...one.element.querySelectorAll("option")].map(text), ["Ground", "Upper · First floor"]);
  assert.equal(one.element.querySelector(".fp-loading"), null);
});

test("another storey is chosen", async () => {
  const select = one.element.querySelector("select");
  select.value = "Upper";
  select.dispatchEvent(new Event("change"));
  await clock.pass(50);
  assert.ok(drawn("Jar002") && !drawn("Jar001"));
  assert.deepEqual(told("storey").at(-1), { name: "Upper", alone: false });
});

test("a click chooses, and says what it is", async () => {
  await clicked("Jar001");
  assert.deepEqual(told("select"), [{ name: "Jar001" }]);
  assert.match(text(one.element.querySelector('[aria-live="polite"]')), /^Jar001, Jar, on Table001, x 2.00 m, y 3.50 m$/);
  await clock.pass(50);
  assert.equal(drawing.querySelectorAll(".fp-chosen, .fp-chosen-ring").length, 1);
});

test("what is dragged goes to the grid, with what stands on it", async () => {
  await drag("Table001", view().toScreen(4.1, 3.1));
  const [moved] = told("moved");
  assert.deepEqual({ name: moved.name, x: moved.x, y: moved.y, version: moved.version }, { name: "Table001", x: 4, y: 3, version: 7 });
  assert.deepEqual({ ...one.shown.plan.at("Jar001") }, { x: 4, y: 3.5, turned: 0 });
  one.shown.settled("Table001", 8);
  changed([{ type: "ValueSet", object: "Table001", path: "PositionX", value: 4 }, { type: "ValueSet", object: "Jar001", path: "PositionX", value: 4 }], 8);
  await clock.pass(50);
  assert.equal(one.shown.plan.at("Jar001").x, 4);
});

test("what is moved again before the page has answered stays where it was moved to last", async () => {
  await drag("Table001", view().toScreen(4, 3));
  await drag("Table001", view().toScreen(5, 3));
  one.shown.settled("Table001", 8);
  changed([{ type: "ValueSet", object: "Table001", path: "PositionX", value: 4 }], 8);
  await clock.pass(50);
  assert.equal(one.shown.plan.at("Table001").x, 5);
  one.shown.settled("Table001", 9);
  changed([{ type: "ValueSet", object: "Table001", path: "PositionX", value: 5 }, { type: "ValueSet", object: "Jar001", path: "PositionX", value: 5 }], 9);
  await clock.pass(50);
  changed([{ type: "ValueSet", object: "Table001", path: "PositionX", value: 6 }], 10);
  await clock.pass(50);
  assert.equal(one.shown.plan.at("Table001").x, 6, "and is where the map has it after that");
});

test("keys that move something on while the answer to a move comes are all counted", async () => {
  await clicked("Table001");
  await press(pad, "ArrowRight");
  await clock.pass(500);
  await press(pad, "ArrowRight");
  one.shown.settled("Table001", 8);
  changed([{ type: "ValueSet", object: "Table001", path: "PositionX", value: 2.1 }], 8);
  await clock.pass(50);
  await press(pad, "ArrowRight");
  await clock.pass(500);
  assert.deepEqual(told("moved").map(({ x }) => x), [2.1, 2.3]);
});

test("a move that is refused leaves others alone", async () => {
  await drag("Table001", view().toScreen(4, 3));
  await clicked("Wall001");
  await drag("Wall001", view().toScreen(0.1, 0.1));
  one.shown.back("Wall001");
  assert.equal(one.shown.plan.at("Table001").x, 4);
});

test("what may not stand there goes back", async () => {
  await drag("Table001", view().toScreen(0.1, 0.1), { altKey: true });
  assert.equal(told("moved").length, 1);
  one.shown.back("Table001");
  assert.equal(one.shown.plan.at("Table001").x, 2);
});

test("a move that nobody answers stays, and the plan says so until the answer comes, however late", async () => {
  const late = () => [...one.element.querySelectorAll(".fp-late")].map(text).join();
  await drag("Table001", view().toScreen(3, 3));
  assert.equal(late(), "");
  await clock.pass(60000);
  assert.equal(late(), "Table001: the move is on its way …");
  assert.deepEqual({ ...one.shown.plan.at("Table001") }, { x: 3, y: 3, turned: 0 });
  one.shown.settled("Table001", 8);
  changed([{ type: "ValueSet", object: "Table001", path: "PositionX", value: 3 }, { type: "ValueSet", object: "Jar001", path: "PositionX", value: 3 }], 8);
  await clock.pass(50);
  assert.equal(late(), "");
  assert.equal(one.shown.plan.at("Table001").x, 3);
});

test("what was on its way when the connection was lost is where the map has it, and the page hears so", async () => {
  const listeners = new Map();
  globalThis.socket = { on: (event, listener) => listeners.set(event, listener), off: (event) => listeners.delete(event) };
  await drag("Table001", view().toScreen(3, 3));
  listeners.get("disconnect")();
  await clock.pass(5000);
  delete globalThis.socket;
  assert.deepEqual(told("unanswered"), [{ names: ["Table001"] }]);
  assert.equal(one.shown.plan.at("Table001").x, 2);
  assert.equal(one.element.querySelector(".fp-late"), null);
});

async function begunDrag(name, to) {
  const from = spot(name);
  await pointer("pointerdown", from, drawn(name));
  await pointer("pointermove", { x: from.x + 6, y: from.y });
  await pointer("pointermove", to);
}

test("Escape in a second drag leaves the first one on its way", async () => {
  await drag("Table001", view().toScreen(4, 3));
  await begunDrag("Table001", view().toScreen(6, 3));
  assert.equal(one.shown.plan.at("Table001").x, 6);
  await press(pad, "Escape");
  await pointer("pointerup", view().toScreen(6, 3));
  assert.deepEqual([one.shown.plan.at("Table001").x, one.shown.plan.at("Jar001").x], [4, 4], "and not where the map still has it");
  await drag("Table001", view().toScreen(5, 3));
  one.shown.settled("Table001", 8);
  changed([{ type: "ValueSet", object: "Table001", path: "PositionX", value: 4 }], 8);
  await clock.pass(50);
  assert.equal(one.shown.plan.at("Table001").x, 5, "the answer to the first move is none to the last one");
  one.shown.settled("Table001", 9);
  changed([{ type: "ValueSet", object: "Table001", path: "PositionX", value: 5 }], 9);
  changed([{ type: "ValueSet", object: "Table001", path: "PositionX", value: 7 }], 10);
  await clock.pass(50);
  assert.equal(one.shown.plan.at("Table001").x, 7);
  assert.equal(told("moved").length, 2);
});

test("Escape in a second drag after the first was refused brings it back to where the map has it", async () => {
  await drag("Table001", view().toScreen(4, 3));
  await begunDrag("Table001", view().toScreen(6, 3));
  one.shown.back("Table001");
  await clock.pass(50);
  assert.equal(one.shown.plan.at("Table001").x, 6, "it is still in the hand");
  await press(pad, "Escape");
  assert.equal(one.shown.plan.at("Table001").x, 2);
});

test("what is in the hand waits for nobody", async () => {
  const from = spot("Table001");
  await pointer("pointerdown", from, drawn("Table001"));
  await pointer("pointermove", { x: from.x - 60, y: from.y });
  await clock.pass(60000);
  assert.deepEqual(told("unanswered"), []);
  assert.notEqual(one.shown.plan.at("Table001").x, 2);
});

test("a robot is where it is, whatever is tried on the map", async () => {
  await drag("Robot1", view().toScreen(3, 3));
  await clicked("Robot1");
  await press(pad, "ArrowRight");
  await clock.pass(500);
  assert.deepEqual(told("moved"), []);
  assert.equal(one.shown.plan.at("Robot1").x, 6);
});

test("a wall is only moved when it was chosen before; else the plan is", async () => {
  const { x } = view();
  await drag("Wall001", { x: 500, y: 300 });
  assert.deepEqual(told("moved"), []);
  assert.notEqual(view().x, x);
});

test("arrow keys nudge what is chosen, and tell it once", async () => {
  await clicked("Table001");
  for (let time = 0; time < 3; time++) await press(pad, "ArrowRight");
  await press(pad, "ArrowUp", { shiftKey: true });
  assert.deepEqual(told("moved"), []);
  await clock.pass(500);
  assert.deepEqual(told("moved").map(({ x, y, target }) => [x, y, target]), [[2.3, 3.01, null]]);
});

test("keys for the rest", async () => {
  await clicked("Jar001");
  await press(pad, "r");
  await clock.pass(500);
  assert.ok(Math.abs(told("moved")[0].turned - Math.PI / 12) < 1e-6);
  await press(pad, "Enter");
  await press(pad, "Delete");
  await press(pad, "z", { ctrlKey: true });
  assert.deepEqual([told("open"), told("remove"), told("undo")], [[{ name: "Jar001" }], [{ name: "Jar001" }], [{}]]);
  const { scale } = view();
  await press(pad, "+");
  assert.equal(view().scale, scale * 1.25);
  await press(pad, "0");
  assert.equal(view().fitted, true);
  await press(pad, "Escape");
  assert.equal(one.shown.plan.selected, null);
  const event = await press(pad, "q");
  assert.equal(event.defaultPrevented, false, "other keys are the page's");
});

test("page down goes from one object to the next, from the top left", async () => {
  const names = [];
  for (let time = 0; time < 3; time++) {
    await press(pad, "PageDown");
    names.push(one.shown.plan.selected);
  }
  assert.deepEqual(names, ["Robot1", "Wall001", "Door001"]);
});

test("something new is placed by a click", async () => {
  one.shown.place("Jar", {});
  await pointer("pointermove", view().toScreen(2.1, 2.4));
  await clock.pass(50);
  assert.ok(drawing.querySelector(".fp-ghost"));
  assert.equal(one.shown.plan.target, "Table001");
  await pointer("pointerdown", view().toScreen(2.1, 2.4));
  await pointer("pointerup", view().toScreen(2.1, 2.4));
  assert.deepEqual(told("placed"), [{ type: "Jar", x: 2, y: 2.5, turned: 0, target: "Table001", storey: "Ground" }]);
  await clock.pass(50);
  assert.equal(drawing.querySelector(".fp-ghost"), null);
});

test("on a plan to choose from, a thing is dropped on its target, and stays", async () => {
  one.given.mode = "pick";
  await settled();
  await drag("Jar001", view().toScreen(8, 2));
  assert.deepEqual(told("dropped"), [{ thing: "Jar001", target: "Floor0", x: 8, y: 2 }]);
  assert.equal(one.shown.plan.at("Jar001").x, 2);
});

test("changes of the map are seen at once", async () => {
  changed([{ type: "ObjectAdded", object: object("Jar009", "Jar", 7, 7) }, { type: "ValueSet", object: "Robot1", path: "PositionX", value: 9 }, { type: "ObjectRemoved", name: "Door001" }], 8);
  await clock.pass(50);
  assert.ok(drawn("Jar009") && !drawn("Door001"));
  assert.match(drawn("Robot1").getAttribute("transform"), /^translate\(9 6\)/);
});

// Robot1 goes a metre in half a second; where it was drawn on its way.
async function goes() {
  const poses = server.socket("/api/poses");
  poses.say({ table: 3, movers: [{ name: "Robot1", numbers: 4 }] });
  const frame = (time, x) => {
    const buffer = new ArrayBuffer(24 + 4 + 16);
    const head = new DataView(buffer);
    head.setFloat64(0, time, true);
    head.setUint32(16, 3, true);
    head.setUint32(20, 1, true);
    new Float32Array(buffer, 28).set([x, 6, 0, 0]);
    return buffer;
  };
  const places = new Set();
  for (let tick = 0; tick < 20; tick++) {
    if (tick <= 10) poses.say(frame(tick / 20, 6 + tick / 10));
    for (let picture = 0; picture < 5; picture++) {
      await clock.pass(10);
      places.add(drawn("Robot1").getAttribute("transform"));
    }
  }
  return places;
}

test("what moves is seen where it is, until the map has it elsewhere", async () => {
  page.calm = false;
  const places = await goes();
  page.calm = true;
  assert.ok(places.size > 25, `drawn at ${places.size} places`);
  assert.match(drawn("Robot1").getAttribute("transform"), /^translate\(7 6\)/);
  assert.ok(drawing.querySelector(".fp-known"), "its outline is where the map has it");
  changed([{ type: "ValueSet", object: "Robot1", path: "PositionX", value: 2 }], 8);
  await clock.pass(50);
  assert.match(drawn("Robot1").getAttribute("transform"), /^translate\(2 6\)/);
});

test("who wants less motion sees what moves a few times a second", async () => {
  const places = await goes();
  assert.ok(places.size > 4 && places.size < 10, `drawn at ${places.size} places`);
  assert.match(drawn("Robot1").getAttribute("transform"), /^translate\(7 6\)/);
});

test("a map of the past is shown as it was, and cannot be changed", async () => {
  server.answers["/api/map"] = ({ query }) => (query.get("version") === "3" ? { version: 3, objects: [object("Old", "Jar", 1, 1)], facts: [] } : building());
  one.given.version = 3;
  await clock.pass(50);
  assert.ok(drawn("Old") && !drawn("Robot1"));
  assert.match(text(one.element.querySelector(".fp-hint")), /A past version of the map/);
  await drag("Old", { x: 100, y: 100 });
  assert.deepEqual(told("moved"), []);
  one.given.version = undefined;
  await clock.pass(50);
  assert.ok(drawn("Robot1"));
});

test("a lost connection is said", async () => {
  server.socket("/api/live").close();
  await settled();
  assert.match(text(one.element.querySelector('[role="alert"]')), /The connection is lost/);
});

test("the legend explains what there is, and no more", async () => {
  one.shown.legend = true;
  await settled();
  const titles = [...one.element.querySelectorAll(".fp-legend-row")].map(text);
  assert.deepEqual(titles, ["Wall", "Door, open", "Door, closed", "Furniture to put things on", "Graspable thing", "Robot and its heading", "State unknown"]);
});

test("what is in view is kept for when the page is loaded again", async () => {
  view().zoom(2);
  one.shown.plan.draw();
  await clock.pass(500);
  const { scale } = view();
  const again = await mounted(floorplan, { mode: "edit" });
  page.sized.get(again.element.querySelector(".fp-pad"))(800, 600);
  server.socket("/api/live").open();
  await clock.pass(50);
  assert.equal(again.shown.plan.view.scale, scale);
  again.leave();
});

test("lanes lead from waypoint to waypoint on their storey, with an arrow if they lead in one direction", async () => {
  const lane = (name, start, end, more) => [object(name, "Lane", undefined, undefined, more), fact("startsAt", name, start), fact("endsAt", name, end)];
  const map = building();
  map.version = 9;
  map.objects.push(object("W1", "Waypoint", 1, 1), object("W2", "Waypoint", 4, 1), object("W3", "Waypoint", 4, 1, { PositionZ: 3 }));
  for (const [made, start, end] of [lane("L1", "W1", "W2"), lane("L2", "W2", "W1", { Bidirectional: true }), lane("L3", "W1", "W3")]) {
    map.objects.push(made);
    map.facts.push(start, end);
  }
  one.shown.plan.read(map, true);
  const drawnLanes = () => drawing.querySelector(".fp-lane").getAttribute("d");
  assert.equal(drawnLanes(), "M1 1L4 1M4 1L1 1", "the third one ends on another storey");
  assert.equal(drawing.querySelector(".fp-lane-tip").getAttribute("d").match(/M/g).length, 1, "only the first one has a direction");
  assert.match(drawing.querySelector(".fp-lane-tip").getAttribute("d"), /^M2\.668 1L/, "it points from W1 to W2");
  changed([{ type: "ValueSet", object: "W2", path: "PositionY", value: 5 }], 10);
  await settled();
  assert.equal(drawnLanes(), "M1 1L4 5M4 5L1 1", "lanes follow their waypoints");
  changed([{ type: "ObjectRemoved", name: "L1" }], 11);
  await settled();
  assert.equal(drawnLanes(), "M4 5L1 1");
});

// Robot1 is at these numbers, after it was at (6, 6) on the ground.
async function moves(...numbers) {
  const poses = server.socket("/api/poses");
  poses.say({ table: 3, movers: [{ name: "Robot1", numbers: 4 }] });
  for (const [time, values] of [[0, [6, 6, 0, 0]], [0.1, numbers], [1, numbers]]) {
    const buffer = new ArrayBuffer(24 + 4 + 16);
    const head = new DataView(buffer);
    head.setFloat64(0, time, true);
    head.setUint32(16, 3, true);
    head.setUint32(20, 1, true);
    new Float32Array(buffer, 28).set(values);
    poses.say(buffer);
    await clock.pass(500);
  }
}

test("a robot that rides to another storey is drawn there", async () => {
  await moves(7, 6, 3, 0);
  assert.equal(drawn("Robot1"), null, "it is not on the ground any more");
  const select = one.element.querySelector("select");
  select.value = "Upper";
  select.dispatchEvent(new Event("change"));
  await clock.pass(50);
  assert.ok(drawn("Robot1"));
});

const ROADMAP = { number: 5, places: [[1, 1, 0], [2, 1, 0], [3, 1, 0], [3, 1, 3]], lanes: [[0, 1], [1, 2], [2, 3]], one_way: [[1, 0], [2, 3]], closed_places: [], closed_lanes: [1] };
const TRAFFIC = {
  roadmap: 5, hold: "",
  robots: [
    { robot: "Robot1", granted: [[6, 6, 0]], planned: [[7, 6, 0], [8, 6, 0]], destination: [8, 6, 0], waits_for: ["Jar001"], waiting: "waits for Jar001, which has to go first" },
    { robot: "Robot2", granted: [[1, 1, 3], [2, 1, 3]] },
  ],
};

async function showTraffic() {
  server.answers["/api/traffic"] = TRAFFIC;
  server.answers["/api/traffic/roadmap"] = ROADMAP;
  one.element.querySelector('button[aria-label="Traffic"]').click();
  await settled();
  server.socket("/api/live").open();
  await clock.pass(200);
}

test("traffic is read only while it is shown", async () => {
  assert.ok(!server.asked.some((address) => address.startsWith("/api/traffic")));
  await showTraffic();
  assert.deepEqual(server.socket("/api/live").sent, [{ follow: ["traffic"], confirm: 1 }]);
  const panel = () => text(one.element.querySelector(".fp-traffic"));
  assert.match(panel(), /Robot1 waits for Jar001, which has to go first/);
  server.socket("/api/live").say({ topic: "traffic", value: { ...TRAFFIC, hold: "fire alarm in B1", robots: [] } });
  await clock.pass(50);
  assert.match(panel(), /Traffic is held: fire alarm in B1/);
  const socket = server.socket("/api/live");
  one.element.querySelector('button[aria-label="Traffic"]').click();
  await settled();
  assert.ok(socket.closed);
  assert.equal(one.element.querySelector(".fp-traffic"), null);
  assert.equal(drawing.querySelector(".fp-road"), null);
});

test("neither traffic nor its roadmap is replaced by an older one that comes late", async () => {
  const late = { "/api/traffic": [], "/api/traffic/roadmap": [] };
  for (const path of Object.keys(late)) {
    server.answers[path] = () =>
      new Promise((done) => {
        late[path].push(done);
      });
  }
  one.element.querySelector('button[aria-label="Traffic"]').click();
  await settled();
  server.socket("/api/live").open();
  await clock.pass(50);
  server.socket("/api/live").say({ topic: "traffic", value: { ...TRAFFIC, hold: "fire alarm in B1", robots: [] } });
  await clock.pass(50);
  late["/api/traffic"][0](TRAFFIC);
  await clock.pass(50);
  assert.match(text(one.element.querySelector(".fp-traffic")), /Traffic is held: fire alarm in B1/);
  server.socket("/api/live").say({ topic: "traffic", value: { ...TRAFFIC, roadmap: 6, robots: [] } });
  await clock.pass(3000);
  assert.equal(late["/api/traffic/roadmap"].length, 1, "one request at a time");
  late["/api/traffic/roadmap"][0](ROADMAP);
  await clock.pass(3000);
  assert.ok(drawing.querySelector(".fp-road-closed"));
  late["/api/traffic/roadmap"][1]({ ...ROADMAP, number: 6, closed_lanes: [] });
  await clock.pass(50);
  assert.equal(drawing.querySelector(".fp-road-closed"), null);
  assert.ok(drawing.querySelector(".fp-road"));
});

test("the roadmap is drawn however slow the network is", async () => {
  server.answers["/api/traffic/roadmap"] = async () => {
    await new Promise((answer) => {
      setTimeout(answer, 5000);
    });
    return ROADMAP;
  };
  server.answers["/api/traffic"] = TRAFFIC;
  one.element.querySelector('button[aria-label="Traffic"]').click();
  await settled();
  server.socket("/api/live").open();
  await clock.pass(20000);
  assert.ok(drawing.querySelector(".fp-road"));
});

test("the roadmap is drawn although the map comes after it", async () => {
  one.leave();
  sessionStorage.setItem("somrs-plan", JSON.stringify({ storey: one.shown.plan.storey, view: { fitted: true } }));
  sessionStorage.setItem("somrs-traffic", "shown");
  server.answers["/api/map"] = async () => {
    await new Promise((answer) => {
      setTimeout(answer, 3000);
    });
    return building();
  };
  Object.assign(server.answers, { "/api/traffic": TRAFFIC, "/api/traffic/roadmap": ROADMAP });
  server.sockets = [];
  one = await mounted(floorplan, { mode: "edit", storey_name: one.shown.plan.storey });
  drawing = one.element.querySelector(".fp-pad").shadowRoot;
  for (const socket of server.sockets.filter(({ url }) => url.endsWith("/api/live"))) socket.open();
  await clock.pass(5000);
  assert.ok(drawing.querySelector(".fp-road"));
});

test("traffic that is hidden and shown again at once has its roadmap", async () => {
  await showTraffic();
  const button = one.element.querySelector('button[aria-label="Traffic"]');
  button.click();
  await settled();
  button.click();
  await settled();
  server.socket("/api/live").open();
  await clock.pass(5000);
  assert.ok(drawing.querySelector(".fp-road"));
});

test("a roadmap whose answer was lost with the connection is read again", async () => {
  server.answers["/api/traffic"] = TRAFFIC;
  server.answers["/api/traffic/roadmap"] = () => new Promise(() => {});
  one.element.querySelector('button[aria-label="Traffic"]').click();
  await settled();
  server.socket("/api/live").open();
  await clock.pass(1000);
  server.answers["/api/traffic/roadmap"] = ROADMAP;
  server.socket("/api/live").close();
  await clock.pass(1000);
  server.socket("/api/live").open();
  await clock.pass(1000);
  assert.ok(drawing.querySelector(".fp-road"));
});

test("the roadmap of the storey is drawn, and what of it is closed", async () => {
  await showTraffic();
  await clock.pass(50);
  assert.equal(drawing.querySelector(".fp-road").getAttribute("d"), "M1 1L2 1");
  assert.equal(drawing.querySelector(".fp-road-closed").getAttribute("d"), "M2 1L3 1");
  assert.equal(drawing.querySelector(".fp-road-ride").getAttribute("d"), "M3 1h0");
  assert.equal(drawing.querySelector(".fp-road-direction").getAttribute("d"), "M1.36 1L1.64 0.86L1.64 1.14Z", "to the place at 1, 1");
  assert.equal(server.asked.filter((address) => address === "/api/traffic/roadmap").length, 1);
  server.answers["/api/traffic/roadmap"] = { ...ROADMAP, number: 6, closed_lanes: [] };
  server.socket("/api/live").say({ topic: "traffic", value: { ...TRAFFIC, roadmap: 6 } });
  await clock.pass(3000);
  assert.equal(drawing.querySelector(".fp-road-closed"), null);
  assert.equal(server.asked.filter((address) => address === "/api/traffic/roadmap").length, 2);
});

test("the ways of the robots on the storey are drawn, and for whom they wait", async () => {
  await showTraffic();
  await clock.pass(50);
  assert.equal(drawing.querySelectorAll(".fp-way-planned").length, 1, "Robot2 is upstairs");
  assert.equal(drawing.querySelectorAll(".fp-wait").length, 1);
  assert.equal(text(drawing.querySelector(".fp-wait title")), "Robot1 waits for Jar001, which has to go first");
  server.answers["/api/map"] = () => building();
  server.socket("/api/live").say({ topic: "traffic", value: { ...TRAFFIC, robots: [] } });
  await clock.pass(50);
  assert.equal(drawing.querySelectorAll(".fp-way-planned, .fp-wait").length, 0);
});

async function sketched(...points) {
  one.shown.sketchZone(true);
  for (const [x, y] of points) {
    await pointer("pointerdown", view().toScreen(x, y));
    await pointer("pointerup", view().toScreen(x, y));
  }
}

test("a zone is drawn by its corners, and ends at the first one", async () => {
  await sketched([1, 1], [4, 1], [4, 3], [1.1, 1.1]);
  assert.deepEqual(told("outlined"), [{ corners: [[1, 1], [4, 1], [4, 3]], storey: "Ground" }]);
  assert.equal(one.element.querySelector(".fp-sketching"), null);
  await pointer("pointerdown", view().toScreen(8, 8));
  await pointer("pointerup", view().toScreen(8, 8));
  assert.equal(told("outlined").length, 1, "later clicks select again");
});

test("two corners of a zone are those of a box", async () => {
  await sketched([1, 1], [4, 3]);
  await clock.pass(50);
  assert.ok(drawing.querySelector(".fp-sketch-area"));
  await press(pad, "Enter");
  assert.deepEqual(told("outlined")[0].corners, [[1, 1], [4, 1], [4, 3], [1, 3]]);
  await clock.pass(50);
  assert.equal(drawing.querySelector(".fp-sketch-area"), null);
});

test("a zone that is given up is not drawn", async () => {
  await sketched([1, 1]);
  await press(pad, "Enter");
  await press(pad, "Escape");
  assert.deepEqual([told("outlined"), told("moved")], [[], []]);
  assert.equal(one.element.querySelector(".fp-sketching"), null);
});

// A zone from (6, 2) to (9, 4), which is selected.
async function zoned() {
  const values = { "Shape.Outline": "-1.5,-1 1.5,-1 1.5,1 -1.5,1" };
  changed([{ type: "ObjectAdded", object: object("Zone001", "NoGoZone", 7.5, 3, values) }], 8);
  await clock.pass(50);
  one.given.selected = "Zone001";
  await settled();
  await clock.pass(50);
}

const corner = (index) => drawing.querySelector(`[data-corner="${index}"]`);
const shaped = (outline, version) => changed([{ type: "ValueSet", object: "Zone001", path: "Shape.Outline", value: outline }], version);

async function dragCorner(index, from, to, release = true) {
  await pointer("pointerdown", view().toScreen(...from), corner(index));
  for (const point of [from, [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2], to]) await pointer("pointermove", view().toScreen(...point));
  if (release) await pointer("pointerup", view().toScreen(...to));
  await clock.pass(50);
}

test("a corner of a zone is dragged, and saved once, when it is let go", async () => {
  await zoned();
  assert.equal(drawing.querySelectorAll("[data-corner]").length, 4);
  await dragCorner(2, [9, 4], [9.9, 5.1], false);
  assert.deepEqual(told("shaped"), []);
  await pointer("pointerup", view().toScreen(9.9, 5.1));
  assert.deepEqual(told("shaped"), [{ name: "Zone001", corners: [[6, 2], [9, 2], [10, 5], [6, 4]], version: 8 }]);
  assert.equal(told("moved").length, 0);
  await clock.pass(50);
  assert.ok(drawing.querySelector(".fp-corners .fp-sketch-area")); // until the map has it
  one.shown.settled("Zone001", 9);
  shaped("-1.5,-1 1.5,-1 2.5,2 -1.5,1", 9);
  await clock.pass(50);
  assert.equal(drawing.querySelector(".fp-corners .fp-sketch-area"), null);
});

test("a corner that is refused, or given up, goes back", async () => {
  await zoned();
  const place = corner(2).getAttribute("transform");
  await dragCorner(2, [9, 4], [10, 5]);
  assert.notEqual(corner(2).getAttribute("transform"), place);
  one.shown.back("Zone001");
  await clock.pass(50);
  assert.equal(corner(2).getAttribute("transform"), place);
  await dragCorner(2, [9, 4], [10, 5], false);
  await press(pad, "Escape");
  await pointer("pointerup", view().toScreen(10, 5));
  await clock.pass(50);
  assert.equal(corner(2).getAttribute("transform"), place);
  assert.equal(told("shaped").length, 1);
});

test("Escape in a second drag of a corner leaves the first one on its way", async () => {
  await zoned();
  await dragCorner(2, [9, 4], [10, 5]);
  const place = corner(2).getAttribute("transform");
  await dragCorner(2, [10, 5], [8, 4], false);
  await press(pad, "Escape");
  await pointer("pointerup", view().toScreen(8, 4));
  await clock.pass(50);
  assert.equal(corner(2).getAttribute("transform"), place);
  assert.equal(told("shaped").length, 1);
});

test("corners are chosen and moved by keys, and saved once, together", async () => {
  await zoned();
  await press(pad, "c");
  await press(pad, "c");
  assert.match(text(one.element.querySelector('[aria-live="polite"]')), /^Corner 2 of 4 of Zone001, x 9.00 m, y 2.00 m$/);
  await press(pad, "ArrowRight");
  await press(pad, "ArrowRight");
  await press(pad, "c");
  await press(pad, "ArrowUp", { shiftKey: true });
  assert.equal(told("shaped").length, 0);
  await clock.pass(600);
  assert.deepEqual(told("shaped"), [{ name: "Zone001", corners: [[6, 2], [9.2, 2], [9, 4.01], [6, 4]], version: 8 }]);
  assert.equal(told("moved").length, 0);
  one.shown.settled("Zone001", 9);
  shaped("-1.5,-1 1.7,-1 1.5,1.01 -1.5,1", 9);
  await press(pad, "Escape"); // leaves the corner, not the zone
  await press(pad, "ArrowUp");
  await clock.pass(600);
  assert.deepEqual(told("moved").map(({ name, x, y }) => [name, x, y]), [["Zone001", 7.5, 3.1]]);
});

test("only zones have corners, and only where they can be changed", async () => {
  await zoned();
  one.given.version = 3;
  await settled();
  await clock.pass(50);
  assert.equal(corner(0), null);
  one.given.version = null;
  one.given.selected = "Table001";
  await settled();
  await clock.pass(50);
  assert.equal(corner(0), null);
  await press(pad, "c");
  assert.match(text(one.element.querySelector('[aria-live="polite"]')), /^Only a zone has corners/);
});
