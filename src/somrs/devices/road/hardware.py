"""The robot itself, as its link and its program in traffic use it."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from somrs.devices.road.building import Building
from somrs.devices.road.member import WholeMap
from somrs.devices.road.motion import Experience, Motion
from somrs.devices.road.waypoints import Way
from somrs.space.solids import Point


class RobotFailed(Exception):
    """The robot could not do what it was told. `description`: why, for people. `is_lost`: the thing that it was to take may be elsewhere
    now; otherwise it is where it was, or in its gripper. `is_unsure`: what did it has ended, and nobody knows how far it came; it is done
    again when that is back."""

    def __init__(self, description: str, *, is_lost: bool = False, is_unsure: bool = False) -> None:
        self.description, self.is_lost, self.is_unsure = description, is_lost, is_unsure
        super().__init__(description)


class Vehicle(Protocol):
    """The robot, as `devices/road_robot.py` describes it for authors."""

    name: str
    battery: float | None
    hindrance: str | None
    remark: str | None
    holding: str | None
    spot: Point | None
    carries: bool | None
    deviation: float
    reconnect_timeout: float
    data: Path
    whole_map: WholeMap
    building: Building
    experience: Experience

    @property
    def motion(self) -> Motion: ...

    def report_problem(self, problem: str | None) -> None: ...

    async def follow(self, way: Way) -> None: ...

    async def halt(self) -> None: ...

    async def charge_at(self, charger: str) -> None: ...

    async def pick(self, thing: str, support: str) -> None: ...

    async def drop(self, thing: str, support: str) -> None: ...

    async def put_down(self, thing: str) -> tuple[float, float, float, str]: ...

    async def interrupt(self) -> None: ...
