"""The table of the paper's sentences names code and tests that exist."""

from __future__ import annotations

import re

import pytest

from tests.support.paths import ROOT

TABLE = ROOT / "docs" / "reference" / "paper.md"
LINK = re.compile(r"\[`([^`]+)`\]\(\.\./\.\./([^)#]+)\)")
ROWS = [line for line in TABLE.read_text("utf-8").splitlines() if line.startswith("| ") and not line.startswith("| sentence")]


def is_defined(name: str, text: str, suffix: str) -> bool:
    """Whether a file defines the name: a class, a function or a value of Python, or a key of YAML."""
    word = re.escape(name)
    pattern = rf"^\s*(?:(?:async )?def|class) {word}\b|^\s*{word}\s*[:=]" if suffix == ".py" else rf"^\s*{word}:"
    return re.search(pattern, text, re.MULTILINE) is not None


@pytest.mark.parametrize(("name", "path"), sorted(set(LINK.findall(TABLE.read_text("utf-8")))))
def test_what_the_table_names_exists(name: str, path: str) -> None:
    file = ROOT / path
    assert file.is_file(), path
    assert is_defined(name, file.read_text("utf-8"), file.suffix), f"{path} has no {name}"


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[2:50])
def test_each_sentence_has_code_and_a_test_and_differences_have_reasons(row: str) -> None:
    _, _, code, tests, remark, _ = re.split(r"(?<!\\)\|", row)
    assert LINK.search(code)
    assert "tests/" in tests
    assert "partly" not in row.lower()
    assert "**Differs:**" not in remark or len(remark) > 60
