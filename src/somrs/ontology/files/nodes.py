"""Parses YAML text into plain values, and finds the line of each value. `loading.py` interprets the values.

The rules are those of the YAML 1.2 core schema: only `true` and `false` are booleans (`Off`, `No` and `y` are names), `1e-3` is a number,
dates are text. Aliases are rejected: a few lines of them can expand to gigabytes, and defaults of types serve the same purpose.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import yaml

from somrs.errors import Problem

Path = tuple[str | int, ...]

DEPTH = 200
"""The maximum nesting of brackets; the C parser recurses."""

_RESOLVERS: list[tuple[str, str, str]] = [
    ("tag:yaml.org,2002:bool", r"^(?:true|True|TRUE|false|False|FALSE)$", "tTfF"),
    ("tag:yaml.org,2002:int", r"^[-+]?[0-9]+$", "-+0123456789"),
    (
        "tag:yaml.org,2002:float",
        r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$",
        "-+.0123456789",
    ),
    ("tag:yaml.org,2002:null", r"^(?:~|null|Null|NULL|)$", "~nN"),
]


class _Loader(yaml.CSafeLoader):
    yaml_implicit_resolvers: dict[Any, Any] = {}  # PyYAML reads this class attribute


class Dumper(yaml.CSafeDumper):
    """Quotes exactly the texts that `Source` would otherwise read as values of another kind."""

    yaml_implicit_resolvers: dict[Any, Any] = {}

    def ignore_aliases(self, data: Any) -> bool:
        return True


class Lines(list[Any]):
    """A list that is written with each item on its own line."""


Dumper.add_representer(Lines, lambda dumper, lines: dumper.represent_sequence("tag:yaml.org,2002:seq", lines, flow_style=False))

for _tag, _pattern, _first in _RESOLVERS:
    for _class in (_Loader, Dumper):
        _class.add_implicit_resolver(_tag, re.compile(_pattern), [*_first, ""] if _tag.endswith("null") else list(_first))

# Numbers of the core schema; PyYAML's own constructors read the octal and base-60 numbers of YAML 1.1.
_Loader.add_constructor("tag:yaml.org,2002:int", lambda _, node: float(node.value))
_Loader.add_constructor("tag:yaml.org,2002:float", lambda _, node: float(re.sub(r"^([-+]?)\.(inf|nan)$", r"\1\2", node.value.lower())))


class Source:
    """One parsed YAML file: its values, its problems, and the line of each value."""

    def __init__(self, file: str, text: str) -> None:
        self.file = file
        self.data: Any = None
        self.problems: list[Problem] = []
        self._root: yaml.Node | None = None
        self._indexes: dict[int, dict[str, tuple[int, yaml.Node]]] = {}
        if _depth(text) > DEPTH:
            self._problem(None, "syntax", f"more than {DEPTH} nested brackets; no map needs so many")
            return
        try:
            loader = _Loader(text)
            try:
                self._root = loader.get_single_node()
                if self._root is not None and self._clean(self._root):
                    self.data = loader.construct_document(self._root)
            finally:
                loader.dispose()
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            self._problem(mark.line + 1 if mark else None, "syntax", f"this is not YAML: {_advice(error.problem or error.context or '')}")
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            self._problem(None, "syntax", f"this is not YAML: {error}")

    def line(self, path: Path) -> int | None:
        """The line of the key or item at the path, or at the longest part of the path that exists; None for an empty file."""
        node, line = self._root, 1 if self._root is not None else None
        for step in path:
            if isinstance(node, yaml.MappingNode):
                entry = self._entries(node).get(str(step))
                if entry is None:
                    break
                line, node = entry
            elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
                node = node.value[step]
                line = node.start_mark.line + 1
            else:
                break
        return line

    def keys(self, path: Path) -> set[str]:
        """The keys of the mapping at the path; empty when there is no mapping."""
        node = self._root
        for step in path:
            entry = self._entries(node).get(str(step)) if isinstance(node, yaml.MappingNode) else None
            if entry is None:
                return set()
            node = entry[1]
        return set(self._entries(node)) if isinstance(node, yaml.MappingNode) else set()

    def _entries(self, node: yaml.MappingNode) -> dict[str, tuple[int, yaml.Node]]:
        """The line and the value of each key."""
        if id(node) not in self._indexes:
            entries = {key.value: (key.start_mark.line + 1, value) for key, value in node.value if isinstance(key, yaml.ScalarNode)}
            self._indexes[id(node)] = entries
        return self._indexes[id(node)]

    def _problem(self, line: int | None, rule: str, message: str, subject: str = "file") -> None:
        self.problems.append(Problem(file=self.file, line=line, subject=subject, rule=rule, message=message))

    def _clean(self, root: yaml.Node) -> bool:
        """Report aliases and repeated keys; of repeated keys, YAML itself would use the last. False when the values cannot be built."""
        visited_ids: set[int] = set()
        aliased = False
        stack = [root]
        while stack:
            node = stack.pop()
            if id(node) in visited_ids:
                line = node.start_mark.line + 1
                self._problem(line, "alias", "YAML aliases (&name, *name) are not used here; write it out, or give the type defaults")
                aliased = True
                continue
            if not isinstance(node, yaml.CollectionNode):
                continue
            visited_ids.add(id(node))
            if isinstance(node, yaml.MappingNode):
                for twice, first in _repeated(node):
                    message = f"{twice.value} is already written in line {first}; keep one of the two"
                    self._problem(twice.start_mark.line + 1, "duplicate", message, subject=twice.value)
                stack.extend(value for _, value in node.value)
            else:
                stack.extend(node.value)
        return not aliased


def _advice(problem: str) -> str:
    """What the parser says of a problem, and what is mostly the matter."""
    if "cannot start any token" in problem:
        return f"{problem}; lines begin with spaces, not with tabs, and texts that begin with @, ` or % are quoted"
    if "constructor for the tag" in problem:
        return "tags such as !name are not used here; leave it out, or quote the text"
    return problem


def _repeated(node: yaml.MappingNode) -> Iterator[tuple[yaml.ScalarNode, int]]:
    first: dict[str, int] = {}
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode):
            if key.value in first:
                yield key, first[key.value]
            else:
                first[key.value] = key.start_mark.line + 1


def _depth(text: str) -> int:
    """The maximum nesting of flow collections. Brackets in texts and comments count too, which is harmless."""
    depth = deepest = 0
    for bracket in re.findall(r"[\[\]{}]", text):
        depth = depth + 1 if bracket in "[{" else max(depth - 1, 0)
        deepest = max(deepest, depth)
    return deepest
