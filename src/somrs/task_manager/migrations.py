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


def _with_reservations(snapshot: Any) -> Any:
    """Give each task its reservation. In version 2, the Task Manager kept all reservations to itself."""
    state = snapshot["state"]
    stored = state.pop("reservations")
    claimants = state["local_reservations"] = {"claimants": {}, "freed": stored["freed"], "arrivals": len(stored["goals"])}
    for arrival, (task, goal) in enumerate(stored["goals"].items(), 1):
        waiting = stored["waiting"].get(task)
        held, awaited = _reservation(stored["held"].get(task)), _reservation(waiting["wanted"]) if waiting is not None else None
        claimants["claimants"][task] = {
            "holder": "",
            "goal": goal,
            "priority": stored["priorities"][task],
            "arrival": arrival,
            "held": held,
            "waiting": awaited,
            "admitted": waiting is not None and waiting["called"],
            "had": held["changes"],
        }
        if task in state["tasks"]:
            state["tasks"][task]["reservation"] = {"held": held, "waiting": awaited}
    return snapshot


def _reservation(stored: Any) -> Any:
    return {"changes": stored["changes"], "relies_on": stored["relies"]} if stored is not None else {"changes": [], "relies_on": []}


def _without_start(entry: Any) -> Any:
    """Keep an earlier start apart from the first one of this program, which tells the Repository of all reservations, and follows the
    Registry."""
    number, time, event, *rest = entry
    return [number, time, {"type": "Notified", "notice": {"type": "StartedBefore"}} if event["type"] == "Started" else event, *rest]


MIGRATIONS = {1: Migration(snapshot=_with_goals), 2: Migration(snapshot=_with_reservations, entry=_without_start)}
"""By the version that they start from."""
