"""Robots that only drive, as the import of a building makes cleaning robots and carts: they drive and charge, whatever their size."""

from __future__ import annotations

import pytest

from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.devices.simulator.drivers.vehicle import Vehicle
from somrs.service_manager.sdk.orders import Quoted, Refusal
from tests.support.building import building
from tests.support.robot_lab import run
from tests.support.simulated_device_harness import simulated

SITE = (
    building(
        "Hall",
        10,
        6,
        "WallA: {type: Wall, at: [5, 1, 0], Shape: {Form: Box, Width: 0.1, Depth: 2, Height: 2.5}}",
        "WallB: {type: Wall, at: [5, 5, 0], Shape: {Form: Box, Width: 0.1, Depth: 2, Height: 2.5}}",
        "WallC: {type: Wall, at: [8, 1.6, 0], Shape: {Form: Box, Width: 4, Depth: 0.1, Height: 2.5}}",
    )
    + """
  Wash: {type: Place, at: [8, 3.5], CleaningZone: true}
  Niche: {type: Place, at: [8, 0.8]}
  Charger1: {type: Charger, at: [1.5, 4.5]}
  Wiper: {type: CleaningRobot, at: [2, 3, 0], Shape: {Form: Cylinder, Radius: 0.75, Height: 1.3}, Speed: 0.7, Weight: 70, Charge: 99.9}
"""
)


def test_a_large_cleaning_robot_drives_through_a_gap_and_charges() -> None:
    async def test() -> None:
        async with simulated(Vehicle, "Wiper", SITE) as harness:
            quote = await harness.quote("MoveTo", Place="Wash")
            assert isinstance(quote, Quoted)
            assert quote.duration > 6 / 0.7
            map = await harness.perform("MoveTo", Place="Wash")
            assert map.has_fact("isAt", ("Wiper", "Wash"))
            state = (await harness.operator.robots())["Wiper"]
            assert (state.x, state.y) == pytest.approx((8, 3.5), abs=0.1)
            map = await harness.perform("ChargeBattery")
            assert map.has_fact("isAt", ("Wiper", "Charger1"))

    run(test())


def test_a_robot_with_an_arm_refuses_a_place_that_only_its_arm_would_reach() -> None:
    site = SITE + "  Nook: {type: Place, at: [9.85, 5.85]}\n  Robot1: {type: PioneerP3DX, at: [8, 4.5, 0], Price: 1 EUR, Charge: 99}\n"

    async def test() -> None:
        async with simulated(Manipulator, "Robot1", site) as harness:
            with pytest.raises(Refusal, match="Robot1 can stand nowhere from where it could reach Nook: there is no room for it"):
                await harness.quote("MoveTo", Place="Nook")

    run(test())


def test_it_refuses_a_place_for_which_it_is_too_large() -> None:
    async def test() -> None:
        async with simulated(Vehicle, "Wiper", SITE) as harness:
            with pytest.raises(Refusal, match="Wiper can stand nowhere from where it could reach Niche"):
                await harness.quote("MoveTo", Place="Niche")

    run(test())
