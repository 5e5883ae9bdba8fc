"""Parses PDDL text into words and groups with their lines, and collects mistakes. `syntax.py` interprets them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from somrs.errors import ModelError, Problem

DEEPEST = 100
"""The maximum nesting of parentheses; more are taken for a mistake."""

_TOKEN = re.compile(r"[()]|\?[^\s();?]*|[^\s();?]+|;[^\n]*|\n")


@dataclass(frozen=True, slots=True)
class Word:
    """A name, a variable, a keyword or a number. PDDL is not case-sensitive: `text` is in lower case, `written` as in the file."""

    text: str
    written: str
    line: int

    def __str__(self) -> str:
        return self.written


@dataclass(frozen=True, slots=True)
class Group:
    """The items between two parentheses."""

    items: tuple[Node, ...]
    line: int

    @property
    def head(self) -> str:
        """The first item, if it is a word; otherwise empty."""
        return self.items[0].text if self.items and isinstance(self.items[0], Word) else ""

    def __str__(self) -> str:
        return f"({' '.join(map(str, self.items))})"


Node = Word | Group


@dataclass(slots=True)
class Mistakes:
    """The mistakes in one file, collected so that all are reported at once."""

    file: str
    problems: list[Problem] = field(default_factory=list)

    def note(self, node: Node | int | None, subject: str, rule: str, message: str) -> None:
        line = node if isinstance(node, int) or node is None else node.line
        self.problems.append(Problem(file=self.file, line=line, subject=subject, rule=rule, message=message))

    def unsupported(self, node: Node | int, subject: str, message: str) -> None:
        """Note that the file uses an unsupported feature."""
        self.note(node, subject, "unsupported", f"{message}; docs/how-to/import-planning-problems.md lists what is supported")


def raise_all(*files: Mistakes) -> None:
    """Raise ModelError with the mistakes in all files, if there are any."""
    problems = [problem for file in files for problem in dict.fromkeys(file.problems)]
    if problems:
        raise ModelError(problems)


def parse(text: str, mistakes: Mistakes) -> Group | None:
    """The single group of a file; None after a mistake."""
    open_groups: list[tuple[int, list[Node]]] = []
    top_nodes: list[Node] = []
    for token, line in _tokens(text):
        if token == "(":
            if len(open_groups) == DEEPEST:
                mistakes.note(line, "file", "syntax", f"more than {DEEPEST} nested parentheses; reduce the nesting")
                return None
            open_groups.append((line, []))
        elif token == ")":
            if not open_groups:
                mistakes.note(line, "file", "syntax", "this ) has no matching (; remove it, or add the missing (")
                return None
            start_line, items = open_groups.pop()
            (open_groups[-1][1] if open_groups else top_nodes).append(Group(tuple(items), start_line))
        else:
            (open_groups[-1][1] if open_groups else top_nodes).append(Word(token.lower(), token, line))
    if open_groups:
        mistakes.note(open_groups[-1][0], "file", "syntax", "the ( in this line is never closed; add the missing )")
        return None
    if len(top_nodes) != 1 or not isinstance(top_nodes[0], Group):
        line = top_nodes[1].line if len(top_nodes) > 1 else 1
        mistakes.note(line, "file", "syntax", "a PDDL file is one group, (define ...), and nothing else")
        return None
    return top_nodes[0]


def _tokens(text: str) -> Iterator[tuple[str, int]]:
    line = 1
    for match in _TOKEN.finditer(text):
        token = match.group()
        if token == "\n":
            line += 1
        elif not token.startswith(";"):
            yield token, line


def number(node: Node) -> float | None:
    """The value of a word that is a number; None for other nodes."""
    if isinstance(node, Word) and re.fullmatch(r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?", node.text):
        return float(node.text)
    return None
