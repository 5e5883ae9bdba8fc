// Data from the server: the scene (GET /api/scene), its changes (/api/live), and poses (/api/poses). Lost connections are restored, and the
// scene is read again.

import { follow } from "live";

const PAUSES = [300, 700, 1500, 3000];
const GATHERING = 150; // ms for which changes are gathered before they are requested
const MOST_NAMES = 100; // in one request
const POSITIONS = new Set(["PositionX", "PositionY", "PositionZ", "RotationX", "RotationY", "RotationZ"]);
const UNSEEN = new Set(["Charge", "Price", "Speed", "Working", "Problem", "Weight", "Payload", "OperationRange", "Texture"]);

class Poses {
  // The connection to /api/poses, which is made again until it is closed here.
  constructor(hears) {
    this.hears = hears;
    this.tries = 0;
    this.closed = false;
    this.connect();
  }

  connect() {
    const socket = (this.socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/poses`));
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => {
      this.tries = 0;
      this.hears.message(event.data);
    };
    socket.onclose = () => {
      if (this.closed) return;
      this.hears.lost();
      this.timer = setTimeout(() => this.connect(), PAUSES[Math.min(this.tries++, PAUSES.length - 1)]);
    };
  }

  close() {
    this.closed = true;
    clearTimeout(this.timer);
    this.socket.close();
  }
}

export class Feed {
  // `hears`: scene(scene), changed(bodies, gone), placed(name, at), movers(list), robots(work by name), frame(clock, which, values),
  // alive(bool), trouble(text or null). `version`: of a past map, which does not change; null: now.
  constructor(hears, version) {
    this.hears = hears;
    this.version = version;
    this.wanted = new Set(); // names of what has changed and is to be read
    this.all = false; // whether the whole scene is to be read
    this.reading = null; // the reading under way
    this.late = []; // facts that are told after it, as it may be older than they are
    this.isMover = () => false;
    this.stopped = false;
    this.table = -1;
    if (version !== null) {
      this.read();
      return;
    }
    this.leave = follow(["map", "ontology"], {
      open: () => {
        this.reading = null; // it may never end: its connection may be lost, too
        this.read();
      },
      news: (news) => this.news(news),
      lost: () => this.hears.trouble("The connection to the server is lost. Reconnecting…"),
    });
    this.follow();
  }

  follow() {
    this.poses ??= new Poses({
      message: (data) => (typeof data === "string" ? this.told(JSON.parse(data)) : this.frame(data)),
      lost: () => (this.table = -1),
    });
  }

  rest() {
    // The page is hidden: poses are not needed.
    this.poses?.close();
    this.poses = null;
    this.table = -1;
  }

  stop() {
    this.stopped = true;
    clearTimeout(this.timer);
    clearTimeout(this.again);
    this.leave?.();
    this.rest();
  }

  // Read the whole scene.
  read() {
    this.all = true;
    return this.readOn();
  }

  // Read what is wanted, one reading after the other: of two at once, the older one could come last, and would be shown.
  async readOn() {
    if (this.reading) return;
    const reading = (this.reading = {});
    while (this.all || this.wanted.size) {
      // Too many names for one address: read the whole scene.
      const names = this.all || this.wanted.size > MOST_NAMES ? null : [...this.wanted];
      this.all = false;
      this.wanted.clear();
      const hear = await this.ask(names);
      if (this.stopped || reading !== this.reading) return; // the connection was lost meanwhile: everything is read anew
      hear();
      for (const fact of this.late.splice(0)) this.hears.placed(...fact);
    }
    this.reading = null;
  }

  // Returns what to do with the answer.
  async ask(names) {
    const asked = names ? `?names=${encodeURIComponent(names.join(","))}` : this.version !== null ? `?version=${this.version}` : "";
    try {
      const answer = await fetch(`/api/scene${asked}`);
      const found = await answer.json();
      if (!answer.ok) return () => this.hears.trouble(found.problem);
      return () => {
        this.hears.trouble(null);
        if (names) this.hears.changed(found, names);
        else this.hears.scene(found);
      };
    } catch {
      return () => {
        this.hears.trouble("The server does not answer. Retrying…");
        clearTimeout(this.again);
        this.again = setTimeout(() => this.read(), 2000);
      };
    }
  }

  news({ topic, value, missed }) {
    if (missed || topic === "ontology" || value.read) {
      this.read();
      return;
    }
    for (const change of value.changes) this.change(change);
    if (this.wanted.size && !this.timer) {
      this.timer = setTimeout(() => {
        this.timer = null;
        this.readOn();
      }, GATHERING);
    }
  }

  change(change) {
    switch (change.type) {
      case "ObjectAdded":
        this.wanted.add(change.object.name);
        break;
      case "ObjectRemoved":
        this.wanted.add(change.name);
        break;
      case "ValueSet":
        if (UNSEEN.has(change.path) || (POSITIONS.has(change.path) && this.isMover(change.object))) break;
        this.wanted.add(change.object);
        break;
      case "FactAdded":
      case "FactRemoved": {
        const { relation, arguments: about } = change.fact;
        if (["isOn", "isIn", "isHeldBy"].includes(relation)) {
          const fact = [about[0], relation, about[1], change.type === "FactAdded"];
          if (this.reading) this.late.push(fact);
          else this.hears.placed(...fact);
        }
      }
    }
  }

  told(news) {
    if (news.movers) {
      this.table = news.table;
      this.numbers = news.movers.map((mover) => mover.numbers);
      this.hears.movers(news.movers, news.source);
    }
    if (news.robots) this.hears.robots(news.robots);
    if (news.alive !== undefined && news.alive !== null) this.hears.alive(news.alive);
  }

  frame(buffer) {
    const head = new DataView(buffer);
    if (head.getUint32(16, true) !== this.table) return;
    const count = head.getUint32(20, true);
    const which = new Uint32Array(buffer, 24, count);
    this.hears.frame(head.getFloat64(0, true), which, new Float32Array(buffer, 24 + 4 * count));
  }
}
