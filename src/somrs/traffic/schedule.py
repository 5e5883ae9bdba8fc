"""The order in which robots pass places: a plan of steps, made safe against delay.

A plan says who is where at which step, but robots are late. What has to be kept of it is the order at each place: a robot may enter a
place when all robots that the plan sends there before it have left (the action dependency graph of Hönig, Kiesel, Tinka, Durham and Ayanian
2019). As no step of the plan moves robots in a circle, one of them can always go on.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence

from somrs.errors import UsageError
from somrs.traffic.planning.graph import Graph


class Schedule:
    """Which robot holds which places, and in which order they are to enter the next ones.

    The places that a robot *holds* were granted to it, and not given back. The first is where it is, the last is up to where it may drive.
    The places after these are planned, and may be planned anew at any time, from the last held places of all robots. Two robots never hold
    the same place, nor places that exclude each other.

    `held` and `planned` are the data of a component's state, which the schedule changes: by robot, the places that it holds, and the
    numbers of the steps and the places that it is to enter after them.
    """

    def __init__(
        self, graph: Graph, held: dict[str, list[int]] | None = None, planned: dict[str, list[tuple[int, int]]] | None = None
    ) -> None:
        self.graph = graph
        self._held = held if held is not None else {}
        self._planned = planned if planned is not None else {}
        self._holder = {place: robot for robot, places in self._held.items() for place in places}
        self.moved: set[str] = {*self._held}
        """The robots that may hold other places than when this was emptied last."""
        self._waiting: dict[int, deque[tuple[int, str]]] = {}
        """By place: the numbers of the steps and the robots that are to enter it, in this order."""
        for step, robot, place in sorted((step, robot, place) for robot, entries in self._planned.items() for step, place in entries):
            self._waiting.setdefault(place, deque()).append((step, robot))

    def __contains__(self, robot: str) -> bool:
        return robot in self._held

    def last(self, robot: str) -> int:
        """The place up to which the robot's way is granted. The next plan begins there."""
        return self._held[robot][-1]

    def held(self, robot: str) -> tuple[int, ...]:
        """The places that the robot holds, in the order of its way."""
        return tuple(self._held[robot])

    def planned(self, robot: str) -> tuple[int, ...]:
        """The places that the robot is to enter after these, in the order of its way."""
        return tuple(place for _, place in self._planned[robot])

    def holder(self, place: int, besides: str | None = None) -> str | None:
        """The robot, other than `besides`, that holds the place, or one that excludes it; None if there is none."""
        holders = (self._holder.get(close_place) for close_place in (place, *self.graph.exclusions[place]))
        return next((robot for robot in holders if robot not in (None, besides)), None)

    def enter(self, robot: str, place: int) -> None:
        """A robot is where it was not known before. Raises UsageError if it is known, or if its place is not free."""
        if robot in self._held:
            raise UsageError(f"{robot} takes part already")
        if (holder := self.holder(place)) is not None:
            raise UsageError(f"{robot} cannot be there: {holder} is too close")
        self._held[robot], self._planned[robot] = [place], []
        self.moved.add(robot)
        self._holder[place] = robot

    def hold(self, robot: str, place: int) -> None:
        """The robot is on its way to a place that nobody has granted it. Raises UsageError if that is not free."""
        if (holder := self.holder(place, besides=robot)) is not None:
            raise UsageError(f"{robot} cannot be there: {holder} is too close")
        self._held[robot].append(place)
        self._holder[place] = robot
        self.moved.add(robot)

    def leave(self, robot: str) -> None:
        """The robot takes part no more, and holds nothing."""
        self.plan({name: (places[-1],) for name, places in self._held.items()})
        for place in self._held.pop(robot):
            self._holder.pop(place, None)
        del self._planned[robot]
        self.moved.add(robot)

    def plan(self, ways: Mapping[str, Sequence[int]]) -> None:
        """Replace what is planned: for each robot, the place where it is at each step. Step 0 is where its granted way ends."""
        self._waiting.clear()
        for planned in self._planned.values():
            planned.clear()
        entries: list[tuple[int, str, int]] = []
        for robot, places in ways.items():
            assert places[0] == self._held[robot][-1], "a plan begins where the granted ways end"
            entries += ((step, robot, place) for step, place in enumerate(places) if step and place != places[step - 1])
        for step, robot, place in sorted(entries):
            self._planned[robot].append((step, place))
            self._waiting.setdefault(place, deque()).append((step, robot))

    def grant(self, robot: str) -> int | None:
        """Grant the robot the next place of its way, and return it; None if there is none, or another robot goes first."""
        planned = self._planned[robot]
        if not planned or next(self.obstacles(robot), None) is not None:
            return None
        _, place = planned.pop(0)
        self._waiting[place].popleft()
        self._held[robot].append(place)
        self._holder[place] = robot
        self.moved.add(robot)
        return place

    def obstacles(self, robot: str) -> Iterator[str]:
        """The robots that have to leave the next place of the robot's way first, or to pass it."""
        planned = self._planned[robot]
        if not planned:
            return
        number, next_place = planned[0]
        for place in (next_place, *self.graph.exclusions[next_place]):
            if (holder := self._holder.get(place, robot)) != robot:
                yield holder
            for earlier, rival in self._waiting.get(place, ()):
                if earlier >= number:
                    break
                if rival != robot:
                    yield rival

    def retreat(self, robot: str, kept: int = 1) -> None:
        """The robot gives back all places but the first ones of its way. What is planned for all robots ends."""
        self.plan({})
        held = self._held[robot]
        for returned_place in held[kept:]:
            if returned_place not in held[:kept]:
                self._holder.pop(returned_place, None)
        del held[kept:]
        self.moved.add(robot)

    def advance(self, robot: str, count: int) -> None:
        """The robot has come to so many more of the places that it holds, and gives back those behind it."""
        held = self._held[robot]
        if not 0 <= count < len(held):
            raise UsageError(f"{robot} is where it has no right to be")
        self.moved.add(robot)
        returned_places = held[:count]
        del held[:count]
        for returned_place in returned_places:
            if returned_place not in held:  # a way may lead to a place twice
                self._holder.pop(returned_place, None)
