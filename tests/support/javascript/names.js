// Resolves module names for node as the page's import map does: `somrs-FOLDER/NAME.js` is in a component's folder, and Vue and three.js are
// those of NiceGUI, so tests use the same versions as the product.

import { spawnSync } from "node:child_process";
import { existsSync } from "node:fs";
import { fileURLToPath, pathToFileURL } from "node:url";

const ROOT = new URL("../../../", import.meta.url);
const COMPONENTS = new URL("src/somrs/gui/components/", ROOT);
const OF_NICEGUI = { vue: "static/vue.esm-browser.js", "nicegui-scene": "elements/scene/dist/index.js" };

let nicegui = null;

// The folder of NiceGUI in the project's own Python, or in the one that PYTHON names.
function niceguiFolder() {
  if (nicegui) return nicegui;
  const own = fileURLToPath(new URL(".venv/bin/python", ROOT));
  const python = existsSync(own) ? own : (process.env.PYTHON ?? "python3");
  const script = "import importlib.util; print(importlib.util.find_spec('nicegui').submodule_search_locations[0])";
  const { status, stdout } = spawnSync(python, ["-c", script], { encoding: "utf8" });
  if (status !== 0) throw new Error(`'${python}' has no NiceGUI: make setup, or say by PYTHON which Python has it`);
  nicegui = pathToFileURL(`${stdout.trim()}/`);
  return nicegui;
}

function place(name) {
  const own = /^somrs-(\w+)(?:\/(.+))?$/.exec(name);
  if (own) return new URL(`${own[1]}/modules/${own[2] ?? "index.js"}`, COMPONENTS);
  if (name === "live") return new URL("live.js", COMPONENTS);
  return name in OF_NICEGUI ? new URL(OF_NICEGUI[name], niceguiFolder()) : null;
}

export async function resolve(name, context, next) {
  const url = place(name);
  return url ? { url: url.href, format: "module", shortCircuit: true } : next(name, context);
}
