// The objects that the user has moved, and that are not there on the map yet. They stay where they were moved to until the page has answered
// all their moves, and the map has the last one, however long that takes.

const NOTICE = 1000; // milliseconds after which the user is told that a move is still on its way

export class Held {
  // `told(movers)`: called with the objects whose moves are on their way for a while, whenever these are others than before.
  constructor(told) {
    this._told = told;
    this._held = new Map(); // by name: { mover, inHand, unanswered, version, since }
    this._late = [];
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
    if (held?.mover === mover) held.inHand = true;
    else this._held.set(name, { mover, inHand: true, unanswered: 0, version: -1, since: Infinity });
  }

  drop(name) {
    this._held.delete(name);
    this._note();
  }

  // What was moved with an object, and itself.
  movedWith(mover) {
    return [...this._held].filter(([, held]) => held.mover === mover).map(([name]) => name);
  }

  // Whether a move of the object is not on the map yet, besides the one in the hand.
  isOnItsWay(name, map) {
    const held = this._held.get(name);
    return held !== undefined && (held.unanswered > 0 || held.version > map.version);
  }

  // The object is not in the hand any more. `asked`: the page has been told of the move, and will answer.
  release(mover, asked) {
    for (const held of this._of(mover)) {
      held.inHand = false;
      if (asked && held.unanswered++ === 0) held.since = performance.now();
    }
    this._note();
  }

  // The page has answered a move: the map contains it since this version; without a version, it was refused.
  answered(mover, version = -1) {
    for (const held of this._of(mover)) {
      held.unanswered = Math.max(held.unanswered - 1, 0);
      held.version = Math.max(held.version, version);
      if (held.unanswered === 0) held.since = Infinity;
    }
    this._note();
  }

  // The objects that the map has where they were moved to, or not at all, and those whose moves were all refused.
  settledBy(map) {
    const isSettled = (held) => !held.inHand && held.unanswered === 0 && map.version >= held.version;
    return [...this._held].filter(([name, held]) => isSettled(held) || !map.objects.has(name)).map(([name]) => name);
  }

  // The page will not answer the moves that it has been told of: the connection was lost. Returns the objects that were moved.
  giveUp() {
    const lost = [...this._held.values()].filter((held) => held.unanswered > 0);
    for (const held of lost) [held.unanswered, held.since] = [0, Infinity];
    this._note();
    return [...new Set(lost.map((held) => held.mover))];
  }

  _of(mover) {
    return this.movedWith(mover).map((name) => this._held.get(name));
  }

  // Tell which moves are on their way for a while, now and when there are more.
  _note() {
    clearTimeout(this._timer);
    this._timer = null;
    const now = performance.now();
    const moves = [...this._held.values()];
    const late = [...new Set(moves.filter((held) => now >= held.since + NOTICE).map((held) => held.mover))];
    if (late.join() !== this._late.join()) this._told((this._late = late));
    const next = Math.min(...moves.map((held) => held.since + NOTICE).filter((due) => due > now));
    if (Number.isFinite(next)) this._timer = setTimeout(() => this._note(), next - now);
  }
}
