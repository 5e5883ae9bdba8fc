"""The driver and the simulated controller of Pioneer robots, over real lines."""

from __future__ import annotations

import asyncio
import contextlib
import math
import sys
from collections.abc import AsyncIterator, Callable, Coroutine

import pytest

from somrs.adapters.arcos.driver import Driver
from somrs.adapters.arcos.events import Effect, Follow, GaveUp, Heard, Passed
from somrs.adapters.arcos.line import RobotLine
from somrs.adapters.arcos.odometry import Pose
from somrs.adapters.arcos.simulated.body import Place, PlaneBody
from somrs.adapters.arcos.simulated.firmware import Firmware
from somrs.adapters.arcos.simulated.server import SimulatedRobot, serving_tcp, serving_terminal
from tests.support.hang import HANG_TIME
from tests.support.pioneers import way

SHORT = way((0.0, 0.0), (0.6, 0.0))


def run(test: Coroutine[None, None, None]) -> None:
    async def limited() -> None:
        async with asyncio.timeout(HANG_TIME):
            await test

    asyncio.run(limited())


async def wait_until(condition: Callable[[], object]) -> None:
    while not condition():
        await asyncio.sleep(0.01)


def simulated() -> SimulatedRobot:
    return SimulatedRobot(Firmware(PlaneBody(Place(x=0.0, y=0.0, yaw=0.0))))


@contextlib.asynccontextmanager
async def driving(port: str) -> AsyncIterator[tuple[RobotLine, list[Effect]]]:
    """A driver at a port, and what it says."""
    effects: list[Effect] = []
    line = RobotLine(Driver(Pose(x=0.0, y=0.0, yaw=0.0)), port, 38400, effects.append)
    running = asyncio.create_task(line.run())
    try:
        yield line, effects
    finally:
        running.cancel()
        await asyncio.wait({running})


def position(robot: SimulatedRobot) -> float:
    return robot.firmware.body.place.x


def stands(robot: SimulatedRobot) -> bool:
    return max(map(abs, robot.firmware.velocity)) < 2


def test_a_robot_drives_over_tcp() -> None:
    async def test() -> None:
        robot = simulated()
        async with serving_tcp(robot) as port, driving(port) as (line, effects):
            await wait_until(lambda: Heard(True) in effects)
            line.give(Follow(SHORT))
            await wait_until(lambda: Passed(2) in effects and stands(robot))
            assert abs(position(robot) - 0.6) < 0.05

    run(test())


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")
def test_a_robot_drives_over_a_serial_line() -> None:
    pytest.importorskip("serial_asyncio_fast")

    async def test() -> None:
        robot = simulated()
        async with serving_terminal(robot) as port, driving(port) as (line, effects):
            await wait_until(lambda: Heard(True) in effects)
            line.give(Follow(SHORT))
            await wait_until(lambda: Passed(2) in effects and stands(robot))
            assert abs(position(robot) - 0.6) < 0.05

    run(test())


def test_a_robot_may_come_later_than_its_driver() -> None:
    async def test() -> None:
        robot = simulated()
        async with serving_tcp(robot) as port:
            number = int(port.rpartition(":")[2])
        async with driving(port) as (_, effects):
            await asyncio.sleep(0.2)
            async with serving_tcp(robot, number):
                await wait_until(lambda: Heard(True) in effects)

    run(test())


def test_lost_bytes_delay_and_do_no_harm() -> None:
    async def test() -> None:
        robot = simulated()
        robot.loss = 0.005
        async with serving_tcp(robot) as port, driving(port) as (line, effects):
            await wait_until(lambda: Heard(True) in effects)
            line.give(Follow(SHORT))
            await wait_until(lambda: Passed(2) in effects and stands(robot))
            assert abs(position(robot) - 0.6) < 0.06
            assert not [effect for effect in effects if isinstance(effect, GaveUp)]

    run(test())


def test_a_lost_line_is_opened_again_and_the_way_goes_on() -> None:
    async def test() -> None:
        robot = simulated()
        async with serving_tcp(robot) as port, driving(port) as (line, effects):
            await wait_until(lambda: Heard(True) in effects)
            line.give(Follow(SHORT))
            await wait_until(lambda: position(robot) > 0.1)
            assert line._writer is not None
            line._writer.transport.abort()
            await wait_until(lambda: Passed(2) in effects and stands(robot))
            assert abs(position(robot) - 0.6) < 0.05
            heard = [effect for effect in effects if isinstance(effect, Heard)]
            assert [effect.is_connected for effect in heard] == [True, False, True]
            assert port in str(heard[1].problem)

    run(test())


def test_a_program_that_ends_stops_its_robot() -> None:
    async def test() -> None:
        robot = simulated()
        async with serving_tcp(robot) as port:
            async with driving(port) as (line, effects):
                await wait_until(lambda: Heard(True) in effects)
                line.give(Follow(way((0.0, 0.0), (20.0, 0.0))))
                await wait_until(lambda: position(robot) > 0.2)
            stopped_at = position(robot)
            await wait_until(lambda: stands(robot))
            assert position(robot) - stopped_at < 0.3

    run(test())


PROGRAM = """
import asyncio, sys
from somrs.adapters.arcos.driver import Driver
from somrs.adapters.arcos.events import Follow, Heard
from somrs.adapters.arcos.line import RobotLine
from somrs.adapters.arcos.odometry import Pose
from somrs.devices.road_robot import Waypoint

way = tuple(Waypoint(number=n, name=str(n), x=x, y=0.0, level=0.0, released=True) for n, x in ((1, 0.0), (2, 50.0)))

async def main():
    line = RobotLine(Driver(Pose(x=0.0, y=0.0, yaw=0.0)), sys.argv[1], 9600, lambda effect: None)
    line.give(Follow(way))
    await line.run()

asyncio.run(main())
"""


def test_a_robot_whose_program_is_killed_stands_within_its_watchdog() -> None:
    async def test() -> None:
        robot = simulated()
        async with serving_tcp(robot) as port:
            program = await asyncio.create_subprocess_exec(sys.executable, "-c", PROGRAM, port)
            await wait_until(lambda: position(robot) > 0.3)
            program.kill()
            await program.wait()
            place, speed = position(robot), robot.firmware.velocity[0] / 1000
            await wait_until(lambda: stands(robot))
            assert position(robot) - place < 0.5 * 2.0 + 0.5**2 / (2 * 0.3) + 0.1, "the watchdog's two seconds, and braking"
            assert speed > 0.1
            assert not math.isclose(position(robot), 50.0)

    run(test())
