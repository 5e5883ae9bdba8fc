// The modules of the floor plan that its element uses.
export { doings } from "./doings.js";
export { Hands } from "./hands.js";
export { kindById, LEGEND } from "./kinds.js";
export { get, Live } from "./live.js";
export { Plan } from "./plan.js";
export { Poses } from "./poses.js";
export { sample } from "./shapes.js";
export { TrafficNews } from "./traffic.js";
