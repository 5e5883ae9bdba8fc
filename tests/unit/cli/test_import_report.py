"""What an import says fits on a screen, with what matters most first."""

from __future__ import annotations

from io import StringIO

from rich.console import Console

from somrs.cli.import_report import report
from somrs.sites import ImportOptions, Site
from somrs.sites.models import shipped_models
from somrs.sites.openrmf import import_text
from tests.unit.sites.test_models import HALL, hall

SCREEN = 36
"""Lines of a terminal that is not large, of 80 columns."""


def printed(site: Site, *, details: bool = False) -> list[str]:
    file = StringIO()
    Console(file=file, width=80).print(report(site, details=details))
    return file.getvalue().splitlines()


def test_hundreds_of_notes_fit_on_a_screen() -> None:
    kinds = [f"Acme/Gizmo{'abcdefghijklmnopqrstuvwxyz'[i]}" for i in range(26)]
    site = hall(*(kind for kind in kinds for _ in range(20)))
    lines = printed(site)
    assert len(lines) <= SCREEN
    assert sum("the size is not known" in line for line in lines) == 12
    assert lines[-1] == "and 14 more kinds of notes: --details"
    assert sum("--sizes FILE" in line for line in lines) == 1, "advice is given once"
    assert len([line for line in printed(site, details=True) if "the size is not known" in line]) == 26


def test_what_is_left_out_comes_before_what_is_assumed_and_moved() -> None:
    walls = "    walls: [[0, 1, {}], [1, 2, {}], [2, 3, {}], [3, 0, {}]]\n"
    text = HALL.replace("    models:\n", walls + "    models:\n")
    for model, x in (("Acme/Gizmo", 5), ("OpenRobotics/Table", 0.05), ("NCS/Campus", 9)):
        text += f"      - {{model_name: {model}, name: m, x: {x}, y: 20, z: 0, yaw: 0, static: true}}\n"
    lines = printed(import_text(text))
    ranks = [line.split()[0] for line in lines if line.strip().startswith(("left", "assumed", "moved"))]
    assert ranks == ["left", "assumed", "moved"]
    assert lines[0].startswith("hall: 1 storey, 4 walls, 1 table or shelf, 1 obstacle")


def test_people_of_a_crowd_are_counted_as_people() -> None:
    crowd = "crowd_sim: {agent_groups: [{agents_name: [], agents_number: 3, x: 20, y: -10}]}\n"
    first_line = printed(import_text(HALL + crowd, options=ImportOptions(models=shipped_models(), crowds=True)))[0]
    assert first_line == "hall: 1 storey, 3 people"


def test_a_building_without_a_robot_says_so() -> None:
    spawned = HALL.replace(
        '[40, 40, 0, ""]', '[40, 40, 0, ""], [20, 20, 0, here, {spawn_robot_type: [1, DeliveryRobot], spawn_robot_name: [1, r1]}]'
    )
    assert any("no robot in it" in line for line in printed(import_text(HALL)))
    assert not any("no robot in it" in line for line in printed(import_text(spawned)))
