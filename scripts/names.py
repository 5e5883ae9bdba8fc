"""Counts and lists names that do not describe their values.

A name describes what a value is: `candidate`, `binding`, `reply`. A bare name only says that there is a value (`one`), or that something
was done to it (`found`, `said`, `wanted`): each of its words is a pronoun, a preposition, an adverb or a form of a general verb. The script
counts the names that code assigns: variables, attributes, parameters, loop variables, names of captures and of exceptions.

    python scripts/names.py                  counts for src, verification and tests; fails above the limit
    python scripts/names.py --list [PATH]    every bare name with its file and line
"""

from __future__ import annotations

import argparse
import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

LIMIT = 0.02
"""The maximum share of bare names in each tree."""

TREES = ("src", "verification", "tests")

PRONOUNS = """
    all another any anyone anything both each either else every everyone everything few he her here him his how it its last less
    many more most much neither next no nobody none nothing one ones only other others own same self several she so some somebody
    someone something somewhere such that the their them then there these they this those us we what when where which who whom whose
    why you
"""

PREPOSITIONS = """
    a about above across after again against ago along already also although among an and around as at away back because before
    behind below beside between beyond but by down during enough even ever for forth from if in inside instead into just later left
    like near never not of off on once onto or out outside over past per rather right since soon still than though through till to
    together too toward under until up upon very via while with within without yet
"""

VERBS = """
    added alone asked asking asks be became become becomes been began begun being bring brought called came can cannot come comes
    coming could did do does doing done find finding finds found gave get gets getting give given gives giving go goes going gone
    got had happen happened happens has have having heard hearing holds is keep keeping keeps kept knew know knowing known knows
    leave leaves let lets looked looking looks made make makes making may mean meant met might must need needed needs put puts said
    saw say saying says see seeing seen sees sent shall should show showed shown shows stays stood take taken takes taking tell
    telling tells think thought told took tried try used uses want wanted wants was went were will would
"""

BARE = frozenset((PRONOUNS + PREPOSITIONS + VERBS).split())


def is_bare(name: str) -> bool:
    """Whether no word of the name describes the value."""
    words = [word.strip("0123456789").lower() for word in name.split("_")]
    words = [word for word in words if word]
    return bool(words) and all(word in BARE for word in words)


def assigned_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and the name of each assignment of a name."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store(), lineno=line) | ast.Attribute(attr=name, ctx=ast.Store(), lineno=line):
                yield line, name
            case ast.arg(arg=name, lineno=line) if name not in ("self", "cls"):
                yield line, name
            case ast.ExceptHandler(name=str(name), lineno=line):
                yield line, name
            case (
                ast.MatchAs(name=str(name), lineno=line)
                | ast.MatchStar(name=str(name), lineno=line)
                | ast.MatchMapping(rest=str(name), lineno=line)
            ):
                yield line, name
            case _:
                pass


def bare_names(file: Path) -> tuple[int, list[tuple[int, str]]]:
    """Return the number of assigned names in a file, and line and name of the bare ones.

    Raises:
        SyntaxError: when the file is not Python.
    """
    assigned = list(assigned_names(ast.parse(file.read_text(encoding="utf-8"), str(file))))
    return len(assigned), sorted((line, name) for line, name in assigned if is_bare(name))


def main() -> int:
    parser = argparse.ArgumentParser(description="Counts the names that do not describe their values.")
    parser.add_argument("--list", action="store_true", help="list every bare name with its file and line")
    parser.add_argument("paths", nargs="*", type=Path, help="trees or files (default: src, verification and tests, each held to the limit)")
    arguments = parser.parse_args()
    root = Path(__file__).resolve().parent.parent
    above = False
    for path in arguments.paths or [root / tree for tree in TREES]:
        total, names = 0, Counter[str]()
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            count, bare = bare_names(file)
            total += count
            names.update(name for _, name in bare)
            if arguments.list:
                for line, name in bare:
                    print(f"{file}:{line}: {name}")
        share = names.total() / total if total else 0.0
        above = above or share > LIMIT
        most_frequent = ", ".join(f"{name} {count}" for name, count in names.most_common(12))
        print(f"{path.name}: {names.total()} of {total} assigned names are bare, {share:.1%} (limit {LIMIT:.0%}): {most_frequent}")
    return 1 if above else 0


if __name__ == "__main__":
    sys.exit(main())
