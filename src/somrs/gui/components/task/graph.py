"""A plan as a graph: of a task, with the state of each step; or of a preview."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
from nicegui.element import Element

from somrs.gui.components import LIVE
from somrs.protocol.messages.task_views import StepView


class PlanGraph(Element, component="graph.js", dependencies=[LIVE]):
    """With `task` (the full id), the element shows and follows that task's plan; otherwise it shows `steps`."""

    def __init__(
        self, *, task: str | None = None, steps: Sequence[StepView] = (), label: str = "The plan", empty: str = "No plan yet"
    ) -> None:
        super().__init__()
        self._props.update({"task": task, "plan": msgspec.to_builtins(list(steps)), "label": label, "empty": empty})
