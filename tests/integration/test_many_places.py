"""Robots know all places and chargers of a large building, and not only those of the first page of an answer."""

from __future__ import annotations

from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.service_manager.sdk.orders import Quoted
from tests.support.building import building
from tests.support.robot_lab import run
from tests.support.simulated_device_harness import simulated

NUMBER = 130
"""Of chargers: more than a page has."""


def site(charge: int) -> str:
    """A hall with rows of chargers, and a robot at the last one."""
    spots = [(1 + 1.2 * (number % 26), 1 + 1.2 * (number // 26)) for number in range(NUMBER)]
    chargers = (f"Charger{number:03}: {{type: Charger, at: [{x:.1f}, {y:.1f}]}}" for number, (x, y) in enumerate(spots))
    robot = f"  Robot1: {{type: PioneerP3DX, at: [{spots[-1][0]:.1f}, {spots[-1][1] + 1.2:.1f}, 0], Charge: {charge}, Price: 1 EUR}}\n"
    return building("Lab", 33, 9, *chargers) + "\n" + robot


def test_a_robot_drives_to_any_place_of_a_large_building() -> None:
    async def test() -> None:
        async with simulated(Manipulator, "Robot1", site(99), None) as harness:
            assert isinstance(await harness.quote("MoveTo", Place=f"Charger{NUMBER - 1}"), Quoted)
            map = await harness.perform("MoveTo", Place=f"Charger{NUMBER - 1}")
            assert map.has_fact("isAt", ("Robot1", f"Charger{NUMBER - 1}"))

    run(test())


def test_a_robot_charges_at_the_nearest_of_many_chargers() -> None:
    async def test() -> None:
        async with simulated(Manipulator, "Robot1", site(60), None) as harness:
            map = await harness.perform("ChargeBattery")
            (charger,) = (fact.arguments[1] for fact in map.facts("isAt"))
            assert charger == f"Charger{NUMBER - 1}"

    run(test())
