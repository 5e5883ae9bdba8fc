// A clock that advances only when a test lets time pass.

export const clock = {
  now: 0,
  due: new Map(),
  last: 0,

  set(act, after, every = null) {
    this.due.set(++this.last, { act, at: this.now + (after || 0), every });
    return this.last;
  },

  // Let milliseconds pass, with all timers that are due in them.
  async pass(milliseconds = 0) {
    const end = this.now + milliseconds;
    await settled();
    for (let next = this.next(end); next; next = this.next(end)) {
      const [number, one] = next;
      this.now = Math.max(this.now, one.at);
      if (one.every === null) this.due.delete(number);
      else one.at += one.every;
      one.act(this.now);
      await settled();
    }
    this.now = end;
  },

  next(end) {
    return [...this.due].filter(([, one]) => one.at <= end).sort((a, b) => a[1].at - b[1].at || a[0] - b[0])[0];
  },
};

// Wait until all pending promises have been handled.
export async function settled() {
  for (let turn = 0; turn < 4; turn++)
    await new Promise((done) => {
      setImmediate(done);
    });
}

globalThis.setTimeout = (act, after) => clock.set(act, after);
globalThis.setInterval = (act, every) => clock.set(act, every, every);
globalThis.requestAnimationFrame = (act) => clock.set(act, 16);
globalThis.clearTimeout = globalThis.clearInterval = globalThis.cancelAnimationFrame = (number) => clock.due.delete(number);
performance.now = () => clock.now;
Date.now = () => 1e6 + clock.now;
