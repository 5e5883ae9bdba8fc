// For `node --import`: resolves modules by their names in the browser.

import { register } from "node:module";

register("./names.js", import.meta.url);
