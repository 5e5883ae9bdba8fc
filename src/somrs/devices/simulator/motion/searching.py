"""Searching: a robot drives to where it can see a place, turns around, and stops as soon as it sees the object.

These are routines, as in `driving.py`. They add what they see to the `observations` of the caller.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from somrs.devices.simulator.link.commands import Likeness, ObjectState
from somrs.devices.simulator.motion.approach import ranked
from somrs.devices.simulator.motion.arm import withdraw
from somrs.devices.simulator.motion.driving import MARGIN, drive_to, floor_things, robot_discs, turn_to
from somrs.devices.simulator.motion.robot import GivenUp, Robot, Routine, stand
from somrs.devices.simulator.world.recognition import look_alikes
from somrs.devices.simulator.world.vision import Place, eye_of, looks_towards, view, visible
from somrs.space.distances import Array
from somrs.space.solids import Point

DISTANCES = (0.9, 1.3, 1.8, 2.5, 3.3)
"""Distances from which a place is observed, m."""
CLOSE = 0.6
"""Largest distance for observing a place, as a fraction of the camera's range."""
ATTEMPTS = 4
"""Number of viewpoints that are tried for a place."""
GLANCE = 0.1
"""Time between two checks whether the object is in view, s."""


@dataclass(frozen=True, slots=True)
class Sought:
    """What ends a search when it is seen: a landmark by its name, or anything of this likeness. Without both, nothing does."""

    object: str | None = None
    like: Likeness | None = None

    def in_view(self, robot: Robot) -> bool:
        names = (self.object,) if self.object is not None else look_alikes(robot.scene, self.like) if self.like is not None else ()
        return any(visible(robot.scene, robot.name, name) for name in names)

    def is_among(self, robot: Robot, observations: Mapping[str, ObjectState]) -> bool:
        return self.object in observations or (
            self.like is not None and any(name in observations for name in look_alikes(robot.scene, self.like))
        )


def look_at(robot: Robot, point: Place, sought: Sought, observations: dict[str, ObjectState]) -> Routine:
    """Drive to where the point is in view, and face it; stop earlier when the object comes into view. Raises GivenUp."""
    yield from withdraw(robot)
    problem = GivenUp("unreachable", f"there is no place from which {robot.name} could see ({point[0]:.2f}, {point[1]:.2f})")
    for x, y in _varied(_viewpoints(robot, point)):
        yaw = math.atan2(point[1] - y, point[0] - x)
        try:
            yield from _move_until_seen(robot, drive_to(robot, (x, y), yaw, patience=4.0), sought)
        except GivenUp as failure:
            if not failure.leaves_other_places:
                raise
            problem = failure
        else:
            _note(robot, observations)
            return
    raise problem


def look_around(robot: Robot, sought: Sought, observations: dict[str, ObjectState]) -> Routine:
    """Turn once around, and record everything that comes into view; stop earlier when the object does."""
    yield from withdraw(robot)
    _note(robot, observations)
    view, start = robot.solid.view, robot.pose()[2]
    turns = math.ceil(math.tau / (0.8 * view)) if view < math.tau else 1
    for i in range(1, turns):
        if sought.is_among(robot, observations):
            return
        yield from _move_until_seen(robot, turn_to(robot, start + i * math.tau / turns), sought)
        _note(robot, observations)


def _note(robot: Robot, observations: dict[str, ObjectState]) -> None:
    observations.update({object_state.object: object_state for object_state in view(robot.scene, robot.name)})


def _move_until_seen(robot: Robot, moving: Routine, sought: Sought) -> Routine:
    """Run a routine until the object is seen, and then stand still: where a robot says that it is, it is to be."""
    glance_periods = max(1, round(GLANCE / robot.period))
    for period, _ in enumerate(moving):
        if period % glance_periods == 0 and sought.in_view(robot):
            moving.close()
            yield from stand(robot)
            return
        yield


def _viewpoints(robot: Robot, point: Place) -> Iterator[Point]:
    """Places from which the robot sees the point, nearest first, and close enough to see its surroundings, too."""
    (x, y, _), min_clearance = robot.pose(), robot.size.radius + MARGIN
    eye = eye_of(robot.scene, robot.name)
    angles = np.arange(16) * (math.pi / 8)
    ring = [
        (point[0] + r * math.cos(angle), point[1] + r * math.sin(angle)) for r in DISTANCES if r < CLOSE * eye.sight for angle in angles
    ]
    spots: Array = np.array([(x, y), *ring])
    costs = 0.8 * np.hypot(spots[:, 0] - point[0], spots[:, 1] - point[1])
    room = robot.scene.room(spots, robot.solid.z)
    discs = [*floor_things(robot), *robot_discs(robot.staying_robots())]
    for i in ranked(robot, spots, costs, 1.0):
        spot = float(spots[i][0]), float(spots[i][1])
        eye_position = (*spot, eye.position[2])
        is_current = i == 0
        if math.dist(eye_position, point) > CLOSE * eye.sight or (
            not is_current and (room[i] < min_clearance or not robot.free_space.free(spot, min_clearance, discs))
        ):
            continue
        if looks_towards(robot.scene, eye_position, point, [robot.name]):
            yield spot


def _varied(spots: Iterator[Point]) -> Iterator[Point]:
    """The first spots that are more than 0.8 m apart, at most `ATTEMPTS`."""
    selected: list[Point] = []
    for spot in spots:
        if all(math.dist(spot, selected_spot) > 0.8 for selected_spot in selected):
            selected.append(spot)
            yield spot
        if len(selected) >= ATTEMPTS:
            return
