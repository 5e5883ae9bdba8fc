"""How a robot looks for something: it drives to where it can see a place, turns about, and stops as soon as it sees it.

These are routines, as in `driving.py`. What was seen on the way is noted in a dictionary that the caller gives.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from somrs.devices.simulator.link.commands import Seen
from somrs.devices.simulator.motion.driving import MARGIN, drive_to, floor_things, robot_discs, turn_to
from somrs.devices.simulator.motion.handling import withdraw
from somrs.devices.simulator.motion.robot import GivenUp, Robot, Routine
from somrs.devices.simulator.world.distances import Array
from somrs.devices.simulator.world.solids import Point
from somrs.devices.simulator.world.vision import Place, eye_of, looks_towards, view, visible

DISTANCES = (0.9, 1.3, 1.8, 2.5, 3.3)
"""From which a place is looked at, m."""
CLOSE = 0.6
"""A place is looked at from within that part of how far the camera sees."""
ATTEMPTS = 4
"""So many spots are tried from which a place could be seen."""
GLANCE = 5
"""Control periods between two looks for the object on the way."""
BLOCKED = ("blocked", "unreachable")


def look_at(robot: Robot, point: Place, object: str | None, found: dict[str, Seen]) -> Routine:
    """Get to where the point is in view, and look there; or to where the object comes in view."""
    yield from withdraw(robot)
    problem = GivenUp("unreachable", f"there is no place from which {robot.name} could see ({point[0]:.2f}, {point[1]:.2f})")
    for x, y in _varied(_viewpoints(robot, point)):
        yaw = math.atan2(point[1] - y, point[0] - x)
        try:
            yield from _until_seen(robot, drive_to(robot, (x, y), yaw, patience=4.0), object)
        except GivenUp as given:
            if given.reason not in BLOCKED:
                raise
            problem = given
        else:
            _note(robot, found)
            return
    raise problem


def look_around(robot: Robot, object: str | None, found: dict[str, Seen]) -> Routine:
    """Turn once around. Notes everything that was seen."""
    yield from withdraw(robot)
    _note(robot, found)
    view, start = robot.solid.view, robot.pose()[2]
    turns = math.ceil(math.tau / (0.8 * view)) if view < math.tau else 1
    for i in range(1, turns):
        if object is not None and object in found:
            return
        yield from _until_seen(robot, turn_to(robot, start + i * math.tau / turns), object)
        _note(robot, found)


def _note(robot: Robot, found: dict[str, Seen]) -> None:
    found.update({seen.object: seen for seen in view(robot.scene, robot.name)})


def _until_seen(robot: Robot, moving: Routine, object: str | None) -> Routine:
    """Move, but not on once the object is seen."""
    for period, _ in enumerate(moving):
        if object is not None and period % GLANCE == 0 and visible(robot.scene, robot.name, object):
            moving.close()
            return
        yield


def _viewpoints(robot: Robot, point: Place) -> Iterator[Point]:
    """Where the robot can stand, with the point in view; the nearest first. So near that what is around the point is seen, too."""
    (x, y, _), need = robot.pose(), robot.size.radius + MARGIN
    eye = eye_of(robot.scene, robot.name)
    angles = np.arange(16) * (math.pi / 8)
    ring = [(point[0] + r * math.cos(a), point[1] + r * math.sin(a)) for r in DISTANCES if r < CLOSE * eye.sight for a in angles]
    spots: Array = np.array([(x, y), *ring])
    costs = np.hypot(spots[:, 0] - x, spots[:, 1] - y) + 0.8 * np.hypot(spots[:, 0] - point[0], spots[:, 1] - point[1])
    room = robot.scene.clearances(spots, robot.solid.z + 0.02, robot.solid.z + 1.85)
    discs = [*floor_things(robot), *robot_discs(robot.others())]
    for i in np.argsort(costs, kind="stable").tolist():
        spot = float(spots[i][0]), float(spots[i][1])
        at = (*spot, eye.at[2])
        here = i == 0
        if math.dist(at, point) > CLOSE * eye.sight or (not here and (room[i] < need or not robot.navigator.free(spot, need, discs))):
            continue
        if looks_towards(robot.scene, at, point, [robot.name]):
            yield spot


def _varied(spots: Iterator[Point]) -> Iterator[Point]:
    """The first ones that are not next to each other."""
    tried: list[Point] = []
    for spot in spots:
        if all(math.dist(spot, other) > 0.8 for other in tried):
            tried.append(spot)
            yield spot
        if len(tried) >= ATTEMPTS:
            return
