// Poses of moving objects from the simulator. The map gets them only when a service reports a situation.

import { Motion } from "somrs-scene/motion.js";

const AGAIN = 3000; // milliseconds before a lost connection is restored
const SELDOM = 100; // milliseconds between two frames when the user prefers reduced motion
const LEAVES = 2; // numbers of a pose up to which it is that of leaves
const STILL = 0.01; // metres or radians; an object that moved less since its first pose is drawn at its map pose

export class Poses {
  // `place(poses)` is called before each frame with the moved objects: a map from names to { x, y, z, turned }; `swing(shares)` with the doors
  // and cupboards whose leaves moved: a map from names to how far each leaf is open, from 0 to 1.
  constructor(place, swing) {
    this._place = place;
    this._swing = swing;
    this._motion = new Motion();
    this._table = -1;
    this._first = new Map();
    this._frame = this._pause = 0;
    this._waits = false;
    this._socket = null;
    this._seen = () => (document.hidden ? this.rest() : this.follow());
    document.addEventListener("visibilitychange", this._seen);
  }

  end() {
    document.removeEventListener("visibilitychange", this._seen);
    this.rest();
    this._ended = true;
  }

  follow() {
    if (this._socket || this._ended) return;
    const url = new URL("/api/poses", location.href);
    url.protocol = url.protocol.replace("http", "ws");
    const socket = (this._socket = new WebSocket(url));
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => (typeof data === "string" ? this._told(JSON.parse(data)) : this._heard(data));
    socket.onclose = () => {
      if (socket !== this._socket) return;
      this.rest();
      this._timer = setTimeout(() => this.follow(), AGAIN);
    };
  }

  rest() {
    clearTimeout(this._timer);
    clearTimeout(this._pause);
    cancelAnimationFrame(this._frame);
    const socket = this._socket;
    [this._socket, this._waits, this._table] = [null, false, -1];
    socket?.close();
    this._motion.restart();
    this._first.clear();
  }

  _told(news) {
    if (!news.movers) return;
    this._table = news.table;
    this._motion.set(news.movers);
  }

  // The format of a frame is documented in `api/poses.py`.
  _heard(buffer) {
    const head = new DataView(buffer);
    if (head.getUint32(16, true) !== this._table) return;
    const count = head.getUint32(20, true);
    this._motion.hear(head.getFloat64(0, true), new Uint32Array(buffer, 24, count), new Float32Array(buffer, 24 + 4 * count), performance.now() / 1000);
    if (!this._waits) this._next();
  }

  _next() {
    this._waits = true;
    const draw = () => (this._frame = requestAnimationFrame(() => this._play()));
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) this._pause = setTimeout(draw, SELDOM);
    else draw();
  }

  _play() {
    this._waits = false;
    const moved = new Map();
    const swung = new Map();
    this._motion.play(performance.now() / 1000, (name, numbers) => {
      if (numbers.length <= LEAVES) {
        swung.set(name, numbers);
        return;
      }
      const [x, y, z, turned] = numbers;
      const first = this._first.get(name);
      if (!first) this._first.set(name, { x, y, z, turned });
      else if (first.moves || Math.hypot(x - first.x, y - first.y, z - first.z) > STILL || Math.abs(turned - first.turned) > STILL) {
        first.moves = true;
        moved.set(name, { x, y, z, turned });
      }
    });
    if (swung.size) this._swing(swung);
    if (moved.size) this._place(moved);
    if (this._motion.active) this._next();
  }
}
