"""One file of the modules of a component: a page with a floor plan would request two dozen. The modules stay what ESLint and tests read.

Each module becomes a function that returns what it exports, so that their names do not meet:

    const floorplan_view = (() => {
    const { reach } = floorplan_model;
    ...
    return { View };
    })();

It is for this project's modules: each `import` and `export` is one line, which names what it takes or gives, and no module imports itself
on a way round.
"""

from __future__ import annotations

import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

NAMES = r"\{ (?P<names>\w+(?:, \w+)*) \}"
IMPORT = re.compile(rf'import {NAMES} from "(?P<module>[^"]+)";')
EXPORT_FROM = re.compile(rf'export {NAMES} from "(?P<module>[^"]+)";')
EXPORT_NAMES = re.compile(rf"export {NAMES};")
EXPORT_DECLARATION = re.compile(r"export (?P<declaration>(?:(?:async )?function|class|const) (?P<name>\w+)\b.*)")
STATEMENT = re.compile(r"(import|export)\b")
OWN_NAME = re.compile(r"somrs-(?P<folder>\w+)/(?P<file>[\w/]+\.js)")


def bundle(index: Path, components: Path) -> str:
    """Return a module that exports what `index` exports, with all modules of `components` (a folder) that it needs. Modules with other
    names, such as libraries, are imported once. Raises ValueError for a module
    that cannot be bundled."""
    modules: dict[Path, _Module] = {}
    to_read = [index]
    while to_read:
        if (path := to_read.pop()) not in modules:
            modules[path] = _Module(path, components)
            to_read += modules[path].needed
    try:
        order = [*TopologicalSorter({path: module.needed for path, module in modules.items()}).static_order()]
    except CycleError as error:
        ring = ", ".join(str(path) for path in error.args[1])
        raise ValueError(f"these modules import each other: {ring}; move what they share to a module of its own") from None
    libraries = sorted({library for module in modules.values() for library in module.libraries})
    imports = [f'import * as {_library_variable(library)} from "{library}";' for library in libraries]
    exports = f"export const {{ {', '.join(modules[index].exports)} }} = {_variable(index, components)};"
    return "\n".join([*imports, *(modules[path].function() for path in order), exports, ""])


class _Module:
    def __init__(self, path: Path, components: Path) -> None:
        self.needed: list[Path] = []
        self.libraries: list[str] = []
        self.exports: list[str] = []
        self._path = path
        self._components = components
        self._lines = [self._line(line, number) for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)]

    def function(self) -> str:
        returned = f"return {{ {', '.join(self.exports)} }};"
        return "\n".join([f"const {_variable(self._path, self._components)} = (() => {{", *self._lines, returned, "})();"])

    def _line(self, line: str, number: int) -> str:
        if not STATEMENT.match(line):
            return line
        if statement := IMPORT.fullmatch(line):
            return self._assignment(statement)
        if statement := EXPORT_FROM.fullmatch(line):
            self.exports += statement["names"].split(", ")
            return self._assignment(statement)
        if statement := EXPORT_NAMES.fullmatch(line):
            self.exports += statement["names"].split(", ")
            return ""
        if statement := EXPORT_DECLARATION.fullmatch(line):
            self.exports.append(statement["name"])
            return statement["declaration"]
        forms = 'import { a, b } from "module"; export { a, b }; export { a } from "module"; export function, class or const'
        raise ValueError(f"{self._path}:{number}: cannot be bundled: {line!r}; write it in one line as one of: {forms}")

    def _assignment(self, statement: re.Match[str]) -> str:
        """Return the line that takes names from a module."""
        name = statement["module"]
        if name.startswith("./"):
            path = self._path.parent / name[2:]
        elif own := OWN_NAME.fullmatch(name):
            path = self._components / own["folder"] / "modules" / own["file"]
        else:
            self.libraries.append(name)
            return f"const {{ {statement['names']} }} = {_library_variable(name)};"
        self.needed.append(path)
        return f"const {{ {statement['names']} }} = {_variable(path, self._components)};"


def _variable(path: Path, components: Path) -> str:
    return re.sub(r"\W", "_", path.relative_to(components).with_suffix("").as_posix().replace("/modules/", "_"))


def _library_variable(name: str) -> str:
    return "library_" + re.sub(r"\W", "_", name)
