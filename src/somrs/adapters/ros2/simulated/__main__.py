"""Runs a simulated robot: `python -m somrs.adapters.ros2.simulated '{"namespace": "robot1", "pose": [0, 0, 0]}'`.

Settings, in JSON: `namespace`; `pose`, `things`, `speed` and `battery` of a body that only moves; or `link`, the address of a simulator,
`robot`, and `origin`: where the robot's own map is on that of the building; `grid`, width and height in cells, for a map; `managed`: its
node is inactive at first. It ends when its input ends.
"""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import sys
import threading
from typing import Any

import msgspec
import rclpy
from msgspec import Struct
from rclpy.executors import MultiThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from somrs.adapters.ros2.simulated.body import KinematicBody
from somrs.adapters.ros2.simulated.link_body import LinkBody
from somrs.adapters.ros2.simulated.nodes import SimulatedRobot, obey

PATIENCE = 5
"""Seconds for an orderly end when the input has ended."""
THREADS = 8
"""A goal that is under way occupies one."""


class RobotDescription(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The settings of a simulated robot."""

    namespace: str = ""
    link: str | None = None
    robot: str = ""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    things: dict[str, tuple[float, float]] = {}
    speed: float = 1.0
    battery: float = 1.0
    grid: tuple[int, int] | None = None
    managed: bool = False


async def _end_with_input(lines: asyncio.StreamReader) -> None:
    """Have the process end soon after its input, also while it waits for the simulator, or for the middleware."""
    while not lines.at_eof():
        await asyncio.sleep(0.1)
    signal.alarm(PATIENCE)  # the middleware may hang with the lock of the interpreter


async def run(description: RobotDescription, node: Any) -> None:
    """Run the robot until the input ends."""
    loop = asyncio.get_running_loop()
    lines = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    watching = asyncio.create_task(_end_with_input(lines))
    body: KinematicBody | LinkBody
    if description.link is not None:
        body = LinkBody(description.link, description.robot, description.origin)
        await body.open()
    else:
        body = KinematicBody(description.pose, description.things, description.speed, description.battery)
    robot = SimulatedRobot(node, description.namespace, body, loop, description.grid)
    if description.managed:
        robot.manage()
    publishing = asyncio.create_task(robot.publish())
    executor = MultiThreadedExecutor(THREADS)
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    print("ready", flush=True)
    await obey(robot, lines)
    publishing.cancel()
    await watching
    executor.shutdown(timeout_sec=1.0)
    robot.close()
    if isinstance(body, LinkBody):
        await body.close()


def main() -> None:
    description = msgspec.json.decode(sys.argv[1], type=RobotDescription)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(f"{description.namespace.strip('/').replace('/', '_') or 'robot'}_simulated")
    asyncio.run(run(description, node))
    node.destroy_node()
    gc.collect()  # nodes in cycles would keep the middleware, and leave its shared memory
    rclpy.shutdown()
    os._exit(0)  # the threads of goals that are under way are not waited for


if __name__ == "__main__":
    main()
