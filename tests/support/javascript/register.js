// For `node --import`: has the modules found by the names that they have in the browser.

import { register } from "node:module";

register("./names.js", import.meta.url);
