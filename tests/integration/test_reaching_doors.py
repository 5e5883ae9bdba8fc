"""From where robots open doors: from the side that they reach, and only if there is room."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager

import pytest

from somrs.devices.simulator.drivers.manipulator import Manipulator
from somrs.service_manager.sdk.orders import Quoted, Refusal
from tests.support.building import building
from tests.support.robot_lab import run
from tests.support.simulated_device_harness import SimulatedDeviceHarness, simulated

BLOCK = "Block: {type: Wall, at: [4.6, 1.5, 0], Shape: {Form: Box, Width: 0.1, Depth: 3, Height: 2.5}}"
"""A wall close before the door."""

PILLAR = "Pillar: {type: Wall, at: [4.6, 1.1, 0], Shape: {Form: Box, Width: 1, Depth: 1.4, Height: 2.5}}"
"""A wall close before the part of the doorway into which the handle moves."""


def _harness(*parts: str) -> AbstractAsyncContextManager[SimulatedDeviceHarness]:
    """A robot beside a closed room with a door around the corner: the robot is on the side of the wall that is inside the room."""
    site = (
        building(
            "Lab",
            8,
            6,
            "WallNorth: {type: Wall, at: [2, 3.05, 0], Shape: {Form: Box, Width: 4.1, Depth: 0.1, Height: 2.5}}",
            "WallEast: {type: Wall, at: [4, 0.6, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.2, Height: 2.5}}",
            "WallCorner: {type: Wall, at: [4, 2.8, 0], Shape: {Form: Box, Width: 0.1, Depth: 0.4, Height: 2.5}}",
            "WallWest: {type: Wall, at: [-0.05, 3, 0], Shape: {Form: Box, Width: 0.1, Depth: 6, Height: 2.5}}",
            "WallSouth: {type: Wall, at: [4, -0.05, 0], Shape: {Form: Box, Width: 8, Depth: 0.1, Height: 2.5}}",
            "Door1: {type: Door, at: [4, 1.9, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.4, Height: 2.1}, Open: false}",
            *parts,
        )
        + """
  Inside: {type: Place, at: [1.5, 1.5]}
  Robot1: {type: PioneerP3DX, at: [2, 4.5, 0], Price: 10 EUR, Charge: 99}
"""
    )
    return simulated(Manipulator, "Robot1", site, None)


def test_a_door_is_opened_from_the_side_that_the_robot_reaches() -> None:
    async def test() -> None:
        async with _harness() as harness:
            assert isinstance(await harness.quote("OpenDoor", Door="Door1"), Quoted)
            map = await harness.perform("OpenDoor", Door="Door1")
            assert map.objects["Door1"].values["Open"] is True

    run(test())


@pytest.mark.parametrize("obstacle", [BLOCK, PILLAR], ids=["no room", "room for half of the way"])
def test_a_door_that_cannot_be_moved_to_its_end_is_refused(obstacle: str) -> None:
    async def test() -> None:
        async with _harness(obstacle) as harness:
            with pytest.raises(Refusal, match="finds no path to a place from which it could move the door of Door1"):
                await harness.quote("OpenDoor", Door="Door1")

    run(test())


def test_a_door_at_which_there_is_nowhere_to_stand_is_refused_with_that_reason() -> None:
    async def test() -> None:
        async with _harness(BLOCK, BLOCK.replace("Block", "OtherBlock").replace("4.6", "3.4")) as harness:
            with pytest.raises(Refusal, match="Robot1 can stand nowhere from where it could move the door of Door1"):
                await harness.quote("OpenDoor", Door="Door1")

    run(test())


def test_who_is_to_drive_through_a_shut_door_demands_that_it_is_open() -> None:
    async def test() -> None:
        async with _harness() as harness:
            quote = await harness.quote("MoveTo", Place="Inside")
            assert isinstance(quote, Quoted)
            assert (quote.condition, quote.invariant) == ("Door1.Open = TRUE", "Door1.Open = TRUE")

    run(test())
