"""The view of the map: floor plan or 3D scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.components.scene import Scene3D

PLAN, SCENE = "Plan", "3D"
VIEWS = {PLAN: "plan", SCENE: "3d"}
"""Names of the views in addresses."""
ALL_STOREYS = "all"
"""Value of the address parameter `storey` for all storeys, which only the scene can show."""


class MapView:
    """`plan` always exists; the scene is created on first use. Selection, marks, version and storey are the same in both. `on_view_change`
    is called when another view or storey is shown."""

    def __init__(
        self, api: LiveApi, plan: FloorPlan, holder: ui.element, on_choice: Callable[[str | None], None], on_view_change: Callable[[], None]
    ) -> None:
        self.plan = plan
        self._api, self._holder, self._on_choice, self._on_view_change = api, holder, on_choice, on_view_change
        self._scene: Scene3D | None = None
        self._view = PLAN
        self._storey: str | None = None
        self._shows_all_storeys = False
        self._is_only_storey = True
        self._chosen: str | None = None
        self._marks: Mapping[str, str] = {}
        self._version: int | None = None
        plan.on_storey(self._on_plan_storey)

    def begin(self, storey: str | None) -> None:
        """Start at the storey of the page's address."""
        if storey == ALL_STOREYS:
            self._shows_all_storeys, self._is_only_storey = True, False
        elif storey is not None:
            self._storey, self._is_only_storey = storey, False
            self.plan.set_storey(storey)

    def address_parameters(self) -> dict[str, str]:
        """The address parameters that lead to the current view."""
        view = {"view": VIEWS[self._view]} if self._view != PLAN else {}
        storey = ALL_STOREYS if self._shows_all_storeys and self._view == SCENE else self._storey
        return view | ({"storey": storey} if storey is not None and not self._is_only_storey else {})

    def switch(self, view: str) -> None:
        """Switch to the view."""
        self._view = view
        if view == SCENE and self._scene is None:
            with self._holder:
                self._scene = Scene3D(height="100%", version=self._version)
            self._scene.choose(self._chosen)
            self._scene.highlight(self._marks)
            self._scene.on_select(lambda event: self._on_choice(event["name"]))
            self._scene.on_storey(self._on_scene_storey)
            self._show_storey()
        if self._scene is not None:
            self._scene.set_visibility(view == SCENE)
        self.plan.set_visibility(view != SCENE)
        self._on_view_change()

    def _show_storey(self) -> None:
        if self._scene is None:
            return
        if self._shows_all_storeys:
            self._scene.set_storey(None)
        elif self._storey is not None:
            self._scene.set_storey(self._storey_label(self._storey))

    def _on_plan_storey(self, event: dict[str, Any]) -> None:
        self._storey, self._is_only_storey = event["name"], event["alone"]
        self._shows_all_storeys = self._shows_all_storeys and self._view == SCENE
        self._show_storey()
        self._on_view_change()

    def _on_scene_storey(self, event: dict[str, Any]) -> None:
        self._shows_all_storeys = event["name"] is None
        storey = next((name for name in self.storeys() if self._storey_label(name) == event["name"]), None)
        if storey is not None:
            self._storey = storey
            self.plan.set_storey(storey)
        self._show_storey()
        self._on_view_change()

    def storeys(self) -> list[str]:
        map, ontology = self._api.context.map, self._api.context.ontology
        return [map_object.name for map_object in map.objects.values() if ontology.is_subtype(map_object.type, "Storey")]

    def _storey_label(self, storey: str) -> str:
        """The storey's label in the scene."""
        object = self._api.context.map.objects.get(storey)
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

    def show_version(self, version: int | None) -> None:
        self._version = version
        self.plan.show_version(version)
        if self._scene is not None:
            self._scene.show_version(version)
