"""The settings of the adapter in a site file: `adapters: arcos:`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from msgspec import Struct

from somrs.adapters.arcos.driver import Battery
from somrs.adapters.arcos.odometry import Pose
from somrs.adapters.arcos.parameters import Parameters, read_parameters
from somrs.adapters.settings import Mistake, read_struct
from somrs.errors import UsageError

REACH, SIMULATED_REACH = 0.35, 0.56
"""From the centre of a robot to the middle of its paddles, and to where the arm of a robot of the simulator puts things, m."""


class RobotSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One robot.

    `port`: `tcp://HOST:PORT`, or a serial line such as `/dev/ttyUSB0`. `baud`: of the serial line. `start`: where the robot stands when
    its program starts, as x and y in metres and the direction in degrees; None: where the map has it. `parameters`: the parameter file of
    the robot; None: the type that the robot says it is. `speed`: with which it drives at most, m/s. `reach`: from its centre to the middle
    of the paddles, m; None: the usual one. `battery`: the voltages of the empty and of the full battery. `dock`: whether it has contacts
    for a charger. `simulated`: a robot of the simulator answers at this port, which has to be one of TCP.
    """

    port: str
    baud: int = 9600
    start: tuple[float, float, float] | None = None
    parameters: str | None = None
    speed: float | None = None
    reach: float | None = None
    battery: Battery = Battery()
    dock: bool = False
    simulated: bool = False

    @property
    def paddles(self) -> float:
        """How far from its centre the robot holds things, m."""
        return self.reach if self.reach is not None else SIMULATED_REACH if self.simulated else REACH

    @property
    def pose(self) -> Pose | None:
        return Pose(x=self.start[0], y=self.start[1], yaw=math.radians(self.start[2])) if self.start is not None else None


class Settings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All robots, by their names on the map."""

    robots: dict[str, RobotSettings]


def read_settings(settings: Mapping[str, Any]) -> Settings:
    """The settings as they are in the site file. Raises SettingsError with all mistakes."""
    examples = {"robots": "robots: {Robot1: {port: /dev/ttyUSB0}}", "port": "port: tcp://HOST:PORT, or port: /dev/ttyUSB0"}
    return read_struct("arcos", settings, Settings, examples, _mistakes)


def _mistakes(settings: Settings) -> Iterator[Mistake]:
    for name, robot in settings.robots.items():
        place = ("robots", name)
        if robot.port.startswith("tcp://") and not robot.port.rpartition(":")[2].isdigit():
            yield (*place, "port"), f"{robot.port!r} has no number of a port: write tcp://HOST:PORT"
        if robot.speed is not None and robot.speed <= 0:
            yield (*place, "speed"), f"{robot.speed} is not positive: give metres per second, such as 0.4"
        if robot.battery.full <= robot.battery.empty:
            yield (*place, "battery"), "full has to be more than empty: give both in volts"


def robot_parameters(name: str, settings: RobotSettings, folder: Path) -> Parameters | None:
    """The parameters of a robot's parameter file; None if it has none. Raises UsageError if the file cannot be read."""
    if settings.parameters is None:
        return None
    path = folder / settings.parameters
    try:
        return read_parameters(path.read_text(encoding="utf-8", errors="replace"), Parameters())
    except OSError as error:
        raise UsageError(
            f"adapters: arcos: robots: {name}: parameters: {path} cannot be read ({error.strerror}): give the path of the robot's "
            "parameter file, from the folder of the site file, or leave it out"
        ) from None
