"""States of earlier versions say the same in the words of today."""

from __future__ import annotations

from typing import Any

import msgspec

from somrs.kernel.reservations import Reservations
from somrs.task_manager.migrations import MIGRATIONS


def test_the_names_of_steps_said_what_they_are_for() -> None:
    def execution(kind: str, *labels: str) -> dict[str, Any]:
        return {"kind": kind, "workflow": {"runs": {label: {"label": label} for label in labels}} if labels else None}

    task: dict[str, Any] = {
        "goal": execution("task", "step1"),
        "aside": [execution("look", "look2.step1"), execution("undo")],
        "log": {
            "works": [
                {"label": "step1", "undoes": False},
                {"label": "handler12.step1", "undoes": False},
                {"label": "undo3.step1", "undoes": True},
            ]
        },
        "events": [{"step": None}, {"step": "step1"}, {"step": "look2.step1"}],
    }
    assert MIGRATIONS[1].snapshot({"state": {"tasks": {"a task": task}}}) == {"state": {"tasks": {"a task": task}}}
    assert [run["goal"] for goal_data in (task["goal"], task["aside"][0]) for run in goal_data["workflow"]["runs"].values()] == [
        "task",
        "look",
    ]
    assert task["log"]["works"] == [
        {"label": "step1", "goal": "task"},
        {"label": "handler12.step1", "goal": "handler"},
        {"label": "undo3.step1", "goal": "undo"},
    ]
    assert [noted["goal"] for noted in task["events"]] == [None, "task", "look"]


def test_what_a_task_manager_had_reserved_itself_its_tasks_claim_at_the_repository() -> None:
    reserved = {"changes": ["Jar1"], "relies": ["Table1"]}
    reservations = {
        "goals": {"urgent": "wish 2", "first": "wish 1"},
        "priorities": {"urgent": 3, "first": 0},
        "held": {"first": reserved},
        "waiting": {"urgent": {"wanted": reserved, "called": True}},
        "freed": False,
    }
    state: dict[str, Any] = {"reservations": reservations, "tasks": {"first": {}, "urgent": {}}}
    MIGRATIONS[2].snapshot({"state": state})
    renamed = {"changes": ["Jar1"], "relies_on": ["Table1"]}
    assert state["tasks"] == {
        "first": {"reservation": {"held": renamed, "waiting": None}},
        "urgent": {"reservation": {"held": {"changes": [], "relies_on": []}, "waiting": renamed}},
    }
    local = msgspec.convert(state["local_reservations"], Reservations)
    assert [(task, known.arrival, known.priority, known.admitted) for task, known in local.claimants.items()] == [
        ("urgent", 1, 3, True),
        ("first", 2, 0, False),
    ]
    assert "reservations" not in state


def test_an_earlier_start_is_not_the_one_at_which_reservations_are_claimed_and_the_registry_is_followed() -> None:
    started, other = {"type": "Started", "address": "tm"}, {"type": "Received", "message": {}}
    assert MIGRATIONS[2].entry([1, 2.0, started, [3]]) == [1, 2.0, {"type": "Notified", "notice": {"type": "StartedBefore"}}, [3]]
    assert MIGRATIONS[2].entry([1, 2.0, other]) == [1, 2.0, other]
