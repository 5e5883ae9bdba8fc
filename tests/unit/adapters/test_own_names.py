"""Robots of adapters use no name that their base classes use for something else: Python would not say so."""

from __future__ import annotations

import ast
import inspect
import textwrap
from pathlib import Path

import pytest

from somrs.devices.road_robot import CarryingRobot, RoadRobot

ADAPTERS = Path("src/somrs/adapters")
FOR_AUTHORS = {
    "battery",
    "holding",
    "carries",
    "hindrance",
    "remark",
    "can_charge",
    "can_carry",
    "type",
    "types",
    "values",
    "situation",
    "attributes",
}
"""The attributes that authors set."""


def set_attributes(node: ast.AST) -> set[str]:
    """The attributes of `self` that are assigned."""
    targets = (child for child in ast.walk(node) if isinstance(child, ast.Attribute) and isinstance(child.ctx, ast.Store))
    return {target.attr for target in targets if isinstance(target.value, ast.Name) and target.value.id == "self"}


def base_names() -> set[str]:
    """What the base classes assign, and the private names of their classes."""
    names: set[str] = set()
    for base in CarryingRobot.__mro__[:-1]:
        names |= set_attributes(ast.parse(textwrap.dedent(inspect.getsource(base))))
        names |= {name for name in vars(base) if not name.startswith("__")}
    return names


def robots_of_adapters() -> list[tuple[str, ast.ClassDef]]:
    bases = {RoadRobot.__name__, CarryingRobot.__name__}
    trees = [(file, ast.parse(file.read_text("utf-8"))) for file in sorted(ADAPTERS.rglob("*.py"))]
    classes = [(file, node) for file, tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    return [
        (f"{file}:{node.name}", node)
        for file, node in classes
        if bases & {base.id for base in node.bases if isinstance(base, ast.Name)} and not str(file).endswith("road_robot.py")
    ]


@pytest.mark.parametrize(("place", "robot"), robots_of_adapters(), ids=lambda value: value if isinstance(value, str) else "")
def test_a_robot_of_an_adapter_has_names_of_its_own(place: str, robot: ast.ClassDef) -> None:
    private = {name for name in base_names() if name.startswith("_")}
    defined = {child.name for child in robot.body if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef)}
    clashes = ((set_attributes(robot) | defined) & private) | (set_attributes(robot) & base_names() - FOR_AUTHORS)
    assert not clashes, f"{place} uses {', '.join(sorted(clashes))}, which its base classes use for something else: rename it"
