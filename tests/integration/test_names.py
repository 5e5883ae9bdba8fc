"""What the count of names that say nothing counts."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.names import assigned_names, is_bare
from tests.support.paths import ROOT


@pytest.mark.parametrize(
    ("name", "is_bare_name"),
    [
        ("found", True),
        ("_one", True),
        ("said_by", True),
        ("WHAT", True),
        ("found2", True),
        ("found_offers", False),
        ("offer", False),
        ("_", False),
    ],
)
def test_a_name_is_bare_when_every_word_of_it_says_nothing(name: str, is_bare_name: bool) -> None:
    assert is_bare(name) is is_bare_name


def test_every_way_to_give_a_name_is_counted_and_no_use_of_one() -> None:
    tree = ast.parse(
        """
limit: int = used
def function(self, parameter, *rest, key=other):
    self.attribute, first = parameter
    for item in rest:
        pass
    try:
        with open(path) as file: [element for element in file if (last := element)]
    except OSError as error:
        pass
    match parameter:
        case [head, *tail] | {"x": head, **tail}: ...
        case str() as text: ...
"""
    )
    names = "limit parameter rest key attribute first item file element last error head tail head tail text"
    assert sorted(name for _, name in assigned_names(tree)) == sorted(names.split())


def test_a_file_above_the_limit_is_named_and_listed(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text("found = 1\nlimit = 2\n", encoding="utf-8")
    command = [sys.executable, str(ROOT / "scripts" / "names.py"), "--list", str(tmp_path)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert f"{tmp_path}/module.py:1: found" in ended.stdout
    assert "1 of 2 assigned names are bare, 50.0% (limit 2%)" in ended.stdout
