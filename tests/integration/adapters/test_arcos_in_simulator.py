"""Robots of the simulator that are driven by ARCOS: they drive, pick and drop as those that are driven by the robot link."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

from somrs.adapters.arcos.driver import Driver
from somrs.adapters.arcos.events import (
    Action,
    ActionDone,
    ActionFailed,
    Advance,
    Effect,
    Follow,
    GaveUp,
    Heard,
    MoveGripper,
    Passed,
    TurnTo,
)
from somrs.adapters.arcos.line import RobotLine
from somrs.adapters.arcos.messages import GripperCommand
from somrs.adapters.arcos.odometry import Pose
from somrs.adapters.arcos.simulated import simulated_robots
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.world.kinds import WorldKind
from tests.integration.adapters.test_arcos_lines import run, wait_until
from tests.support.building import jar_lab
from tests.support.pioneers import way
from tests.support.robot_lab import simulator

SITE = jar_lab(
    "Robot1: {type: PioneerP3DX, at: [3, 3, 0], Speed: 0.8}",
    "Robot2: {type: PioneerP3DX, at: [6, 1.5, 0], Speed: 1.0}",
)


class Simulated:
    """A robot of the simulator, with its driver."""

    def __init__(self, line: RobotLine, effects: list[Effect], operator: OperatorLink) -> None:
        self.line, self.effects, self.operator = line, effects, operator

    async def act(self, action: Action) -> ActionDone:
        self.effects.clear()
        self.line.give(action)
        ends: list[Effect] = []
        while not ends:
            await asyncio.sleep(0.02)
            ends = [effect for effect in self.effects if isinstance(effect, ActionDone | ActionFailed)]
        assert isinstance(ends[0], ActionDone), ends
        return ends[0]


@contextlib.asynccontextmanager
async def pioneer(server: Server) -> AsyncIterator[Simulated]:
    """Robot1, at (3, 3)."""
    effects: list[Effect] = []
    address = f"{server.host}:{server.port}"
    async with simulated_robots({"Robot1": 0}, address) as ports, OperatorLink(server.host, server.port) as operator:
        line = RobotLine(Driver(Pose(x=3.0, y=3.0, yaw=0.0)), ports["Robot1"], 9600, effects.append)
        running = asyncio.create_task(line.run())
        try:
            await wait_until(lambda: Heard(True) in effects)
            yield Simulated(line, effects, operator)
        finally:
            running.cancel()
            await asyncio.wait({running})


def test_a_simulated_robot_drives_by_arcos() -> None:
    async def test() -> None:
        async with simulator(1, SITE, WorldKind.KINEMATIC) as server, pioneer(server) as robot:
            robot.line.give(Follow(way((3.0, 3.0), (4.0, 3.0), (4.0, 3.8))))
            await wait_until(lambda: Passed(3) in robot.effects)
            await asyncio.sleep(1.0)
            state = (await robot.operator.robots())["Robot1"]
            assert abs(state.x - 4.0) < 0.05
            assert abs(state.y - 3.8) < 0.05
            pose = robot.line.driver.pose
            assert abs(state.x - pose.x) < 0.02
            assert abs(state.y - pose.y) < 0.02

    run(test())


def test_a_simulated_robot_picks_and_drops_by_arcos() -> None:
    async def test() -> None:
        async with simulator(1, SITE, WorldKind.KINEMATIC) as server, pioneer(server) as robot:
            robot.line.give(Follow(way((3.0, 3.0), (1.7, 4.0))))
            await wait_until(lambda: Passed(2) in robot.effects)
            await robot.act(TurnTo(3.14159))
            await robot.act(MoveGripper(GripperCommand.OPEN))
            approach = await robot.act(Advance(distance=0.0, until_beam=True))
            assert approach.is_occupied
            closing = await robot.act(MoveGripper(GripperCommand.CLOSE))
            assert closing.is_occupied
            assert (await robot.operator.robots())["Robot1"].holding == "Jar1"
            await robot.act(MoveGripper(GripperCommand.OPEN))
            assert (await robot.operator.robots())["Robot1"].holding is None
            assert (await robot.operator.observe("Jar1")).support == "Table1"

    run(test())


def test_the_sonar_of_a_simulated_robot_stops_it_before_another_one() -> None:
    async def test() -> None:
        site = SITE.replace("at: [6, 1.5, 0]", "at: [5, 3.05, 0]")
        async with simulator(1, site, WorldKind.KINEMATIC) as server, pioneer(server) as robot:
            robot.line.give(Follow(way((3.0, 3.0), (6.0, 3.0))))
            await wait_until(lambda: any(isinstance(effect, GaveUp) for effect in robot.effects))
            (refusal,) = [effect for effect in robot.effects if isinstance(effect, GaveUp)]
            assert "in the way" in refusal.description
            assert 4.1 < (await robot.operator.robots())["Robot1"].x < 5.0 - 0.44

    run(test())
