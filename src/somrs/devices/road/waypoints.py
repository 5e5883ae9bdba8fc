"""The ways that robots of any make are told to follow."""

from __future__ import annotations

from msgspec import Struct


class Waypoint(Struct, frozen=True, kw_only=True):
    """A place on the way of a robot, which drives there from the one before in a straight line.

    `number`: grows by one from waypoint to waypoint, for as long as the program runs, so that a place that is visited twice has two
    numbers; ways that follow each other share the numbers of the waypoints that they share. `name`: that of the place in traffic. `x`,
    `y`: in metres on the map. `level`: the height of its floor, in metres. `released`: the robot may drive there; others are planned, and
    can change. `speed_limit`: of the lane that leads there, in metres per second; None: as fast as the robot may. `travel`: `Forward` or
    `Backward`, if the robot may not choose. `yaw`: the heading that it is to have there, in radians, if it stops there; None: any.
    """

    number: int
    name: str
    x: float
    y: float
    level: float
    released: bool
    speed_limit: float | None = None
    travel: str | None = None
    yaw: float | None = None


Way = tuple[Waypoint, ...]
"""Waypoints with consecutive numbers. The first is the one that the robot has passed last, or at which it stands: it is always released."""
