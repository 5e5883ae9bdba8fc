"""The settings of a site file for Pioneer robots, and the devices that they make."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from somrs.adapters.arcos.adapter import ArcosAdapter
from somrs.adapters.arcos.robot import ArcosRobot
from somrs.adapters.arcos.settings import read_settings
from somrs.errors import InputError
from somrs.service_manager.sdk.device import Device

HERE = Path(__file__).parent


class CollectingFleet:
    """A fleet that runs nothing."""

    data = Path(".somrs")

    def __init__(self) -> None:
        self.devices: list[Device] = []

    def add(self, device: Device) -> None:
        self.devices.append(device)

    def report_problem(self, name: str, problem: str | None) -> None:
        """Tell nobody."""

    async def remove(self, name: str) -> None:
        raise AssertionError("no robot leaves")

    async def storeys(self) -> Mapping[str, float]:
        return {}


def test_each_robot_of_the_settings_is_a_device() -> None:
    adapter = ArcosAdapter(
        {"robots": {"Robot1": {"port": "tcp://127.0.0.1:8101", "start": [1, 0.8, 90]}, "Robot2": {"port": "/dev/ttyUSB0"}}}, HERE
    )
    assert list(adapter.names) == ["Robot1", "Robot2"]

    async def devices() -> list[Device]:
        fleet = CollectingFleet()
        running = asyncio.create_task(adapter.run(fleet))
        await asyncio.sleep(0)
        running.cancel()
        return fleet.devices

    first, second = asyncio.run(devices())
    assert isinstance(first, ArcosRobot)
    assert isinstance(second, ArcosRobot)
    assert [first.name, second.name] == ["Robot1", "Robot2"]
    assert first.settings.pose is not None
    assert first.settings.pose.yaw == math.pi / 2
    assert second.settings.pose is None


@pytest.mark.parametrize(
    ("settings", "place"),
    [
        ({}, "robots"),
        ({"robots": {"Robot1": {}}}, "port"),
        ({"robots": {"Robot1": {"port": "/dev/ttyUSB0", "colour": "red"}}}, "colour"),
        ({"robots": {"Robot1": {"port": "tcp://127.0.0.1"}}}, "Robot1.port: "),
        ({"robots": {"Robot1": {"port": "tcp://127.0.0.1:312010"}}}, "Robot1.port: .* the number of a port"),
        ({"robots": {"Robot1": {"port": "127.0.0.1:31201"}}}, "Robot1.port: .*: write tcp://127.0.0.1:31201"),
        ({"robots": {"Robot1": {"port": "ttyUSB0"}}}, "Robot1.port: .*, such as /dev/ttyUSB0, nor tcp://HOST:PORT"),
        ({"robots": {"Robot1": {"port": "/dev/ttyUSB0", "simulated": True}}}, "Robot1.port: .* no address of TCP"),
        ({"robots": {name: {"port": "/dev/ttyUSB0"} for name in ("Robot1", "Robot2")}}, "Robot2.port: .*as that of Robot1 is"),
        ({"robots": {"Robot1": {"port": "/dev/ttyUSB0", "start": [1, 2]}}}, r"start should be a list of 3 numbers, such as \[2, 1.5, 90\]"),
        ({"robots": {"Robot1": {"port": "/dev/ttyUSB0", "speed": 5}}}, "speed should be at most 2.5 m/s, not 5"),
        ({"robots": {"Robot1": {"port": "/dev/ttyUSB0", "speed": 0}}}, "Robot1.speed: "),
        ({"robots": {"Robot1": {"port": "/dev/ttyUSB0", "battery": {"empty": 13, "full": 12}}}}, "Robot1.battery: "),
    ],
)
def test_wrong_settings_are_refused_with_their_place(settings: dict[str, Any], place: str) -> None:
    with pytest.raises(InputError, match=place):
        read_settings(settings)


def test_a_parameter_file_is_looked_for_beside_the_site_file(tmp_path: Path) -> None:
    settings = {"robots": {"Robot1": {"port": "/dev/ttyUSB0", "parameters": "robot.p"}}}
    with pytest.raises(InputError, match=r"robots\.Robot1\.parameters: .*robot\.p"):
        ArcosAdapter(settings, tmp_path)
    (tmp_path / "robot.p").write_text("DistConvFactor 0.5\n")
    assert list(ArcosAdapter(settings, tmp_path).names) == ["Robot1"]
