"""The 3D view of the building, with the robots moving, as an element for pages: `Scene3D(height="70vh")`.

It reads what there is from `/api/scene`, follows changes at `/api/live` and poses at `/api/poses` by itself, and draws only when something
changed. How it is made is in `modules`.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import nicegui
from nicegui.element import Element
from nicegui.events import GenericEventArguments

THREE = Path(nicegui.__file__).parent / "elements" / "scene" / "dist"
"""NiceGUI's own three.js, of the version that it brings along."""
MODULES = Path(__file__).parent / "modules"
"""What the view is made of; the floor plan moves robots as it does."""

EventHandler = Callable[[dict[str, Any]], Awaitable[None] | None]


class Scene3D(Element, component="scene3d.js", esm={"nicegui-scene": str(THREE), "somrs-scene": str(MODULES)}):
    """`height`: as CSS has it. `follow`: the object that the camera stays with. `version`: the map of that version, at rest; None: as it
    is now.

    Events: `select {name}`, what somebody chose, None for nothing; what was chosen elsewhere, say with `choose`. `storey {name}`: what the
    storey is called that somebody looks at, None for all of them; have another one shown with `set_storey`.
    """

    def __init__(self, *, height: str = "60vh", follow: str | None = None, version: int | None = None) -> None:
        super().__init__()
        self._props["height"] = height
        self._props["follow"] = follow
        self._props["version"] = version

    def _set_prop(self, key: str, value: object) -> None:
        self._props[key] = value
        self.update()

    def choose(self, name: str | None) -> None:
        """Frame an object as the chosen one."""
        self._set_prop("chosen", name)

    def highlight(self, marks: Mapping[str, str] | Iterable[str]) -> None:
        """Mark objects with a ring and a pin, and name them; with a mapping, write something behind each name."""
        pairs = marks.items() if isinstance(marks, Mapping) else ((name, "") for name in marks)
        self._set_prop("highlighted", [{"name": name, "mark": mark} for name, mark in pairs])

    def follow(self, name: str | None) -> None:
        """Have the camera stay with an object; None: with none."""
        self._set_prop("follow", name)

    def set_storey(self, storey_label: str | None) -> None:
        """Show the storey that is called so; None: all of them."""
        self._set_prop("storey", storey_label or "")

    def show_version(self, version: int | None) -> None:
        """Show the map of a version; None: as it is now."""
        self._set_prop("version", version)

    def on_select(self, handler: EventHandler) -> None:
        self._add_handler("select", handler)

    def on_storey(self, handler: EventHandler) -> None:
        self._add_handler("storey", handler)

    def _add_handler(self, event: str, handler: EventHandler) -> None:
        async def handle(arguments: GenericEventArguments) -> None:
            answer = handler(arguments.args)
            if answer is not None:
                await answer

        self.on(event, handle)
