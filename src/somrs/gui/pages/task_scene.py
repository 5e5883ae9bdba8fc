"""The 3D view or floor plan of a task: working devices and the things that they handle are marked; on the plan, arrows show the goal."""

from __future__ import annotations

from collections.abc import Iterator

from nicegui import app, ui

from somrs.entish import Name, Relation
from somrs.entish.formula import conjuncts
from somrs.entish.parse import parse
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.components.scene import Scene3D
from somrs.gui.pages.task_text import device_name
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.task_views import TaskView

_SPACE, _PLAN = "3d", "plan"
VIEW_SETTING = "task view"
"""Key in the browser's settings: which of the two views is shown."""

_HEIGHT = "340px"

SCENE_DELAY = 0.3
"""Seconds after which the scene is made, so that the rest of the page appears first."""

_WORKING = (State.EXECUTING, State.STOPPING, State.COMPENSATING)


class TaskScene:
    """One of two views; the user's choice is kept in the browser."""

    def __init__(self) -> None:
        self._marks: dict[str, str] = {}
        self._arrows: list[tuple[str, str | tuple[float, float]]] = []
        self._plan: FloorPlan | None = None
        self._space: Scene3D | None = None
        chosen = app.storage.user.get(VIEW_SETTING, _SPACE)
        self._choice = shown_at_once(ui.toggle({_SPACE: "3D", _PLAN: "Floor plan"}, value=chosen, on_change=self._switch_view))
        self._choice.props('no-caps dense unelevated aria-label="View"').classes("somrs-task-scene-choice")
        self._place = ui.element("div").classes("somrs-task-view").style(f"min-height: {_HEIGHT}")
        ui.timer(SCENE_DELAY, self._build_view, once=True)

    def _switch_view(self) -> None:
        app.storage.user[VIEW_SETTING] = self._choice.value
        self._build_view()

    def _build_view(self) -> None:
        self._place.clear()
        self._plan = self._space = None
        with self._place:
            if self._choice.value == _PLAN:
                self._plan = FloorPlan(mode="view").classes("somrs-task-floor")
            else:
                self._space = Scene3D(height=_HEIGHT)
        self._mark()

    def _mark(self) -> None:
        if self._plan is not None:
            self._plan.highlight(self._marks)
            self._plan.point(self._arrows)
        if self._space is not None:
            self._space.highlight(self._marks)

    def render(self, view: TaskView) -> None:
        marks = dict(_work_marks(view))
        arrows = [*_goal_arrows(view)] if view.outcome is None else []
        if (marks, arrows) != (self._marks, self._arrows):
            self._marks, self._arrows = marks, arrows
            self._mark()


def _work_marks(view: TaskView) -> Iterator[tuple[str, str]]:
    """Names of objects, each with the text to append to its label."""
    for work in view.work:
        if work.state in _WORKING:
            yield next(iter(work.inputs.values()), ""), ""
            yield device_name(work.service), work.step


def _goal_arrows(view: TaskView) -> Iterator[tuple[str, str | tuple[float, float]]]:
    """Arrows from things to their places in the goal."""
    for part in conjuncts(parse(view.effect)):
        match part:
            case Relation(_, (Name(thing), Name(place))):
                yield thing, place
