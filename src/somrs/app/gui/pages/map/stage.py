"""What the page shows of the map: the floor plan, or the same in three dimensions."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from nicegui import ui

from somrs.app.gui.parts.floorplan import FloorPlan
from somrs.app.gui.parts.scene import Scene3D

PLAN, SCENE = "Plan", "3D"


class Stage:
    """`plan` is always there; the scene is made when it is first asked for. What is chosen, found and looked back at is so in both."""

    def __init__(self, plan: FloorPlan, holder: ui.element, chosen: Callable[[str | None], None]) -> None:
        self.plan = plan
        self._holder, self._heard = holder, chosen
        self._scene: Scene3D | None = None
        self._chosen: str | None = None
        self._marks: Mapping[str, str] = {}
        self._version: int | None = None

    def switch(self, view: str) -> None:
        """Show one of the two."""
        if view == SCENE and self._scene is None:
            with self._holder:
                self._scene = Scene3D(height="100%", version=self._version)
            self._scene.choose(self._chosen)
            self._scene.highlight(self._marks)
            self._scene.on_select(lambda told: self._heard(told["name"]))
        if self._scene is not None:
            self._scene.set_visibility(view == SCENE)
        self.plan.set_visibility(view != SCENE)

    def choose(self, name: str | None) -> None:
        self._chosen = name
        self.plan.choose(name)
        if self._scene is not None:
            self._scene.choose(name)

    def highlight(self, marks: Mapping[str, str]) -> None:
        self._marks = dict(marks)
        self.plan.highlight(marks)
        if self._scene is not None:
            self._scene.highlight(marks)

    def turn_to(self, version: int | None) -> None:
        self._version = version
        self.plan.turn_to(version)
        if self._scene is not None:
            self._scene.turn_to(version)
