// The modules of the 3D view.
export { Feed } from "./feed.js";
export { Motion } from "./motion.js";
export { Stage } from "./stage.js";
export { World } from "./world.js";
export { Labels } from "./labels.js";
export { Pilot } from "./pilot.js";
export { Marks } from "./marks.js";
export { summary, listed, described } from "./descriptions.js";
export { template } from "./template.js";
