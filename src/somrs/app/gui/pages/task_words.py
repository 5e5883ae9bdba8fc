"""Words for tasks: phases and outcomes with their signs, ids and names as people need them, situations without figures."""

from __future__ import annotations

from urllib.parse import unquote

from somrs.app.gui.signs import OUTCOMES, Sign, lasted
from somrs.protocol.clients import Phase
from somrs.protocol.frp import Outcome

PHASES = {
    Phase.PLANNING: Sign("schema", "Planning", "busy"),
    Phase.WAITING: Sign("hourglass_empty", "Waiting", "plain"),
    Phase.ARRANGING: Sign("handshake", "Arranging", "busy"),
    Phase.EXECUTING: Sign("play_circle", "At work", "busy"),
    Phase.RECOVERING: Sign("healing", "Recovering", "bad"),
    Phase.COMPENSATING: Sign("undo", "Undoing", "bad"),
    Phase.ENDED: Sign("flag", "Over", "plain"),
}

FIGURES = ("Position", "Rotation")
"""Attributes whose values say little to people."""


def sign(phase: Phase, outcome: Outcome | None) -> Sign:
    """How far a task is, or how it ended."""
    return OUTCOMES[outcome] if outcome is not None else PHASES[phase]


def key(task: str) -> str:
    """A task's id without what all ids begin with: as it stands in the address of its page."""
    return task.rpartition(":")[2]


def path(task: str) -> str:
    return f"/tasks/{key(task)}"


def person(client: str) -> str:
    """Who stated a task."""
    return unquote(client.removeprefix("urn:so-mrs:client:")) or "somebody"


def device(service: str) -> str:
    return service.partition(".")[0]


def gist(situation: str | None) -> str:
    """A situation without the places in figures."""
    parts = (situation or "").split(" AND ")
    told = [part for part in parts if not any(f".{figure}" in part for figure in FIGURES)]
    return " and ".join(told or parts)


def counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def limit(deadline: float | None) -> str:
    return f"within {lasted(deadline)}" if deadline is not None else "no deadline"
