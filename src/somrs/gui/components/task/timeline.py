"""Who does what when in a task: bars by device over time, with what was promised."""

from __future__ import annotations

from nicegui.element import Element

from somrs.gui.components import LIVE
from somrs.gui.components.task import MODULES


class DeviceTimeline(Element, component="timeline.js", dependencies=[LIVE], esm=MODULES):
    """Of the task with this whole id, which it follows by itself."""

    def __init__(self, task: str, *, empty: str = "Nobody is at work yet") -> None:
        super().__init__()
        self._props.update({"task": task, "empty": empty})
