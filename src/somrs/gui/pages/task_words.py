"""Words for tasks: phases and outcomes with their signs, ids and names as people need them, situations without figures."""

from __future__ import annotations

import re

from somrs.client import state_labels
from somrs.gui.icons import OUTCOMES, Sign, lasted
from somrs.protocol.messages.clients import Phase
from somrs.protocol.messages.frp import Outcome

PHASES = {
    Phase.PLANNING: Sign("schema", state_labels.PHASES[Phase.PLANNING], "busy"),
    Phase.WAITING: Sign("hourglass_empty", state_labels.PHASES[Phase.WAITING], "plain"),
    Phase.ARRANGING: Sign("handshake", state_labels.PHASES[Phase.ARRANGING], "busy"),
    Phase.EXECUTING: Sign("play_circle", state_labels.PHASES[Phase.EXECUTING], "busy"),
    Phase.RECOVERING: Sign("healing", state_labels.PHASES[Phase.RECOVERING], "bad"),
    Phase.COMPENSATING: Sign("undo", state_labels.PHASES[Phase.COMPENSATING], "bad"),
    Phase.ENDED: Sign("flag", state_labels.PHASES[Phase.ENDED], "plain"),
}

PLACE = re.compile(r"(\w+)\.PositionX = (\S+) AND \1\.PositionY = (\S+)(?: AND \1\.PositionZ = \S+)?")
FIGURES = re.compile(r" AND \w+\.(?:Position|Rotation)\w* = \S+")
BESIDE = re.compile(r" AND \w+ at \S+, \S+ m")
"""Where something is in figures, when something else was said before: that says more."""


def sign(phase: Phase, outcome: Outcome | None) -> Sign:
    """How far a task is, or how it ended."""
    return OUTCOMES[outcome] if outcome is not None else PHASES[phase]


def key(task: str) -> str:
    """A task's id without what all ids begin with: as it stands in the address of its page."""
    return task.rpartition(":")[2]


def path(task: str) -> str:
    return f"/tasks/{key(task)}"


def device(service: str) -> str:
    return service.partition(".")[0]


def gist(text: str) -> str:
    """A situation, or a text that ends with one, with as few figures as will do."""
    placed = FIGURES.sub("", PLACE.sub(r"\1 at \2, \3 m", text))
    return BESIDE.sub("", placed).replace(" AND ", " and ")


def counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def due(submitted_at: float, deadline: float | None, over: bool, now: float) -> str:
    """How much time a task has left, or had."""
    if deadline is None:
        return "none"
    left = submitted_at + deadline - now
    if over:
        return f"within {lasted(deadline)}"
    return f"in {lasted(left)}" if left > 0 else f"{lasted(-left)} over"
