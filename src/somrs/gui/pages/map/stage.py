"""What the page shows of the map: the floor plan, or the same in three dimensions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.components.scene import Scene3D

PLAN, SCENE = "Plan", "3D"
VIEWS = {PLAN: "plan", SCENE: "3d"}
"""As addresses have them."""
ALL = "all"
"""All storeys, in addresses: in the scene, they can be looked at together."""


class Stage:
    """`plan` is always there; the scene is made when it is first asked for. What is chosen, found and looked back at is so in both, and
    the storey is the same. `turned` is called when another view or storey is shown."""

    def __init__(
        self, desk: LiveApi, plan: FloorPlan, holder: ui.element, chosen: Callable[[str | None], None], turned: Callable[[], None]
    ) -> None:
        self.plan = plan
        self._desk, self._holder, self._heard, self._turned = desk, holder, chosen, turned
        self._scene: Scene3D | None = None
        self._view = PLAN
        self._storey: str | None = None
        self._all = False
        self._alone = True
        self._chosen: str | None = None
        self._marks: Mapping[str, str] = {}
        self._version: int | None = None
        plan.on_storey(self._plan_turned)

    def begin(self, storey: str | None) -> None:
        """Start at the storey that an address asks for."""
        if storey == ALL:
            self._all, self._alone = True, False
        elif storey is not None:
            self._storey, self._alone = storey, False
            self.plan.set_storey(storey)

    def asked(self) -> dict[str, str]:
        """What an address would have to ask for to get to see the same."""
        view = {"view": VIEWS[self._view]} if self._view != PLAN else {}
        storey = ALL if self._all and self._view == SCENE else self._storey
        return view | ({"storey": storey} if storey is not None and not self._alone else {})

    def switch(self, view: str) -> None:
        """Show one of the two."""
        self._view = view
        if view == SCENE and self._scene is None:
            with self._holder:
                self._scene = Scene3D(height="100%", version=self._version)
            self._scene.choose(self._chosen)
            self._scene.highlight(self._marks)
            self._scene.on_select(lambda told: self._heard(told["name"]))
            self._scene.on_storey(self._scene_turned)
            self._show_storey()
        if self._scene is not None:
            self._scene.set_visibility(view == SCENE)
        self.plan.set_visibility(view != SCENE)
        self._turned()

    def _show_storey(self) -> None:
        if self._scene is None:
            return
        if self._all:
            self._scene.set_storey(None)
        elif self._storey is not None:
            self._scene.set_storey(self._called(self._storey))

    def _plan_turned(self, told: dict[str, Any]) -> None:
        self._storey, self._alone = told["name"], told["alone"]
        self._all = self._all and self._view == SCENE
        self._show_storey()
        self._turned()

    def _scene_turned(self, told: dict[str, Any]) -> None:
        self._all = told["name"] is None
        map, ontology = self._desk.context.map, self._desk.context.ontology
        storeys = (one.name for one in map.objects.values() if ontology.is_subtype(one.type, "Storey"))
        storey = next((one for one in storeys if self._called(one) == told["name"]), None)
        if storey is not None:
            self._storey = storey
            self.plan.set_storey(storey)
        self._show_storey()
        self._turned()

    def _called(self, storey: str) -> str:
        """As the scene has it."""
        object = self._desk.context.map.objects.get(storey)
        return str(object.values.get("Label", storey)) if object is not None else storey

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
