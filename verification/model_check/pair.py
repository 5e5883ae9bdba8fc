"""Two participants of one step: two quotients of the same part, joined by the rules of their transaction.

What is looked for here takes both: that they never work at the same time, that both get home, and how it ends for both. What
`properties.wrongs` says of one participant was looked for in its part with any others beside it, so it holds of any number.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

from verification.model_check.coordinator import Phase
from verification.model_check.explore import Tick
from verification.model_check.properties import Outcome, Property
from verification.model_check.quotient import Quotient

Both = tuple[int, int]
"""The classes of the two, the smaller first: which of the two is which makes no difference."""

TOGETHER = (
    ("cancel", "cancel"), ("fail", "fail"), ("end", "end"), ("overdue", "overdue"), ("accomplish+", "accomplish+"),
    ("accomplish+", "accomplish-"), ("accomplish-", "accomplish+"),
)  # fmt: skip
"""The moves of the transaction, which both make at once. It is accomplished when either has completed the step."""


@dataclass(frozen=True, kw_only=True)
class PairFalls:
    """A property of two participants that does not hold, and the number of the state in which that shows."""

    property: Property
    why: str
    state: int


@dataclass(kw_only=True)
class PairSpace:
    """All states of the two that can be reached."""

    quotient: Quotient
    states: list[Both] = field(default_factory=list)
    came_from: array[int] = field(default_factory=lambda: array("i"))
    falls: dict[Property, PairFalls] = field(default_factory=dict)
    outcomes: set[tuple[Outcome, Outcome]] = field(default_factory=set)

    def way(self, state: int) -> list[Both]:
        """The states from the first to this one."""
        numbers = [state]
        while numbers[-1] != 0:
            numbers.append(self.came_from[numbers[-1]])
        return [self.states[number] for number in reversed(numbers)]


def explore_pair(quotient: Quotient, *, hasty: bool = False, tick: Tick | None = None) -> PairSpace:
    """Every state of the two, breadth first."""
    space = PairSpace(quotient=quotient)
    shows = quotient.shows
    numbers: dict[Both, int] = {(0, 0): 0}
    space.states.append((0, 0))
    space.came_from.append(0)
    begins, fairly = array("i"), array("i")
    for at, both in enumerate(space.states):
        one, other = both
        if shows[one].moving and shows[other].moving and Property.HANDS not in space.falls:
            space.falls[Property.HANDS] = PairFalls(property=Property.HANDS, why="both devices work on the same step", state=at)
            if hasty:
                return space
        begins.append(len(fairly))
        for fair, after in successors(quotient, both):
            number = numbers.get(after)
            if number is None:
                number = numbers[after] = len(space.states)
                space.states.append(after)
                space.came_from.append(at)
            if fair:
                fairly.append(number)
        if tick is not None and at % 4096 == 0:
            tick(len(space.states))
    begins.append(len(fairly))
    home = [at for at, (one, other) in enumerate(space.states) if shows[one].outcome is not None and shows[other].outcome is not None]
    if (stuck := _first_without(home, begins, fairly)) is not None:
        space.falls[Property.HOME] = PairFalls(property=Property.HOME, why="no fair moves lead from here to the end", state=stuck)
    for at in home:
        mine, its = (shows[block].outcome for block in space.states[at])
        assert mine is not None
        assert its is not None
        space.outcomes |= {(mine, its), (its, mine)}
    return space


def successors(quotient: Quotient, both: Both) -> Iterator[tuple[int, Both]]:
    """What either does, and what the transaction does to both."""
    one, other = both
    yield from _alone(quotient, one, other)
    if one != other:
        yield from _alone(quotient, other, one)
    mine, its = _joint(quotient, one), _joint(quotient, other)
    for first, second in TOGETHER:
        for fair, after in mine.get(first, ()):
            for its_fair, its_after in its.get(second, ()):
                yield min(fair, its_fair), (after, its_after) if after <= its_after else (its_after, after)


def _alone(quotient: Quotient, one: int, other: int) -> Iterator[tuple[int, Both]]:
    held = quotient.shows[other].holds
    for (joint, fair, _), after in quotient.moves[one]:
        if joint == "" or (joint == "claim" and not held):
            yield fair, (after, other) if after <= other else (other, after)


def _joint(quotient: Quotient, one: int) -> dict[str, list[tuple[int, int]]]:
    if quotient.shows[one].phase not in (Phase.OPEN, Phase.STOPPING):
        return {}
    found: dict[str, list[tuple[int, int]]] = {}
    for (joint, fair, _), after in quotient.moves[one]:
        if joint not in ("", "claim"):
            found.setdefault(joint, []).append((fair, after))
    return found


def _first_without(goal: list[int], begins: array[int], fairly: array[int]) -> int | None:
    """The first state from which no fair moves lead to the goal."""
    many = len(begins) - 1
    counts = array("i", bytes(4 * (many + 1)))
    for target in fairly:
        counts[target + 1] += 1
    for at in range(many):
        counts[at + 1] += counts[at]
    before, filled = array("i", bytes(4 * len(fairly))), array("i", counts)
    for at in range(many):
        for move in range(begins[at], begins[at + 1]):
            target = fairly[move]
            before[filled[target]] = at
            filled[target] += 1
    good, waiting = bytearray(many), list(goal)
    for at in waiting:
        good[at] = 1
    while waiting:
        at = waiting.pop()
        for move in range(counts[at], counts[at + 1]):
            if not good[before[move]]:
                good[before[move]] = 1
                waiting.append(before[move])
    stuck = good.find(0)
    return stuck if stuck >= 0 else None
