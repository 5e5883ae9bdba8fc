"""Reduces one participant's part by strong bisimulation: states that are indistinguishable from outside become one.

Two states are equivalent if they agree in an `Observation`, and if every move of either leads, by the same rule and with the same fairness,
to a state equivalent to the target of a move of the other. So every run of two parts together is a run of their quotients, step by step,
and the reverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from somrs.protocol.frp import states
from verification.model_check.coordinator import Phase
from verification.model_check.explore import StateSpace
from verification.model_check.properties import Outcome, has_ended, outcome
from verification.model_check.system import TransitionKind


class Observation(NamedTuple):
    """What is visible of a state from outside. `outcome` is set when the part has ended."""

    phase: Phase
    holds_step: bool
    """The coordinator counts the step as this participant's."""
    moving: bool
    outcome: Outcome | None


@dataclass(frozen=True)
class Quotient:
    """The classes and their moves. Class 0 contains the first state."""

    space: StateSpace
    classes: list[int]
    """The class of each state."""
    observations: list[Observation]
    transitions: list[tuple[tuple[TransitionKind, int], ...]]


def quotient(space: StateSpace) -> Quotient:
    """Return the coarsest bisimulation quotient, by splitting classes until all members of each have the same moves."""
    state_observations = [_observe(space, state_number) for state_number in range(len(space.states))]
    numbers: dict[object, int] = {}
    classes = [numbers.setdefault(observation, len(numbers)) for observation in state_observations]
    labels, targets, begins, kind_count = space.labels, space.targets, space.begins, len(space.kinds)
    count = 0
    while count != len(numbers):
        count = len(numbers)
        numbers = {}
        refined = []
        for state_number in range(len(classes)):
            first, end = begins[state_number], begins[state_number + 1]
            leads = frozenset(
                [classes[target] * kind_count + label for target, label in zip(targets[first:end], labels[first:end], strict=True)]
            )
            refined.append(numbers.setdefault((classes[state_number], leads), len(numbers)))
        classes = refined
    observations: list[Observation | None] = [None] * count
    transitions: list[tuple[tuple[TransitionKind, int], ...]] = [()] * count
    for state_number, block in enumerate(classes):
        if observations[block] is None:
            observations[block] = state_observations[state_number]
            transitions[block] = tuple(
                {(space.kinds[labels[transition]], classes[targets[transition]]) for transition in space.transitions(state_number)}
            )
    return Quotient(space, classes, [observation for observation in observations if observation is not None], transitions)


def _observe(space: StateSpace, state_number: int) -> Observation:
    coordinator, participant = space.link.coordinator(space.states[state_number]), space.link.participant(space.states[state_number])
    holds_step = coordinator.phase is not Phase.LOST and coordinator.session.state in states.HOLDING_STATES
    ended = outcome(coordinator, participant) if has_ended(coordinator, participant) else None
    return Observation(coordinator.phase, holds_step, participant.moving, ended)
