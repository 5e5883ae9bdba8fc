"""Programs of devices come from the site, and never from the map; what cannot be started does not stop the rest."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.deployment.devices_of_map import DevicePrograms, is_own_driver
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.ontology.objects import Object, ObjectAdded
from somrs.ontology.types import ObjectType
from somrs.protocol.messages.knowledge import Define, Definitions, UpdateMap
from tests.support import warm
from tests.support.hang import HANG_TIME

pytestmark = pytest.mark.long

SITE = """
types:
  Clock: {parent: StationaryDevice, driver: "FOLDER/clock.py:Clock"}
objects:
  Building001:
    type: Building
    parts:
      Storey001:
        type: Storey
        parts:
          Floor001: {type: Floor, at: [4, 3, -0.1], Shape: {Form: Box, Width: 8, Depth: 6, Height: 0.1}}
"""
PROGRAM = """
import pathlib
from somrs import Device
pathlib.Path(__file__ + ".ran").touch()
BODY
class Clock(Device): pass
"""
BODY_OF = {"clock": "", "stranger": "", "listed": "", "broken": "import os; os._exit(3)", "wrong": "raise ValueError('no such clock')"}


@pytest.mark.parametrize(
    ("driver", "own"),
    [
        ("somrs.devices.symbolic.device:SymbolicDevice", True),
        ("somrs.demo.hosts:Host", True),
        ("somrs.py:Clock", False),
        ("somrs.devices/../../tmp/x.py:Clock", False),
        ("somrs.devices.x.py:Clock", False),
        ("somrs_more.devices:Clock", False),
        ("os:system", False),
        ("/tmp/x.py:Clock", False),
    ],
)
def test_own_drivers_are_modules_of_the_package(driver: str, own: bool) -> None:
    assert is_own_driver(driver) is own


def test_a_program_that_nobody_listed_is_left_out_with_what_to_do(tmp_path: Path) -> None:
    programs = DevicePrograms([tmp_path / "gone.yaml"], ["mine:Clock"])
    devices, (problem,) = programs.select([("Clock1", "mine:Clock"), ("Clock2", "/tmp/x.py:Clock")])
    assert devices == [("Clock1", "mine:Clock")]
    assert problem.startswith("Clock2 is left out")
    assert "--driver /tmp/x.py:Clock" in problem


def test_a_system_starts_its_own_programs_alone(tmp_path: Path) -> None:
    for name, body in BODY_OF.items():
        (tmp_path / f"{name}.py").write_text(PROGRAM.replace("BODY", body))
    site = tmp_path / "site.yaml"
    site.write_text(SITE.replace("FOLDER", str(tmp_path)))
    drivers = {name: f"{tmp_path}/{name}.py:Clock" for name in BODY_OF} | {"missing": "somrs.devices.missing:Clock"}
    types = [
        ObjectType(name=name.capitalize(), parent="StationaryDevice", driver=driver) for name, driver in drivers.items() if name != "clock"
    ]

    def system() -> System:
        listed = [drivers[name] for name in ("listed", "broken", "wrong")]
        return System([site], tmp_path / "data", world=WorldKind.KINEMATIC, launcher=warm.launcher(), drivers=listed)

    async def run() -> list[str]:
        async with asyncio.timeout(HANG_TIME), system() as first, Client(first.addresses) as client:
            await client.define(Define(definitions=Definitions(types=tuple(types))))
            at = {"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.0}
            devices = [Object(name=f"{name.capitalize()}1", type=name.capitalize(), values=dict(at)) for name in drivers]
            await client.update(UpdateMap(changes=tuple(map(ObjectAdded, devices))))
        async with asyncio.timeout(HANG_TIME), system() as second, Client(second.addresses) as client:
            assert "Listed1" in second.programs
            assert "Stranger1" not in second.programs
            await client.map()
            return second.problems

    problems = asyncio.run(run())
    assert any(problem.startswith("Stranger1 is left out") for problem in problems)
    assert any(problem.startswith("Broken1 did not start") for problem in problems)
    assert {name for name in BODY_OF if (tmp_path / f"{name}.py.ran").exists()} == BODY_OF.keys() - {"stranger"}
