"""The base class for mobile robots of any make: traffic grants them their ways, and they drive along them.

    class AcmeRobot(RoadRobot):
        async def follow(self, way: Way) -> None: ...   # drive along the released waypoints
        async def halt(self) -> None: ...               # stand still, wherever it is

The robot's program says where the robot is: `located`, `passed`, `broken`, `heard`. The rest is done here: entering traffic, trips, leases,
waiting before lifts and doors, quotes by the roadmap, the service MoveTo.
"""

from __future__ import annotations

from msgspec import Struct

from somrs.service_manager.sdk.device import Device


class Waypoint(Struct, frozen=True, kw_only=True):
    """A place on the way of a robot, which drives there from the one before in a straight line.

    `number`: grows by one from waypoint to waypoint, for as long as the program runs, so that a place that is visited twice has two
    numbers; ways that follow each other share the numbers of the waypoints that they share. `name`: that of the place in traffic. `x`,
    `y`: in metres on the map. `level`: the height of its floor, in metres. `released`: the robot may drive there; others are planned,
    and can change. `speed_limit`: of the lane that leads there, in metres per second; None: as fast as the robot may. `travel`:
    `Forward` or `Backward`, if the robot may not choose.
    """

    number: int
    name: str
    x: float
    y: float
    level: float
    released: bool
    speed_limit: float | None = None
    travel: str | None = None


Way = tuple[Waypoint, ...]
"""Waypoints with consecutive numbers. The first is the one that the robot has passed last, or at which it stands: it is always released."""


class RoadRobot(Device):
    """A mobile robot in the traffic of its building."""

    async def follow(self, way: Way) -> None:
        """Drive along the way, up to its last released waypoint, and stop there. Returns at once.

        Called anew whenever the way changes: more is released, or what is planned is another way. What was released stays released,
        until the robot has been told to `halt`.
        """
        raise NotImplementedError

    async def halt(self) -> None:
        """Stand still, wherever the robot is. Returns when it stands. What was released is not, any more."""
        raise NotImplementedError

    def located(self, x: float, y: float, yaw: float, level: float | None = None) -> None:
        """The robot is at this pose, in metres and radians on the map; `level`: the height of its floor, None: as before. Call it
        with every state of the robot."""

    def passed(self, number: int) -> None:
        """The robot has come to the waypoint of this number, or driven past it."""

    def gave_up(self, description: str) -> None:
        """The robot does not drive on along its way, and stands: something is in the way, for example. The trip fails with this
        description."""

    def broken(self, reason: str | None) -> None:
        """The robot cannot drive, for this reason, until somebody mends it; None: it can again."""

    def heard(self, is_connected: bool) -> None:
        """Whether the robot can be reached. What it does meanwhile goes on, or is taken up again, when it is there again."""


class RobotFailed(Exception):
    """The robot could not do what it was told. `description`: why, for people."""

    def __init__(self, description: str) -> None:
        self.description = description
        super().__init__(description)


class CarryingRobot(RoadRobot):
    """A mobile robot that takes things from one support to another: the services TransferObject and ChargeBattery besides MoveTo."""

    holding: str | None = None
    """The thing that it carries, by its name on the map."""

    async def pick(self, thing: str, support: str) -> None:
        """Take a thing from its support, from where the robot stands. Returns when it carries the thing. Raises RobotFailed."""
        raise NotImplementedError

    async def drop(self, thing: str, support: str) -> None:
        """Put the thing that it carries on a support, from where the robot stands. Raises RobotFailed."""
        raise NotImplementedError

    async def charge(self, charger: str) -> None:
        """Charge the battery at the charger at which the robot stands. Returns when it is full. Raises RobotFailed."""
        raise NotImplementedError

    async def interrupt(self) -> None:
        """End `pick`, `drop` or `charge`, as soon as this is safe. Returns when the robot does nothing."""
        raise NotImplementedError
