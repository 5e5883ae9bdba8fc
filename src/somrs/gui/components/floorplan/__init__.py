"""The floor plan of a storey, drawn to scale from the objects of the map.

The element reads the map, its changes and the poses of moving objects from the API. The page sets what to show and handles the events:

    plan = FloorPlan(mode="edit")
    plan.on_select(lambda at: ...)

Modes: in `view`, objects can only be selected. In `pick`, the user drags a thing or a robot to where it should be; the object stays where
it is, and the element emits `dropped`. In `edit`, the user moves and turns objects, and moves the corners of zones, by mouse, touch
or keys; the element emits `moved` or `shaped`, and the page changes the map and calls `confirm_move(name, version)`, or `reject_move(name)`
if the change is refused.

Events, each with a dict:
- `select {name}`: the selected object, None for nothing. The page confirms it with `choose`, which also selects from elsewhere.
- `moved {name, x, y, turned, target, version}`: the new position (metres, radians), the object below it (for things only), and the version
  of the map when the drag began. `unanswered {names}`: the connection was lost before the page had answered the moves of these objects.
- `dropped {thing, target, x, y}` and `picked {name, x, y, target}`, in `pick`. `target`: the highest support, place or floor there.
- `placed {type, x, y, turned, target, storey}`: the position of a new object, after `place(type)`; `stopped {}`: placing was cancelled.
- `outlined {corners, storey}`: the corners of a zone, after `sketch_zone_on_click`, each x and y.
- `shaped {name, corners, version}`, in `edit`: a zone with one or more of its corners elsewhere; the page answers it as it answers `moved`.
- `open {name}` (Enter, double click), `remove {name}` (Delete), `undo {}` (Ctrl+Z).
- `storey {name, alone}`: the storey shown, and whether it is the only one; `loaded {version, objects}`: a map was read.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

from nicegui.element import Element
from nicegui.events import GenericEventArguments

from somrs.gui.components import LIVE, publish_modules

Mode = Literal["view", "pick", "edit"]
publish_modules(Path(__file__).parent / "modules")

EventHandler = Callable[[dict[str, Any]], Awaitable[None] | None]


class FloorPlan(Element, component="floorplan.js", dependencies=[LIVE]):
    """`storey`: the storey to show, by default the first. `snap`: grid size for dragged objects in metres, 0 for none."""

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

    # Content

    def set_mode(self, mode: Mode) -> None:
        self._set_prop("mode", mode)

    def set_storey(self, name: str) -> None:
        self._set_prop("storey_name", name)

    def set_snap(self, metres: float) -> None:
        self._set_prop("snap", metres)

    def choose(self, name: str | None) -> None:
        """Show an object as selected."""
        self._set_prop("selected", name)

    def highlight(self, marks: Mapping[str, str] | Iterable[str]) -> None:
        """Mark objects with a ring. A mapping gives the text to append to each label, such as the variable that the object is bound to."""
        pairs = marks.items() if isinstance(marks, Mapping) else ((name, "") for name in marks)
        self._set_prop("highlighted", [{"name": name, "mark": mark} for name, mark in pairs])

    def link(self, relations: Iterable[str]) -> None:
        """Draw the facts of these relations as links."""
        self._set_prop("relations", list(relations))

    def point(self, ways: Iterable[tuple[str, str | tuple[float, float]]]) -> None:
        """Draw arrows from things to the objects or positions where they should be."""
        arrows = [
            {"thing": thing, "target": target} if isinstance(target, str) else {"thing": thing, "x": target[0], "y": target[1]}
            for thing, target in ways
        ]
        self._set_prop("arrows", arrows)

    def show_version(self, version: int | None) -> None:
        """Show a past version of the map; None: the current one, with updates."""
        self._set_prop("version", version)

    def fit(self) -> None:
        self.run_method("fit")

    def show_object(self, name: str) -> None:
        """Scroll the plan so that an object is visible."""
        self.run_method("show", name)

    # Responses to moves

    def confirm_move(self, name: str, version: int) -> None:
        """Report that the map contains the move since this version."""
        self.run_method("settled", name, version)

    def reject_move(self, name: str) -> None:
        """Move the object back: the move was refused."""
        self.run_method("back", name)

    def place(self, type_name: str | None, values: Mapping[str, object] | None = None) -> None:
        """Let the user click where a new object of the type goes; None cancels. `values`: attributes that differ from the type's
        defaults."""
        self.run_method("place", type_name, dict(values or {}))

    def sketch_zone_on_click(self, button: Element) -> None:
        """Let the user click the corners of a zone once the button was clicked; emits `outlined`. The browser begins by itself: the next
        click may come before the server knows of the first."""
        button.on("click", js_handler=f"() => getElement({self.id}).sketchZone(true)")

    def focus(self) -> None:
        self.run_method("focus")

    # Events

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

    def on_outlined(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("outlined", handler)

    def on_shaped(self, handler: EventHandler) -> FloorPlan:
        return self._add_handler("shaped", handler)

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
