// The modules of the elements that show a task.
export { drawn, lanes, ticks, works } from "./bars.js";
export { feed } from "./feed.js";
export { curve, layered } from "./layout.js";
export { escaped, fitting, look, sign, word } from "./marks.js";
export { clock, said, saidOf, since, span } from "./messages.js";
