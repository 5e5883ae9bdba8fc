"""Parts of components yield their effects: whoever calls one without going through them has nothing done, and nobody notices."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import somrs

SOURCE = Path(somrs.__file__).parent
PACKAGES = ("task_manager", "service_manager", "registry", "repository", "kernel")


def trees() -> Iterator[tuple[Path, ast.Module]]:
    for package in PACKAGES:
        for file in sorted((SOURCE / package).rglob("*.py")):
            yield file, ast.parse(file.read_text(encoding="utf-8"))


def functions(*, yielding: bool) -> set[str]:
    """The names of the functions that yield effects, or of those that do not."""
    return {
        node.name
        for _, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and node.returns is not None
        and ast.unparse(node.returns).startswith(("Effects", "Doing[")) is yielding
    }


def forgotten(tree: ast.Module, names: set[str]) -> Iterator[ast.Call]:
    """Calls of such functions as statements by themselves."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            callee = node.value.func
            if (callee.attr if isinstance(callee, ast.Attribute) else callee.id if isinstance(callee, ast.Name) else "") in names:
                yield node.value


def test_no_effects_are_forgotten() -> None:
    # A name that means something else, too, says nothing.
    names = functions(yielding=True) - functions(yielding=False) - {*dir(dict), *dir(list), *dir(set)}
    assert {"proceed", "dismiss"} <= names
    ignored_calls = [
        f"{file.relative_to(SOURCE)}:{call.lineno} {ast.unparse(call)}" for file, tree in trees() for call in forgotten(tree, names)
    ]
    assert not ignored_calls


def test_a_call_whose_effects_are_forgotten_is_found() -> None:
    tree = ast.parse("def f(self):\n    self.proceed(now)\n    yield from self.proceed(now)\n")
    assert [call.lineno for call in forgotten(tree, {"proceed"})] == [2]
