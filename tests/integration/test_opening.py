"""Simulated devices that cannot be opened."""

from __future__ import annotations

import asyncio

import pytest

from somrs.devices.simulator.server.server import Server
from somrs.errors import DeviceError, RemoteError
from somrs.protocol.messages.bodies import Body
from somrs.service_manager.sdk.map_reader import MapReader
from tests.support import robot_lab
from tests.support.observation_lab import KINDS, SITE
from tests.support.virtual_devices import make_ask


async def has_opened(name: str, server: Server, answers: int) -> bool:
    """Open and close a device whose Repository falls silent after so many answers. Return whether that was enough to open it."""
    ask, given = make_ask(robot_lab.repository(SITE), lambda: 0.0), 0
    silence = RemoteError("the Repository does not answer")

    async def ask_repository(body: Body) -> Body:
        nonlocal given
        given += 1
        if given > answers:
            raise silence
        return await ask(body)

    device = KINDS[name](name, f"{server.host}:{server.port}")
    device.map = MapReader(ask_repository)
    try:
        await device.open()
    except RemoteError as error:
        if error is not silence:
            raise  # such as: the robot is not free
        return False
    finally:
        await device.close()
    return True


@pytest.mark.parametrize("name", KINDS)
def test_wherever_opening_a_device_fails_its_robot_is_free_for_the_next_try(name: str) -> None:
    async def scenario() -> int:
        async with robot_lab.simulator(None, SITE) as server:
            answers = 0
            while not await has_opened(name, server, answers):
                answers += 1
            return answers

    assert asyncio.run(scenario()) > 2


def test_a_device_without_a_simulator_says_so_and_can_be_closed() -> None:
    async def scenario() -> None:
        device = KINDS["Robot1"]("Robot1")
        with pytest.raises(DeviceError, match="Robot1 needs a simulator"):
            await device.open()
        await device.close()

    asyncio.run(scenario())
