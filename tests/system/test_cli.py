"""The `somrs` command as a user meets it: what it prints and how it exits."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from enum import StrEnum
from pathlib import Path

import pytest

from somrs.cli.main import FaultOption
from somrs.cli.task_options import PolicyOption
from somrs.cli.tasks import FormatOption, OutcomeOption, TableOption
from somrs.client.export import Format, Table
from somrs.devices.simulator.link.commands import Fault
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Policy
from tests.support.command import program, somrs
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1, SHARED
from tests.unit.sites.test_openrmf import SMALL

OFFICE = SHARED / "sites" / "office.building.yaml"
TRACK = """\
map: Depot
objects:
  Depot:
    type: Building
    parts:
      Ground:
        type: Storey
        parts:
          Floor1: {type: Floor, at: [5, 2, -0.1], Shape: {Form: Box, Width: 10, Depth: 4, Height: 0.1}}
          Bay: {type: Place, at: [1, 2]}
          Junction: {type: Waypoint, at: [5, 2]}
          Lane1: {type: Lane}
facts:
  - Lane1 startsAt Bay
  - Lane1 endsAt Junction
"""
COMMANDS = [
    "demo",
    "up",
    "do",
    "tasks",
    "task",
    "cancel",
    "export",
    "services",
    "questions",
    "answer",
    "plan",
    "check",
    "import",
    "schema",
    "fault",
    "picture",
    "map",
    "ontology",
    "user",
    "token",
    "run",
]


def test_help_names_every_command() -> None:
    result = program("--help")
    assert result.returncode == 0
    for command in COMMANDS:
        assert f"\n  {command} " in result.stdout, command


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str) -> None:
    result = somrs(command, "--help")
    assert result.returncode == 0
    assert "Usage:" in result.stdout


def test_help_needs_none_of_the_heavy_libraries() -> None:
    """What makes `--help` slow is imports; that it is quick is measured in benchmarks/."""
    code = (
        "import sys, runpy; sys.argv = ['somrs', '--help']\n"
        "try: runpy.run_module('somrs.cli.main', run_name='__main__')\n"
        "except SystemExit: pass\n"
        "print('HEAVY', [m for m in ('mujoco', 'numpy', 'aiohttp', 'uvicorn', 'lxml', 'pint', 'pydantic', 'lark') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG_TIME)
    assert "HEAVY []" in result.stdout, result.stdout + result.stderr


def test_check_accepts_the_demo_site() -> None:
    result = program("check", SCENARIO_1)
    assert result.returncode == 0, result.stdout
    assert "no problems" in result.stdout


def test_check_notes_what_no_plan_can_use(tmp_path: Path) -> None:
    file = tmp_path / "services.yaml"
    file.write_text('services:\n  Print: {inputs: {Jar: Jar, Text: text}, outputs: {Pages: number}, effect: "?Jar.Unknown = FALSE"}\n')
    result = program("check", file)
    assert result.returncode == 0, result.stdout
    assert "note: Print: no later step can use the output ?Pages" in result.stdout
    assert "which value its input ?Text has" in result.stdout


def test_check_reports_every_error_at_once_with_its_line(tmp_path: Path) -> None:
    site = tmp_path / "wrong.yaml"
    site.write_text(
        "map: Wrong\n"
        "objects:\n"
        "  Building1: {type: Building, parts: {Storey1: {type: Storey, parts: {Floor1: {type: Floor, at: [0, 0, 0],"
        " Shape: {Form: Box, Width: 9, Depth: 9, Height: 0.1}}}}}}\n"
        "  Jar1: {type: Jarr, at: [1, 1, 0]}\n"
        "  Jar2: {type: Jar, at: [1, 1, 0], Weight: 900 kg}\n"
        "facts:\n"
        "  - Jar2 isOnn Floor1\n"
    )
    result = program("check", site)
    assert result.returncode == 1
    for line, part in ((4, "Jarr"), (5, "Weight"), (7, "isOnn")):
        assert any(f"wrong.yaml:{line}:" in output_line and part in output_line for output_line in result.stdout.splitlines()), (
            line,
            result.stdout,
        )
    assert "Traceback" not in result.stdout + result.stderr
    problems = json.loads(somrs("check", site, "--json").stdout)
    assert {problem["line"] for problem in problems} == {4, 5, 7}
    assert all(problem["file"] and problem["subject"] and problem["rule"] for problem in problems)


@pytest.mark.parametrize(
    ("offered", "values"),
    [(PolicyOption, Policy), (OutcomeOption, Outcome), (FormatOption, Format), (TableOption, Table), (FaultOption, Fault)],
)
def test_whatever_there_is_can_be_chosen(offered: type[StrEnum], values: type[StrEnum]) -> None:
    """The options are written down once more, so that --help need not import what they stand for."""
    assert [option.value for option in offered] == [value.value for value in values]


def test_without_a_running_system_commands_say_how_to_start_one(tmp_path: Path) -> None:
    commands = ("do 'A isOn B'", "tasks", "task last", "export", "services", "plan 'A isOn B'", "map query 'A isOn B'")
    assert "somrs up" in program("tasks", cwd=tmp_path).stderr
    for arguments in map(shlex.split, commands):
        result = somrs(*arguments, cwd=tmp_path)
        assert result.returncode == 2
        assert "somrs up" in result.stderr
        assert "Traceback" not in result.stderr


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    for arguments in (["check", "nowhere.yaml"], ["up", "nowhere.yaml"], ["import", "nowhere.building.yaml"], ["import", "some.txt"]):
        result = somrs(*arguments, cwd=tmp_path)
        assert result.returncode in (1, 2), arguments
        assert arguments[1] in result.stdout + result.stderr
        assert "Traceback" not in result.stderr, result.stderr


@pytest.mark.parametrize(
    "building",
    [
        pytest.param(None, id="a small one"),
        pytest.param(OFFICE, marks=pytest.mark.skipif(not OFFICE.exists(), reason=f"the office is not there: {OFFICE}"), id="an office"),
    ],
)
def test_import_writes_a_map_that_passes_the_check(building: Path | None, tmp_path: Path) -> None:
    if building is None:
        building = tmp_path / "depot.building.yaml"
        building.write_text(SMALL)
    result = somrs("import", building, "-o", "site.yaml", cwd=tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    assert somrs("check", "site.yaml", cwd=tmp_path).returncode == 0


def test_import_tells_each_kind_once_and_takes_sizes(tmp_path: Path) -> None:
    building, sizes = tmp_path / "depot.building.yaml", tmp_path / "sizes.yaml"
    building.write_text(SMALL)
    sizes.write_text("furniture: {Contraption: {type: Table, size: [2, 1, 1]}}\n")
    unknown = somrs("import", building, cwd=tmp_path).stdout
    assert "Contraption: the size is not known" in unknown
    assert unknown.index("Contraption") < unknown.index("moved out of a wall"), "what matters more comes first"
    assert "Contraption" not in somrs("import", building, "--sizes", sizes, cwd=tmp_path).stdout
    sizes.write_text("furniture: {Contraption: {type: Tabel, size: [2, 1, 1]}}\n")
    mistaken = somrs("import", building, "--sizes", sizes, cwd=tmp_path)
    assert mistaken.returncode != 0
    assert "sizes.yaml:1" in mistaken.stderr
    assert "Tabel is no type below Furniture" in mistaken.stderr


def test_lanes_go_out_as_a_layout_and_come_back(tmp_path: Path) -> None:
    (tmp_path / "track.yaml").write_text(TRACK)
    exported = somrs("map", "export", "track.lif", "--from", "track.yaml", cwd=tmp_path)
    assert exported.returncode == 0, exported.stdout + exported.stderr
    assert [edge["edgeId"] for edge in json.loads((tmp_path / "track.lif").read_text())["layouts"][0]["edges"]] == ["Lane1"]
    assert somrs("import", "track.lif", "-o", "again.yaml", cwd=tmp_path).returncode == 0
    assert "Lane1 startsAt Bay" in (tmp_path / "again.yaml").read_text()
    (tmp_path / "empty.yaml").write_text("map: m\nobjects:\n  B: {type: Site}\n")
    refused = somrs("map", "export", "track.lif", "--from", "empty.yaml", cwd=tmp_path)
    assert refused.returncode != 0
    assert "no lanes to export" in refused.stderr


def test_check_finds_mistakes_in_the_geometry_with_their_line(tmp_path: Path) -> None:
    (tmp_path / "track.yaml").write_text(TRACK.replace("Bay: {type: Place, at: [1, 2]}", "Bay: {type: Place, at: [1, 9]}"))
    result = somrs("check", "track.yaml", cwd=tmp_path)
    assert result.returncode == 1
    assert "track.yaml:10: Bay: there is no floor under it" in result.stdout
    problems = json.loads(somrs("check", "track.yaml", "--json", cwd=tmp_path).stdout)
    assert [(problem["subject"], problem["line"], problem["rule"]) for problem in problems] == [
        ("Bay", 10, "no-floor"),
        ("Lane1", 12, "no-way-back"),
    ]


def test_degrees_taken_for_metres_are_found(tmp_path: Path) -> None:
    """A campus in longitude and latitude, which somebody calls metres."""
    vertices = "\n".join(f'      - [{103.77 + 0.001 * i}, {1.3 + 0.0005 * i}, 0, "p{i}"]' for i in range(6))
    (tmp_path / "campus.building.yaml").write_text(
        f"name: campus\ncoordinate_system: cartesian_meters\nlevels:\n  L1:\n    vertices:\n{vertices}\n"
    )
    assert "1 mistake" in somrs("import", "campus.building.yaml", cwd=tmp_path).stdout
    result = somrs("check", "campus.map.yaml", cwd=tmp_path)
    assert result.returncode == 1
    assert "cannot be metres" in result.stdout
