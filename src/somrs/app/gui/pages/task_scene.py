"""Where a task takes place: the floor plan, with whoever is at work and the things that they handle marked, and an arrow to where things
are wanted."""

from __future__ import annotations

from collections.abc import Iterator

from somrs.app.gui.pages.task_words import device
from somrs.app.gui.parts.floorplan import FloorPlan
from somrs.entish import Name, Relation
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.protocol.clients import TaskView
from somrs.protocol.frp import State

WORKING = (State.EXECUTING, State.STOPPING, State.COMPENSATING)


class Scene:
    def __init__(self) -> None:
        self._plan = FloorPlan(mode="view").classes("somrs-task-plan-view")
        self._shown: object = None

    def show(self, view: TaskView) -> None:
        marks = dict(_marks(view))
        ways = [*_ways(view)] if view.outcome is None else []
        if (marks, ways) != self._shown:
            self._shown = marks, ways
            self._plan.highlight(marks)
            self._plan.point(ways)


def _marks(view: TaskView) -> Iterator[tuple[str, str]]:
    """Names of objects, with what is to be said of them."""
    for work in view.work:
        if work.state in WORKING:
            yield next(iter(work.inputs.values()), ""), ""
            yield device(work.service), work.step


def _ways(view: TaskView) -> Iterator[tuple[str, str | tuple[float, float]]]:
    """From things to where the wish wants them."""
    for part in conjuncts(parse(view.effect)):
        match part:
            case Relation(_, (Name(thing), Name(place))):
                yield thing, place
