"""The modules of a component become one file."""

from __future__ import annotations

import subprocess
from pathlib import Path
from shutil import which

import pytest

from somrs.gui.components.bundle import bundle

INDEX = """// The plan.
export { drawn } from "./draw.js";
export { Shape, SIZE } from "./shape.js";
"""
DRAW = """import { basename } from "node:path";
import { Shape } from "./shape.js";
import { move } from "somrs-scene/motion.js";

const size = 2;

export function drawn(at) {
  return `${basename("/a/b")} ${new Shape(size).area} ${move(at)}`;
}
"""
SHAPE = """import { sep } from "node:path";

const size = sep.length + 2;
export const SIZE = size;

export class Shape {
  constructor(by) {
    this.area = by * size;
  }
}
"""
MOTION = """export async function wait() {}

function move(at) {
  return at + 1;
}

export { move };
"""


def folder(root: Path, **modules: str) -> Path:
    """Write modules `FOLDER__NAME`; return the index of the folder `plan`."""
    for name, text in modules.items():
        path = root.joinpath(*name.replace("__", "/modules/").split("/")).with_suffix(".js")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return root / "plan" / "modules" / "index.js"


def result(content: str, expression: str) -> str:
    """Return what node prints for an expression of a bundle's exports."""
    if (node := which("node")) is None:
        pytest.skip("node is not installed; on Debian and Ubuntu: sudo apt-get install nodejs npm")
    script = f"{content}\nconsole.log({expression});"
    return subprocess.run([node, "--input-type=module"], input=script, capture_output=True, text=True, check=True).stdout.strip()


def test_modules_keep_their_own_names(tmp_path: Path) -> None:
    index = folder(tmp_path, plan__index=INDEX, plan__draw=DRAW, plan__shape=SHAPE, scene__motion=MOTION)
    content = bundle(index, components=tmp_path)
    assert result(content, "[drawn(1), SIZE, new Shape(1).area, typeof wait].join()") == "b 6 2,3,3,undefined"
    assert content.count('import * as library_node_path from "node:path";') == 1
    assert bundle(index, components=tmp_path) == content


@pytest.mark.parametrize(
    "statement",
    ['import Shape from "./shape.js";', 'import { a as b } from "./shape.js";', "export default 3;", "export let count = 0;", "import {"],
)
def test_what_cannot_be_bundled_is_named(tmp_path: Path, statement: str) -> None:
    index = folder(tmp_path, plan__index=f"// Shapes.\n{statement}\n")
    with pytest.raises(ValueError, match=r"index\.js:2: cannot be bundled: .*; write it in one line as one of: import"):
        bundle(index, components=tmp_path)


def test_modules_that_import_each_other_are_named(tmp_path: Path) -> None:
    index = folder(
        tmp_path,
        plan__index='export { a } from "./a.js";\n',
        plan__a='import { b } from "./b.js";\n',
        plan__b='import { a } from "./a.js";\n',
    )
    with pytest.raises(ValueError, match=r"import each other: .*a\.js, .*b\.js, .*a\.js; move what they share"):
        bundle(index, components=tmp_path)
