"""One robot in the way of another one: it makes room, or it is said at once that there is none, and who stands there."""

from __future__ import annotations

from collections.abc import Collection
from random import Random

import pytest

from somrs.kernel.component import Input, Received
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.traffic import TripEnded, TripResult
from somrs.runtime.virtual_time import Work, World
from somrs.traffic.component import SCHEMA, Traffic
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import Lane, Place, Roadmap
from somrs.traffic.state import PlanTraffic
from verification.traffic_runs.vehicle import Robot, Vehicle

SECONDS = 1.4
"""The time for each lane."""
LINE = ("R......BG", "#########", ".........")
"""A dead end, in which two robots cannot pass each other; and a floor of its own."""
MOST_SECONDS = 1.0
ROWS = 10
HALL = tuple("." * 31 + ("RBG" if row == ROWS // 2 else "###") for row in range(ROWS))
"""A hall with a dead end of three places."""


def drawn(*rows: str) -> Roadmap:
    """The roadmap of a drawing: `#` is a wall, a letter names a place, and other places are named by column and row."""
    names = {
        (column, row): f"{column}-{row}" if sign == "." else sign
        for row, text in enumerate(rows)
        for column, sign in enumerate(text)
        if sign != "#"
    }
    pairs = [(name, names[neighbour]) for (x, y), name in names.items() for neighbour in ((x + 1, y), (x, y + 1)) if neighbour in names]
    return Roadmap(
        places=tuple(Place(name=name, x=0.7 * x, y=0.7 * y) for (x, y), name in names.items()),
        lanes=tuple(Lane(start=start, end=end, seconds=SECONDS) for pair in pairs for start, end in (pair, pair[::-1])),
    )


class Trips:
    """Trips on a roadmap, on virtual time.

    `working`: the robots that work all the time; `broken`: those that cannot move; `hindered`: those in front of which people stand, and
    which arrive nowhere.
    """

    def __init__(
        self,
        roadmap: Roadmap,
        robots: dict[str, tuple[str, list[str]]],
        working: Collection[str] = (),
        broken: Collection[str] = (),
        hindered: Collection[str] = (),
        seed: int = 0,
    ) -> None:
        self.ends: list[tuple[float, TripEnded]] = []
        """Those of the first robot's trips, each with its time in seconds."""
        self._planner, self._first = TrafficPlanner(roadmap, Random(seed)), next(iter(robots))
        self.world = World(watch=self._watch)
        self._start_time = self.world.now
        self._robots: list[Robot] = []
        dice = Random(seed)
        self.world.add("traffic", Traffic("traffic", roadmap), self._plan, journaled=SCHEMA)
        for name, (place, ends) in robots.items():
            robot = Robot(name=name, place=place, trips=ends, berths={}, broken=name in broken)
            seconds = 1e9 if name in hindered else SECONDS
            vehicle = Vehicle(robot, "traffic", lambda *_, seconds=seconds: seconds * dice.uniform(1.0, 1.3), 0.0, works=name in working)
            self._robots.append(robot)
            self.world.add(name, vehicle)

    @property
    def is_open(self) -> bool:
        """Whether a robot still has a trip to make."""
        return any(robot.trips for robot in self._robots)

    def first_end(self, longest: float) -> tuple[float, TripEnded]:
        """When and how the first trip of the first robot ended."""
        assert self.world.run(longest, lambda: bool(self.ends)), "its trip has not ended"
        return self.ends[0]

    def _plan(self, task: object) -> Work:
        assert isinstance(task, PlanTraffic)
        yield 0.1, self._planner.plan(task)

    def _watch(self, address: str, event: Input) -> None:
        match event:
            case Received(Message(body=TripEnded() as ended)) if address == self._first:
                self.ends.append((self.world.now - self._start_time, ended))


def test_it_is_said_at_once_that_there_is_no_room_although_others_get_on() -> None:
    trips = Trips(drawn(*LINE), {"R": ("R", ["G"]), "B": ("B", []), "Other": ("0-2", ["8-2", "0-2"] * 9), "Idle": ("4-2", [])})
    _, ended = trips.first_end(MOST_SECONDS)
    assert (ended.result, ended.robots) == (TripResult.NO_ROOM, ("B",))


def test_a_robot_that_is_broken_elsewhere_is_not_blamed() -> None:
    trips = Trips(drawn(*LINE), {"R": ("R", ["G"]), "B": ("B", []), "Broken": ("0-2", [])}, broken=["Broken"])
    _, ended = trips.first_end(MOST_SECONDS)
    assert (ended.result, ended.robots) == (TripResult.NO_ROOM, ("B",))


def test_a_broken_robot_where_the_other_one_would_make_room_is_named_first() -> None:
    trips = Trips(drawn("R.....BG", "###X####"), {"R": ("R", ["G"]), "B": ("B", []), "Broken": ("X", [])}, broken=["Broken"])
    _, ended = trips.first_end(MOST_SECONDS)
    assert (ended.result, ended.robots) == (TripResult.CLOSED, ("Broken", "B"))


def test_one_that_stands_in_a_dead_end_comes_out_although_many_others_are_under_way() -> None:
    """Both have to come out of the dead end, so that no single step brings the robot nearer to its goal."""
    roadmap, dice = drawn(*HALL), Random(1)
    names = [place.name for place in roadmap.places if place.name not in "RBG"]
    bystanders = {f"Other{number}": (start, dice.choices(names, k=40)) for number, start in enumerate(dice.sample(names, 40))}
    undisturbed, _ = Trips(roadmap, {"R": ("R", ["G"]), "B": ("B", [])}).first_end(60.0)
    seconds, ended = Trips(roadmap, {"R": ("R", ["G"]), "B": ("B", []), **bystanders}).first_end(600.0)
    assert ended.result is TripResult.ARRIVED
    assert seconds < 3 * undisturbed


def test_one_that_works_is_waited_for() -> None:
    trips = Trips(drawn(*HALL), {"R": ("R", ["G"]), "B": ("B", [])}, working=["B"])
    trips.world.run(100.0, lambda: bool(trips.ends))
    assert not trips.ends, "it makes room when its work is done"


def test_others_go_on_while_people_stand_in_front_of_a_robot() -> None:
    """It has driven nowhere for long, but ways that others give it do not help: it does not use those that it has."""
    robots = {"R": ("0-2", ["8-2", "0-2"] * 20), "Hindered": ("0-0", ["8-0"])}
    trips = Trips(drawn(".........", "####.####", "........."), robots, hindered=["Hindered"])
    assert trips.world.run(1_000.0, lambda: len(trips.ends) == 40), len(trips.ends)
    assert {ended.result for _, ended in trips.ends} == {TripResult.ARRIVED}


def test_others_do_not_wait_for_one_that_makes_no_room_although_it_could() -> None:
    robots = {"Other": ("0-0", ["9-0", "0-0"] * 20), "R": ("R", ["G"]), "B": ("B", [])}
    trips = Trips(drawn(*HALL), robots, hindered=["B"])
    assert trips.world.run(3_000.0, lambda: len(trips.ends) == 40), len(trips.ends)


@pytest.mark.parametrize("seed", range(2))
def test_ways_are_found_that_take_a_long_search_although_robots_drive_meanwhile(seed: int) -> None:
    """Six robots in an aisle with four bays have to change their order. What is planned step by step leads nowhere."""
    robots = {
        "R": ("10-1", ["1-1", "G"]),
        "Robot0": ("3-1", ["D", "D", "3-1"]),
        "Robot1": ("4-1", ["8-1"]),
        "Robot2": ("9-1", ["G", "10-1", "5-1", "11-1"]),
        "Robot3": ("D", ["13-1", "2-1", "4-1"]),
        "Robot5": ("C", ["C", "6-1"]),
    }
    trips = Trips(drawn("G#B####C####D#", ".............."), robots, seed=seed)
    assert trips.world.run(400.0, lambda: not trips.is_open)
