"""Every state of one participant's part that can be reached, breadth first, so that the first way found to a state is a shortest one."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import pairwise

from verification.model_check.coordinator import Phase
from verification.model_check.properties import Outcome, Property, at_home, outcome, wrongs
from verification.model_check.sides import Fair
from verification.model_check.system import Kind, Link, LinkState, Lost, Move

ENDED = (Phase.ACCOMPLISHED, Phase.BROKEN)

MOST_STATES = 2_000_000
"""A part with more states than this counts as one that goes on for ever; the tables as they are stay far below."""

Tick = Callable[[int], None]
"""Told now and then how many states were found."""


@dataclass(frozen=True, kw_only=True)
class Falls:
    """A property that does not hold: why, and the number of the state in which it shows; `last` is the move that is wrong there."""

    property: Property
    why: str
    state: int
    last: Move | None = None


@dataclass(kw_only=True)
class Space:
    """What was found. Moves are numbered on from `begins[state]`; `kinds` says which are joint, fair, and the coordinator's own."""

    link: Link
    states: list[LinkState] = field(default_factory=list)
    came_from: array[int] = field(default_factory=lambda: array("i"))
    begins: array[int] = field(default_factory=lambda: array("i"))
    labels: array[int] = field(default_factory=lambda: array("i"))
    targets: array[int] = field(default_factory=lambda: array("i"))
    kinds: list[Kind] = field(default_factory=list)
    falls: dict[Property, Falls] = field(default_factory=dict)
    outcomes: set[Outcome] = field(default_factory=set)

    def moves(self, state: int) -> range:
        return range(self.begins[state], self.begins[state + 1])

    def way(self, state: int) -> list[Move]:
        """The moves from the first state to this one."""
        numbers = [state]
        while numbers[-1] != 0:
            numbers.append(self.came_from[numbers[-1]])
        numbers.reverse()
        found = []
        for one, other in pairwise(numbers):
            after = self.states[other]
            found.append(next(move for move in self.link.moves(self.states[one]) if move.after == after))
        return found


def explore(link: Link, *, alone: bool, hasty: bool = False, most: int = MOST_STATES, tick: Tick | None = None) -> Space:
    """`alone`: there is no other participant to accomplish anything. `hasty`: the first property that falls is enough."""
    space = Space(link=link)
    numbers = {link.first: 0}
    space.states.append(link.first)
    space.came_from.append(0)
    kinds: dict[Kind, int] = {}
    checked: set[tuple[int, int]] = set()
    # Whoever lost a disk is not held to what it no longer knows, but even so everyone has to get home.
    held = link.model.lost_disk is Lost.NONE
    for at, state in enumerate(space.states):
        if (pair := state[:2]) not in checked:
            checked.add(pair)
            for which, why in wrongs(link.coordinator(state), link.participant(state)) if held else ():
                space.falls.setdefault(which, Falls(property=which, why=why, state=at))
        space.begins.append(len(space.targets))
        for move in link.moves(state):
            kind, to, _, _, wrong = move
            if alone and kind[0] == "accomplish-":
                continue
            if wrong and held:
                space.falls.setdefault(Property.FITS, Falls(property=Property.FITS, why=wrong, state=at, last=move))
            after = numbers.get(to)
            if after is None:
                after = numbers[to] = len(space.states)
                space.states.append(to)
                space.came_from.append(at)
            space.labels.append(kinds.setdefault(kind, len(kinds)))
            space.targets.append(after)
        if hasty and space.falls:
            break
        if len(space.states) > most:
            space.falls[Property.HOME] = Falls(property=Property.HOME, why=f"more than {most} states: it goes on for ever", state=at)
            break
        if tick is not None and at % 4096 == 0:
            tick(len(space.states))
    space.begins.append(len(space.targets))
    space.kinds = list(kinds)
    if alone and not space.falls:
        _everyone_goes_home(space)
    _note_outcomes(space)
    return space


def _note_outcomes(space: Space) -> None:
    link = space.link
    for c, p in {state[:2] for state in space.states}:
        coordinator, participant = link.coordinators.states[c], link.participants.states[p]
        if at_home(coordinator, participant):
            space.outcomes.add(outcome(coordinator, participant))


def _everyone_goes_home(space: Space) -> None:
    """From every state fair moves lead to the end; so they do, with a cancel, when work never ends by itself; and the transaction
    can end without a word from the participant."""
    link = space.link
    home = [n for n, state in enumerate(space.states) if at_home(link.coordinator(state), link.participant(state))]
    fair = {label for label, (_, fair, _) in enumerate(space.kinds) if fair}
    if (stuck := first_without(space, home, fair)) is not None:
        space.falls[Property.HOME] = Falls(property=Property.HOME, why="no fair moves lead from here to the end", state=stuck)
    endless = {label for label, (joint, fair, _) in enumerate(space.kinds) if fair is Fair.YES or joint == "cancel"}
    if (stuck := first_without(space, home, endless)) is not None:
        why = "work that does not end by itself cannot be ended from here"
        space.falls.setdefault(Property.HOME, Falls(property=Property.HOME, why=why, state=stuck))
    over = [n for n, state in enumerate(space.states) if link.coordinator(state).phase not in (Phase.OPEN, Phase.STOPPING)]
    own = {label for label, (_, _, own) in enumerate(space.kinds) if own}
    if (stuck := first_without(space, over, own)) is not None:
        why = "the transaction cannot end as long as the participant is silent"
        space.falls.setdefault(Property.HOME, Falls(property=Property.HOME, why=why, state=stuck))


def first_without(space: Space, goal: Iterable[int], labels: set[int]) -> int | None:
    """The first state from which no moves with these labels lead to the goal."""
    before: list[list[int]] = [[] for _ in space.begins]
    for at in range(len(space.begins) - 1):
        for move in space.moves(at):
            if space.labels[move] in labels:
                before[space.targets[move]].append(at)
    good = bytearray(len(space.states))
    waiting = list(goal)
    for state in waiting:
        good[state] = 1
    while waiting:
        for state in before[waiting.pop()]:
            if not good[state]:
                good[state] = 1
                waiting.append(state)
    stuck = good.find(0)
    return stuck if stuck >= 0 else None
