"""Records a conversation with the bridge and real nodes, for tests without them: `python -m tests.support.ros2.record`.

Each line has a direction: `told` to the connection by its robot, `sent` to the bridge, `heard` from it.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import msgspec

from somrs.adapters.ros2.connection import RobotConnection
from somrs.adapters.ros2.lines import Report, Request
from somrs.adapters.ros2.settings import Binding, RobotSettings
from tests.support.ros2.robots import ROOT, RobotProcess, Witness, running_bridge, way

FILE = ROOT / "tests" / "data" / "ros2" / "corner_then_abort.jsonl"
BINDING: dict[str, Any] = {"pose": {}, "odometry": {}}
WAYS = (way((0, 0), (1, 0), (2, 0), (2, 1)), way((2, 1), (3, 1), first=3))


async def record(file: Path) -> None:
    """A robot drives around a corner, and gives up on its next way."""
    lines: list[bytes] = []

    def note(direction: str, content: object) -> None:
        lines.append(msgspec.json.encode({direction: content}) + b"\n")

    async with RobotProcess(speed=4.0) as robot, running_bridge() as bridge:
        session, witness = bridge.session, Witness()
        send, handle = session._send, session.handle

        def noted_send(request: Request) -> None:
            note("sent", request)
            send(request)

        def noted_handle(report: Report) -> None:
            note("heard", report)
            handle(report)

        session._send, session.handle = noted_send, noted_handle  # type: ignore[method-assign]
        settings = RobotSettings.model_validate({"binding": "none.yaml", "namespace": robot.namespace})
        connection = RobotConnection("Robot1", settings, Binding.model_validate(BINDING), session, witness)
        connection.open()
        await witness.until(lambda: witness.presence == [True])
        note("told", WAYS[0])
        connection.follow(WAYS[0])
        await witness.until(lambda: witness.passed_numbers == [1, 2, 3])
        await robot.tell("abort")
        await asyncio.sleep(0.2)
        note("told", WAYS[1])
        connection.follow(WAYS[1])
        await witness.until(lambda: bool(witness.reasons))
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(b"".join(lines).replace(robot.namespace.encode(), b"robot1"))


if __name__ == "__main__":
    asyncio.run(record(FILE))
