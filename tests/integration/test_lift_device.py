"""A lift is a device: the map has where its cabin is and whether it works, and it takes its cabin to a storey."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest

from somrs.devices.simulator.drivers.lift import Lift
from somrs.devices.simulator.link.commands import CommandDone, CommandGivenUp, DriveTo, Fault, MoveCabin, Stop
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import UsageError
from somrs.ontology.objects import Fact
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from tests.support.robot_lab import map_after
from tests.support.robot_lab import run as run_test
from tests.support.simulated_device_harness import SimulatedDeviceHarness, simulated
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import Run

TOWER = """
map: Tower
objects:
  House:
    type: Building
    parts:
      Ground:
        type: Storey
        parts:
          Floor1: {type: Floor, at: [4, 3, -0.1], Shape: {Form: Box, Width: 8.2, Depth: 6.2, Height: 0.1}}
          Gate1: {type: LiftDoor, at: [8.05, 3, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.2, Height: 2.1}}
      Upper:
        type: Storey
        Elevation: 4
        parts:
          Floor2: {type: Floor, at: [4, 3, 3.9], Shape: {Form: Box, Width: 8.2, Depth: 6.2, Height: 0.1}}
          Gate2: {type: LiftDoor, at: [8.05, 3, 4], Shape: {Form: Box, Width: 0.1, Depth: 1.2, Height: 2.1}}
      Roof:
        type: Storey
        Elevation: 8
        parts:
          Floor3: {type: Floor, at: [4, 3, 7.9], Shape: {Form: Box, Width: 8.2, Depth: 6.2, Height: 0.1}}
      Lift1: {type: Lift, at: [9.1, 3, 0], Shape: {Form: Box, Width: 1.8, Depth: 1.8, Height: 2.3}, Price: 1 EUR}
facts: [Lift1 stopsAt Ground, Lift1 stopsAt Upper, Gate1 leadsInto Lift1, Gate2 leadsInto Lift1]
"""


@asynccontextmanager
async def lift(speed: float | None = None) -> AsyncIterator[tuple[SimulatedDeviceHarness, list[str]]]:
    """A lift, and what it reports to the map by itself."""
    reports: list[str] = []

    class ReportingLift(Lift):
        observer = staticmethod(lambda situation, observation: reports.append(situation))

    async with simulated(ReportingLift, "Lift1", TOWER, speed) as harness:
        yield harness, reports


async def reported(reports: list[str], is_expected: Callable[[str], bool]) -> str:
    """The first report that is expected."""
    while not any(map(is_expected, reports)):
        await asyncio.sleep(0.02)
    return next(filter(is_expected, reports))


def test_the_map_has_that_a_lift_is_broken_and_that_it_works_again() -> None:
    async def test() -> None:
        async with lift() as (harness, reports):
            await harness.operator.fault("Lift1", Fault.DRIVE)
            assert await reported(reports, lambda report: "Working" in report) == "Lift1.Working = FALSE"
            with pytest.raises(Refusal, match="Lift1 is out of order") as caught:
                await harness.quote("CallLift", Storey="Upper")
            assert caught.value.not_now
            reports.clear()
            harness.repository.state.map = map_after("Lift1.Working = FALSE", TOWER)
            await harness.operator.repair("Lift1", Fault.DRIVE)
            assert await reported(reports, lambda report: "Working" in report) == "Lift1.Working = TRUE"

    run_test(test())


def test_a_lift_has_the_faults_of_a_drive_and_no_gripper() -> None:
    async def test() -> None:
        async with lift() as (harness, _):
            await harness.operator.fault("Lift1", Fault.DRIVE)
            device = (await harness.operator.devices())["Lift1"]
            assert device.state.faults == (Fault.DRIVE,)
            assert set(device.possible_faults) == {Fault.DRIVE, Fault.SILENT, Fault.LINK}
            message = "^Lift1 cannot have the fault gripper; it can have drive, silent, link$"
            with pytest.raises(UsageError, match=message):
                await harness.operator.fault("Lift1", Fault.GRIPPER)
            with pytest.raises(UsageError, match=message):
                await harness.operator.schedule("Lift1", Fault.GRIPPER, delay=1.0)
            assert (await harness.operator.devices())["Lift1"].state.faults == (Fault.DRIVE,)

    run_test(test())


def test_the_map_has_at_which_storey_the_cabin_is() -> None:
    async def test() -> None:
        async with lift() as (_, reports):
            assert await reported(reports, lambda report: "standsAt" in report) == "Lift1.PositionZ = 0 AND Lift1 standsAt Ground"

    run_test(test())


def test_a_lift_that_breaks_between_storeys_says_that_it_is_at_none() -> None:
    async def test() -> None:
        async with lift(speed=4) as (harness, _):
            harness.repository.state.map = map_after("Lift1 standsAt Ground", TOWER)
            called = asyncio.create_task(harness.perform("CallLift", Storey="Upper"))
            while (await harness.operator.observe("Lift1")).z < 1:
                await asyncio.sleep(0.01)
            await harness.operator.fault("Lift1", Fault.DRIVE)
            with pytest.raises(ServiceFailed) as failure:
                await called
            map = map_after(str(failure.value.situation), TOWER)
            assert map.objects["Lift1"].values["Working"] is False
            assert 1 <= float(map.objects["Lift1"].values["PositionZ"]) < 4
            assert "NOT Lift1 standsAt Ground" in str(failure.value.situation)

    run_test(test())


def test_the_cabin_is_called_to_a_storey_and_taken_back() -> None:
    async def test() -> None:
        async with lift() as (harness, _):
            quoted = await harness.quote("CallLift", Storey="Upper")
            assert 4 < quoted.duration < 20
            map = await harness.perform("CallLift", Storey="Upper")
            assert map.facts_with("standsAt", 0, "Lift1")
            assert Fact("standsAt", ("Lift1", "Upper")) in map.facts()
            assert map.objects["Lift1"].values["PositionZ"] == 4
            assert (await harness.operator.observe("Lift1")).z == 4
            map = await harness.undo("CallLift", "Lift1 standsAt Ground", Storey="Upper")
            assert Fact("standsAt", ("Lift1", "Ground")) in map.facts()
            assert (await harness.operator.observe("Lift1")).z == 0

    run_test(test())


def test_a_lift_goes_only_where_it_stops() -> None:
    async def test() -> None:
        async with lift() as (harness, _):
            with pytest.raises(Refusal, match=r"^Lift1 does not stop at Roof; it stops at Ground, Upper$"):
                await harness.quote("CallLift", Storey="Roof")

    run_test(test())


def test_a_call_waits_until_the_robot_has_left_the_lift(world: WorldKind) -> None:
    run = Run(tower((7, 3, 0)), world)
    ride = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.run_until(lambda: run.simulation.state("Lift1").holding == "Robot1")
    call = run.start("Lift1", MoveCabin(z=0))
    run.run_until(lambda: call)
    assert isinstance(call[0], CommandDone), call
    assert (run.simulation.state("Robot1").z, run.simulation.state("Lift1").z) == (HEIGHT, 0)
    assert not run.simulation.observe("Gate1").open
    run.run_until(lambda: ride)
    assert isinstance(ride[0], CommandDone), ride
    assert not run.collisions


def test_robots_go_before_a_call(world: WorldKind) -> None:
    run = Run(tower((7, 3, 0)), world)
    call = run.start("Lift1", MoveCabin(z=HEIGHT))
    ride = run.start("Robot1", DriveTo(x=3, y=3, z=HEIGHT))
    run.run_until(lambda: call and ride)
    assert isinstance(ride[0], CommandDone), ride
    assert isinstance(call[0], CommandDone), call
    assert run.simulation.state("Lift1").z == HEIGHT


def test_a_call_is_stopped_by_an_operator_and_ends_when_the_drive_breaks() -> None:
    run = Run(tower((2, 2, 0)), WorldKind.KINEMATIC)
    call = run.start("Lift1", MoveCabin(z=HEIGHT))
    run.run_for(1.0)
    run.simulation.linked.set_paused("Lift1", True)
    height = run.simulation.state("Lift1").z
    run.run_for(5.0)
    assert (run.simulation.state("Lift1").z, call) == (height, [])
    run.simulation.linked.set_paused("Lift1", False)
    run.simulation.fault("Lift1", Fault.DRIVE)
    assert isinstance(call[0], CommandGivenUp)
    assert call[0].reason == "drive-dead"
    assert isinstance(run.execute("Lift1", MoveCabin(z=HEIGHT)), CommandGivenUp)
    run.simulation.repair("Lift1", Fault.DRIVE)
    nowhere = run.execute("Lift1", MoveCabin(z=2))
    assert isinstance(nowhere, CommandGivenUp)
    assert nowhere.description == "Lift1 is a lift: it accepts MoveCabin to a floor at which it stops, Stop and Status"
    stopped = run.start("Lift1", MoveCabin(z=HEIGHT))
    run.execute_all("Lift1", Stop())
    assert isinstance(stopped[0], CommandGivenUp)
