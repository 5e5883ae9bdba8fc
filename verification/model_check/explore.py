"""Explores every reachable state of one participant's part, breadth first, so that the path found to each state is a shortest one."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise

from verification.model_check.coordinator import Phase
from verification.model_check.properties import Outcome, broken_properties, has_ended, outcome, works_behind_a_shut_door
from verification.model_check.property import Property
from verification.model_check.sides import Fair
from verification.model_check.step import StepKind
from verification.model_check.system import Link, LinkState, LostDisk, Transition, TransitionKind

ENDED = (Phase.ACCOMPLISHED, Phase.BROKEN)

MAX_STATES = 2_000_000
"""The limit on the states of a part. A part beyond it counts as infinite; the unaltered tables stay far below."""


@dataclass(frozen=True, kw_only=True)
class Violation:
    """A violated property: the reason, and the number of the state in which it shows. `last_transition` is the wrong move from there, if
    any."""

    property: Property
    reason: str
    state: int
    last_transition: Transition | None = None


@dataclass(kw_only=True)
class StateSpace:
    """The states and moves found. The moves of a state begin at `begins[state]`; `kinds` are the kinds of moves that `labels` index."""

    link: Link
    states: list[LinkState] = field(default_factory=list)
    parents: array[int] = field(default_factory=lambda: array("i"))
    begins: array[int] = field(default_factory=lambda: array("i"))
    labels: array[int] = field(default_factory=lambda: array("i"))
    targets: array[int] = field(default_factory=lambda: array("i"))
    kinds: list[TransitionKind] = field(default_factory=list)
    violations: dict[Property, Violation] = field(default_factory=dict)
    outcomes: set[Outcome] = field(default_factory=set)

    def transitions(self, state: int) -> range:
        return range(self.begins[state], self.begins[state + 1])

    def path_to(self, state: int) -> list[Transition]:
        """Return the moves from the first state to this one."""
        numbers = [state]
        while numbers[-1] != 0:
            numbers.append(self.parents[numbers[-1]])
        numbers.reverse()
        path = []
        for source, target in pairwise(numbers):
            target_state = self.states[target]
            path.append(next(transition for transition in self.link.transitions(self.states[source]) if transition.target == target_state))
        return path


def explore(link: Link, *, single_participant: bool, stop_at_first: bool = False, max_states: int = MAX_STATES) -> StateSpace:
    """Explore the part of `link`. With `single_participant`, no other participant can accomplish the step. With `stop_at_first`, stop at
    the first violation."""
    space = StateSpace(link=link)
    numbers = {link.first: 0}
    space.states.append(link.first)
    space.parents.append(0)
    kinds: dict[TransitionKind, int] = {}
    checked: set[tuple[int, int]] = set()
    # After a loss of a disk only termination is required.
    checks_properties = link.model.lost_disk is LostDisk.NONE
    for state_number, state in enumerate(space.states):
        if (pair := state[:2]) not in checked:
            checked.add(pair)
            for prop, reason in (
                broken_properties(link.model.kind, link.coordinator(state), link.participant(state)) if checks_properties else ()
            ):
                space.violations.setdefault(prop, Violation(property=prop, reason=reason, state=state_number))
        space.begins.append(len(space.targets))
        for transition in link.transitions(state):
            kind, target, wrong = transition.kind, transition.target, transition.wrong
            if single_participant and kind[0] == "accomplish-":
                continue
            if wrong and checks_properties:
                violated = transition.violates
                space.violations.setdefault(
                    violated, Violation(property=violated, reason=wrong, state=state_number, last_transition=transition)
                )
            target_number = numbers.get(target)
            if target_number is None:
                target_number = numbers[target] = len(space.states)
                space.states.append(target)
                space.parents.append(state_number)
            space.labels.append(kinds.setdefault(kind, len(kinds)))
            space.targets.append(target_number)
        if stop_at_first and space.violations:
            break
        if len(space.states) > max_states:
            space.violations[Property.TERMINATION] = Violation(
                property=Property.TERMINATION, reason=f"more than {max_states} states: the part counts as infinite", state=state_number
            )
            break
    space.begins.append(len(space.targets))
    space.kinds = list(kinds)
    if single_participant and not space.violations:
        _check_termination(space)
    _note_outcomes(space)
    return space


def _note_outcomes(space: StateSpace) -> None:
    link = space.link
    for c, p in {state[:2] for state in space.states}:
        coordinator, participant = link.coordinators.states[c], link.participants.states[p]
        if has_ended(coordinator, participant):
            space.outcomes.add(outcome(coordinator, participant))


def _check_termination(space: StateSpace) -> None:
    """Check three conditions. From every state, fair moves lead to the end. With a cancel, they do so even if work never ends by itself.
    The transaction can end while the participant is silent."""
    link = space.link
    home = [n for n, state in enumerate(space.states) if has_ended(link.coordinator(state), link.participant(state))]
    fair = {label for label, (_, fair, _) in enumerate(space.kinds) if fair}
    if (stuck := find_stuck_state(space, home, fair)) is not None:
        reason = "no fair moves lead from here to the end"
        space.violations[Property.TERMINATION] = Violation(property=Property.TERMINATION, reason=reason, state=stuck)
    endless = {label for label, (joint, fair, _) in enumerate(space.kinds) if fair is Fair.YES or joint == "cancel"}
    if (stuck := find_stuck_state(space, home, endless)) is not None:
        reason = "a cancel cannot end work that does not end by itself"
        space.violations.setdefault(Property.TERMINATION, Violation(property=Property.TERMINATION, reason=reason, state=stuck))
    if link.model.kind is StepKind.WHILE:
        _check_that_it_stops(space)
    ended_states = [n for n, state in enumerate(space.states) if link.coordinator(state).phase not in (Phase.OPEN, Phase.STOPPING)]
    coordinator_labels = {label for label, (_, _, is_coordinator) in enumerate(space.kinds) if is_coordinator}
    if (stuck := find_stuck_state(space, ended_states, coordinator_labels)) is not None:
        reason = "the transaction cannot end as long as the participant is silent"
        space.violations.setdefault(Property.TERMINATION, Violation(property=Property.TERMINATION, reason=reason, state=stuck))


def _check_that_it_stops(space: StateSpace) -> None:
    """Check that a device which works although the door is shut comes to rest, even if the work never ends and the door never opens."""
    link = space.link
    allowed = [n for n, state in enumerate(space.states) if not works_behind_a_shut_door(link.coordinator(state), link.participant(state))]
    labels = {label for label, (joint, fair, _) in enumerate(space.kinds) if fair is Fair.YES and joint != "map"}
    if (stuck := find_stuck_state(space, allowed, labels)) is not None:
        reason = "the device works on, although what has to hold meanwhile does not hold any more"
        space.violations[Property.INVARIANT] = Violation(property=Property.INVARIANT, reason=reason, state=stuck)


def find_stuck_state(space: StateSpace, goal: Iterable[int], labels: set[int]) -> int | None:
    """Return the first state from which no moves with these labels lead to the goal, or None."""
    predecessors: list[list[int]] = [[] for _ in space.begins]
    for source in range(len(space.begins) - 1):
        for transition in space.transitions(source):
            if space.labels[transition] in labels:
                predecessors[space.targets[transition]].append(source)
    good = bytearray(len(space.states))
    waiting = list(goal)
    for state in waiting:
        good[state] = 1
    while waiting:
        for state in predecessors[waiting.pop()]:
            if not good[state]:
                good[state] = 1
                waiting.append(state)
    stuck = good.find(0)
    return stuck if stuck >= 0 else None
