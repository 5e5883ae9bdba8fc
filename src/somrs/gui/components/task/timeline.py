"""Work in a task over time: bars by device, with the promised times."""

from __future__ import annotations

from nicegui.element import Element

from somrs.gui.components import LIVE


class DeviceTimeline(Element, component="timeline.js", dependencies=[LIVE]):
    """`task`: the full id. The element follows the task itself."""

    def __init__(self, task: str, *, empty: str = "No work has begun yet") -> None:
        super().__init__()
        self._props.update({"task": task, "empty": empty})
