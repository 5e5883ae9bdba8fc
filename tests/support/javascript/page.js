// A page for tests of components without a browser. Import it before the module under test. There is no layout: all sizes are 0 except
// those that a test sets.

import { JSDOM, VirtualConsole } from "jsdom";
import { settled } from "./clock.js";
import "./server.js";

export { clock, settled } from "./clock.js";
export { server } from "./server.js";

// An error in a listener fails the test.
const heard = new VirtualConsole().on("jsdomError", (error) => setImmediate(() => {
  throw error;
}));
const PAGE = '<!doctype html><html><head><link rel="stylesheet" href="/look.css"></head><body></body></html>';
const { window } = new JSDOM(PAGE, { url: "http://somrs.test/", pretendToBeVisual: true, virtualConsole: heard });

const TAKEN = [
  "document", "location", "sessionStorage", "Element", "Event", "HTMLElement", "InputEvent", "KeyboardEvent", "MouseEvent", "Node", "ShadowRoot", "SVGElement",
];
for (const name of TAKEN) globalThis[name] = window[name];
globalThis.window = window;
globalThis.CSS = { escape: (text) => text.replace(/[^\w-]/g, "\\$&") };
globalThis.devicePixelRatio = 1;
globalThis.matchMedia = (query) => ({ matches: query.includes("reduce") && page.calm });
window.HTMLCanvasElement.prototype.getContext = (kind) => (kind === "2d" ? { measureText: (text) => ({ width: 6 * text.length }) } : null);
window.Element.prototype.scrollIntoView = () => {};
window.Element.prototype.setPointerCapture = () => {};
window.SVGElement.prototype.getTotalLength = () => 0;
window.SVGElement.prototype.getPointAtLength = () => ({ x: 0, y: 0 });
globalThis.IntersectionObserver = class {
  observe() {}
  disconnect() {}
};
globalThis.ResizeObserver = class {
  constructor(told) {
    this.told = told;
  }

  observe(element) {
    page.sized.set(element, (width, height) => this.told([{ contentRect: { width, height } }]));
  }

  disconnect() {}
};

export const page = {
  calm: false, // whether the user prefers reduced motion
  sized: new Map(), // by element: the function that reports a new size
};

globalThis.console.info = () => {}; // Vue prints a notice for developers

// Components

const QUASAR = ["q-btn", "q-icon", "q-tooltip"];

// Mounts the component on the page, as Vue does there. A warning of Vue, such as for an unknown name in a template, fails the test.
// Returns the element, the component itself, and its events: [event, value].
export async function mounted(component, properties = {}) {
  const { createApp, h, reactive } = await import("vue");
  const given = reactive({ ...properties });
  const told = [];
  const hears = Object.fromEntries((component.emits ?? []).map((event) => [`on${event[0].toUpperCase()}${event.slice(1)}`, (value) => told.push([event, value])]));
  let shown = null;
  const app = createApp({ render: () => h(component, { ...given, ...hears, ref: (one) => (shown = one ?? shown) }) });
  app.config.warnHandler = (what, _, trace) => {
    throw new Error(`${what}${trace}`);
  };
  app.config.errorHandler = (error) => {
    throw error;
  };
  for (const name of QUASAR) app.component(name, { template: "<span><slot /></span>" });
  const holder = document.body.appendChild(document.createElement("div"));
  app.mount(holder);
  await settled();
  return {
    shown,
    told,
    given,
    element: holder.firstElementChild,
    leave: () => {
      app.unmount();
      holder.remove();
    },
  };
}

// Gestures

export async function press(element, key, more = {}) {
  const event = new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true, ...more });
  element.dispatchEvent(event);
  await settled();
  return event;
}

export async function write(field, text) {
  field.value = text;
  field.dispatchEvent(new InputEvent("input", { bubbles: true }));
  await settled();
}

export async function click(element) {
  element.dispatchEvent(new MouseEvent("click", { bubbles: true, cancelable: true }));
  await settled();
}

// The text of an element, with the whitespace of the layout collapsed.
export const text = (element) => element.textContent.replace(/\s+/g, " ").trim();
