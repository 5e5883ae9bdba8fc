"""The 3D view of the building with moving robots: `Scene3D(height="70vh")`.

The element reads the scene from `/api/scene`, its changes from `/api/live` and poses from `/api/poses`. It draws only when something
changed. The parts of its implementation are in `modules`.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import nicegui
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from somrs.gui.components import LIVE, publish_modules

THREE = Path(nicegui.__file__).parent / "elements" / "scene" / "dist"
"""The three.js that NiceGUI bundles."""
MODULES = Path(__file__).parent / "modules"
"""Modules of the view. The floor plan uses the one that interpolates motion."""
publish_modules(MODULES)

EventHandler = Callable[[dict[str, Any]], Awaitable[None] | None]


class Scene3D(Element, component="scene3d.js", dependencies=[LIVE], esm={"nicegui-scene": str(THREE)}):
    """`height`: as in CSS. `follow`: the object that the camera follows. `version`: show this version of the map, without updates; None:
    the current one.

    Events: `select {name}`: the object that the user selected, None for nothing; use `choose` to select from elsewhere. `storey {name}`:
    the label of the storey shown, None for all; use `set_storey` to show another one.
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
        """Show an object as selected."""
        self._set_prop("chosen", name)

    def highlight(self, marks: Mapping[str, str] | Iterable[str]) -> None:
        """Mark objects with a ring, a pin and a label. A mapping gives the text to append to each label."""
        pairs = marks.items() if isinstance(marks, Mapping) else ((name, "") for name in marks)
        self._set_prop("highlighted", [{"name": name, "mark": mark} for name, mark in pairs])

    def follow(self, name: str | None) -> None:
        """Let the camera follow an object; None stops it."""
        self._set_prop("follow", name)

    def set_storey(self, storey_label: str | None) -> None:
        """Show the storey with this label; None: all storeys."""
        self._set_prop("storey", storey_label or "")

    def show_version(self, version: int | None) -> None:
        """Show a version of the map; None: the current one."""
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
