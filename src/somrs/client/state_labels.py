"""Texts for users: the states and priorities of tasks, in the windows and in the terminal."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from somrs.errors import UsageError
from somrs.protocol.messages.directory import NeighbourView
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.neighbours import MapNeighbourView
from somrs.protocol.messages.task_views import Phase

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

PRIORITIES: Mapping[int, str] = {-1: "Low", 0: "Normal", 1: "High", 2: "Urgent"}
"""The priorities with a name. Other priorities have the name of the nearest one, with their number."""


def task_state(phase: Phase, outcome: Outcome | None) -> str:
    """The text for the phase of a task or, after its end, for its outcome."""
    return OUTCOMES[outcome] if outcome is not None else PHASES[phase]


def neighbour_text(neighbour: NeighbourView, clock: Callable[[float], str]) -> str:
    """How it stands with a neighbour of the Registry. `clock`: the text for a time."""
    if neighbour.away_since is None:
        state = f"{neighbour.services} of its services {'is' if neighbour.services == 1 else 'are'} listed"
    else:
        state = f"no answer since {clock(neighbour.away_since)}; its services are left out"
    return f"{state}; it says: {neighbour.problem}" if neighbour.problem else state


MAP_AWAY_TIME = 90.0
"""Seconds after its last answer after which it is said that the Repository of a neighbour does not answer; it is asked every 20 s."""


def map_neighbour_is_away(neighbour: MapNeighbourView, now: float) -> bool:
    """Whether the Repository of a neighbour has not answered for long, or never."""
    return neighbour.heard_at is None or now - neighbour.heard_at > MAP_AWAY_TIME


def map_neighbour_text(neighbour: MapNeighbourView, now: float, clock: Callable[[float], str]) -> str:
    """How it stands with a neighbour of the Repository. `clock`: the text for a time."""
    count = f"{neighbour.objects} object{'' if neighbour.objects == 1 else 's'} of {neighbour.neighbour.map} on the map"
    if not map_neighbour_is_away(neighbour, now):
        state = count
    elif neighbour.heard_at is None:
        state = f"its Repository has never answered; {count}"
    else:
        state = f"no answer of its Repository since {clock(neighbour.heard_at)}; {count}, as it was then"
    return f"{state}; {neighbour.problems[0]}{_more(len(neighbour.problems) - 1)}" if neighbour.problems else state


def _more(count: int) -> str:
    return f" (and {count} more)" if count else ""


def priority_text(priority: int) -> str:
    """The name of a priority: `High`; `Urgent (7)` for a priority between or beyond the named ones."""
    return PRIORITIES.get(priority) or f"{PRIORITIES[min(max(priority, min(PRIORITIES)), max(PRIORITIES))]} ({priority})"


def parse_priority(text: str) -> int:
    """The priority of a name, such as `high`, or of a whole number. Raises UsageError for other texts."""
    named_priorities = {name.lower(): priority for priority, name in PRIORITIES.items()}
    try:
        return named_priorities[text.strip().lower()] if text.strip().lower() in named_priorities else int(text)
    except ValueError:
        raise UsageError(f"{text!r} is not a priority; write {', '.join(named_priorities)}, or a whole number") from None
