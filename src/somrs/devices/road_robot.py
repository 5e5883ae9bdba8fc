"""The base classes for mobile robots of any make: traffic grants them their ways, and they drive along them.

    class AcmeRobot(RoadRobot):
        async def follow(self, way: Way) -> None: ...   # drive along the released waypoints
        async def halt(self) -> None: ...               # stand still, wherever it is

The robot's program says where the robot is: `located`, `passed`, `broken`, `heard`. The rest is done here: entering traffic, trips, leases,
waiting before lifts and doors, and the driver that simulated robots have, with its services, quotes, and recovery.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Collection, Mapping

from somrs.devices.own_names import FOR_ALL, check_own_names
from somrs.devices.road.building import Building
from somrs.devices.road.hardware import RobotFailed
from somrs.devices.road.link import RoadLink
from somrs.devices.road.member import WholeMap
from somrs.devices.road.motion import Experience, Motion
from somrs.devices.road.waypoints import Way, Waypoint
from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.devices.simulator.drivers.mobile_robot import MobileRobot
from somrs.devices.simulator.drivers.simulated import Pose
from somrs.devices.simulator.link.command_link import CommandLink
from somrs.devices.simulator.link.commands import RobotState
from somrs.errors import RemoteError
from somrs.ontology.map import Map
from somrs.ontology.modes import is_stopped
from somrs.ontology.types import Ontology
from somrs.service_manager.sdk.device import Service, Task
from somrs.space.solids import Point

__all__ = ["CarryingRobot", "Motion", "RoadRobot", "RobotFailed", "Way", "Waypoint"]

FOR_AUTHORS = FOR_ALL | {
    *("follow", "halt", "pause", "resume", "charge_at", "pick", "drop", "put_down", "interrupt", "motion"),
    *("battery", "holding", "carries", "hindrance", "remark", "deviation", "can_charge", "can_carry"),
    *("silence", "reconnect_timeout", "carrying_patience", "price", "price_per_metre", "features", "driving_time", "handling_time"),
}
"""What authors of robots set and override."""

STOPS = 0.5
"""Seconds between two looks at the map for whether an operator has stopped the robot."""


async def _no_map(*, is_current: bool = True) -> tuple[Map, Ontology]:
    raise RemoteError("no program runs the robot, so that it has no map")


class RoadRobot(MobileRobot):
    """A mobile robot in the traffic of its building, with the service MoveTo."""

    type = "MobileRobot"
    silence = reconnect_timeout = 6.0
    battery: float | None = None
    """The charge of its battery in percent; None if nobody knows. Set it before `located`."""
    holding: str | None = None
    """The thing that it carries, by its name on the map."""
    spot: Point | None = None
    """The point of a support over which it is to drop what it carries, m: it was told to stand before that, and to look there."""
    carries: bool | None = None
    """Whether it carries something, as it says itself; None: it cannot tell. Set it before `located`."""
    hindrance: str | None = None
    """What keeps it from going on, and will pass without it, for people. Set it before `located`."""
    remark: str | None = None
    """What it says of itself that does not keep it from going on, for people. Set it before `located`."""
    deviation: float = 1.0
    """How far from where it has come to it may be by its pose, m. One that is farther has not come there."""
    can_charge: bool = False
    """Whether it can charge its battery."""

    def __init_subclass__(cls, *, replaces: Collection[str] = ()) -> None:
        """`replaces`: further names of the base classes that the class replaces on purpose. Raises DeviceError for those that it uses by
        mistake."""
        super().__init_subclass__()
        check_own_names(cls, FOR_AUTHORS.union(replaces))

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self._working, self._known_broken, self._reported_charge = 0, False, None  # a state may come before the device is opened
        self._road_link = RoadLink(self, self._notice_state)
        self.road = self._road_link.traveller
        """Drives where traffic lets it; the program that runs the device connects it to traffic."""
        self.whole_map: WholeMap = _no_map
        """The map as it is, and the ontology; the program that runs the device sets it."""
        self.experience = Experience()
        self.building = Building()
        """What is known of the building; robots of one process share it."""

    def _make_link(self) -> CommandLink:
        return self._road_link

    async def open(self) -> None:
        """Connect to the robot, and call this: it waits for the first state of the robot."""
        await super().open()
        self.keep_doing(self._follow_stops())

    async def _follow_stops(self) -> None:
        """Have the robot stand still while an operator has stopped it, or paused its task."""
        is_paused: bool | None = None
        while True:
            with contextlib.suppress(RemoteError):
                map, ontology = await self.whole_map(is_current=False)
                if (stopped := is_stopped(self.name, map, ontology)) is not is_paused:
                    is_paused = stopped
                    if not is_paused:
                        self.road.confirm()
                    await (self.pause() if is_paused else self.resume())
            await asyncio.sleep(STOPS)

    def services(self) -> Mapping[str, Service]:
        offered = {"move_to", *(("charge",) if self.can_charge else ())}
        return {name: service for name, service in super().services().items() if name in offered}

    async def driving_time(self, task: Task, way: float) -> float:
        return self.experience.ratio * way / self.road.driver().solid.speed

    @property
    def _needs_charge(self) -> bool:
        return self.can_charge and super()._needs_charge

    # For authors: what the robot is told

    async def follow(self, way: Way) -> None:
        """Drive along the way, up to its last released waypoint, and stop there. Returns at once.

        Called anew whenever the way changes: more is released, or what is planned is another way. What was released stays released,
        until the robot has been told to `halt`.
        """
        raise NotImplementedError

    async def halt(self) -> None:
        """Stand still, wherever the robot is. Returns when it stands. What was released is not, any more."""
        raise NotImplementedError

    async def pause(self) -> None:
        """Stand still at once, because an operator wants it, until `resume` is called. What was released stays released; the way may
        change meanwhile. Here, driving stops; a robot that can pause what it works on overrides both."""
        await self.road.pause()

    async def resume(self) -> None:
        """Go on along the way as it is now."""
        await self.road.resume()

    async def charge_at(self, charger: str) -> None:
        """Charge the battery at the charger at which the robot stands. Returns when it is full. Raises RobotFailed."""
        raise NotImplementedError

    async def pick(self, thing: str, support: str) -> None:
        """Take a thing from its support, from where the robot stands. Returns when it carries the thing. Raises RobotFailed."""
        raise RobotFailed(f"{self.name} cannot carry anything")

    async def drop(self, thing: str, support: str) -> None:
        """Put the thing that it carries on a support, from where the robot stands. Raises RobotFailed."""
        raise RobotFailed(f"{self.name} cannot carry anything")

    async def put_down(self, thing: str) -> tuple[float, float, float, str]:
        """Put the thing that it carries down where it stands, because its task has ended. Returns the point in metres, and what the thing
        stands on; empty: the floor. Raises RobotFailed if it cannot: then the robot brings the thing back to where it was."""
        raise RobotFailed(f"{self.name} cannot put {thing} down where it stands")

    async def interrupt(self) -> None:
        """End what the robot works on, such as picking, dropping or charging, as soon as this is safe. Returns when it does nothing."""
        raise NotImplementedError

    @property
    def motion(self) -> Motion:
        """How it moves, and handles things; its quotes come from there, and from how long it took before."""
        return Motion()

    # For authors: what the robot says

    def located(self, x: float, y: float, yaw: float, level: float | None = None) -> None:
        """The robot is at this pose, in metres and radians on the map; `level`: the height of its floor, None: as before. Call it
        with every state of the robot, also if it stands still. A pose where nothing can stand is not believed."""
        self.road.located(x, y, yaw, level)

    def passed(self, number: int) -> None:
        """The robot has come to the waypoint of this number, or driven past it. It has not if its pose is farther than `deviation` from
        there and from the way that follows: then its trip fails."""
        self.road.passed(number)

    def gave_up(self, description: str) -> None:
        """The robot does not drive on along its way, and stands: something is in the way, for example. The trip fails with this
        description."""
        self.road.gave_up(description)

    def broken(self, reason: str | None) -> None:
        """The robot cannot drive, for this reason (`its stop is pressed`), until somebody mends it; None: it can again."""
        self.road.broken(reason)

    def lost(self, reason: str | None) -> None:
        """The robot does not know where it is, for this reason (`nothing is heard of its scanner`); None: it knows again. Meanwhile, it is
        halted, and keeps its places in traffic."""
        self.road.lost(reason)

    def heard(self, is_connected: bool, reason: str | None = None) -> None:
        """Whether the robot can be reached, and why not, for people, as far as it is known. What it does meanwhile goes on, or is taken up
        again, when it is there again."""
        self.road.heard(is_connected, reason)


class CarryingRobot(RoadRobot, Manipulator):
    """A mobile robot that takes things from one support to another: the service TransferObject besides."""

    type = "MobileManipulator"
    can_carry: bool = True
    """Whether it can pick and drop things."""
    carrying_patience: float = 120.0
    """Seconds for which a robot that cannot be reached keeps its task while it may carry something: nobody else can go on with that."""
    _place_is_due: bool = True
    """Whether the map may have forgotten where the thing is with which the robot had to do last."""

    @property
    def lost_link_patience(self) -> float:
        may_carry = self.holding is not None or self._road_link.gripper.is_working
        return self.carrying_patience if may_carry else self.reconnect_timeout

    def heard(self, is_connected: bool, reason: str | None = None) -> None:
        self._place_is_due = self._place_is_due or is_connected
        super().heard(is_connected, reason)

    async def _notice_idle(self, state: RobotState, pose: Pose) -> None:
        await super()._notice_idle(state, pose)
        gripper = self._road_link.gripper
        if self._place_is_due and gripper.held is None:
            if gripper.place is not None and not await self._is_on_map(gripper.place.object):
                self.observed(await self._situation(state, gripper.place.object, (gripper.place,)))
            self._place_is_due = False

    async def _is_on_map(self, thing: str) -> bool:
        """Whether the map says where a thing is."""
        places = [await self.map.query(f"{thing} {relation} ?Place", limit=1) for relation in ("isOn", "isIn", "isHeldBy")]
        return any(places)

    async def open(self) -> None:
        await super().open()
        held_on_map = [str(row["Thing"]) for row in await self.map.query(f"?Thing isHeldBy {self.name}")]
        self._road_link.gripper.load(held_on_map)
        for thing in held_on_map:
            if thing != self.holding:
                self.observed(f"NOT {thing} isHeldBy {self.name}")

    @property
    def handling_time(self) -> float:
        return self.motion.handling

    def services(self) -> Mapping[str, Service]:
        offered = {"move_to", *(("charge",) if self.can_charge else ()), *(("transfer",) if self.can_carry else ())}
        return {name: service for name, service in Manipulator.services(self).items() if name in offered}
