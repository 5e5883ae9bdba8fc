"""Real ROS 2 nodes for tests: simulated robots in processes of their own, and the adapter's connection to them."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import itertools
import json
import math
import os
import signal
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator, Callable, Coroutine
from pathlib import Path
from typing import Any, Self

import pytest

from somrs.adapters.ros2.connection import RobotConnection
from somrs.adapters.ros2.lines import Values
from somrs.adapters.ros2.process import BridgeProcess, ros_environment
from somrs.adapters.ros2.settings import Binding, RobotSettings, read_settings
from somrs.devices.road_robot import Way, Waypoint
from somrs.ontology.types import Value
from tests.support import leftovers

ROOT = Path(__file__).parents[3]
PYTHON = ROOT / ".venv-ros2" / "bin" / "python"
DOMAIN = os.getpid() % 100 + 1
"""Tests that run at the same time do not hear each other's nodes: domains above 101 need ports that programs may have."""
ROS = {
    "python": str(PYTHON),
    "domain": DOMAIN,
    "discovery": "LOCALHOST",
    "environment": {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"},
}
"""Settings of the adapter. Nodes that are killed leave their shared memory."""
SHORT_LEASE = Path(__file__).with_name("short_lease.xml")

needs_ros2 = pytest.mark.usefixtures("ros2")

PATIENCE = 120.0
"""Seconds for a test."""

_numbers = itertools.count(1)


def in_event_loop(test: Callable[[], Coroutine[Any, Any, None]]) -> Callable[[], None]:
    """Run a test in an event loop of its own."""

    @functools.wraps(test)
    def run() -> None:
        async def limited() -> None:
            async with asyncio.timeout(PATIENCE):
                await test()

        asyncio.run(limited())

    return run


def environment() -> dict[str, str]:
    """The environment of a node."""
    settings = read_settings({**ROS, "robots": {"Robot1": {"binding": "none.yaml"}}})
    return {**ros_environment(settings), "PYTHONPATH": str(ROOT / "src"), "FASTDDS_DEFAULT_PROFILES_FILE": str(SHORT_LEASE)}


def way(*points: tuple[float, float], first: int = 0, level: float = 0.0) -> Way:
    """Released waypoints."""
    return tuple(Waypoint(number=first + n, name=f"P{first + n}", x=x, y=y, level=level, released=True) for n, (x, y) in enumerate(points))


def new_namespace() -> str:
    """A namespace that no other robot has."""
    return f"test{os.getpid()}_{next(_numbers)}"


class RobotProcess:
    """A simulated robot, in a process. It ends as processes end that are told to, unless it was killed before."""

    def __init__(self, **description: Any) -> None:
        self.namespace = new_namespace()
        self._description = {"namespace": self.namespace, **description}
        self.process: Process | None = None

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self.process is not None
        assert self.process.stdin is not None
        self.process.stdin.close()
        await self.process.wait()

    async def start(self, **changes: Any) -> None:
        """Start the robot; also again, after it was killed."""
        command = [str(PYTHON), "-m", "somrs.adapters.ros2.simulated", json.dumps({**self._description, **changes})]
        self.process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, env=environment())
        assert self.process.stdout is not None
        assert await self.process.stdout.readline() == b"ready\n"

    async def tell(self, text: str) -> None:
        """Have the robot behave so. Returns when it does."""
        assert self.process is not None
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(text).encode() + b"\n")
        assert await self.process.stdout.readline() == b"done\n"

    async def kill(self) -> None:
        assert self.process is not None
        self.process.send_signal(signal.SIGKILL)
        await self.process.wait()


class Witness:
    """Notes what the robot says; `until` waits for it."""

    def __init__(self) -> None:
        self.pose: tuple[float, float, float, float | None] = (math.nan, math.nan, math.nan, None)
        self.passed_numbers: list[int] = []
        self.reasons: list[str] = []
        self.faults: list[str | None] = []
        self.losses: list[str | None] = []
        self.presence: list[bool] = []
        self.absence: str | None = None
        self.x_when_present = math.nan
        self.hindrances: list[str | None] = []
        self.values: dict[str, list[Value]] = {}
        self._change = asyncio.Event()

    def located(self, x: float, y: float, yaw: float, level: float | None = None) -> None:
        self.pose = (x, y, yaw, level)
        self._change.set()

    def passed(self, number: int) -> None:
        self.passed_numbers.append(number)
        self._change.set()

    def gave_up(self, description: str) -> None:
        self.reasons.append(description)
        self._change.set()

    def broken(self, reason: str | None) -> None:
        self.faults.append(reason)
        self._change.set()

    def lost(self, reason: str | None) -> None:
        self.losses.append(reason)
        self._change.set()

    def heard(self, is_connected: bool, reason: str | None = None) -> None:
        was_connected = bool(self.presence) and self.presence[-1]
        if is_connected is not was_connected:
            self.presence.append(is_connected)
        self.absence = reason
        self.x_when_present = self.pose[0]
        self._change.set()

    def hindered(self, hindrance: str | None) -> None:
        self.hindrances.append(hindrance)
        self._change.set()

    def measured(self, attribute: str, value: Value) -> None:
        self.values.setdefault(attribute, []).append(value)
        self._change.set()

    async def until(self, holds: Callable[[], bool]) -> None:
        while not holds():
            self._change.clear()
            await self._change.wait()


@contextlib.asynccontextmanager
async def running_bridge() -> AsyncIterator[BridgeProcess]:
    """The bridge, with the Python of .venv-ros2."""
    bridge = BridgeProcess(read_settings({**ROS, "robots": {"Robot1": {"binding": "none.yaml"}}}), ROOT)
    running = asyncio.create_task(bridge.run())
    try:
        yield bridge
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


def bridge_process() -> int:
    """The id of the only bridge that this test has."""
    (bridge,) = [pid for pid, command in leftovers.processes().items() if "adapters/ros2/bridge" in command]
    return bridge


@contextlib.asynccontextmanager
async def listening_to(robot: RobotProcess) -> AsyncIterator[Witness]:
    """A witness of where a robot is, that sends it nothing."""
    witness = Witness()

    def take(message: Values) -> None:
        position = message["pose"]["pose"]["position"]
        witness.located(position["x"], position["y"], 0.0)

    async with running_bridge() as bridge:
        bridge.session.subscribe(f"/{robot.namespace}/amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", take, interval=0.05)
        yield witness


@contextlib.asynccontextmanager
async def started(
    robot: RobotProcess | str, binding: dict[str, Any], settings: dict[str, Any] | None = None
) -> AsyncIterator[tuple[RobotConnection, Witness]]:
    """The connection of the adapter to a robot, or to that of a namespace."""
    namespace = robot.namespace if isinstance(robot, RobotProcess) else robot
    async with running_bridge() as bridge:
        witness = Witness()
        robot_settings = RobotSettings.model_validate({"binding": "none.yaml", "namespace": namespace, **(settings or {})})
        connection = RobotConnection("Robot1", robot_settings, Binding.model_validate(binding), bridge.session, witness)
        connection.open()
        yield connection, witness
        connection.close()


@contextlib.asynccontextmanager
async def connected(
    robot: RobotProcess | str, binding: dict[str, Any], settings: dict[str, Any] | None = None
) -> AsyncIterator[tuple[RobotConnection, Witness]]:
    """The same, when the navigation of the robot is there."""
    async with started(robot, binding, settings) as (connection, witness):
        await witness.until(lambda: witness.presence == [True])
        yield connection, witness
