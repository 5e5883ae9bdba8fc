"""One step of all robots at once: priority inheritance with backtracking (PIBT; Okumura, Machida, Défago and Tamura 2022).

The robot of the highest priority takes the place that it likes best. A robot that stands there has to give way first, with the same
priority, and so on; if one of them cannot, the next best place is tried. Two robots that have to pass each other in a narrow way are
recognised, and the one that is pushed back leads to where there is room (the swap technique of LaCAM; Okumura 2023).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from somrs.traffic.planning.corridors import NOWHERE
from somrs.traffic.planning.graph import FAR, Graph

NOBODY = -1
UNDECIDED = -1

Configuration = tuple[int, ...]
"""The places of all robots, in their order."""

Goals = Sequence[int | None]
"""The places to which robots want; None for a robot that wants nowhere."""

Estimate = Sequence[float]
"""By place: how far it is to a robot's goal."""


class StepPlanner:
    """Finds the next places of all robots on a graph.

    `rotations`: robots in a circle may all move on at once; robots that are granted one place after the other cannot. `shuffle` orders
    places of equal distance anew. `restless`: where a robot is, is no better to it than other places of the same distance.
    """

    def __init__(
        self, graph: Graph, *, rotations: bool = False, shuffle: Callable[[list[int]], None] | None = None, restless: bool = False
    ) -> None:
        self._graph, self._rotations, self._shuffle, self._restless = graph, rotations, shuffle, restless
        self._now = [NOBODY] * graph.size
        self._next = [NOBODY] * graph.size

    def is_in_corridor(self, place: int) -> bool:
        """Whether robots cannot pass each other at a place, and around it."""
        return self._graph.corridors[place] != NOWHERE

    def step(
        self, places: Sequence[int], estimates: Sequence[Estimate], order: Sequence[int], fixed: Sequence[tuple[int, int]] = ()
    ) -> Configuration | None:
        """The next places of the robots, decided in this `order`; None if the `fixed` next places (robot, place) are not possible together.

        Without `fixed`, there always are next places: at worst, all robots wait.
        """
        step = _Step(self._graph, self._now, self._next, places, estimates, self._rotations, self._shuffle, self._restless)
        try:
            return step.decide(order, fixed)
        finally:
            step.clear()


class _Step:
    def __init__(
        self,
        graph: Graph,
        now: list[int],
        next: list[int],
        places: Sequence[int],
        estimates: Sequence[Estimate],
        rotations: bool,
        shuffle: Callable[[list[int]], None] | None,
        restless: bool,
    ) -> None:
        self._graph, self._now, self._next, self._places, self._estimates = graph, now, next, places, estimates
        self._exits: dict[int, int] = {}
        """Where robots leave the corridor in which they are, or which they enter now."""
        self._rotations, self._shuffle, self._restless = rotations, shuffle, restless
        self._decided = [UNDECIDED] * len(places)
        self._journal: list[int] = []
        """The robots that are decided, in the order of the decisions."""
        for robot, place in enumerate(places):
            now[place] = robot

    @property
    def _corridors(self) -> Sequence[int]:
        return self._graph.corridors  # found only where there are robots

    def clear(self) -> None:
        for place in self._places:
            self._now[place] = NOBODY
        for place in self._decided:
            if place != UNDECIDED:
                self._next[place] = NOBODY

    def decide(self, order: Sequence[int], fixed: Sequence[tuple[int, int]]) -> Configuration | None:
        for robot, place in fixed:
            if not self._is_free(robot, place):
                return None
            self._take(robot, place)
        for robot in order:
            self._let_out(robot)
            if self._decided[robot] == UNDECIDED and not self._find_place(robot) and self._decided[robot] == UNDECIDED:
                return None
        if fixed and not self._rotations and any(self._is_in_circle(robot) for robot, _ in fixed):
            return None
        return tuple(self._decided)

    def _take(self, robot: int, place: int) -> None:
        self._decided[robot] = place
        self._next[place] = robot
        self._journal.append(robot)

    def _take_back(self, count: int) -> None:
        """Undo all decisions but the first `count`."""
        while len(self._journal) > count:
            robot = self._journal.pop()
            self._next[self._decided[robot]] = NOBODY
            self._decided[robot] = UNDECIDED

    def _is_free(self, robot: int, place: int) -> bool:
        """Whether no decided robot is going to be at the place, or so close that the two would touch, or comes from it to this robot's."""
        taken_places = self._next
        if taken_places[place] != NOBODY:
            return False
        for close_place in self._graph.exclusions[place]:
            if taken_places[close_place] not in (NOBODY, robot):
                return False
        present_place = self._places[robot]
        if place == present_place:
            return True
        close = (present_place, *self._graph.exclusions[present_place])
        return not any(self._decided[occupant] in close for occupant in self._occupants(place) if occupant != robot)

    def _occupants(self, place: int) -> Iterator[int]:
        """The robots that stand at the place, or so close that it is not free."""
        now = self._now
        if now[place] != NOBODY:
            yield now[place]
        for close_place in self._graph.exclusions[place]:
            if now[close_place] != NOBODY:
                yield now[close_place]

    def _find_place(self, robot: int) -> bool:
        """Decide on the robot's next place, and on those of all robots that have to give way. Returns whether it got one."""
        present_place, estimate = self._places[robot], self._estimates[robot]
        candidates = [*self._graph.options(present_place, robot), present_place]
        if self._shuffle is not None:
            self._shuffle(candidates)
        now, restless, corridors = self._now, self._restless, self._corridors
        meets = {place: self._oncoming(robot, place) != NOBODY for place in candidates}
        candidates.sort(
            key=lambda place: (
                meets[place],
                estimate[place],
                place != present_place and not restless,
                corridors[place] != NOWHERE,
                now[place] != NOBODY,
            )
        )
        comes_out = corridors[present_place] != NOWHERE and corridors[candidates[0]] == NOWHERE  # others wait outside, and can give way
        partner = self._partner(robot, candidates[0]) if candidates[0] != present_place and not comes_out else NOBODY
        if partner != NOBODY:
            candidates.reverse()
        for number, place in enumerate(candidates):
            if not self._is_free(robot, place):
                continue
            count = len(self._journal)
            self._take(robot, place)
            if self._clear_away(robot, place):
                if number == 0 and partner != NOBODY:
                    self._pull(partner, present_place)
                return True
            self._take_back(count)
        if self._is_free(robot, present_place):
            self._take(robot, present_place)
        return False

    def _let_out(self, robot: int) -> None:
        """Let the robot that comes out of a corridor decide first, if this one waits for it, maybe where the other has to pass."""
        if self._decided[robot] != UNDECIDED:
            return
        estimate = self._estimates[robot]
        best = min(self._graph.options(self._places[robot], robot), key=estimate.__getitem__, default=self._places[robot])
        oncoming = self._oncoming(robot, best)
        if oncoming != NOBODY and self._decided[oncoming] == UNDECIDED:
            self._find_place(oncoming)

    def _oncoming(self, robot: int, place: int) -> int:
        """The robot that comes towards this one in the corridor that it would enter at the place; NOBODY if there is none."""
        corridor = self._corridors[place]
        if corridor == NOWHERE or self._corridors[self._places[robot]] != NOWHERE:
            return NOBODY
        estimate = self._estimates[robot]
        for oncoming in range(len(self._places)):
            for taken_place in (self._places[oncoming], self._decided[oncoming]):
                if oncoming == robot or taken_place == UNDECIDED or self._corridors[taken_place] != corridor:
                    continue
                exit = self._exit(oncoming, taken_place)
                if exit != taken_place and estimate[exit] >= estimate[place]:  # one that is to stay there gives way
                    return oncoming
        return NOBODY

    def _exit(self, robot: int, place: int) -> int:
        """Where a robot at a place in a corridor leaves it; its goal, if that is inside."""
        if robot not in self._exits:
            estimate, corridor = self._estimates[robot], self._corridors[place]
            while self._corridors[place] == corridor and 0 < estimate[place] < FAR:
                following = min(self._graph.successors[place], key=estimate.__getitem__, default=place)
                if estimate[following] >= estimate[place]:
                    break
                place = following
            self._exits[robot] = place
        return self._exits[robot]

    def _pull(self, partner: int, place: int) -> None:
        """Take the robot along that has to pass, if it can come."""
        leads_there = place in self._graph.successors[self._places[partner]]
        if leads_there and self._decided[partner] == UNDECIDED and self._is_free(partner, place):
            count = len(self._journal)
            self._take(partner, place)
            if not self._clear_away(partner, place):
                self._take_back(count)

    def _clear_away(self, robot: int, place: int) -> bool:
        """Make the robots at the place give way."""
        for occupant in self._occupants(place):
            if occupant != robot and self._decided[occupant] == UNDECIDED and not self._find_place(occupant):
                return False
        return self._rotations or place == self._places[robot] or not self._is_in_circle(robot)

    def _is_in_circle(self, robot: int) -> bool:
        """Whether the robot moves to where another leaves, that to where a third one leaves, and so on, back to its own place."""
        waiting, visited = [robot], {robot}
        while waiting:
            mover = waiting.pop()
            place = self._decided[mover]
            if place in (UNDECIDED, self._places[mover]):
                continue
            for occupant in self._occupants(place):
                if occupant == robot and mover != robot:
                    return True
                if occupant not in visited:
                    visited.add(occupant)
                    waiting.append(occupant)
        return False

    # Two robots that have to pass each other

    def _partner(self, robot: int, best: int) -> int:
        """The robot that has to pass this one, which wants to the place `best`, where only one has room; NOBODY if there is none."""
        present_place, now = self._places[robot], self._now
        partner = now[best]
        if (
            partner != NOBODY
            and self._decided[partner] == UNDECIDED
            and self._have_to_swap(robot, partner, present_place, best)
            and self._can_swap(best, present_place)
        ):
            return partner
        for place in self._graph.successors[present_place]:
            partner = now[place]
            if (
                partner != NOBODY
                and place != best
                and self._decided[partner] == UNDECIDED
                and self._have_to_swap(partner, robot, present_place, best)
                and self._can_swap(best, present_place)
            ):
                return partner
        return NOBODY

    def _have_to_swap(self, pusher: int, pulled: int, pusher_place: int, pulled_place: int) -> bool:
        """Whether the pusher cannot get past the other without a swap of their places, and the other wants to where the pusher is."""
        pusher_estimate, pulled_estimate = self._estimates[pusher], self._estimates[pulled]
        while pusher_estimate[pulled_place] < pusher_estimate[pusher_place]:
            ways, way_on = self._ways_on(pusher_place, pulled_place)
            if ways >= 2:
                return False
            if ways <= 0:
                break
            pusher_place, pulled_place = pulled_place, way_on
        return pulled_estimate[pusher_place] < pulled_estimate[pulled_place] and (
            pusher_estimate[pusher_place] == 0 or pusher_estimate[pulled_place] < pusher_estimate[pusher_place]
        )

    def _can_swap(self, pusher_place: int, pulled_place: int) -> bool:
        """Whether the one that is pulled back comes to a place with two ways on, where the two can pass each other. One-way lanes may lead
        it round and round, or back to the pusher."""
        passed_places = {pusher_place}
        while pulled_place not in passed_places:
            passed_places.add(pulled_place)
            ways, way_on = self._ways_on(pusher_place, pulled_place)
            if ways >= 2:
                return True
            if ways <= 0:
                return False
            pusher_place, pulled_place = pulled_place, way_on
        return False

    def _ways_on(self, way_back_place: int, place: int) -> tuple[int, int]:
        """How many places lead on from a place, and one of them: not the way back, and no dead end where a robot is at its goal."""
        successors, now, estimates = self._graph.successors, self._now, self._estimates
        ways, way_on = 0, NOBODY
        for following in successors[place]:
            if following == way_back_place:
                continue
            occupant = now[following]
            if occupant != NOBODY and len(successors[following]) == 1 and estimates[occupant][following] == 0:
                continue
            ways, way_on = ways + 1, following
        return ways, way_on
