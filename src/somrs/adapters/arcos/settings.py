"""The settings of the adapter in a site file: `adapters: arcos:`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, Strict

from somrs.adapters.arcos.driver import Battery
from somrs.adapters.arcos.odometry import Pose
from somrs.adapters.arcos.parameters import Parameters, read_parameters
from somrs.adapters.settings import valid_settings
from somrs.errors import Mistake, SettingsError, UsageError
from somrs.ontology.files.documents import Entry, WholeNumber
from somrs.ports import host_and_port

FASTEST = 2.5
"""m/s: no robot with ARCOS drives faster."""
FARTHEST_REACH = 2.0
"""m: no paddles are farther from the centre of a robot."""
REACH, SIMULATED_REACH = 0.35, 0.56
"""From the centre of a robot to the middle of its paddles, and to where the arm of a robot of the simulator puts things, m."""


class RobotSettings(Entry):
    """One robot.

    `port`: `tcp://HOST:PORT`, or a serial line such as `/dev/ttyUSB0`. `baud`: of the serial line. `start`: where the robot stands when
    its program starts, as x and y in metres and the direction in degrees; None: where the map has it. `parameters`: the parameter file of
    the robot; None: the type that the robot says it is. `speed`: with which it drives at most, m/s. `reach`: from its centre to the middle
    of the paddles, m; None: the usual one. `battery`: the voltages of the empty and of the full battery. `dock`: whether it has contacts
    for a charger. `simulated`: a robot of the simulator answers at this port, which has to be one of TCP.
    """

    port: str = Field(examples=["tcp://HOST:PORT", "/dev/ttyUSB0"])
    baud: WholeNumber = Field(default=9600, gt=0)
    start: Annotated[tuple[float, float, float], Strict(False)] | None = Field(default=None, examples=["[2, 1.5, 90]"])
    parameters: str | None = None
    speed: float | None = Field(default=None, gt=0, le=FASTEST, json_schema_extra={"unit": "m/s"})
    reach: float | None = Field(default=None, ge=0, le=FARTHEST_REACH, json_schema_extra={"unit": "m"})
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


class Settings(Entry):
    """All robots, by their names on the map."""

    robots: dict[str, RobotSettings] = Field(examples=["{Robot1: {port: /dev/ttyUSB0}}"])


def read_settings(settings: Mapping[str, Any]) -> Settings:
    """The settings as they are in the site file. Raises SettingsError with all mistakes."""
    return valid_settings("arcos", settings, Settings, _mistakes)


def _mistakes(settings: Settings) -> Iterator[Mistake]:
    ports: dict[str, str] = {}
    for name, robot in settings.robots.items():
        place = ("robots", name)
        if (problem := _port_problem(robot)) is not None:
            yield (*place, "port"), problem
        elif (twin := ports.setdefault(robot.port, name)) != name:
            yield (*place, "port"), f"is {robot.port}, as that of {twin} is: each robot has a port of its own"
        if robot.battery.full <= robot.battery.empty:
            yield (*place, "battery"), "full has to be more than empty: give both in volts"


def _port_problem(robot: RobotSettings) -> str | None:
    port = robot.port
    scheme, separator, rest = port.partition("://")
    if scheme == "tcp" and separator:
        try:
            host_and_port(rest)
        except UsageError:
            return f"{port!r} has no address: write tcp://HOST:PORT, with the number of a port, such as tcp://10.0.0.7:8101"
        return None
    if robot.simulated:
        return f"{port!r} is no address of TCP, at which robots of the simulator are: write tcp://HOST:PORT"
    if separator or port.startswith("/"):
        return None  # pyserial opens other URLs
    with contextlib.suppress(UsageError):
        host_and_port(port)
        return f"{port!r} would be a serial line: write tcp://{port}"
    return f"{port!r} is neither the path of a serial line, such as /dev/{port.strip('/') or 'ttyUSB0'}, nor tcp://HOST:PORT"


def robot_parameters(name: str, settings: RobotSettings, folder: Path) -> Parameters | None:
    """The parameters of a robot's parameter file; None if it has none. Raises SettingsError if the file cannot be read."""
    if settings.parameters is None:
        return None
    path = folder / settings.parameters
    try:
        return read_parameters(path.read_text(encoding="utf-8", errors="replace"), Parameters())
    except OSError as error:
        text = f"{path} cannot be read: {error.strerror}; correct the path, which is relative to the site file, or leave it out"
        raise SettingsError("arcos", [(("robots", name, "parameters"), text)]) from None
