"""Two participants of one step: two quotients of the same part, composed by the rules of their transaction.

This module checks the properties of two participants: mutual exclusion and termination, and it collects the outcomes. The properties of
one participant (`properties.broken_properties`) are checked in its part with arbitrary others, and so hold for any number.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

from verification.model_check.coordinator import Phase
from verification.model_check.properties import Outcome
from verification.model_check.property import Property
from verification.model_check.quotient import Quotient

ClassPair = tuple[int, int]
"""The classes of the two participants, the smaller first: the two are interchangeable."""

JOINT_RULES = (
    ("cancel", "cancel"), ("fail", "fail"), ("end", "end"), ("overdue", "overdue"), ("accomplish+", "accomplish+"),
    ("accomplish+", "accomplish-"), ("accomplish-", "accomplish+"),
)  # fmt: skip
"""The moves of the transaction, which both participants make at once. It is accomplished when either has completed the step."""


SEPARATE = ("", "map", "anew")
"""The rules of moves that one participant makes without regard to the other."""


@dataclass(frozen=True, kw_only=True)
class PairViolation:
    """A violated property of two participants, and the number of the state in which it shows."""

    property: Property
    reason: str
    state: int


@dataclass(kw_only=True)
class PairSpace:
    """All reachable states of the two participants."""

    quotient: Quotient
    states: list[ClassPair] = field(default_factory=list)
    parents: array[int] = field(default_factory=lambda: array("i"))
    violations: dict[Property, PairViolation] = field(default_factory=dict)
    outcomes: set[tuple[Outcome, Outcome]] = field(default_factory=set)

    def path_to(self, state: int) -> list[ClassPair]:
        """Return the states from the first to this one."""
        numbers = [state]
        while numbers[-1] != 0:
            numbers.append(self.parents[numbers[-1]])
        return [self.states[number] for number in reversed(numbers)]


def explore_pair(quotient: Quotient, *, stop_at_first: bool = False) -> PairSpace:
    """Explore every reachable state of the two participants, breadth first."""
    space = PairSpace(quotient=quotient)
    observations = quotient.observations
    numbers: dict[ClassPair, int] = {(0, 0): 0}
    space.states.append((0, 0))
    space.parents.append(0)
    begins, fairly = array("i"), array("i")
    for state_number, pair in enumerate(space.states):
        class_a, class_b = pair
        if observations[class_a].moving and observations[class_b].moving and Property.MUTUAL_EXCLUSION not in space.violations:
            space.violations[Property.MUTUAL_EXCLUSION] = PairViolation(
                property=Property.MUTUAL_EXCLUSION, reason="both devices work on the same step", state=state_number
            )
            if stop_at_first:
                return space
        begins.append(len(fairly))
        for fair, target in successors(quotient, pair):
            number = numbers.get(target)
            if number is None:
                number = numbers[target] = len(space.states)
                space.states.append(target)
                space.parents.append(state_number)
            if fair:
                fairly.append(number)
    begins.append(len(fairly))
    home = [
        state_number
        for state_number, (class_a, class_b) in enumerate(space.states)
        if observations[class_a].outcome is not None and observations[class_b].outcome is not None
    ]
    if (stuck := _find_stuck_state(home, begins, fairly)) is not None:
        space.violations[Property.TERMINATION] = PairViolation(
            property=Property.TERMINATION, reason="no fair moves lead from here to the end", state=stuck
        )
    for state_number in home:
        outcome_a, outcome_b = (observations[block].outcome for block in space.states[state_number])
        assert outcome_a is not None
        assert outcome_b is not None
        space.outcomes |= {(outcome_a, outcome_b), (outcome_b, outcome_a)}
    return space


def successors(quotient: Quotient, pair: ClassPair) -> Iterator[tuple[int, ClassPair]]:
    """Yield the moves of either participant, and the joint moves of the transaction."""
    class_a, class_b = pair
    yield from _single_successors(quotient, class_a, class_b)
    if class_a != class_b:
        yield from _single_successors(quotient, class_b, class_a)
    joint_a, joint_b = _joint(quotient, class_a), _joint(quotient, class_b)
    for first, second in JOINT_RULES:
        for fair, target_a in joint_a.get(first, ()):
            for fair_b, target_b in joint_b.get(second, ()):
                yield min(fair, fair_b), (target_a, target_b) if target_a <= target_b else (target_b, target_a)


def _single_successors(quotient: Quotient, mover: int, partner: int) -> Iterator[tuple[int, ClassPair]]:
    held = quotient.observations[partner].holds_step
    for (joint, fair, _), target in quotient.transitions[mover]:
        if joint in SEPARATE or (joint == "claim" and not held):
            yield fair, (target, partner) if target <= partner else (partner, target)


def _joint(quotient: Quotient, mover: int) -> dict[str, list[tuple[int, int]]]:
    if quotient.observations[mover].phase not in (Phase.OPEN, Phase.STOPPING):
        return {}
    targets: dict[str, list[tuple[int, int]]] = {}
    for (joint, fair, _), target in quotient.transitions[mover]:
        if joint not in (*SEPARATE, "claim"):
            targets.setdefault(joint, []).append((fair, target))
    return targets


def _find_stuck_state(goal: list[int], begins: array[int], fairly: array[int]) -> int | None:
    """Return the first state from which no fair moves lead to the goal, or None."""
    state_count = len(begins) - 1
    counts = array("i", bytes(4 * (state_count + 1)))
    for target in fairly:
        counts[target + 1] += 1
    for state_number in range(state_count):
        counts[state_number + 1] += counts[state_number]
    predecessors, filled = array("i", bytes(4 * len(fairly))), array("i", counts)
    for state_number in range(state_count):
        for transition in range(begins[state_number], begins[state_number + 1]):
            target = fairly[transition]
            predecessors[filled[target]] = state_number
            filled[target] += 1
    good, waiting = bytearray(state_count), list(goal)
    for state_number in waiting:
        good[state_number] = 1
    while waiting:
        state_number = waiting.pop()
        for transition in range(counts[state_number], counts[state_number + 1]):
            if not good[predecessors[transition]]:
                good[predecessors[transition]] = 1
                waiting.append(predecessors[transition])
    stuck = good.find(0)
    return stuck if stuck >= 0 else None
