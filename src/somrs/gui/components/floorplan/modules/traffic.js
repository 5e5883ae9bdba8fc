// Traffic on the plan: lanes and places of the roadmap, the ways that robots were granted and those that are planned, and who waits for whom.

import { follow } from "live";
import { get } from "./live.js";
import { escape, svg } from "./layers.js";

const AGAIN = 2000; // milliseconds after a reading of the roadmap before the next one
const n = (value) => +value.toFixed(2);

// News of traffic from the API, while it is shown.
export class TrafficNews {
  // `told({ traffic })` is called with each state of traffic, `told({ roadmap })` with each roadmap, `told({ lost })` when neither comes.
  constructor(told) {
    this._told = told;
    this._number = null; // that of the roadmap that was read
    this._heard = 0; // states of traffic so far
    this._reading = null; // the reading of the roadmap under way, and the pause after it
    this._close = null;
  }

  begin() {
    const open = () => {
      this._forgetReading(); // it may never end: its connection may be lost, too
      this._read();
    };
    this._close ??= follow(["traffic"], { open, news: (news) => this._hear(news), lost: () => this._told({ lost: true }) });
  }

  end() {
    this._close?.();
    this._close = null;
    this._number = null;
    this._forgetReading();
  }

  _forgetReading() {
    this._reading = null;
    clearTimeout(this._timer);
  }

  async _read() {
    const heard = this._heard;
    try {
      const traffic = await get("/api/traffic");
      if (heard === this._heard) this._show(traffic); // else news have overtaken it
    } catch {
      if (heard === this._heard) this._told({ lost: true });
    }
  }

  _hear(news) {
    this._heard++;
    if (news.missed) this._read();
    else if (news.value.problem) this._told({ lost: true });
    else this._show(news.value);
  }

  _show(traffic) {
    if (!this._close) return;
    this._told({ traffic });
    this._wanted = traffic.roadmap;
    if (!this._reading) this._readRoadmap();
  }

  // Doors may move often: the roadmap is read at most once in a while, and one reading after the other.
  async _readRoadmap() {
    if (this._wanted === null || this._wanted === this._number) return;
    const reading = (this._reading = {});
    const roadmap = await get("/api/traffic/roadmap").catch(() => null);
    if (reading !== this._reading) return; // it is hidden, or read anew
    if (roadmap) {
      this._number = roadmap.number;
      this._told({ roadmap });
    }
    this._timer = setTimeout(() => {
      this._reading = null;
      this._readRoadmap();
    }, AGAIN);
  }
}

// The roadmap, above the floors of a sheet.
export class RoadmapLayer {
  constructor(sheet) {
    this._group = svg("g", { class: "fp-roads" });
    sheet.insertBefore(this._group, sheet.querySelector(".fp-layer-places"));
  }

  // `isHere(height)`: whether a floor of this height is that of the storey.
  show(roadmap, isHere) {
    if (!roadmap) return this._group.replaceChildren();
    const shut = new Set(roadmap.closed_places);
    const shutLanes = new Set(roadmap.closed_lanes);
    const [open, closed, places, rides] = [[], [], [], []];
    roadmap.lanes.forEach(([start, end], i) => {
      const [a, b] = [roadmap.places[start], roadmap.places[end]];
      if (!isHere(a[2]) || !isHere(b[2])) {
        if (isHere(a[2]) || isHere(b[2])) rides.push(dot(isHere(a[2]) ? a : b));
      } else (shut.has(start) || shut.has(end) || shutLanes.has(i) ? closed : open).push(`M${n(a[0])} ${n(a[1])}L${n(b[0])} ${n(b[1])}`);
    });
    roadmap.places.forEach((place, i) => {
      if (isHere(place[2]) && !shut.has(i)) places.push(dot(place));
    });
    const directions = [];
    for (const [start, end] of roadmap.one_way ?? []) {
      const [a, b] = [roadmap.places[start], roadmap.places[end]];
      if (isHere(a[2]) && isHere(b[2])) directions.push(arrow(a, b));
    }
    const path = (name, parts) => (parts.length ? `<path class="${name}" d="${parts.join("")}"/>` : "");
    this._group.innerHTML = path("fp-road-closed", closed) + path("fp-road", open) + path("fp-road-direction", directions) + path("fp-road-place", places) + path("fp-road-ride", rides);
  }
}

// The ways of the robots, above everything else, in pixels.
export class Ways {
  constructor(layer) {
    this._layer = layer;
    this._robots = [];
  }

  set(robots) {
    this._robots = robots;
  }

  // `spot(name)`: where a robot is drawn on the storey, or null.
  draw(view, spot, isHere) {
    if (this._robots.length === 0) {
      if (this._layer.firstChild) this._layer.replaceChildren();
      return;
    }
    const screen = ([x, y]) => view.toScreen(x, y);
    const parts = [];
    for (const robot of this._robots) {
      const at = spot(robot.robot);
      const granted = ahead(robot.granted ?? [], at);
      parts.push(line("fp-way-planned", [...granted.slice(-1), ...(robot.planned ?? [])], isHere, screen));
      parts.push(line("fp-way-granted", at ? [[at.x, at.y, granted[0]?.[2] ?? null], ...granted] : granted, (z) => z === null || isHere(z), screen));
      if (robot.destination && isHere(robot.destination[2])) {
        const p = screen(robot.destination);
        parts.push(`<circle class="fp-way-end" cx="${n(p.x)}" cy="${n(p.y)}" r="5"><title>${escape(`Destination of ${robot.robot}`)}</title></circle>`);
      }
      for (const blocker of at ? (robot.waits_for ?? []) : []) parts.push(wait(robot, blocker, at, spot, view));
    }
    this._layer.innerHTML = parts.join("");
  }
}

// The granted way without the places that the robot has passed: it is between the first two, or at the first.
function ahead(granted, at) {
  if (!at || granted.length < 2) return granted.slice(granted.length < 2 ? 0 : 1);
  const [, next] = granted;
  return Math.hypot(next[0] - at.x, next[1] - at.y) < 0.02 ? granted.slice(2) : granted.slice(1);
}

function line(name, points, isHere, screen) {
  const pieces = [];
  let last = false;
  for (const point of points) {
    if (isHere(point[2])) {
      const p = screen(point);
      pieces.push(`${last ? "L" : "M"}${n(p.x)} ${n(p.y)}`);
    }
    last = isHere(point[2]);
  }
  return pieces.length > 1 ? `<path class="${name}" d="${pieces.join("")}"/>` : "";
}

function wait(robot, blocker, at, spot, view) {
  const to = spot(blocker);
  if (!to) return "";
  const [a, b] = [view.toScreen(at.x, at.y), view.toScreen(to.x, to.y)];
  const angle = (Math.atan2(b.y - a.y, b.x - a.x) * 180) / Math.PI;
  const [mx, my] = [(a.x + b.x) / 2, (a.y + b.y) / 2];
  return (
    `<g class="fp-wait"><title>${escape(`${robot.robot} ${robot.waiting}`)}</title><path d="M${n(a.x)} ${n(a.y)}L${n(b.x)} ${n(b.y)}"/>` +
    `<path class="fp-tip" transform="translate(${n(mx)} ${n(my)}) rotate(${n(angle)})" d="M6 0L-5 5V-5Z"/></g>`
  );
}

// The tip of an arrow in the middle of a lane, for its direction.
function arrow(a, b) {
  const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
  const size = Math.min(0.14, length / 3); // m
  const [x, y] = [(size * (b[0] - a[0])) / length, (size * (b[1] - a[1])) / length];
  const [mx, my] = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
  return `M${n(mx + x)} ${n(my + y)}L${n(mx - x - y)} ${n(my - y + x)}L${n(mx - x + y)} ${n(my - y - x)}Z`;
}

function dot(place) {
  return `M${n(place[0])} ${n(place[1])}h0`;
}
