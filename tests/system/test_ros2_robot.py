"""A whole system with a robot that is connected by ROS 2: traffic grants its ways, and its own nodes drive, pick and drop."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import yaml

from somrs.client.client import Client
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support.accomplishing import accomplish
from tests.support.building import DELIVERY_LAB
from tests.support.ros2.robots import ROOT, ROS, needs_ros2, new_namespace
from tests.system.test_system import running

pytestmark = [needs_ros2, pytest.mark.long]

EXAMPLE = ROOT / "examples" / "ros2_robot.yaml"


@contextlib.asynccontextmanager
async def running_system(folder: Path, namespace: str) -> AsyncIterator[tuple[Client, OperatorLink]]:
    """A system whose Robot1 has its nodes in a namespace: a client of it, and the operator of its simulator."""
    robot = {"binding": str(EXAMPLE), "namespace": namespace, "simulated": True}
    site = folder / "site.yaml"
    site.write_text(f"{DELIVERY_LAB}\n{yaml.safe_dump({'adapters': {'ros2': {**ROS, 'robots': {'Robot1': robot}}}})}")
    async with running(folder / "data", site, speed="1", world=WorldKind.KINEMATIC) as (_, client, operator):
        yield client, operator


def nodes_of(namespace: str) -> int:
    """The process of the nodes in a namespace."""
    commands = {file.parent.name: file.read_bytes() for file in Path("/proc").glob("[0-9]*/cmdline")}
    words = b"somrs.adapters.ros2.simulated", namespace.encode()
    (process,) = (int(pid) for pid, command in commands.items() if all(word in command for word in words))
    return process


def test_a_task_is_accomplished_by_a_robot_with_ros2(tmp_path: Path) -> None:
    async def run() -> None:
        async with running_system(tmp_path, new_namespace()) as (client, _):
            for effect in ("Jar1 isOn Table2", "Robot1 isAt Dock1"):
                view = await accomplish(client, effect)
                assert view.outcome == "accomplished", view.explanation

    asyncio.run(run())


def test_a_task_is_accomplished_although_the_nodes_of_the_robot_die_on_the_way(tmp_path: Path) -> None:
    async def run() -> None:
        namespace = new_namespace()
        async with running_system(tmp_path, namespace) as (client, operator):
            task = asyncio.create_task(accomplish(client, "Robot1 isAt Dock1"))
            while (await operator.robots())["Robot1"].x < 3.2:
                await asyncio.sleep(0.1)
            os.kill(nodes_of(namespace), signal.SIGKILL)
            view = await task
            assert view.outcome == "accomplished", view.explanation

    asyncio.run(run())
