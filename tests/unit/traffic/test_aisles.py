"""Robots that meet in an aisle that is one robot wide: one side goes first, and the other one waits outside, but not for ever."""

from __future__ import annotations

from itertools import pairwise, product
from random import Random

import pytest

from somrs.protocol.messages.traffic import TripResult
from somrs.runtime.virtual_time import Work, World
from somrs.traffic.component import SCHEMA, Traffic
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import Lane, Place, Roadmap
from somrs.traffic.state import PlanTraffic
from verification.traffic_runs.vehicle import Robot, Vehicle

SECONDS = 1.4
"""The time for each lane: 0.7 m at 0.5 m/s."""
LEFT, RIGHT = ("L21", "L10", "L02"), ("R11", "R20", "R32")
"""The places in the two rooms from which robots start."""


def aisle(length: int, *, has_bay: bool) -> Roadmap:
    """An aisle of so many places between two rooms of 16 places, maybe with a bay for one robot in the middle."""
    points = {f"{room}{x}{y}": (start + x, y - 1) for room, start in (("L", -4), ("R", length)) for x, y in product(range(4), repeat=2)}
    pairs = [(f"{room}{x}{y}", f"{room}{x + 1}{y}") for room, x, y in product("LR", range(3), range(4))]
    pairs += [(f"{room}{x}{y}", f"{room}{x}{y + 1}") for room, x, y in product("LR", range(4), range(3))]
    points |= {f"A{number}": (number, 0) for number in range(length)}
    pairs += pairwise(["L31", *(f"A{number}" for number in range(length)), "R01"])
    if has_bay:
        points["Bay"] = (length // 2, 1)
        pairs.append((f"A{length // 2}", "Bay"))
    return Roadmap(
        places=tuple(Place(name=name, x=0.7 * x, y=0.7 * y) for name, (x, y) in points.items()),
        lanes=tuple(Lane(start=start, end=end, seconds=SECONDS) for pair in pairs for start, end in (pair, pair[::-1])),
    )


def drive(roadmap: Roadmap, trips: dict[str, list[str]], seed: int = 0) -> dict[str, float]:
    """When each robot has come to the end of its trips. `trips`: by the place where it starts."""
    world, dice, planner = World(), Random(seed), TrafficPlanner(roadmap, Random())

    def plan(task: object) -> Work:
        assert isinstance(task, PlanTraffic)
        yield 0.1, planner.plan(task)

    world.add("traffic", Traffic("traffic", roadmap), plan, journaled=SCHEMA)
    robots = [Robot(name=f"From{start}", place=start, trips=[*ends], berths={}) for start, ends in trips.items()]
    for robot in robots:
        world.add(robot.name, Vehicle(robot, "traffic", lambda start, end: SECONDS * dice.uniform(1.0, 1.3), 0.0))
    began, arrivals = world.now, dict[str, float]()
    while open_robots := [robot for robot in robots if robot.name not in arrivals]:
        assert world.run(600.0, lambda: any(not robot.trips for robot in open_robots)), open_robots
        arrivals |= {robot.name: world.now - began for robot in open_robots if not robot.trips}
    assert all(ending.result is TripResult.ARRIVED for robot in robots for ending in robot.endings)
    return arrivals


@pytest.mark.parametrize(("length", "has_bay", "count"), [*product((6, 10, 16), (False, True), (1, 2, 3))])
def test_robots_on_both_sides_of_an_aisle_change_places(length: int, has_bay: bool, count: int) -> None:
    roadmap = aisle(length, has_bay=has_bay)
    alone = drive(roadmap, {"L21": ["R11"]})["FromL21"]
    behind = 2 * SECONDS
    least = 2 * (alone + (count - 1) * behind)
    for seed in range(3):
        trips = {start: [end] for start, end in (*zip(LEFT[:count], RIGHT, strict=False), *zip(RIGHT[:count], LEFT, strict=False))}
        slowest = max(drive(roadmap, trips, seed).values())
        assert slowest < 1.3 * least


def test_nobody_waits_for_ever_while_others_come_and_go_through_the_aisle() -> None:
    roadmap = aisle(10, has_bay=True)
    others = {"L21": ["R11", "L21"] * 4, "L10": ["R12", "L10"] * 4, "L02": ["R32", "L02"] * 4}
    alone = drive(roadmap, {"R20": ["L20"]})["FromR20"]
    for seed in range(3):
        arrivals = drive(roadmap, {**others, "R20": ["L20"]}, seed)
        assert arrivals["FromR20"] < 5 * alone
