// Data from the server: the scene (GET /api/scene), its changes (/api/live), and poses (/api/poses). Lost connections are restored, and the
// scene is read again.

import { follow } from "live";

const PAUSES = [300, 700, 1500, 3000];
const GATHERING = 150; // ms for which changes are gathered before they are requested
const POSITIONS = new Set(["PositionX", "PositionY", "PositionZ", "RotationX", "RotationY", "RotationZ"]);
const UNSEEN = new Set(["Charge", "Price", "Speed", "Working", "Weight", "Payload", "OperationRange", "Texture"]);

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
    this.wanted = new Set();
    this.gone = new Set();
    this.isMover = () => false;
    this.stopped = false;
    this.table = -1;
    if (version !== null) {
      this.read();
      return;
    }
    this.leave = follow(["map", "ontology"], {
      open: () => this.read(),
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

  async read(names = null) {
    const asked = names ? `?names=${encodeURIComponent(names.join(","))}` : this.version !== null ? `?version=${this.version}` : "";
    try {
      const answer = await fetch(`/api/scene${asked}`);
      const found = await answer.json();
      if (this.stopped) return;
      if (!answer.ok) {
        this.hears.trouble(found.problem);
        return;
      }
      this.hears.trouble(null);
      if (names) this.hears.changed(found, names);
      else this.hears.scene(found);
    } catch {
      if (this.stopped) return;
      this.hears.trouble("The server does not answer. Retrying…");
      clearTimeout(this.again);
      this.again = setTimeout(() => this.read(), 2000);
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
        const names = [...this.wanted];
        this.wanted.clear();
        // Too many names for one address: read the whole scene.
        if (names.length > 100) this.read();
        else this.read(names);
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
          this.hears.placed(about[0], relation, about[1], change.type === "FactAdded");
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
