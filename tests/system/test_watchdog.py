"""A program of a running system that hangs is ended and started again; the others go on."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.deployment import supervision, watchdog
from somrs.deployment.incidents import read_incidents
from somrs.deployment.supervision import keep_running
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support import warm
from tests.support.hang import HANG_TIME
from tests.system.test_device_programs import SITE

pytestmark = pytest.mark.long

PROGRAM = """
import asyncio
import pathlib
from somrs import Device

class Clock(Device):
    type = "Clock"

def spin():
    marker = pathlib.Path(__file__ + ".hung")
    if not marker.exists():
        marker.touch()
        while True:
            pass

asyncio.get_running_loop().call_later(3, spin)
"""


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.1)


def test_a_program_that_hangs_is_started_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "MOST_CPU", 2.0)
    monkeypatch.setattr(supervision, "LOOK_PAUSE", 0.2)
    (tmp_path / "clock.py").write_text(PROGRAM)
    site = tmp_path / "site.yaml"
    place = "Clock1: {type: Clock, at: [1, 1, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}}"
    site.write_text(SITE.replace("FOLDER", str(tmp_path)).replace("          Floor001", f"          {place}\n          Floor001"))
    notices: list[str] = []

    def is_back(name: str) -> bool:
        return any(notice.startswith(f"{name} hangs") for notice in notices) and f"{name} is back" in notices

    async def run() -> None:
        data = tmp_path / "data"
        async with (
            asyncio.timeout(HANG_TIME),
            System([site], data, world=WorldKind.KINEMATIC, launcher=warm.launcher()) as system,
            Client(system.addresses) as client,
        ):
            supervisor = asyncio.create_task(keep_running(system, notices.append))
            await until(lambda: is_back("Clock1"))
            await until(lambda: system.programs["registry"].beat_file.exists())
            os.kill(system.programs["registry"].process.pid, signal.SIGSTOP)
            await until(lambda: is_back("registry"))
            await client.services()
            supervisor.cancel()
        assert [incident.text for incident in read_incidents(data)] == notices
        hanging = [notice.partition(" hangs: ")[::2] for notice in notices if " hangs: " in notice]
        assert [name for name, _ in hanging] == ["Clock1", "registry"]
        assert "has not turned" in hanging[0][1]
        assert "SIGSTOP" in hanging[1][1]

    asyncio.run(run())
