// Every module can be loaded: its text is in order, and what it imports is there.

import assert from "node:assert/strict";
import { readdirSync } from "node:fs";
import test from "node:test";

const COMPONENTS = new URL("../../../../src/somrs/gui/components/", import.meta.url);

const modules = readdirSync(COMPONENTS, { recursive: true }).filter((file) => file.endsWith(".js"));

test("there are modules", () => assert.ok(modules.length > 40));

for (const file of modules.sort())
  test(file, async () => {
    const module = await import(new URL(file, COMPONENTS));
    assert.notDeepEqual(Object.keys(module), [], "it exports something");
    if (module.default) assert.equal(typeof module.default.template, "string");
  });
