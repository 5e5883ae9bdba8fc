// Converts mouse, touch and key input on a floor plan to actions: pan, select, drag, turn, nudge. Knows nothing of the map.

const FAR = 4; // pixels that a pointer may move before a drag begins
const BIG = 0.1; // metres per arrow key
const SMALL = 0.01; // metres with Shift
const TURN = Math.PI / 12;
const PANNED = 80; // pixels that an arrow key pans the plan when nothing is selected
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const KEYS = new Map([
  [["r", "R"], (does, shift) => does.nudge(0, 0, shift ? -TURN : TURN)],
  [["c", "C"], (does, shift) => does.nextCorner(shift ? -1 : 1)],
  [["+", "="], (does) => does.zoom(1.25)],
  [["-", "_"], (does) => does.zoom(0.8)],
  [["0"], (does) => does.fit()],
  [["Delete", "Backspace"], (does) => does.remove()],
  [["Enter", " "], (does) => does.enter()],
  [["Escape"], (does) => does.escape()],
  [["PageDown", "]"], (does) => does.next(1)],
  [["PageUp", "["], (does) => does.next(-1)],
].flatMap(([keys, act]) => keys.map((key) => [key, act])));

export class Hands {
  // `does`: the actions, see the calls below.
  constructor(element, does) {
    this._element = element;
    this._does = does;
    this._pointers = new Map();
    this._grip = null;
    this._listeners = {
      pointerdown: (event) => this._down(event),
      pointermove: (event) => this._move(event),
      pointerup: (event) => this._up(event),
      pointercancel: (event) => this._cancel(event),
      pointerleave: () => this._does.hover(null),
      wheel: (event) => this._wheel(event),
      keydown: (event) => this._key(event),
      dblclick: () => this._does.open(),
    };
    for (const [type, listener] of Object.entries(this._listeners)) element.addEventListener(type, listener, { passive: false });
  }

  end() {
    for (const [type, listener] of Object.entries(this._listeners)) this._element.removeEventListener(type, listener);
  }

  // Drop the current drag without effect.
  drop() {
    this._grip = null;
  }

  _point(event) {
    const box = this._element.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  _down(event) {
    if (event.button > 1) return;
    const at = this._point(event);
    this._pointers.set(event.pointerId, at);
    this._element.setPointerCapture(event.pointerId);
    this._element.focus({ preventScroll: true });
    if (this._pointers.size === 2) {
      if (this._grip?.dragging) this._does.cancel();
      this._grip = { what: "pinch", ...this._pinch() };
      return;
    }
    const handle = under(event)?.closest("[data-handle]")?.dataset;
    const name = nameAt(event);
    const what = event.button === 1 ? "plan" : handle ? handle.handle : name && this._does.draggable(name, event.pointerType) ? "object" : "plan";
    this._grip = { what, name, corner: Number(handle?.corner), start: at, last: at, dragging: false, below: event.altKey };
    event.preventDefault();
  }

  _move(event) {
    const at = this._point(event);
    if (this._pointers.has(event.pointerId)) this._pointers.set(event.pointerId, at);
    const grip = this._grip;
    if (!grip) return this._does.hover(at, nameAt(event));
    if (grip.what === "pinch") return this._pinched();
    if (!grip.dragging && Math.hypot(at.x - grip.start.x, at.y - grip.start.y) < FAR) return;
    const free = event.altKey;
    if (!grip.dragging) {
      grip.dragging = true;
      if (grip.what === "object") this._does.take(grip.name, grip.start);
      if (grip.what === "turn") this._does.grasp();
      if (grip.what === "corner") this._does.graspCorner(grip.corner);
    }
    if (grip.what === "object") this._does.drag(at, free);
    else if (grip.what === "turn") this._does.turn(at, free);
    else if (grip.what === "corner") this._does.dragCorner(at, free);
    else this._does.pan(at.x - grip.last.x, at.y - grip.last.y);
    grip.last = at;
  }

  _up(event) {
    const grip = this._grip;
    this._pointers.delete(event.pointerId);
    if (grip?.what === "pinch") {
      if (this._pointers.size === 0) this._grip = null;
      return;
    }
    this._grip = null;
    if (!grip) return;
    if (!grip.dragging && grip.what === "corner") this._does.chooseCorner(grip.corner);
    else if (!grip.dragging) this._does.click(grip.name, this._point(event), { below: grip.below, handle: grip.what === "turn" });
    else if (grip.what !== "plan") this._does.release(this._point(event));
  }

  _cancel(event) {
    this._pointers.delete(event.pointerId);
    if (this._grip?.dragging && this._grip.what !== "plan") this._does.cancel();
    this._grip = null;
  }

  _pinch() {
    const [a, b] = [...this._pointers.values()];
    return { apart: Math.hypot(a.x - b.x, a.y - b.y), x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
  }

  _pinched() {
    if (this._pointers.size < 2) return;
    const [before, now] = [this._grip, this._pinch()];
    this._does.pan(now.x - before.x, now.y - before.y);
    this._does.zoom(now.apart / (before.apart || 1), now);
    this._grip = { what: "pinch", ...now };
  }

  _wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    if (event.shiftKey) return this._does.pan(-(event.deltaX || event.deltaY) * lines, 0);
    this._does.zoom(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.008 : 0.0016)), this._point(event));
  }

  _key(event) {
    if (event.target !== this._element) return;
    if (!this._press(event)) return;
    event.preventDefault();
    event.stopPropagation(); // the page may have shortcuts for the same keys
  }

  _press(event) {
    const { key, shiftKey: shift, ctrlKey, metaKey, altKey } = event;
    const does = this._does;
    if (ctrlKey || metaKey) {
      if (key.toLowerCase() !== "z" || shift) return false;
      does.undo();
      return true;
    }
    if (altKey) return false;
    const arrow = ARROWS[key];
    if (arrow) {
      const step = shift ? SMALL : BIG;
      if (!does.nudge(arrow[0] * step, arrow[1] * step, 0)) does.pan(-arrow[0] * PANNED, arrow[1] * PANNED);
      return true;
    }
    KEYS.get(key)?.(does, shift);
    return KEYS.has(key);
  }
}

function nameAt(event) {
  const element = under(event)?.closest("[data-name], [data-label]");
  return element?.dataset.name ?? element?.dataset.label ?? null;
}

// The element under the pointer: the event's target is only the plan.
function under(event) {
  const first = event.composedPath()[0];
  return first instanceof Element ? first : null;
}
