"""Corridors of a graph: chains of places at which robots cannot pass each other, with the places at their mouths."""

from __future__ import annotations

from collections.abc import Sequence

SHORTEST = 3
"""Chains with fewer places are no corridors: who meets another one there is soon out again."""
NOWHERE = -1
_SHORT = -2
"""In a chain that is too short."""


def find_corridors(successors: Sequence[Sequence[int]], exclusions: Sequence[Sequence[int]]) -> list[int]:
    """By place: the number of the corridor in which it is, or at whose mouth; `NOWHERE` if it is in none.

    `successors`: the places to which lanes lead from each place; `exclusions`: those at which no robot may be while one is at this place.
    """
    size = len(successors)
    narrow = [_is_narrow(place, successors, exclusions) for place in range(size)]
    numbers = [NOWHERE] * size
    count = 0
    for start in range(size):
        if not narrow[start] or numbers[start] != NOWHERE:
            continue
        chain, numbers[start] = [start], count
        for place in chain:
            for neighbour in successors[place]:
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


def _is_narrow(place: int, successors: Sequence[Sequence[int]], exclusions: Sequence[Sequence[int]]) -> bool:
    """Whether at most two robots have room around a robot at this place: before and behind it."""
    neighbours: list[int] = []
    for neighbour in successors[place]:
        excluded = exclusions[neighbour]
        if place not in excluded and not any(chosen in excluded for chosen in neighbours):
            neighbours.append(neighbour)
            if len(neighbours) > 2:
                return False
    return True
