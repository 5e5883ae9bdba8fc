"""Planning problems played by the whole system, as `make bench-codmap` plays published ones."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from somrs.sites.pddl import classical, read
from tests.support.courier import DOMAIN, PROBLEM
from tests.support.paths import SHARED
from verification.codmap.problem_run import run_problem
from verification.codmap.referee import judges, objections

PUBLISHED = SHARED / "benchmarks" / "codmap"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """The folder of the problem."""
    folder = tmp_path / "courier" / "two-towns"
    folder.mkdir(parents=True)
    (folder / "domain.pddl").write_text(DOMAIN, encoding="utf-8")
    (folder / "problem.pddl").write_text(PROBLEM, encoding="utf-8")
    return folder


def test_a_goal_is_reached_in_the_world_and_the_referee_agrees(place: Path) -> None:
    result = run_problem(place, limit=30.0)
    assert (result.trouble, result.accomplished, result.agents) == ("", True, 2)


def test_who_does_not_need_the_other_does_not_wait_for_it(place: Path) -> None:
    apart = PROBLEM.replace("(road west depot) (road depot west)", "")
    apart = apart.replace("(at red west) (at blue east)", "(at red depot) (at blue mill)")
    apart = apart.replace("west depot - place", "west depot mill - place").replace("(at blue west))", "(at blue west) (road west mill))")
    (place / "problem.pddl").write_text(apart, encoding="utf-8")
    result = run_problem(place, limit=30.0)
    assert (result.trouble, result.steps, result.makespan) == ("", 6, 3.0)


@pytest.mark.parametrize("seed", range(8))
def test_a_goal_that_can_be_reached_is_reached_whatever_fails(place: Path, seed: int) -> None:
    result = run_problem(place, 30.0, 0.3, seed)
    assert result.trouble == "", "\n".join(result.notes)
    assert result.accomplished or result.leaver is not None or result.out_of_reach


REPEATED = """(define (domain lights) (:requirements :strips) (:predicates (lit ?x) (wire ?x ?x))
  (:action light :parameters (?a ?b) :precondition (and (lit ?a) (wire ?a ?b)) :effect (lit ?b)))"""
LAMPS = "(define (problem lamps) (:domain lights) (:objects one two) (:init (lit one) (wire one two)) (:goal (lit two)))"


@pytest.mark.skipif(len(judges()) < 2, reason="VAL is not installed")
def test_a_problem_that_one_validator_cannot_read_is_judged_by_the_other() -> None:
    """unified-planning takes `(wire ?x ?x)` for a predicate of one object."""
    assert objections(REPEATED, LAMPS, "(light one two)\n") == []
    (objection,) = objections(REPEATED, LAMPS, "(light two one)\n")
    assert objection.startswith("VAL")


def test_a_problem_that_no_validator_can_read_does_not_pass() -> None:
    assert objections("(define (domain lights", LAMPS, "(light one two)\n") == ["no validator can read the problem"]


def test_what_the_files_get_wrong_is_said_and_nothing_is_played(place: Path) -> None:
    (place / "problem.pddl").write_text(PROBLEM.replace("(at red east)", "(at red nowhere)"), encoding="utf-8")
    assert "nowhere" in run_problem(place, 30.0).trouble


def test_a_problem_without_a_plan_does_not_pass(place: Path) -> None:
    (place / "problem.pddl").write_text(PROBLEM.replace("(road east depot)", ""), encoding="utf-8")
    result = run_problem(place, 30.0)
    assert result.steps is None
    assert "at west" in result.trouble


def test_the_referee_knows_a_plan_from_one_that_is_none(place: Path) -> None:
    files = place / "domain.pddl", place / "problem.pddl"
    assert read(*files).name == "two-towns"
    texts = classical(*files)
    legs = ["(load van1 red east)", "(drive van1 east depot)", "(drive van1 depot west)", "(unload van1 red west)"]
    return_legs = ["(load van1 blue west)", "(drive van1 west depot)", "(drive van1 depot east)", "(unload van1 blue east)"]
    assert objections(*texts, "\n".join([*legs, *return_legs])) == []
    blue_is_where_it_was, red_was_never_loaded = legs, [*legs[1:], *return_legs]
    for wrong in (blue_is_where_it_was, red_was_never_loaded):
        complaints = objections(*texts, "\n".join(wrong))
        assert [complaint.partition(":")[0] for complaint in complaints] == judges()


def test_the_command_prints_a_table_and_a_closing_line(place: Path) -> None:
    folder = place.parents[1]
    shutil.copytree(place, place.parent / "other")
    result = subprocess.run(
        [sys.executable, "-m", "verification.codmap", str(folder), "--limit", "30"], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert "2 of 2" in result.stdout
    assert result.stdout.strip().endswith("2 passed, 0 failed")


@pytest.mark.skipif(not PUBLISHED.is_dir(), reason=f"there are no published problems in {PUBLISHED}")
@pytest.mark.parametrize(
    "name", ["depot/pfile2", "driverlog/pfile3", "elevators08/p02", "logistics00/probLOGISTICS-6-0", "zenotravel/pfile4"]
)
def test_published_problems(name: str) -> None:
    result = run_problem(PUBLISHED / name, 60.0)
    assert result.trouble == ""
    assert result.steps is not None
    assert result.makespan is not None
    assert result.makespan <= result.steps
