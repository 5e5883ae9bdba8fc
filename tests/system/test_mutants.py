"""What `make mutants` changes, and that it tells what tests notice from what they do not, on a project of one module."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from verification.mutants.mutations import all_mutants, mutants
from verification.mutants.tree import Tree

CORE = ("entish", "ontology", "protocol", "planner", "kernel", "repository", "registry", "service_manager", "task_manager")


def changes(source: str) -> list[str]:
    """The lines that come instead."""
    found_mutants = mutants("src/somrs/one.py", source.encode())
    return [mutant.diff(source.encode()).partition("\n+ ")[2] for mutant in found_mutants]


@pytest.mark.parametrize(
    ("line", "changed"),
    [
        ("if a < b: x()", ["if a <= b: x()", "if not (a < b): x()"]),
        ("if a == b: x()", ["if a != b: x()"]),
        ("if a not in b: x()", ["if a in b: x()"]),
        ("while (a): x()", ["while (not (a)): x()"]),
        ("y = a and b or c", ["y = a or b or c", "y = a and b and c"]),
        ("y = not (a)", ["y = (a)"]),
        ("y = [a for a in b if a]", ["y = [a for a in b if not (a)]"]),
        ("y = a if b else c", ["y = a if not (b) else c"]),
        ("y = any(a)", ["y = all(a)"]),
        ("y = a + b", ["y = a - b"]),
        ("y = a | b", ["y = a & b"]),
        ("y = -a", ["y = a"]),
        ("y = f(1, True)", ["y = f(2, True)", "y = f(1, False)"]),
        ('y = f("word")', ['y = f("changed")']),
        ("a.b = c", ["pass"]),
        ("a += b", ["pass", "a -= b"]),
        ("del a[b]", ["pass"]),
        ("raise Wrong(1)", ["pass"]),
        ("return", ["pass"]),
        ("return a", ["return None"]),
        ("yield from a()", ["yield from ()"]),
        ("yield a", ["yield from ()"]),
        ("for a in b: break", ["for a in b: continue"]),
    ],
)
def test_what_is_changed(line: str, changed: list[str]) -> None:
    actual_changes = changes(f"def f():\n    {line}\n")
    assert set(changed) <= set(actual_changes)
    assert len([change for change in actual_changes if change not in changed]) == line.count("x()")  # which is left out, too


def test_a_default_is_changed_and_judged_by_what_the_function_does() -> None:
    [mutant] = mutants("src/somrs/one.py", b"def f(a, b=1):\n    x = a\n    y = b\n")
    assert (mutant.name, mutant.line_range) == ("one.py:1:1", (2, 3))


def test_what_a_module_does_when_it_is_imported_has_no_lines_of_a_function() -> None:
    assert [mutant.line_range for mutant in mutants("src/somrs/one.py", b'NAMES = {"a"}\n\nclass C:\n    b: bool = True\n')] == [None, None]


@pytest.mark.parametrize(
    "source",
    [
        '"""What it is."""',
        "PATIENCE = 10.0",
        "class C(Struct, frozen=True): ...",
        'class C(StrEnum):\n    A = "a"',
        'x: "C" = y',
        'T = TypeVar("T")',
        "if TYPE_CHECKING:\n    import a",
        "@cache(1)\ndef f(): ...",
        "def __repr__(self):\n    return 1",
        'def f():\n    y = "two words"',
        'def f():\n    assert a > 1, "why"',
        "x = zip(a, b, strict=True)",
        "Both = A | B",
        'Two = Literal["a"]',
        'x = f"{a + 1}"',
        "def f():\n    yield from ()",
    ],
)
def test_what_nobody_could_tell_is_left_alone(source: str) -> None:
    assert changes(source) == []


@pytest.mark.slow
def test_every_mutant_of_the_core_is_python_and_another_program() -> None:
    found_mutants = all_mutants(ROOT, CORE)
    assert len({mutant.name for mutant in found_mutants}) == len(found_mutants) > 10_000
    sources = {mutant.file: (ROOT / mutant.file).read_bytes() for mutant in found_mutants}
    programs = {file: ast.dump(ast.parse(source)) for file, source in sources.items()}
    for mutant in found_mutants[::50]:
        assert ast.dump(ast.parse(mutant.applied(sources[mutant.file]))) != programs[mutant.file], mutant.name


SUMS = """
LIMITS = {"low": 1}

def bounded(a: int, least: int = 0) -> int:
    while a < least:
        a += 1
    return a

def low() -> int:
    return LIMITS["low"]

def forgotten() -> int:
    return 7 * 6

def halved(a: int) -> int:
    return a // 2

def squared(a: int) -> int:
    return a ** 2

NINE = squared(3)
"""

TESTS = """
import subprocess, sys

from somrs.entish.sums import NINE, bounded, low

def test_what_is_less_is_raised():
    assert bounded(-2) == 0

def test_low():
    assert low() > 0

def test_nine():
    assert NINE == 9

def test_halved():
    program = "from somrs.entish.sums import halved; print(halved(4))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout == "2\\n"
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    root = tmp_path / "project"
    settings = '[tool.pytest.ini_options]\naddopts = ["--import-mode=importlib"]\npythonpath = ["."]\n'
    files = {"src/somrs/__init__.py": "", "src/somrs/entish/__init__.py": "", "src/somrs/entish/sums.py": SUMS}
    files |= {"tests/unit/test_sums.py": TESTS, "pyproject.toml": settings, ".gitignore": "out/\n"}
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    for name in ("verification/mutants", "tests/support"):
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "src" / "somrs" / "errors.py", root / "src" / "somrs" / "errors.py")
    subprocess.run(["git", "init", "-q"], cwd=root, check=True)
    return root


def mutants_of(project: Path, *options: str) -> tuple[int, str, dict[str, str]]:
    """The exit status, what is printed, and what caught each change."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(project / "src"), str(project)]), "COLUMNS": "200"}
    command = [sys.executable, "-m", "verification.mutants", "--jobs", "1", "--floor", "3", *options]
    result = subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True, check=False)
    rows = [json.loads(line) for line in (project / "out" / "mutants" / "results.jsonl").read_text().splitlines()]
    assert result.returncode < 2, result.stderr
    return result.returncode, result.stdout, {row["diff"]: row["caught by"] for row in rows}


@pytest.mark.slow
def test_what_tests_notice_is_caught_and_the_rest_survives(project: Path) -> None:
    status, output, caught_by = mutants_of(project, "--seed", "3")
    raised, low, nine, halved = (f"tests/unit/test_sums.py::test_{name}" for name in ("what_is_less_is_raised", "low", "nine", "halved"))
    assert caught_by == {
        '- LIMITS = {"low": 1}\n+ LIMITS = {"changed": 1}': low,
        '- LIMITS = {"low": 1}\n+ LIMITS = {"low": 2}': "",
        "- def bounded(a: int, least: int = 0) -> int:\n+ def bounded(a: int, least: int = 1) -> int:": raised,
        "- while a < least:\n+ while a <= least:": raised,
        "- while a < least:\n+ while not (a < least):": raised,
        "- a += 1\n+ pass": f"{raised}, which never ends",
        "- a += 1\n+ a -= 1": f"{raised}, which never ends",
        "- a += 1\n+ a += 2": "",
        "- return a\n+ return None": raised,
        '- return LIMITS["low"]\n+ return None': low,
        '- return LIMITS["low"]\n+ return LIMITS["changed"]': low,
        "- return 7 * 6\n+ return None": "",
        "- return 7 * 6\n+ return 7 / 6": "",
        "- return 7 * 6\n+ return 8 * 6": "",
        "- return 7 * 6\n+ return 7 * 7": "",
        "- return a // 2\n+ return None": halved,
        "- return a // 2\n+ return a * 2": halved,
        "- return a // 2\n+ return a // 3": halved,
        "- return a ** 2\n+ return None": nine,
        "- return a ** 2\n+ return a * 2": nine,
        "- return a ** 2\n+ return a ** 3": nine,
        "- NINE = squared(3)\n+ NINE = squared(4)": nine,
    }
    assert status == 1
    assert re.search(r"SEED=3\b", output)
    assert "return 7 / 6" in output
    assert "none" in output

    tried_file = project / "out" / "mutants" / "tried.jsonl"
    rows = tried_file.read_text().splitlines(keepends=True)
    rows.sort(key=lambda row: "never ends" not in row)
    tried_file.write_text("".join(rows[:20]) + rows[20][:20])  # as who is killed leaves it
    second_run = mutants_of(project, "--seed", "3")
    assert (second_run[0], second_run[2]) == (status, caught_by)
    assert "20 of them have results" in second_run[1]
    assert len(tried_file.read_text().splitlines()) == 22
    assert {*map(len, tried_file.read_text().splitlines())} == {len(row) - 1 for row in rows}
    (project / "tests" / "unit" / "test_sums.py").write_text(f"{TESTS}\n")
    assert "have results" not in mutants_of(project, "--seed", "3", "--sample", "2")[1], "with other tests, all is open again"


def test_one_can_be_played_alone(project: Path) -> None:
    status, output, caught_by = mutants_of(project, "--only", "entish/sums.py:5:1")
    assert (status, len(caught_by)) == (0, 1)
    assert output.splitlines()[-2:] == [
        "entish/sums.py:5:1 is caught by tests/unit/test_sums.py::test_what_is_less_is_raised",
        "1 caught, 0 survived",
    ]


ALL_MODULES = """
import importlib, pkgutil

import somrs

def test_fields():
    for module in [importlib.import_module(info.name) for info in pkgutil.walk_packages(somrs.__path__, "somrs.")]:
        assert vars(module).get("FIELDS", ["at"]) == ["at"]
"""


def test_a_test_that_imports_all_modules_runs_for_code_at_import(project: Path) -> None:
    (project / "src" / "somrs" / "entish" / "fields.py").write_text('FIELDS = ["at"]\n', encoding="utf-8")
    (project / "tests" / "unit" / "test_fields.py").write_text(ALL_MODULES, encoding="utf-8")
    importing = "from somrs.entish.fields import FIELDS\n\ndef test_importing():\n    assert FIELDS\n"
    (project / "tests" / "unit" / "test_importing.py").write_text(importing, encoding="utf-8")
    caught_by = mutants_of(project, "--only", "entish/fields.py:1:1")[2]
    assert caught_by == {'- FIELDS = ["at"]\n+ FIELDS = ["changed"]': "tests/unit/test_fields.py::test_fields"}


def test_a_copy_is_what_it_was_when_the_change_is_over(tmp_path: Path) -> None:
    tree = Tree(tmp_path / "copy")
    place = tree.root / "src" / "somrs" / "errors.py"
    old_bytes, time = place.read_bytes(), place.stat().st_mtime_ns
    with tree.changed("src/somrs/errors.py", b"another = 1\n"):
        assert place.read_bytes() == b"another = 1\n"
        assert place.stat().st_mtime_ns != time
    assert (place.read_bytes(), place.stat().st_mtime_ns) == (old_bytes, time)


def test_a_copy_that_is_made_again_is_as_the_project_is(tmp_path: Path) -> None:
    tree = Tree(tmp_path / "copy")
    changed_file, added_file = tree.root / "src" / "somrs" / "errors.py", tree.root / "src" / "somrs" / "added.py"
    changed_file.write_text("another = 1\n")
    added_file.write_text("another = 1\n")
    Tree(tmp_path / "copy")
    assert changed_file.read_bytes() == (ROOT / "src" / "somrs" / "errors.py").read_bytes()
    assert not added_file.exists()
