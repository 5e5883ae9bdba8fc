"""An operator puts a simulated robot somewhere else, as somebody would carry it."""

from __future__ import annotations

import asyncio
import math
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
from msgspec.structs import replace

from somrs.devices.simulator.link.commands import CommandGivenUp, DriveTo, Fault, Grip
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import RemoteError, UsageError
from tests.support.command import CommandResult, somrs
from tests.support.robot_lab import run as run_in_room
from tests.support.robot_lab import simulator
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import Run, room
from tests.support.small_system import SmallSystem, live_api_at, running


def test_a_robot_that_is_put_elsewhere_gives_up_what_it_does_and_works_from_there(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0)), world)
    end = run.start("Robot1", DriveTo(x=6.5, y=3))
    run.run_until(lambda: run.simulation.robots["Robot1"].speed > 0.3)
    run.simulation.robots["Robot1"].battery.charge = 40.0
    run.simulation.move("Robot1", 2.0, 5.0, 0.0, math.pi)
    assert isinstance(end[0], CommandGivenUp)
    assert "carried Robot1 elsewhere" in end[0].description
    state = run.simulation.state("Robot1")
    assert math.dist((state.x, state.y), (2, 5)) < 0.01
    assert state.charge == pytest.approx(40.0, abs=0.1)
    run.execute_all("Robot1", DriveTo(x=6, y=3))
    run.execute_all("Robot2", DriveTo(x=1.5, y=3))
    assert not run.collisions


def test_a_robot_keeps_its_faults_where_it_is_put(world: WorldKind) -> None:
    run = Run(room((1.5, 3, 0)), world)
    run.simulation.fault("Robot1", Fault.DRIVE)
    run.simulation.move("Robot1", 2.0, 5.0, 0.0)
    assert run.simulation.state("Robot1").faults == (Fault.DRIVE,)


def test_a_robot_is_put_on_another_storey(world: WorldKind) -> None:
    run = Run(tower((2, 2, 0)), world)
    run.simulation.move("Robot1", 3.0, 3.0, HEIGHT)
    run.execute_all("Robot1", DriveTo(x=5, y=3))
    assert run.simulation.state("Robot1").z == HEIGHT


@pytest.mark.parametrize(
    ("x", "y", "reason"), [(6.5, 4.5, "Robot2 stands there"), (4.0, 5.2, "something stands there"), (20.0, 3.0, "there is no floor")]
)
def test_a_robot_is_put_only_where_it_fits(world: WorldKind, x: float, y: float, reason: str) -> None:
    run = Run(room(), world)
    with pytest.raises(UsageError, match=reason):
        run.simulation.move("Robot1", x, y, 0.0)
    assert math.dist(run.simulation.robots["Robot1"].pose()[:2], (1.5, 1.5)) < 0.01


def test_a_robot_that_holds_something_is_not_carried(world: WorldKind) -> None:
    run = Run(room(), world)
    run.execute_all("Robot1", Grip(object="Jar002"))
    with pytest.raises(UsageError, match="it holds Jar002"):
        run.simulation.move("Robot1", 5.0, 3.0, 0.0)


def test_the_operator_of_the_simulator_moves_robots_by_the_link() -> None:
    async def scenario() -> None:
        async with simulator() as server, OperatorLink(server.host, server.port) as operator:
            await operator.move("Robot1", 2.6, 1.5, 0.0)
            states = await operator.robots()
            assert math.dist((states["Robot1"].x, states["Robot1"].y), (2.6, 1.5)) < 0.01

    run_in_room(scenario())


def test_robots_that_are_not_simulated_are_not_put_elsewhere(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(tmp_path) as (_, api):
            with pytest.raises(RemoteError, match="only simulated robots"):
                await api.fleet.put("Robot1", x=1.0, y=1.0)

    asyncio.run(run())


def test_the_command_puts_a_robot_elsewhere_and_says_why_it_does_not_fit(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with AsyncExitStack() as stack:
            server = await stack.enter_async_context(simulator())
            system = SmallSystem(tmp_path, ())
            stack.push_async_callback(system.stop)
            await system.start()
            system.addresses = replace(system.addresses, simulator=f"{server.host}:{server.port}")
            api = await stack.enter_async_context(live_api_at(system))
            replace(system.addresses, api=api.client.url).write(system.data)

            async def put(*arguments: str) -> CommandResult:
                return await asyncio.to_thread(somrs, "put", *arguments, "--data", str(system.data))

            done = await put("Robot1", "2.6", "1.5")
            assert (done.returncode, done.stdout) == (0, "Robot1 was put at x 2.60 m, y 1.50 m\n")
            assert math.dist(server.simulation.robots["Robot1"].pose()[:2], (2.6, 1.5)) < 0.01
            off_the_floor = await put("Robot1", "-20", "1.5")
            assert off_the_floor.returncode != 0
            assert "Robot1 cannot be put at (-20.00, 1.50): there is no floor" in off_the_floor.stderr
            assert "there is no storey Attic" in (await put("Robot1", "2", "1.5", "--storey", "Attic")).stderr
            assert (await put("Robot1", "2", "1.5", "--stroey", "Attic")).returncode == 2

    run_in_room(scenario())
