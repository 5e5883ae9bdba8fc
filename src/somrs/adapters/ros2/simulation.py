"""Starts the ROS 2 nodes of robots of the simulator, each in a process of its own (`simulated/`)."""

from __future__ import annotations

import asyncio
import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path

from somrs.adapters.ros2.process import ros_command, ros_environment
from somrs.adapters.ros2.settings import RobotSettings, Settings

log = logging.getLogger(__name__)

SOURCE = Path(__file__).parents[3]
"""Where the package `somrs` is."""
PAUSE = 2.0
"""Seconds before nodes that have ended are started again."""


async def run_simulated(settings: Settings, folder: Path, robots: Mapping[str, RobotSettings], simulator: str) -> None:
    """Be the nodes of robots of the simulator at an address, until this is cancelled."""
    async with asyncio.TaskGroup() as tasks:
        for name, robot in robots.items():
            description = {"namespace": robot.namespace, "link": simulator, "robot": name, "origin": robot.levels[0].origin}
            command = ros_command(settings, folder, "-m", "somrs.adapters.ros2.simulated", json.dumps(description))
            tasks.create_task(_run(name, command, settings))


async def _run(name: str, command: list[str], settings: Settings) -> None:
    environment = ros_environment(settings)
    paths = [str(SOURCE), environment.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    while True:
        process = await asyncio.create_subprocess_exec(
            *command, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.DEVNULL, env=environment, start_new_session=True
        )
        assert process.stdin is not None, "it is a pipe"
        try:
            code = await process.wait()
            log.error("the simulated nodes of %s have ended with %s, and are started again", name, code)
        finally:
            process.stdin.close()  # they end then
            await process.wait()
        await asyncio.sleep(PAUSE)
