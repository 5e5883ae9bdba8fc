"""Corridors of a graph: chains of places at which robots cannot pass each other, with the bays beside them and the places at their mouths.

In a bay, one robot at a time can let others pass. If robots counted on that, they would drive in from both sides, and back out again: a
corridor with bays is one corridor.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

SHORTEST = 3
"""Chains with fewer places are no corridors: who meets another one there is soon out again."""
DEEPEST = 2
"""The number of places up to which a dead end is a bay."""
NOWHERE = -1
_SHORT = -2
"""In a chain that is too short."""


def find_corridors(successors: Sequence[Sequence[int]], exclusions: Sequence[Sequence[int]]) -> list[int]:
    """By place: the number of the corridor in which it is, or at whose mouth; `NOWHERE` if it is in none.

    `successors`: the places to which lanes lead from each place; `exclusions`: those at which no robot may be while one is at this place.
    On one-way lanes, nobody meets another one.
    """
    size = len(successors)
    both_ways = [[end for end in ends if place in successors[end]] for place, ends in enumerate(successors)]
    bays = _find_bays(successors, both_ways)
    narrow = [bool(both_ways[place]) and (place in bays or _is_narrow(place, successors, exclusions, bays)) for place in range(size)]
    numbers = [NOWHERE] * size
    count = 0
    for start in range(size):
        if not narrow[start] or numbers[start] != NOWHERE:
            continue
        chain, numbers[start] = [start], count
        for place in chain:
            for neighbour in both_ways[place]:
                if narrow[neighbour] and numbers[neighbour] == NOWHERE:
                    numbers[neighbour] = count
                    chain.append(neighbour)
        if len(chain) < SHORTEST:
            for place in chain:
                numbers[place] = _SHORT
        else:
            count += 1
    corridors = [max(number, NOWHERE) for number in numbers]
    for place in range(size):  # who waits at the mouth is in the way, too
        if corridors[place] == NOWHERE:
            corridors[place] = max((numbers[neighbour] for neighbour in successors[place]), default=NOWHERE)
    return [max(corridor, NOWHERE) for corridor in corridors]


def _find_bays(successors: Sequence[Sequence[int]], both_ways: Sequence[Sequence[int]]) -> set[int]:
    """The places of dead ends that are no deeper than a bay."""
    bays: set[int] = set()
    for _ in range(DEEPEST):
        ways_on = [[end for end in ends if end not in bays] for ends in successors]
        bays |= {place for place, ends in enumerate(ways_on) if len(ends) == 1 and ends[0] in both_ways[place]}
    return bays


def _is_narrow(place: int, successors: Sequence[Sequence[int]], exclusions: Sequence[Sequence[int]], bays: Collection[int]) -> bool:
    """Whether at most two robots have room around a robot at this place, besides one in a bay: before and behind it."""
    around: list[int] = []
    for neighbour in successors[place]:
        if neighbour in bays:
            continue
        excluded = exclusions[neighbour]
        if place not in excluded and not any(chosen in excluded for chosen in around):
            around.append(neighbour)
            if len(around) > 2:
                return False
    return True
