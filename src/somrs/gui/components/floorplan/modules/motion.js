// Animates drawings to the poses of their objects. A new destination continues from the current pose.

const TIME = 450; // milliseconds
const FEW = 300; // more objects than these jump: nobody could follow them

export class Motion {
  // `put(name, at)` draws an object at a pose; `done(names)` is called after each frame with the objects that moved, and whether all have
  // arrived.
  constructor(put, done) {
    this._put = put;
    this._done = done;
    this._ways = new Map();
    this._frame = 0;
  }

  go(moves) {
    const still = moves.length > FEW || matchMedia("(prefers-reduced-motion: reduce)").matches || document.hidden;
    const now = performance.now();
    for (const { name, from, to } of moves) {
      if (still) this._put(name, to);
      else this._ways.set(name, { from, to, turn: shortest(to.turned - from.turned), start: now });
    }
    if (still) this._done(new Set(moves.map((move) => move.name)), true);
    else if (this._ways.size && !this._frame) this._frame = requestAnimationFrame(() => this._step());
  }

  stop(name) {
    this._ways.delete(name);
  }

  end() {
    cancelAnimationFrame(this._frame);
    this._ways.clear();
    this._frame = 0;
  }

  _step() {
    const now = performance.now();
    const moved = new Set();
    for (const [name, way] of this._ways) {
      const share = Math.min(1, (now - way.start) / TIME);
      const s = share * (2 - share);
      const { from, to } = way;
      this._put(name, share === 1 ? to : { x: from.x + s * (to.x - from.x), y: from.y + s * (to.y - from.y), turned: from.turned + s * way.turn });
      moved.add(name);
      if (share === 1) this._ways.delete(name);
    }
    this._frame = this._ways.size ? requestAnimationFrame(() => this._step()) : 0;
    this._done(moved, this._frame === 0);
  }
}

export function shortest(angle) {
  return Math.atan2(Math.sin(angle), Math.cos(angle));
}
