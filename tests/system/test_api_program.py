"""The API as a process: without the windows and their libraries, and beside them, when one of the two is killed."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from somrs.api.remote import api_of, live_api
from somrs.client.addresses import Addresses
from somrs.client.api_client import local_token_reader
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import SomrsError
from somrs.protocol.messages.submission import Submit
from tests.support import warm
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1
from tests.support.signed_in import authorization

CORE_ONLY_PROGRAM = """
import sys

for name in ("nicegui", "fastapi", "fastapi_swagger", "numpy", "rdflib", "mujoco", "scipy", "PIL"):
    sys.modules[name] = None  # as if it were not installed
from somrs.cli.main import main
main()
"""


async def answering(url: str, data: Path) -> None:
    async with asyncio.timeout(HANG_TIME), httpx.AsyncClient(headers=authorization(data)) as client:
        while True:
            try:
                if (await client.get(f"{url}/map")).status_code == 200:
                    return
            except httpx.TransportError:
                pass
            await asyncio.sleep(0.1)


def test_it_runs_with_the_core_alone(tmp_path: Path) -> None:
    async def run() -> None:
        async with System([SCENARIO_1], tmp_path / "run", speed="max", world=WorldKind.KINEMATIC, launcher=warm.launcher()) as system:
            line = [sys.executable, "-c", CORE_ONLY_PROGRAM, "run", "api", "--data", str(tmp_path / "run"), "--port", "0"]
            os.kill(system.programs["api"].process.pid, signal.SIGKILL)  # it has the file of orders
            await system.programs["api"].process.wait()
            process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
            try:
                assert process.stdout is not None
                first_line = await asyncio.wait_for(asyncio.to_thread(process.stdout.readline), HANG_TIME)
                url = httpx.Response(200, text=first_line).json()["at"]
                async with httpx.AsyncClient(base_url=url, headers=authorization(system.data)) as client:
                    assert (await client.get("/scene")).json()["bodies"]
                    assert (await client.get("/", follow_redirects=True)).json()["openapi"] == "3.1.0"
                    owl = await client.get("/ontology/export.ttl")
                    assert (owl.status_code, "pip install 'somrs[api]'" in owl.json()["problem"]) == (400, True)
                async with live_api(url, local_token_reader(system.data)) as api:
                    assert (await api.tasks.submit(Submit(effect="Jar002 isOn ?Shelf: Cupboard"))).task
            finally:
                process.terminate()
                process.wait(HANG_TIME)

    asyncio.run(run())


def test_the_windows_and_the_api_do_not_take_each_other_along(tmp_path: Path) -> None:
    pytest.importorskip("nicegui", reason="the windows' libraries are not installed")

    async def run() -> None:
        async with (
            System(
                [SCENARIO_1], tmp_path / "run", speed="max", world=WorldKind.KINEMATIC, windows=True, launcher=warm.launcher()
            ) as system,
            httpx.AsyncClient() as browser,
        ):
            api, gui = system.addresses.api, system.addresses.gui
            assert api is not None
            assert gui is not None
            browser.headers.update(authorization(system.data))
            assert (await browser.get(f"{gui}/api/system")).json()["site"]
            os.kill(system.programs["gui"].process.pid, signal.SIGKILL)
            await system.programs["gui"].process.wait()
            async with api_of(system.data) as client:
                assert (await client.map.read()).objects
            await system.restart("gui")
            os.kill(system.programs["api"].process.pid, signal.SIGKILL)
            await system.programs["api"].process.wait()
            assert (await browser.get(f"{gui}/api/system")).status_code == 503
            assert "The API does not answer" in (await browser.get(f"{gui}/map")).text
            await system.restart("api")
            await answering(f"{gui}/api", system.data)
            async with asyncio.timeout(HANG_TIME):
                while "The API does not answer" in (await browser.get(f"{gui}/map")).text:
                    await asyncio.sleep(0.2)
            assert (await browser.get(f"{gui}/tasks")).status_code == 200

    asyncio.run(run())


def test_addresses_of_before_there_was_an_api_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "system.json").write_text('{"repository": "a", "registry": "b", "task_manager": "c", "gui": "d"}')
    old_addresses = Addresses.read(tmp_path)
    assert old_addresses.api is None

    async def run() -> None:
        with pytest.raises(SomrsError, match="without the API"):
            async with api_of(tmp_path):
                pass

    asyncio.run(run())
