"""Texts for users: the states of a task, in the windows and in the terminal."""

from __future__ import annotations

from collections.abc import Mapping

from somrs.protocol.messages.clients import Phase
from somrs.protocol.messages.frp import Outcome

PHASES: Mapping[Phase, str] = {
    Phase.PLANNING: "Planning",
    Phase.WAITING: "Waiting",
    Phase.ARRANGING: "Arranging",
    Phase.EXECUTING: "At work",
    Phase.RECOVERING: "Recovering",
    Phase.COMPENSATING: "Undoing",
    Phase.ENDED: "Over",
}

OUTCOMES: Mapping[Outcome, str] = {
    Outcome.ACCOMPLISHED: "Accomplished",
    Outcome.FAILED: "Failed",
    Outcome.CANCELLED: "Cancelled",
}


def task_state(phase: Phase, outcome: Outcome | None) -> str:
    """The text for the phase of a task or, after its end, for its outcome."""
    return OUTCOMES[outcome] if outcome is not None else PHASES[phase]
