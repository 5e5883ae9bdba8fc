"""States of earlier versions say the same in the words of today."""

from __future__ import annotations

from typing import Any

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
