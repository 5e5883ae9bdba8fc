"""The floor plan of a storey, drawn to scale from the objects of the map: an element for any page.

It reads the map and its news from the API by itself, and where things are that move, so a page only says what to show and hears what
people do:

    plan = FloorPlan(mode="edit")
    plan.on_select(lambda at: ...)

Modes: in `view`, things are only chosen. In `pick`, a thing (or a robot) is dragged to where it should be; it stays where it is, and
the page hears `dropped`. In `edit`, objects are moved and turned, by mouse, finger or keys; the page hears `moved`, changes the map, and
says `settled(name, version)`, or `back(name)` when that was refused.

Events, each with a dict:
- `select {name}`: what was chosen, None for nothing. Say so with `choose`, also for what was chosen elsewhere.
- `moved {name, x, y, turned, target, version}`: where to (metres, radians), what would be below it (a thing only), and of which version
  the map was when it was taken. `unanswered {names}`: they went back, for nobody said whether they may stay.
- `dropped {thing, target, x, y}` and `picked {name, x, y, target}`, in `pick`. `target`: the highest support, place or floor there.
- `placed {type, x, y, turned, target, storey}`: where something new goes, after `place(type)`; `stopped {}`: nowhere.
- `open {name}` (Enter, double click), `remove {name}` (Delete), `undo {}` (Ctrl+Z).
- `storey {name, alone}`: which one is shown, and whether there is no other; `loaded {version, objects}`: a map was read.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Mapping
from typing import Any, Literal

from nicegui.element import Element
from nicegui.events import GenericEventArguments

from somrs.gui.components import LIVE
from somrs.gui.components.scene import MODULES

Mode = Literal["view", "pick", "edit"]
EventHandler = Callable[[dict[str, Any]], Awaitable[None] | None]


class FloorPlan(Element, component="floorplan.js", dependencies=[LIVE], esm={"somrs-floorplan": "modules", "somrs-scene": str(MODULES)}):
    """`storey`: which one to show, else the first; `snap`: metres between the points that dragged objects snap to, 0 for none."""

    def __init__(self, *, mode: Mode = "view", storey: str | None = None, snap: float = 0.0, legend: bool = False) -> None:
        super().__init__()
        self._props["mode"] = mode
        self._props["snap"] = snap
        self._props["show_legend"] = legend
        if storey is not None:
            self._props["storey_name"] = storey

    def _set_prop(self, key: str, value: object) -> None:
        if value is None:
            self._props.pop(key, None)
        else:
            self._props[key] = value
        self.update()

    # What is shown

    def set_mode(self, mode: Mode) -> None:
        self._set_prop("mode", mode)

    def set_storey(self, name: str) -> None:
        self._set_prop("storey_name", name)

    def set_snap(self, metres: float) -> None:
        self._set_prop("snap", metres)

    def choose(self, name: str | None) -> None:
        """Frame an object as the chosen one."""
        self._set_prop("selected", name)

    def highlight(self, marks: Mapping[str, str] | Iterable[str]) -> None:
        """Ring objects; with a mapping, write something behind each name, such as the variable that it is."""
        pairs = marks.items() if isinstance(marks, Mapping) else ((name, "") for name in marks)
        self._set_prop("highlighted", [{"name": name, "mark": mark} for name, mark in pairs])

    def link(self, relations: Iterable[str]) -> None:
        """Draw the facts of these relations as links."""
        self._set_prop("relations", list(relations))

    def point(self, ways: Iterable[tuple[str, str | tuple[float, float]]]) -> None:
        """Draw arrows: from a thing to the object or the spot where it is to be."""
        arrows = [
            {"thing": thing, "target": target} if isinstance(target, str) else {"thing": thing, "x": target[0], "y": target[1]}
            for thing, target in ways
        ]
        self._set_prop("arrows", arrows)

    def show_version(self, version: int | None) -> None:
        """Show the map as it was at a version; None for as it is, and goes on to be."""
        self._set_prop("version", version)

    def fit(self) -> None:
        self.run_method("fit")

    def show_object(self, name: str) -> None:
        """Have an object in view."""
        self.run_method("show", name)

    # What becomes of what was done

    def confirm_move(self, name: str, version: int) -> None:
        """What was moved is so on the map since the version."""
        self.run_method("settled", name, version)

    def reject_move(self, name: str) -> None:
        """What was moved may not stay there."""
        self.run_method("back", name)

    def place(self, type_name: str | None, values: Mapping[str, object] | None = None) -> None:
        """Have people click where a new object of the type goes; None stops that. `values`: what it has beside the type's defaults."""
        self.run_method("place", type_name, dict(values or {}))

    def focus(self) -> None:
        self.run_method("focus")

    # What people do

    def _add_handler(self, event: str, handler: EventHandler) -> FloorPlan:
        def handle(arguments: GenericEventArguments) -> Awaitable[None] | None:
            return handler(arguments.args)

        self.on(event, handle)
        return self

    def on_select(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("select", handler)

    def on_moved(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("moved", handler)

    def on_unanswered(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("unanswered", handler)

    def on_dropped(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("dropped", handler)

    def on_picked(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("picked", handler)

    def on_placed(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("placed", handler)

    def on_stopped(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("stopped", handler)

    def on_open(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("open", handler)

    def on_remove(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("remove", handler)

    def on_undo(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("undo", handler)

    def on_storey(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("storey", handler)

    def on_loaded(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("loaded", handler)
