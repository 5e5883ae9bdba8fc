"""Small graphs of places and the robots on them."""

from __future__ import annotations

from collections import deque
from itertools import product

from hypothesis import strategies as st

from somrs.traffic.planning.graph import Graph
from somrs.traffic.planning.pibt import Configuration, Goals


def two_way(size: int, *edges: tuple[int, int], conflicts: tuple[tuple[int, int], ...] = ()) -> Graph:
    """A graph of so many places, with lanes of length 1 in both directions."""
    return Graph(size, [(start, end, 1.0) for a, b in edges for start, end in ((a, b), (b, a))], conflicts)


def grid(*rows: str) -> tuple[Graph, dict[str, int]]:
    """The graph of a drawing: `#` is a wall, and a letter names a place. Places are numbered from the upper left."""
    cells = [(row, column) for row, text in enumerate(rows) for column, sign in enumerate(text) if sign != "#"]
    number = {cell: index for index, cell in enumerate(cells)}
    edges = [
        (number[row, column], number[other]) for row, column in cells for other in ((row + 1, column), (row, column + 1)) if other in number
    ]
    return two_way(len(cells), *edges), {rows[row][column]: number[row, column] for row, column in cells if rows[row][column] != "."}


@st.composite
def graphs(draw: st.DrawFn, most_places: int = 8, *, with_conflicts: bool = True) -> Graph:
    """Connected graphs, with some one-way lanes and some places that exclude each other."""
    size = draw(st.integers(2, most_places))
    lanes: list[tuple[int, int, float]] = []
    for place in range(1, size):
        other = draw(st.integers(0, place - 1))
        lanes += [(place, other, 1.0), (other, place, 1.0)]
    pairs = st.tuples(st.integers(0, size - 1), st.integers(0, size - 1)).filter(lambda pair: pair[0] != pair[1])
    lanes += [(start, end, 1.0) for start, end in draw(st.lists(pairs, max_size=4))]
    conflicts = draw(st.lists(pairs, max_size=2)) if with_conflicts else []
    return Graph(size, lanes, conflicts)


@st.composite
def configurations(draw: st.DrawFn, graph: Graph, most_robots: int = 4) -> Configuration:
    """Places of robots that do not exclude each other."""
    places: list[int] = []
    for place in draw(st.permutations(range(graph.size))):
        if not any(other in places for other in graph.exclusions[place]):
            places.append(place)
    return tuple(places[: draw(st.integers(1, min(most_robots, len(places))))])


def is_valid(graph: Graph, configuration: Configuration) -> bool:
    """Whether no two robots are in one place, nor in places that exclude each other."""
    places = set(configuration)
    return len(places) == len(configuration) and all(places.isdisjoint(graph.exclusions[place]) for place in places)


def is_possible(graph: Graph, before: Configuration, after: Configuration, *, rotations: bool) -> bool:
    """Whether robots can move from one configuration to the other in one step: the definition, tried out."""
    if not is_valid(graph, after):
        return False
    if not all(new == old or new in graph.successors[old] for old, new in zip(before, after, strict=True)):
        return False
    blocks = [
        {other for other in range(len(before)) if other != robot and before[other] in (after[robot], *graph.exclusions[after[robot]])}
        if before[robot] != after[robot]
        else set()
        for robot in range(len(before))
    ]
    """By robot: those that have to leave before it can come."""
    if any(after[other] == before[other] for others in blocks for other in others):
        return False
    if any(robot in blocks[other] for robot, others in enumerate(blocks) for other in others):
        return False
    return rotations or _has_order(blocks)


def _has_order(blocks: list[set[int]]) -> bool:
    """Whether robots can go one after the other, each after those that have to leave first."""
    waiting = dict(enumerate(blocks))
    while waiting:
        free = [robot for robot, others in waiting.items() if others.isdisjoint(waiting)]
        if not free:
            return False
        for robot in free:
            del waiting[robot]
    return True


def shortest_course(graph: Graph, start: Configuration, goals: Goals, *, rotations: bool) -> int | None:
    """The fewest steps until all robots are at their goals, by a search through all configurations; None if there are no ways."""
    steps = {start: 0}
    waiting = deque([start])
    while waiting:
        here = waiting.popleft()
        if all(goal is None or place == goal for place, goal in zip(here, goals, strict=True)):
            return steps[here]
        for after in product(*((*graph.successors[place], place) for place in here)):
            if after not in steps and is_possible(graph, here, after, rotations=rotations):
                steps[after] = steps[here] + 1
                waiting.append(after)
    return None
