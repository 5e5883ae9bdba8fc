"""YAML as it is read: which values plain words stand for, on which line each stands, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

from somrs.errors import Problem
from somrs.ontology.files.nodes import DEPTH, Dumper, Lines, Path, Source

TEXT = """\
a:
  b: 1
  c:
    - x
    - {d: 2,
       e: 3}
f: [1, 2]
"""


def problem(line: int | None, rule: str, message: str, subject: str = "file") -> Problem:
    return Problem(file="file.yaml", line=line, subject=subject, rule=rule, message=message)


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("true", True),
        ("True", True),
        ("FALSE", False),
        ("tRUE", "tRUE"),
        ("No", "No"),
        ("off", "off"),
        ("null", None),
        ("~", None),
        ("", None),
        ("Nulls", "Nulls"),
        ("12", 12.0),
        ("+12", 12.0),
        ("-010", -10.0),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("0x1F", "0x1F"),
        ("1.5e-3", 0.0015),
        (".5", 0.5),
        ("5.", 5.0),
        ("1E3", 1000.0),
        ("-.5", -0.5),
        (".INF", float("inf")),
        ("-.inf", float("-inf")),
        ("+.Inf", float("inf")),
        ("2024-01-02", "2024-01-02"),
        ("'12'", "12"),
        ("300 g", "300 g"),
    ],
)
def test_what_a_plain_word_is_read_as(written: str, value: object) -> None:
    read = Source("file.yaml", f"key: {written}\n")
    assert read.problems == []
    assert read.data == {"key": value}
    assert type(read.data["key"]) is type(value)


@pytest.mark.parametrize("value", ["true", "12", "1e3", ".5", "null", "~", "", ".inf", "no", "2024-01-02", "a: b"])
def test_texts_are_quoted_where_they_would_be_read_as_something_else(value: str) -> None:
    written = yaml.dump({"key": value}, Dumper=Dumper)
    assert Source("file.yaml", written).data == {"key": value}
    assert ("'" in written) is (value not in ("no", "2024-01-02"))


def test_what_is_there_twice_is_written_twice_and_lines_each_on_their_own() -> None:
    shared_list = ["a", "b"]
    assert yaml.dump({"x": shared_list, "y": shared_list}, Dumper=Dumper, default_flow_style=None) == "x: [a, b]\ny: [a, b]\n"
    assert yaml.dump({"x": Lines(shared_list)}, Dumper=Dumper, default_flow_style=None) == "x:\n- a\n- b\n"


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ((), 1),
        (("a",), 1),
        (("a", "b"), 2),
        (("a", "b", "z"), 2),
        (("a", "z"), 1),
        (("z",), 1),
        (("a", "c"), 3),
        (("a", "c", 0), 4),
        (("a", "c", 1), 5),
        (("a", "c", 2), 3),
        (("a", "c", "0"), 3),
        (("a", "c", 1, "d"), 5),
        (("a", "c", 1, "e"), 6),
        (("f",), 7),
        (("f", 1), 7),
    ],
)
def test_the_line_of_a_path(path: Path, line: int) -> None:
    assert Source("file.yaml", TEXT).line(path) == line


@pytest.mark.parametrize(
    ("path", "keys"),
    [((), {"a", "f"}), (("a",), {"b", "c"}), (("a", "b"), set()), (("a", "z"), set()), (("a", "c", 1), set()), (("f",), set())],
)
def test_the_keys_at_a_path(path: Path, keys: set[str]) -> None:
    assert Source("file.yaml", TEXT).keys(path) == keys


def test_an_empty_text_has_no_lines() -> None:
    empty = Source("file.yaml", "")
    assert (empty.data, empty.problems, empty.line(("a",)), empty.keys(())) == (None, [], None, set())


@pytest.mark.parametrize(
    ("text", "data", "problems"),
    [
        (
            "a: 1\nb: {a: 1}\na: 2\n",
            {"a": 2.0, "b": {"a": 1.0}},
            [problem(3, "duplicate", "a is already written in line 1; keep one of the two", "a")],
        ),
        (
            "x:\n  - a: 1\n    b: 2\n    a: 3\n    a: 4\n",
            {"x": [{"a": 4.0, "b": 2.0}]},
            [
                problem(4, "duplicate", "a is already written in line 2; keep one of the two", "a"),
                problem(5, "duplicate", "a is already written in line 2; keep one of the two", "a"),
            ],
        ),
        (
            "a: &x {b: 1}\nb: 2\nb: 3\nc: *x\n",
            None,
            [
                problem(3, "duplicate", "b is already written in line 2; keep one of the two", "b"),
                problem(1, "alias", "YAML aliases (&name, *name) are not used here; write it out, or give the type defaults"),
            ],
        ),
        ("a: 1\nb: [\n", None, [problem(3, "syntax", "this is not YAML: did not find expected node content")]),
    ],
)
def test_what_is_wrong_with_a_text(text: str, data: Any, problems: list[Problem]) -> None:
    read = Source("file.yaml", text)
    assert read.data == data
    assert read.problems == problems


def test_brackets_may_be_nested_so_deep_and_no_deeper() -> None:
    def nested(depth: int) -> str:
        return "a: " + "[" * depth + "]" * depth

    assert Source("file.yaml", nested(DEPTH)).problems == []
    assert Source("file.yaml", f"b: '{']' * 300}'\n{nested(DEPTH)}").problems == []
    assert Source("file.yaml", "[" + "[], {}, " * DEPTH + "1]").problems == []
    for text in (nested(DEPTH + 1), f"b: '{']' * 300}'\n{nested(DEPTH + 1)}", "{a: " * (DEPTH + 1) + "}" * (DEPTH + 1)):
        read = Source("file.yaml", text)
        assert read.problems == [problem(None, "syntax", f"more than {DEPTH} nested brackets; no map needs so many")]
        assert read.data is None
