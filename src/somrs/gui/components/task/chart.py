"""Sequence chart of the messages between Task Manager and services (the paper's "Sequence of transaction messages")."""

from __future__ import annotations

from nicegui.element import Element

from somrs.gui.components import LIVE


class MessageChart(Element, component="chart.js", dependencies=[LIVE]):
    """`task`: the full id. The element follows the task itself."""

    def __init__(self, task: str, *, empty: str = "No messages have passed yet") -> None:
        super().__init__()
        self._props.update({"task": task, "empty": empty})
