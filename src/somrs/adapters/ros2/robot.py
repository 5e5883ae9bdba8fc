"""The device of a robot with ROS 2, which a binding file describes: it needs no class of its own."""

from __future__ import annotations

import logging

from somrs.adapters.ros2.connection import RobotConnection
from somrs.adapters.ros2.frames import Pose
from somrs.adapters.ros2.session import Session
from somrs.adapters.ros2.settings import Binding, RobotSettings
from somrs.devices.road_robot import CarryingRobot, Motion, RobotFailed, Way
from somrs.ontology.types import Value
from somrs.service_manager.sdk.values import as_term

log = logging.getLogger(__name__)

UNSEEN = 0.25
"""How far a robot may drive until its localisation says so, m: AMCL's `update_min_d`."""


MOST_CHARGE = 110.0
"""Percent: gauges of full batteries may say a little more than 100, and what is scaled wrongly says much more."""


class Ros2Robot(CarryingRobot):
    """A robot with ROS 2, in the traffic of its building."""

    def __init__(self, name: str, settings: RobotSettings, binding: Binding, session: Session) -> None:
        super().__init__(name)
        self.can_charge, self.can_carry = binding.charge is not None, bool(binding.pick)
        self._full = binding.charge.full if binding.charge is not None else 100.0
        self._is_misread = False
        self._moves, self.deviation = binding.moves, binding.navigate.corridor + UNSEEN
        self._connection = RobotConnection(name, settings, binding, session, self)

    async def open(self) -> None:
        self.heard(False)
        self._connection.open()
        await super().open()

    async def close(self) -> None:
        await super().close()
        self._connection.close()

    @property
    def motion(self) -> Motion:
        moves = self._moves
        return Motion(speed=moves.speed, acceleration=moves.acceleration, turning=moves.turning, handling=moves.handling)

    # What traffic and the services tell the robot

    async def follow(self, way: Way) -> None:
        self._connection.follow(way)

    async def halt(self) -> None:
        await self._connection.halt()

    async def pick(self, thing: str, support: str) -> None:
        await self._connection.pick(thing, support, self._object_pose(thing))

    async def drop(self, thing: str, support: str) -> None:
        pose = self._object_pose(support)
        await self._connection.drop(thing, support, Pose(*self.spot, pose.yaw) if self.spot is not None else pose)

    async def put_down(self, thing: str) -> tuple[float, float, float, str]:
        return (*await self._connection.put_down(thing), "")

    async def charge_at(self, charger: str) -> None:
        await self._connection.charge(charger, self._object_pose(charger))

    async def interrupt(self) -> None:
        await self._connection.interrupt()

    # What the robot says

    def hindered(self, hindrance: str | None) -> None:
        """What keeps the robot from doing what it is told."""
        if hindrance != self.remark:
            self.remark = hindrance
            if hindrance is not None:
                log.warning("%s", hindrance)
            self.road.renew_state()

    def measured(self, attribute: str, value: Value) -> None:
        """An attribute of the robot has this value."""
        if attribute == "Charge":
            level = float(value) if isinstance(value, int | float) else None
            self.battery = self._charge(level) if level is not None and 0 <= level <= MOST_CHARGE else None
            if level is not None and self.battery is None and not self._is_misread:
                self._is_misread = True
                advice = "correct the `scale` of attributes.Charge in its binding, which makes percent of what the topic says"
                self.hindered(f"its battery cannot have a charge of {level:g} %, so that it is not known: {advice}")
        else:
            self.observed(f"{self.name}.{attribute} = {as_term(value)}")

    def _charge(self, level: float) -> float:
        """The charge in percent of that to which the battery is charged: a battery that is charged no further is full."""
        return min(100.0, 100.0 * level / self._full)

    def _object_pose(self, name: str) -> Pose:
        """The pose of an object of the map. Raises RobotFailed."""
        solid = self.building.solids.get(name)
        if solid is None:
            raise RobotFailed(f"the map does not say where {name} is")
        return Pose(solid.x, solid.y, solid.yaw)
