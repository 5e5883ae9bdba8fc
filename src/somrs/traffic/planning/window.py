"""The next steps of all robots together. The plan is made anew, again and again, as long as there are goals (lifelong planning).

Robots without a goal take part, too: they stay as long as nobody wants to get past them, and make room otherwise. PIBT plans one step
after the other; where it brings nobody nearer to a goal, a search (LaCAM) looks for ways further ahead.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice

from somrs.traffic.planning.barriers import Barrier, Barriers
from somrs.traffic.planning.exhaustive import search_all
from somrs.traffic.planning.graph import FAR, Graph
from somrs.traffic.planning.lacam import SearchLimit, find_ways
from somrs.traffic.planning.pibt import Configuration, Estimate, Goals, StepPlanner
from somrs.traffic.planning.turns import FAR_AHEAD, waits_its_turn

EFFORT = 2_000
"""The most steps of PIBT that a search for ways takes, unless said otherwise."""
ALL = 30
"""The configurations that a search among all of them looks at, for each step of PIBT that it takes the place of."""
ASIDE = 200
"""The most places among which a robot looks for one at which it is in nobody's way."""
LONGEST_DETOUR = 10.0
"""The time for which a robot that is held up rather drives round others that stand than asks them to make room, in seconds."""
AHEAD = 3
"""The number of places ahead of a robot that is held up from which others make room."""
DETOUR = 200
"""The most steps of PIBT that a search for ways on a detour takes: many brief ones find more than a long one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Traveller:
    """A robot: where it is, where it wants to (None: nowhere), the number of steps for which it has had this goal, and the least distance
    to it at which it has been. Of two robots, the one that has waited longer comes first. A robot that is not `movable` stays; if it is
    `busy`, it will be movable later. The trip of one that `begins` was not planned before. One that is `held_up` has come no nearer for a
    while: those that stand may be in its way. One that is `stalled` has come no nearer for long, so that ways are searched for, unless it
    waits for its turn in a corridor."""

    place: int
    goal: int | None = None
    waiting: float = 0.0
    nearest: float = FAR
    movable: bool = True
    busy: bool = False
    begins: bool = False
    held_up: bool = False
    stalled: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """The configurations of the robots, one step after the other, from where they are.

    `whole`: it is to be followed to its end, because nobody may come nearer to a goal on its first part. `stuck`: robots, by number, that
    cannot come to their goals, as is proved, with what keeps them from there: the others have no room to let them pass.
    """

    steps: list[Configuration]
    whole: bool = False
    stuck: Mapping[int, Barrier] = field(default_factory=dict)


class WindowPlanner:
    """Plans the next steps of robots on a graph. `blocked`: the places held by robots that cannot move. See `StepPlanner` for `rotations`
    and `shuffle`."""

    def __init__(
        self, whole_graph: Graph, shuffle: Callable[[list[int]], None], *, blocked: Collection[int] = (), rotations: bool = False
    ) -> None:
        self._whole_graph, self._blocked, self._shuffle = whole_graph, blocked, shuffle
        self.graph = graph = whole_graph.without(blocked) if blocked else whole_graph
        self._planner = StepPlanner(graph, rotations=rotations, shuffle=shuffle)
        self._restless = StepPlanner(graph, rotations=rotations, shuffle=shuffle, restless=True)

    def plan(self, robots: Sequence[Traveller], steps: int, effort: int = EFFORT, *, searches: bool = False) -> Course:
        """The next steps of the robots; none if they bring nobody nearer.

        `effort`: the most steps of each search for ways; 0 for none. `searches`: search at once, because going step by step has not brought
        a robot nearer for longer than its turn may take to come.
        """
        estimates = self._estimates_of_goals(robots)
        asides = self._asides(robots, estimates)
        course = self._step_by_step(robots, steps, estimates, asides)
        is_useful = self._brings_nearer(course, robots) or self._clears_ways(course, robots, estimates, asides)
        barriers = Barriers(self._whole_graph, self.graph, self._blocked, robots)
        hindered = [number for number in self._travelling(robots) if robots[number].begins or robots[number].held_up or not is_useful]
        stuck = {number: barrier for number in hindered if (barrier := barriers.shut_off(number)) is not None}
        waiting = [number for number in hindered if number not in stuck and not barriers.waits_for_work(number)]
        is_stalled = any(robots[number].stalled and not waits_its_turn(self.graph, number, robots, estimates) for number in waiting)
        suffices = is_useful and not searches and not is_stalled
        if effort == 0 or not waiting:
            return Course(steps=course if suffices else course[:1], stuck=stuck)
        halted = [number for number in waiting if not self._gets_on(number, course, robots, estimates)] if suffices else waiting
        ways = None if suffices else self._search(course[0], self._goals_of(waiting, robots), effort, _staying(robots))
        for number in halted:
            if ways is None and not waits_its_turn(self.graph, number, robots, estimates):
                ways = barriers.ways_past(number)
        if ways is None and not suffices:
            ways = self._search_one_by_one(waiting, stuck, barriers, effort, robots)
        if ways is not None:
            return Course(steps=self._beside(ways, robots, estimates), whole=True, stuck=stuck)
        return Course(steps=course if is_useful else course[:1], stuck=stuck)

    def _search_one_by_one(
        self, waiting: Sequence[int], stuck: dict[int, Barrier], barriers: Barriers, effort: int, robots: Sequence[Traveller]
    ) -> list[Configuration] | None:
        """Ways for one of the robots to its goal. Those for which there is no room, as is proved, become `stuck`."""
        places, staying = tuple(robot.place for robot in robots), _staying(robots)
        goals = self._goals_of(waiting, robots)
        open_aims: list[Goals] = []
        for number in waiting:
            if goals[number] is None:
                continue
            aim = self._goal_of(number, goals)
            try:
                ways = search_all(self.graph, places, aim, ALL * effort, dict(staying))
                if ways is None and self._is_stuck(places, aim, effort, robots):
                    stuck[number] = barriers.by_all(number, ALL * effort)
                    continue
            except SearchLimit:
                ways = self._search(places, aim, effort, staying)
            if ways is not None:
                return ways
            open_aims.append(aim)
        return self._on_detours(places, open_aims, effort // DETOUR, staying)

    def _travelling(self, robots: Sequence[Traveller]) -> list[int]:
        """The robots with a way to go, the one that has waited longest first."""
        return [
            number
            for number in self._in_line(robots)
            if (goal := robots[number].goal) is not None
            and robots[number].movable
            and 0 < self.graph.distances(goal)[robots[number].place] < FAR
        ]

    def _goals_of(self, numbers: Collection[int], robots: Sequence[Traveller]) -> Goals:
        """The goals of these robots that they can be at together."""
        return [goal if number in numbers else None for number, goal in enumerate(self._reachable(robots))]

    def _beside(self, ways: list[Configuration], robots: Sequence[Traveller], estimates: Mapping[int, Estimate]) -> list[Configuration]:
        """The ways, while the robots that do not move on them go on step by step where these do not lead."""
        start = ways[0]
        movers = [number for number in range(len(robots)) if any(places[number] != start[number] for places in ways)]
        graph = self.graph.without({places[number] for places in ways for number in movers})
        planner = StepPlanner(graph, shuffle=self._shuffle)
        goals = [estimates[number] if number in estimates else graph.distances(robot.place) for number, robot in enumerate(robots)]
        staying = [(number, start[number]) for number, robot in enumerate(robots) if number in movers or not robot.movable]
        order, places, course = self._in_line(robots), start, [start]
        for following in ways[1:]:
            places = planner.step(places, goals, order, staying) or places
            course.append(tuple(following[number] if number in movers else place for number, place in enumerate(places)))
        return course

    def _is_stuck(self, places: Configuration, aim: Goals, effort: int, robots: Sequence[Traveller]) -> bool:
        """Whether there is no room even when all busy robots have come free, of a robot for which there are no ways now. Raises
        SearchLimit."""
        fixed = [number for number, robot in enumerate(robots) if not robot.movable and not robot.busy]
        return not any(robot.busy for robot in robots) or search_all(self.graph, places, aim, ALL * effort, fixed) is None

    def _search(self, places: Configuration, goals: Goals, effort: int, staying: Sequence[tuple[int, int]]) -> list[Configuration] | None:
        """Ways to the goals; None if none are found."""
        try:
            return find_ways(self.graph, places, goals, self._planner, effort, staying)
        except SearchLimit:
            return None

    def _on_detours(
        self, places: Configuration, aims: Sequence[Goals], attempts: int, staying: Sequence[tuple[int, int]]
    ) -> list[Configuration] | None:
        """Ways for one of the robots to its goal, after all have gone somewhere else: one may have to go far back to let another pass."""
        fixed = dict(staying)
        for attempt in range(attempts if aims else 0):
            aim, elsewhere = aims[attempt % len(aims)], list(range(self.graph.public_size))
            self._shuffle(elsewhere)
            detour: Goals = [None if robot in fixed else elsewhere[robot] for robot in range(len(places))]
            for first in (None, detour):
                try:
                    there = find_ways(self.graph, places, first, self._planner, DETOUR, staying) if first is not None else [places]
                    if there is None:
                        continue
                    planner = self._planner if first is not None else self._restless
                    onwards = find_ways(self.graph, there[-1], aim, planner, DETOUR, staying)
                except SearchLimit:
                    continue
                if onwards is not None:
                    return [*there, *onwards[1:]]
        return None

    def _goal_of(self, robot: int, goals: Goals) -> Goals:
        """The goal of one robot alone."""
        return [goal if number == robot else None for number, goal in enumerate(goals)]

    def _in_line(self, robots: Sequence[Traveller]) -> list[int]:
        """The robots, the one that has waited longest first."""
        return sorted(range(len(robots)), key=lambda number: -robots[number].waiting)

    def _step_by_step(
        self, robots: Sequence[Traveller], steps: int, goals: Mapping[int, Estimate], asides: Mapping[int, int]
    ) -> list[Configuration]:
        """`goals`: the estimates of the robots that have one. `asides`: where those go that make room."""
        targets = [asides.get(number, robot.place if robot.goal is None else robot.goal) for number, robot in enumerate(robots)]
        estimates = [goals[number] if number in goals else self.graph.distances(target) for number, target in enumerate(targets)]
        staying = _staying(robots)
        waiting, course = [robot.waiting for robot in robots], [tuple(robot.place for robot in robots)]
        for _ in range(steps):
            # Who makes room goes before those that may stand in its way out; who is in a corridor, and does not stay, gets out first.
            now = course[-1]
            order = sorted(
                range(len(robots)),
                key=lambda robot: (
                    robot not in asides,
                    now[robot] == targets[robot] or not self._planner.is_in_corridor(now[robot]),
                    -waiting[robot],
                ),
            )
            following = self._planner.step(now, estimates, order, staying)
            assert following is not None, "all robots can wait"
            course.append(following)
            waiting = [
                waited + 1 if reached != target else 0.0 for waited, reached, target in zip(waiting, following, targets, strict=True)
            ]
        return course

    def _estimates_of_goals(self, robots: Sequence[Traveller]) -> dict[int, Estimate]:
        """By robot with a goal: how far it is to there. Who is held up by one that stands looks for a way round it."""
        standing: set[int] = set()
        delayed = self.graph
        if any(robot.held_up for robot in robots):
            places = (robot.place for robot in robots if not robot.movable or robot.goal in (None, robot.place))
            standing = {taken_place for place in places for taken_place in self._taken(place)}
            delayed = self.graph.delayed(standing, LONGEST_DETOUR)
        return {
            number: (delayed if robot.held_up and self._is_barred(number, robot, standing) else self.graph).distances(robot.goal)
            for number, robot in enumerate(robots)
            if robot.goal is not None
        }

    def _is_barred(self, number: int, robot: Traveller, standing: Collection[int]) -> bool:
        """Whether one that stands is in the way of a robot, not far ahead."""
        way = self.graph.way(robot.place, robot.goal, number) if robot.goal is not None else iter(())
        return any(place in standing for place in islice(way, FAR_AHEAD))

    def _asides(self, robots: Sequence[Traveller], estimates: Mapping[int, Estimate]) -> dict[int, int]:
        """By robot without a goal that makes room for another one: where to. It does so in time: in the step in which that one comes, there
        may be no place to which it could go."""
        wanted_places = {
            taken_place
            for number in estimates
            for place in self._wanted(number, robots[number], estimates[number])
            for taken_place in self._taken(place)
        }
        taken_places = {
            place for robot in robots for place in (*self._taken(robot.goal if robot.goal is not None else robot.place), robot.place)
        }
        asides: dict[int, int] = {}
        for number, robot in enumerate(robots):
            if robot.goal is None and robot.movable and robot.place in wanted_places:
                aside = self._nearest(number, robot.place, wanted_places | taken_places)
                if aside is not None:
                    asides[number] = aside
                    taken_places.update(self._taken(aside))
        return asides

    def _wanted(self, number: int, robot: Traveller, estimate: Estimate) -> Iterator[int]:
        """The places from which others have to go for a robot: its goal, and if it is held up, the next ones on its way."""
        if robot.goal is None or robot.goal == robot.place:
            return
        yield robot.goal
        place = robot.place
        for _ in range(AHEAD if robot.held_up else 0):
            place = min(self.graph.options(place, number), key=estimate.__getitem__, default=place)
            yield place

    def _taken(self, place: int | None) -> Iterator[int]:
        """The places at which no other robot can be while one is at this place."""
        if place is not None:
            yield place
            yield from self.graph.exclusions[place]

    def _nearest(self, robot: int, start: int, avoided: Collection[int]) -> int | None:
        """The nearest place by the number of lanes that is for all robots, and not avoided; None if none is near."""
        visited_places, waiting = {start}, deque([start])
        while waiting and len(visited_places) < ASIDE:
            for place in self.graph.options(waiting.popleft(), robot):
                if place < self.graph.public_size and place not in avoided:
                    return place
                if place not in visited_places:
                    visited_places.add(place)
                    waiting.append(place)
        return None

    def _brings_nearer(self, course: list[Configuration], robots: Sequence[Traveller]) -> bool:
        """Whether some robot comes nearer to its goal than it has been, or none has a way to go."""
        travelling = self._travelling(robots)
        return not travelling or any(self._comes_nearer(number, course, robots) for number in travelling)

    def _comes_nearer(self, number: int, course: list[Configuration], robots: Sequence[Traveller]) -> bool:
        """Whether a robot comes nearer to its goal than it has been."""
        robot = robots[number]
        distances = self.graph.distances(robot.goal) if robot.goal is not None else ()
        return min(distances[places[number]] for places in course) < min(robot.nearest, distances[robot.place])

    def _gets_on(self, number: int, course: list[Configuration], robots: Sequence[Traveller], estimates: Mapping[int, Estimate]) -> bool:
        """Whether a robot comes nearer to its goal, or drives round those that stand in its way."""
        estimate = estimates[number]
        is_going_round = min(estimate[places[number]] for places in course) < estimate[robots[number].place]
        return self._comes_nearer(number, course, robots) or (robots[number].held_up and not robots[number].stalled and is_going_round)

    def _clears_ways(
        self, course: list[Configuration], robots: Sequence[Traveller], estimates: Mapping[int, Estimate], asides: Mapping[int, int]
    ) -> bool:
        """Whether a robot that is held up drives round one that stands in its way, or one makes room for it."""
        if not any(robot.held_up for robot in robots):
            return False
        targets: dict[int, Estimate] = {number: self.graph.distances(aside) for number, aside in asides.items()}
        targets |= {number: estimate for number, estimate in estimates.items() if robots[number].held_up and robots[number].movable}
        return any(
            min(estimate[configuration[number]] for configuration in course) < estimate[robots[number].place]
            for number, estimate in targets.items()
        )

    def _reachable(self, robots: Sequence[Traveller]) -> Goals:
        """The goals that robots can be at together: of those that exclude each other, the first in line keeps its own."""
        reachable: list[int | None] = [None] * len(robots)
        taken: set[int] = set()
        for number in self._in_line(robots):
            robot = robots[number]
            if robot.goal is None or not robot.movable or robot.goal in taken or not taken.isdisjoint(self.graph.exclusions[robot.goal]):
                continue
            if self.graph.distances(robot.goal)[robot.place] < FAR:
                reachable[number] = robot.goal
                taken.add(robot.goal)
        return reachable


def _staying(robots: Sequence[Traveller]) -> list[tuple[int, int]]:
    """The robots that cannot move, with their places."""
    return [(number, robot.place) for number, robot in enumerate(robots) if not robot.movable]
