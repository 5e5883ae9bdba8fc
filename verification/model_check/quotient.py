"""One participant's part with the states that nobody outside could tell apart made one (strong bisimulation).

Two states are one when they show the same of what the others depend on and what the properties of two participants ask
for, and when every move of the one leads, by the same rule and as fairly, to where a move of the other leads. So every run
of two parts together is a run of their quotients, step by step, and the other way round.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from somrs.protocol.frp import states
from verification.model_check.coordinator import Phase
from verification.model_check.explore import Space
from verification.model_check.properties import Outcome, at_home, outcome
from verification.model_check.system import Kind


class Shows(NamedTuple):
    """What is seen of a state from outside. `outcome` is set when its participant is at home."""

    phase: Phase
    holds: bool
    """The step is this participant's, for the coordinator."""
    moving: bool
    outcome: Outcome | None


@dataclass(frozen=True)
class Quotient:
    """Classes are numbered; class 0 is that of the first state."""

    space: Space
    of: list[int]
    """The class of each state."""
    shows: list[Shows]
    moves: list[tuple[tuple[Kind, int], ...]]


def quotient(space: Space) -> Quotient:
    """The coarsest one, by splitting classes until all members of each have the same moves."""
    shown = [_shows(space, at) for at in range(len(space.states))]
    numbers: dict[object, int] = {}
    of = [numbers.setdefault(one, len(numbers)) for one in shown]
    labels, targets, begins, many = space.labels, space.targets, space.begins, len(space.kinds)
    count = 0
    while count != len(numbers):
        count = len(numbers)
        numbers = {}
        refined = []
        for at in range(len(of)):
            first, last = begins[at], begins[at + 1]
            leads = frozenset([of[target] * many + label for target, label in zip(targets[first:last], labels[first:last], strict=True)])
            refined.append(numbers.setdefault((of[at], leads), len(numbers)))
        of = refined
    shows: list[Shows | None] = [None] * count
    moves: list[tuple[tuple[Kind, int], ...]] = [()] * count
    for at, block in enumerate(of):
        if shows[block] is None:
            shows[block] = shown[at]
            moves[block] = tuple({(space.kinds[labels[move]], of[targets[move]]) for move in space.moves(at)})
    return Quotient(space, of, [one for one in shows if one is not None], moves)


def _shows(space: Space, at: int) -> Shows:
    coordinator, participant = space.link.coordinator(space.states[at]), space.link.participant(space.states[at])
    holds = coordinator.phase is not Phase.LOST and coordinator.session.state in states.HOLDING_STATES
    ended = outcome(coordinator, participant) if at_home(coordinator, participant) else None
    return Shows(coordinator.phase, holds, participant.moving, ended)
