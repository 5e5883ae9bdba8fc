"""Adding an object: its type is found in the tree, a click on the plan says where it goes, and a name is proposed."""

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
from somrs.gui.pages.map.proposals import Spot, adding, form_for, name_for
from somrs.gui.shell import focus, guarded
from somrs.ontology.objects import Change
from somrs.ontology.types import ABSTRACT, PHYSICAL, ROOT, Ontology, Value

Change_ = Callable[[tuple[Change, ...], str], Awaitable[int | None]]


class Adding:
    """`added` hears of the new object's name."""

    def __init__(self, desk: LiveApi, plan: FloorPlan, change: Change_, added: Callable[[str, int], Awaitable[None]]) -> None:
        self._desk, self._plan, self._change, self._added = desk, plan, change, added
        self._type: str | None = None
        ui.label("Choose what it is, then click on the plan where it goes.").classes("somrs-soft")
        self._tree = Tree("Types", "Find a type", self._pick, None, self._nodes())
        self._tree.classes("somrs-map-types")
        self._below = ui.element("div").classes("somrs-map-new")
        self._frame()

    def refresh(self) -> None:
        """The types, and how many objects of each there are, as they are now."""
        self._tree.show(self._nodes())

    def _nodes(self) -> list[Node]:
        ontology, map = self._desk.context.ontology, self._desk.context.map
        nodes = []
        for name, one in sorted(ontology.types.items()):
            parent = one.parent if name not in (PHYSICAL, ABSTRACT) else None
            if name != ROOT:
                nodes.append(Node(id=name, label=name, parent=parent, count=len(map.of_type(name))))
        return nodes

    def _pick(self, type_name: str) -> None:
        self._type = type_name
        self._tree.select(type_name)
        self._frame()
        if self._placeable(type_name):
            map, ontology = self._desk.context.map, self._desk.context.ontology
            self._plan.place(type_name, form_for(type_name, map, ontology))

    def _placeable(self, type_name: str) -> bool:
        return "PositionX" in self._desk.context.ontology.attributes_of(type_name)

    def _frame(self) -> None:
        self._below.clear()
        with self._below:
            if self._type is None:
                return
            doc = self._desk.context.ontology.types[self._type].doc
            ui.label(f"{self._type}: {doc}" if doc else self._type).classes("somrs-soft")
            if self._placeable(self._type):
                ui.label("Click on the plan where it goes. R turns it, Escape stops.").classes("somrs-map-now").props('role="status"')
            without = ui.button("Add without a place", on_click=lambda: self.ask(str(self._type), None)).props("flat dense no-caps")
            without.props('icon="add_location_alt"' if self._placeable(self._type) else 'icon="add"')

    def placed(self, told: dict[str, Any]) -> None:
        """Somebody clicked on the plan."""
        spot = Spot(x=told["x"], y=told["y"], turned=told["turned"], target=told["target"], storey=told["storey"] or "")
        self.ask(told["type"], spot)

    def stop(self) -> None:
        self._type = None
        self._tree.select(None)
        self._plan.place(None)
        self._frame()

    def ask(self, type_name: str, spot: Spot | None) -> None:
        """A form with what it has to have, and a name."""
        _New(self._desk, type_name, spot, self._change, self._done)

    async def _done(self, name: str, version: int) -> None:
        self.stop()
        await self._added(name, version)


class _New:
    """The dialog for one new object."""

    def __init__(
        self, desk: LiveApi, type_name: str, spot: Spot | None, change: Change_, done: Callable[[str, int], Awaitable[None]]
    ) -> None:
        self._desk, self._type, self._spot, self._change, self._done = desk, type_name, spot, change, done
        map, ontology = desk.context.map, desk.context.ontology
        self._values: dict[str, Raw] = {}
        self._fields: dict[str, Field] = {}
        title = f"New {type_name}"
        with ui.dialog() as self._dialog, ui.card().classes("somrs-map-dialog").props(f'role="dialog" aria-label="{title}"'):
            ui.label(title).classes("somrs-title")
            if spot is not None:
                on = f", on {spot.target}" if spot.target is not None and ontology.is_subtype(type_name, "Graspable") else ""
                ui.label(f"At x {spot.x:.2f} m, y {spot.y:.2f} m{on}").classes("somrs-soft")
            with ui.element("form").props(f'aria-label="{title}" novalidate').classes("somrs-map-form") as form:
                self._name = ui.input("Name", value=name_for(type_name, map)).props(
                    "outlined dense autofocus autocomplete=off hide-bottom-space"
                )
                proposed = form_for(type_name, map, ontology)
                with ui.element("div").classes("somrs-map-group"):
                    for path in [*proposed, *self._missing(ontology, set(proposed))]:
                        self._field(path, proposed.get(path), ontology)
                with ui.element("div").classes("somrs-map-buttons"):
                    ui.button("Add", icon="check").props("unelevated no-caps type=submit")
                    ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
            form.on("submit.prevent", guarded(self._add))
        self._dialog.on("hide", self._dialog.delete)
        self._dialog.open()

    def _missing(self, ontology: Ontology, proposed: set[str]) -> list[str]:
        """What it must have, and nobody proposed."""
        known = ontology.attributes_of(self._type)
        found = []
        for ancestor in ontology.ancestors(self._type):
            for name in ontology.types[ancestor].required:
                given = self._spot is not None and name.startswith("Position")
                inner = {path for path in proposed if path.startswith(f"{name}.")}
                if name in known and not given and not inner and ontology.default(self._type, name) is None and not known[name].attributes:
                    found.append(name)
        return [*dict.fromkeys(found)]

    def _field(self, path: str, value: Value | None, ontology: Ontology) -> None:
        spot = AttributeSpot(path, ontology.attributes_of(self._type)[path], self._type, ontology)
        field = Field(spot, self._typed)
        field.show(value)
        self._fields[path] = field
        self._values[path] = spot.raw(value)

    def _typed(self, path: str, raw: Raw) -> None:
        self._values[path] = raw

    async def _add(self) -> None:
        values: dict[str, Value] = {}
        for path, raw in self._values.items():
            try:
                value = self._fields[path].spot.read(raw)
            except InputError as error:
                self._fields[path].problem(str(error))
                self._fields[path].focus()
                return
            if value is not None:
                values[path] = value
        name = str(self._name.value or "").strip()
        map, ontology = self._desk.context.map, self._desk.context.ontology
        if not name or name in map.objects:
            self._name.error = "there is an object of this name already" if name else "it needs a name"
            focus(self._name)
            return
        changes = adding(self._type, name, values, self._spot, map, ontology)
        version = await self._change(changes, f"{name} was added")
        if version is not None:
            self._dialog.close()
            await self._done(name, version)
