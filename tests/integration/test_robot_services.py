"""The services of simulated robots besides carrying: what they quote, do and report, through their drivers."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager

import pytest

from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.devices.simulator.link.commands import Fault
from somrs.entish.parse import parse
from somrs.ontology.files.loading import upper
from somrs.service_manager.sdk.orders import Halt, Quoted, Refusal, ServiceFailed, WorkDone
from tests.support.building import building
from tests.support.robot_lab import map_after, run, run_work
from tests.support.simulated_device_harness import SimulatedDeviceHarness, simulated

SITE = (
    building(
        "Lab",
        8,
        6,
        "WallA: {type: Wall, at: [4, 1.1, 0], Shape: {Form: Box, Width: 0.1, Depth: 2.2, Height: 2.5}}",
        "WallB: {type: Wall, at: [4, 4.8, 0], Shape: {Form: Box, Width: 0.1, Depth: 2.4, Height: 2.5}}",
        "Door1: {type: Door, at: [4, 2.9, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.4, Height: 2.1}, Open: false}",
    )
    + """
  Cupboard1: {type: Cupboard, at: [0.3, 4, 0], Shape: {Form: Box, Width: 0.5, Depth: 1.2, Height: 0.8}, Open: true}
  Table1: {type: Table, at: [2.5, 5.4, 0], Shape: {Form: Box, Width: 1.4, Depth: 0.8, Height: 0.74}}
  Carton1: {type: Carton, at: [2.3, 5.2, 0.74]}
  Jar1: {type: Jar, at: [0.4, 4.2, 0.06]}
  Charger1: {type: Charger, at: [1, 0.8]}
  Charger2: {type: Charger, at: [3, 0.8]}
  Entrance: {type: Place, at: [3, 3]}
  Robot1: {type: PioneerP3DX, at: [1.5, 2, 0], Price: 10 EUR, Charge: 99}
  Robot2: {type: PioneerP3DX, at: [3, 0.8, 0], Price: 10 EUR, Charge: 3}
facts:
  - Carton1 isOn Table1
  - Jar1 isIn Cupboard1
"""
)


def _harness(name: str = "Robot1", speed: float | None = None) -> AbstractAsyncContextManager[SimulatedDeviceHarness]:
    return simulated(Manipulator, name, SITE, speed)


def test_a_robot_moves_to_a_place_and_back() -> None:
    async def test() -> None:
        async with _harness() as harness:
            quote = await harness.quote("MoveTo", Place="Entrance")
            assert isinstance(quote, Quoted)
            assert 1 < quote.duration < 20
            map = await harness.perform("MoveTo", Place="Entrance")
            assert map.has_fact("isAt", ("Robot1", "Entrance"))
            state = (await harness.operator.robots())["Robot1"]
            assert (state.x, state.y) == pytest.approx((3, 3), abs=0.05)
            assert map.objects["Robot1"].values["PositionX"] == round(state.x, 3)
            map = await harness.undo("MoveTo", "Robot1 isAt Charger1", Place="Entrance")
            assert map.has_fact("isAt", ("Robot1", "Charger1"))
            with pytest.raises(ServiceFailed, match="does not say at which place Robot1 was"):
                await harness.undo("MoveTo", "NOT Robot1 isAt Entrance", Place="Entrance")

    run(test())


def test_a_robot_charges_at_the_charger_that_is_free() -> None:
    async def test() -> None:
        async with _harness() as harness:
            quote = await harness.quote("ChargeBattery")
            assert isinstance(quote, Quoted)
            assert 20 < quote.duration < 40, "one percent takes 20 s"
            map = await harness.perform("ChargeBattery")
            assert map.has_fact("isAt", ("Robot1", "Charger1")), "Robot2 stands at the other one"
            assert map.objects["Robot1"].values["Charge"] == 100
            assert parse(upper().services["ChargeBattery"].effect)

    run(test())


def test_a_robot_with_an_almost_empty_battery_only_charges() -> None:
    async def test() -> None:
        async with _harness("Robot2") as harness:
            with pytest.raises(Refusal, match="the battery of Robot2 is at 3 %; it has to be charged first"):
                await harness.quote("MoveTo", Place="Entrance")
            quote = await harness.quote("ChargeBattery")
            assert isinstance(quote, Quoted)
            assert quote.duration > 0.9 * 97 / 0.05

    run(test())


def test_a_door_is_opened_and_closed_again() -> None:
    async def test() -> None:
        async with _harness() as harness:
            quote = await harness.quote("OpenDoor", Door="Door1")
            assert isinstance(quote, Quoted)
            assert 20 < quote.duration < 60
            map = await harness.perform("OpenDoor", Door="Door1")
            assert map.objects["Door1"].values["Open"] is True
            assert (await harness.operator.observe("Door1")).open is True
            map = await harness.undo("OpenDoor", "Door1.Open = FALSE", Door="Door1")
            assert map.objects["Door1"].values["Open"] is False

    run(test())


def test_a_door_that_cannot_be_opened_is_reported_as_it_is() -> None:
    async def test() -> None:
        async with _harness() as harness:
            await harness.operator.schedule("Robot1", Fault.GRIPPER, delay=15)
            with pytest.raises(ServiceFailed) as failed:
                await harness.perform("OpenDoor", Door="Door1")
            map = map_after(failed.value.situation, SITE)
            assert map.objects["Door1"].values["Open"] is False
            assert map.objects["Robot1"].values["Working"] is False

    run(test())


def test_a_stopped_robot_says_how_it_left_the_door() -> None:
    async def test() -> None:
        async with _harness() as harness:
            order = harness.order("OpenDoor", Door="Door1")
            result = await run_work(harness.device, Halt(order), harness.repository, [])
            assert isinstance(result, WorkDone)
            assert "PositionX" in str(result.situation)

    run(test())


def test_a_thing_is_put_into_a_container_and_another_taken_out() -> None:
    async def test() -> None:
        async with _harness() as harness:
            map = await harness.perform("PutInto", Object="Carton1", Cupboard="Cupboard1")
            assert map.has_fact("isIn", ("Carton1", "Cupboard1"))
            assert not map.has_fact("isOn", ("Carton1", "Table1"))
            map = await harness.perform("TakeOutOf", Object="Jar1", Destination="Table1")
            assert map.has_fact("isOn", ("Jar1", "Table1"))
            assert not map.has_fact("isIn", ("Jar1", "Cupboard1"))
            map = await harness.undo("TakeOutOf", "Jar1 isIn Cupboard1", Object="Jar1", Destination="Table1")
            assert map.has_fact("isIn", ("Jar1", "Cupboard1"))

    run(test())


def test_closing_a_container_is_reported() -> None:
    async def test() -> None:
        async with _harness() as harness:
            map = await harness.perform("CloseCupboard", Cupboard="Cupboard1")
            assert map.objects["Cupboard1"].values["Open"] is False
            with pytest.raises(ServiceFailed, match="Cupboard1 is shut"):
                await harness.perform("TakeOutOf", Object="Jar1", Destination="Table1")

    run(test())


def test_looking_tells_which_things_are_there() -> None:
    async def test() -> None:
        async with _harness() as harness:
            quote = await harness.quote("LookAt", Place="Table1")
            assert isinstance(quote, Quoted)
            await harness.operator.move("Jar1", 2.9, 5.3, 0.74)
            map = await harness.perform("LookAt", Place="Table1")
            assert map.has_fact("isOn", ("Carton1", "Table1")), "it is where it was"
            assert map.has_fact("isOn", ("Jar002", "Table1")), "a jar that the map did not have there"
            assert map.objects["Jar002"].values["PositionX"] == pytest.approx(2.9, abs=0.01)
            await harness.operator.move("Carton1", 0.4, 4.2, 0.06)
            map = await harness.perform("LookInto", Cupboard="Cupboard1")
            assert map.has_fact("isIn", ("Carton002", "Cupboard1"))

    run(test())
