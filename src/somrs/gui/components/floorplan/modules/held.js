// The objects that the user has moved, and that are not there on the map yet. They stay where they were moved to until the page has answered
// all their moves, and the map has the last one.

const PATIENCE = 15000; // milliseconds that a moved object waits for the page's reply

export class Held {
  // `late(names)`: called for objects whose move the page has not answered in time; they are held no longer.
  constructor(late) {
    this._late = late;
    this._held = new Map(); // by name: { mover, version, since, unanswered }
    this._timer = null;
  }

  end() {
    clearTimeout(this._timer);
  }

  has(name) {
    return this._held.has(name);
  }

  // The user moves an object, again perhaps, with the object `mover` or by itself. Answers to earlier moves do not end this one.
  keep(name, mover) {
    const held = this._held.get(name);
    const unanswered = held?.mover === mover ? held.unanswered : 0;
    this._held.set(name, { mover, version: Infinity, since: Infinity, unanswered });
  }

  drop(name) {
    this._held.delete(name);
  }

  // What was moved with an object, and itself.
  movedWith(mover) {
    return [...this._held].filter(([, held]) => held.mover === mover).map(([name]) => name);
  }

  // The page has been told of a move: wait for its reply, with a time limit.
  told(mover) {
    for (const name of this.movedWith(mover)) {
      const held = this._held.get(name);
      held.since = performance.now();
      held.unanswered++;
    }
    this._timer ??= setTimeout(() => this._waitedLong(), PATIENCE);
  }

  // The page has answered a move: the map contains it since this version.
  answered(mover, version) {
    for (const name of this.movedWith(mover)) {
      const held = this._held.get(name);
      held.unanswered--;
      if (held.unanswered === 0 && Number.isFinite(held.since)) held.version = version;
    }
  }

  // The objects that the map has where they were moved to, or not at all.
  settledBy(map) {
    return [...this._held].filter(([name, held]) => map.version >= held.version || !map.objects.has(name)).map(([name]) => name);
  }

  _waitedLong() {
    const now = performance.now();
    const late = [...this._held].filter(([, held]) => now - held.since >= PATIENCE - 100).map(([name]) => name);
    for (const name of late) this._held.delete(name);
    const next = Math.min(...[...this._held.values()].map((held) => held.since));
    this._timer = Number.isFinite(next) ? setTimeout(() => this._waitedLong(), next + PATIENCE - now) : null;
    if (late.length) this._late(late);
  }
}
