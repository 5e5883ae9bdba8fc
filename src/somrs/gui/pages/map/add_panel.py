"""Adding an object: choose a type in the tree, click a position on the plan, confirm the proposed name and values."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from somrs.api.remote import LiveApi
from somrs.errors import InputError
from somrs.gui.components.fields.tree import Node, Tree
from somrs.gui.components.floorplan import FloorPlan
from somrs.gui.pages.map.fields import Field, Raw
from somrs.gui.pages.map.fields import Spot as AttributeSpot
from somrs.gui.pages.map.proposals import Spot, creation_changes, form_for, name_for
from somrs.gui.shell import focus
from somrs.gui.submission import submit_once
from somrs.ontology.objects import Change
from somrs.ontology.types import ABSTRACT, PHYSICAL, ROOT, Ontology, Value

ChangeMap = Callable[[tuple[Change, ...], str], Awaitable[int | None]]


class AddPanel:
    """`on_created` is called with the new object's name and the map version that contains it."""

    def __init__(self, api: LiveApi, plan: FloorPlan, change: ChangeMap, on_created: Callable[[str, int], Awaitable[None]]) -> None:
        self._api, self._plan, self._change, self._on_created = api, plan, change, on_created
        self._type: str | None = None
        ui.label("Choose a type, then click a position on the plan.").classes("somrs-soft")
        self._tree = Tree("Types", "Find a type", self._pick, None, self._nodes())
        self._tree.classes("somrs-map-types")
        self._type_details = ui.element("div").classes("somrs-map-new")
        self._frame()

    def refresh(self) -> None:
        """Update the types and the number of objects of each."""
        self._tree.show_nodes(self._nodes())

    def _nodes(self) -> list[Node]:
        ontology, map = self._api.context.ontology, self._api.context.map
        nodes = []
        for name, object_type in sorted(ontology.types.items()):
            parent = object_type.parent if name not in (PHYSICAL, ABSTRACT) else None
            if name != ROOT:
                nodes.append(Node(id=name, label=name, parent=parent, count=len(map.of_type(name))))
        return nodes

    def _pick(self, type_name: str) -> None:
        self._type = type_name
        self._tree.select(type_name)
        self._frame()
        if self._placeable(type_name):
            map, ontology = self._api.context.map, self._api.context.ontology
            self._plan.place(type_name, form_for(type_name, map, ontology))

    def _placeable(self, type_name: str) -> bool:
        return "PositionX" in self._api.context.ontology.attributes_of(type_name)

    def _frame(self) -> None:
        self._type_details.clear()
        with self._type_details:
            if self._type is None:
                return
            doc = self._api.context.ontology.types[self._type].doc
            ui.label(f"{self._type}: {doc}" if doc else self._type).classes("somrs-soft")
            if self._placeable(self._type):
                ui.label("Click a position on the plan. R turns the object, Escape cancels.").classes("somrs-map-now").props(
                    'role="status"'
                )
            add_button = ui.button("Add without a position", on_click=lambda: self._open_dialog(str(self._type), None)).props(
                "flat dense no-caps"
            )
            add_button.props('icon="add_location_alt"' if self._placeable(self._type) else 'icon="add"')

    def place_object(self, event: dict[str, Any]) -> None:
        """Handle a click on the plan."""
        spot = Spot(x=event["x"], y=event["y"], turned=event["turned"], target=event["target"], storey=event["storey"] or "")
        self._open_dialog(event["type"], spot)

    def stop(self) -> None:
        self._type = None
        self._tree.select(None)
        self._plan.place(None)
        self._frame()

    def _open_dialog(self, type_name: str, spot: Spot | None) -> None:
        """Open a form for the name and the required attributes."""
        _NewObjectDialog(self._api, type_name, spot, self._change, self._finish)

    async def _finish(self, name: str, version: int) -> None:
        self.stop()
        await self._on_created(name, version)


class _NewObjectDialog:
    """The dialog for one new object."""

    def __init__(
        self, api: LiveApi, type_name: str, spot: Spot | None, change: ChangeMap, on_created: Callable[[str, int], Awaitable[None]]
    ) -> None:
        self._api, self._type, self._spot, self._change, self._on_created = api, type_name, spot, change, on_created
        map, ontology = api.context.map, api.context.ontology
        self._values: dict[str, Raw] = {}
        self._fields: dict[str, Field] = {}
        title = f"New {type_name}"
        with ui.dialog().props(f'aria-label="{title}"') as self._dialog, ui.card().classes("somrs-map-dialog"):
            ui.label(title).classes("somrs-title")
            if spot is not None:
                location = f", on {spot.target}" if spot.target is not None and ontology.is_subtype(type_name, "Graspable") else ""
                ui.label(f"At x {spot.x:.2f} m, y {spot.y:.2f} m{location}").classes("somrs-soft")
            with ui.element("form").props(f'aria-label="{title}" novalidate').classes("somrs-map-form") as form:
                self._name = ui.input("Name", value=name_for(type_name, map)).props(
                    "outlined dense autofocus autocomplete=off hide-bottom-space"
                )
                proposed = form_for(type_name, map, ontology)
                with ui.element("div").classes("somrs-map-group"):
                    for path in [*proposed, *self._missing(ontology, set(proposed))]:
                        self._field(path, proposed.get(path), ontology)
                with ui.element("div").classes("somrs-map-buttons"):
                    add_button = ui.button("Add", icon="check").props("unelevated no-caps type=submit")
                    ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
            submit_once(form, add_button, self._add)
        self._dialog.on("hide", self._dialog.delete)
        self._dialog.open()

    def _missing(self, ontology: Ontology, proposed: set[str]) -> list[str]:
        """The required attributes for which there is no proposal."""
        attributes = ontology.attributes_of(self._type)
        missing_names = []
        for ancestor in ontology.ancestors(self._type):
            for name in ontology.types[ancestor].required:
                is_positioned = self._spot is not None and name.startswith("Position")
                inner = {path for path in proposed if path.startswith(f"{name}.")}
                if (
                    name in attributes
                    and not is_positioned
                    and not inner
                    and ontology.default(self._type, name) is None
                    and not attributes[name].attributes
                ):
                    missing_names.append(name)
        return [*dict.fromkeys(missing_names)]

    def _field(self, path: str, value: Value | None, ontology: Ontology) -> None:
        spot = AttributeSpot(path, ontology.attributes_of(self._type)[path], self._type, ontology)
        field = Field(spot, self._typed)
        field.show_value(value)
        self._fields[path] = field
        self._values[path] = spot.raw(value)

    def _typed(self, path: str, raw: Raw) -> None:
        self._values[path] = raw

    async def _add(self) -> bool:
        values: dict[str, Value] = {}
        for path, raw in self._values.items():
            try:
                value = self._fields[path].spot.read(raw)
            except InputError as error:
                self._fields[path].show_problem(str(error))
                self._fields[path].focus()
                return False
            if value is not None:
                values[path] = value
        name = str(self._name.value or "").strip()
        map, ontology = self._api.context.map, self._api.context.ontology
        if not name or name in map.objects:
            self._name.error = "there is already an object with this name" if name else "enter a name"
            focus(self._name)
            return False
        changes = creation_changes(self._type, name, values, self._spot, map, ontology)
        version = await self._change(changes, f"{name} was added")
        if version is None:
            return False
        await self._on_created(name, version)
        self._dialog.close()  # last: what a handler of the dialog does has no place on the page any more when it is hidden
        return True
