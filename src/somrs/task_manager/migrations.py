"""Migrations of the Task Manager's state, from each version to the next (`manager.SCHEMA`)."""

from __future__ import annotations

from typing import Any

from somrs.kernel.codec import Migration
from somrs.protocol.messages.goal_kinds import GoalKind


def _with_goals(snapshot: Any) -> Any:
    """Add the kind of goal to steps, work and events. In version 1, only the names of steps show it, such as `look2.step1`."""
    for task in snapshot["state"]["tasks"].values():
        for execution in (task["goal"], *task["aside"]):
            for run in (execution["workflow"] or {"runs": {}})["runs"].values():
                run["goal"] = execution["kind"]
        for work in task["log"]["works"]:
            work["goal"] = GoalKind.UNDO if work.pop("undoes") else _goal(work["label"])
        for noted in task["events"]:
            noted["goal"] = _goal(noted["step"]) if noted["step"] is not None else None
    return snapshot


def _goal(label: str) -> GoalKind:
    beginning, dot, _ = label.partition(".")
    return GoalKind(beginning.rstrip("0123456789")) if dot else GoalKind.TASK


MIGRATIONS = {1: Migration(snapshot=_with_goals)}
"""By the version that they start from."""
