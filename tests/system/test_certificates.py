"""A whole system whose components and devices prove to each other who they are."""

from __future__ import annotations

import asyncio
import os
from datetime import UTC, datetime
from pathlib import Path

import pytest

from somrs.api.service import open_api_service
from somrs.cli.import_commands import import_sources
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.client.trace import Follower
from somrs.deployment.device import DeviceRunner
from somrs.deployment.system import OWN_BUS, System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import RemoteError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.runtime.wire import Unanswered
from somrs.trust.authority import Authority
from somrs.trust.credentials import VARIABLE
from somrs.trust.identity import Identity, Role
from tests.support import warm
from tests.support.command import somrs
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT, SCENARIO_1
from tests.support.small_system import Porter
from tests.support.virtual_system import SITE

PARCELS = ROOT / "examples" / "parcels"
CARRIER = """
from tests.support.small_system import Porter

class Carrier(Porter):
    def __init__(self, name, simulator=None):
        super().__init__(name)
"""
GOAL = "letter lies harbour AND crate lies mill"


async def outcome_of(client: Client, effect: str) -> Outcome | None:
    task = await client.submit(Submit(effect=effect))
    outcome: Outcome | None = None
    async with asyncio.timeout(HANG_TIME):
        async for news in client.news(task):
            outcome = news.view.outcome
    return outcome


@pytest.mark.parametrize("bus", [None, OWN_BUS])
def test_a_system_with_certificates_works_and_keeps_strangers_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bus: str | None) -> None:
    async def run() -> None:
        data = tmp_path / "run"
        data.mkdir()
        files = import_sources([PARCELS / "domain.pddl", PARCELS / "problem.pddl"], data)
        async with System(files, data, speed="20", launcher=warm.launcher(), bus=bus) as system:
            addresses = system.addresses
            components = (addresses.repository, addresses.registry, addresses.task_manager, addresses.scheduler or "")
            assert all(address.startswith("https://") for address in components)
            async with Client(addresses) as client:
                assert await outcome_of(client, GOAL) is Outcome.ACCOMPLISHED
            async with open_api_service(addresses, data) as service:  # as `somrs status` does, which the Repository tells of changes
                assert [part.name for part in (await service.system.read()).parts if part.problem] == []
            shown_status = await asyncio.to_thread(somrs, "status", "--data", data)
            assert (shown_status.returncode, "task-manager" in shown_status.stdout) == (0, True), shown_status
            if addresses.bus is not None:
                shown_status = await asyncio.to_thread(somrs, "status", "--bus", addresses.bus.servers, "--data", data)
                assert (shown_status.returncode, "task-manager" in shown_status.stdout) == (0, True), shown_status
            logs = {file.name: file.read_text() for file in (data / "logs").glob("*.log")}
            assert [name for name, text in logs.items() if "denied" in text] == [], logs
            viewer = Identity(name="guest", roles=frozenset({Role.VIEWER}))
            certificate, _ = Authority.of_data(data).issue_program(viewer, ("127.0.0.1",), datetime.now(UTC))
            with monkeypatch.context() as environment:
                environment.setenv(VARIABLE, str(certificate))
                async with Client(addresses) as guest:
                    assert (await guest.map()).objects
                    with pytest.raises(
                        RemoteError, match=r"guest \(viewer\) may not send Submit: that is for the roles api, client, device, scheduler"
                    ):
                        await guest.submit(Submit(effect=GOAL))
                    Authority.of_data(data).revoke("guest", datetime.now(UTC))
                    with pytest.raises(RemoteError, match=r"the certificate of guest \(\w+\) is revoked"):
                        await guest.map()
            stranger = type(addresses)(repository=addresses.repository, registry=addresses.registry, task_manager=addresses.task_manager)
            async with Client(stranger) as nobody:
                with pytest.raises(Unanswered, match="cannot be reached"):
                    await nobody.map()

    asyncio.run(run())


@pytest.mark.parametrize("bus", [OWN_BUS, pytest.param(None, marks=pytest.mark.slow)])
def test_open_tasks_go_on_when_the_programs_get_certificates_and_when_they_lose_them(tmp_path: Path, bus: str | None) -> None:
    async def run() -> None:
        task, effects = "", ("Jar002 isOn Platform001", "Jar002 isOn Table001", "Jar002 isOn Platform001")
        messages = Follower(tmp_path / "messages.jsonl")
        for effect, (choice, secure) in zip(effects, ((False, True), (True, True), (None, False)), strict=True):
            system = System(
                [SCENARIO_1],
                tmp_path,
                speed="8",
                world=WorldKind.KINEMATIC,
                launcher=warm.launcher(),
                certificates=choice,
                secure=secure,
                bus=bus,
            )
            async with system, Client(system.addresses) as client, asyncio.timeout(HANG_TIME):
                assert (system.addresses.trust is not None) is system.addresses.task_manager.startswith("https:") is bool(choice)
                if task:
                    view = [news.view async for news in client.news(task)][-1]
                    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
                task = await client.submit(Submit(effect=effect))
                while "Execute" not in [line.type for line in messages.new()]:
                    await asyncio.sleep(0.02)

    asyncio.run(run())


def test_a_device_that_is_started_by_hand_takes_part(tmp_path: Path) -> None:
    async def run() -> None:
        site, data = tmp_path / "site.yaml", tmp_path / "run"
        site.write_text(SITE)
        launcher, driver = warm.launcher(), tmp_path / "carrier.py"
        driver.write_text(CARRIER)
        async with System([site], data, simulates=False, launcher=warm.launcher()) as system, Client(system.addresses) as client:
            line = ["run", "device", f"{driver}:Carrier", "--name", "Robot1", "--data", str(data)]
            device = await launcher.start(line, tmp_path / "device.log", os.environ)
            try:
                assert await outcome_of(client, "Jar002 isOn Platform001") is Outcome.ACCOMPLISHED, (tmp_path / "device.log").read_text()
            finally:
                device.kill()
                await launcher.stop()

    asyncio.run(run())


@pytest.mark.parametrize("bus", [None, OWN_BUS])
def test_a_device_on_another_computer_works_until_it_is_revoked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bus: str | None) -> None:
    async def run() -> None:
        site, data, elsewhere = tmp_path / "site.yaml", tmp_path / "run", tmp_path / "robot"
        site.write_text(SITE)
        async with System([site], data, simulates=False, launcher=warm.launcher(), bus=bus) as system:
            word = (await asyncio.to_thread(somrs, "trust", "invite", "Robot1", "--data", data)).stdout.strip()
            service = system.addresses.trust_service
            assert service is not None
            await asyncio.to_thread(somrs, "trust", "enrol", word, "--at", service, "--out", elsewhere)
            with monkeypatch.context() as environment:
                environment.setenv(VARIABLE, str(elsewhere / "Robot1.pem"))
                runner = DeviceRunner(Porter("Robot1"), Addresses.read(elsewhere), elsewhere)
                await runner.start()
            async with Client(system.addresses) as client:
                assert await outcome_of(client, "Jar002 isOn Platform001") is Outcome.ACCOMPLISHED
                Authority.of_data(data).revoke("Robot1", datetime.now(UTC))
                task = await client.submit(Submit(effect="Jar002 isOn Cupboard002"))
                logs = [data / "logs" / f"{name}.log" for name in ("task-manager", "registry", "repository")]

                def is_cut_off() -> bool:
                    """Whether a component has denied it something, or the bus has ended its connection before."""
                    bus_connection = runner._runtime._bus if runner._runtime is not None else None
                    if bus_connection is not None and not bus_connection.client.is_connected:
                        return True
                    return any("denied: " in log.read_text() and "Robot1" in log.read_text() for log in logs)

                async with asyncio.timeout(HANG_TIME):
                    while not is_cut_off():
                        await asyncio.sleep(0.1)
                assert not (await client.query("Jar002 isOn Cupboard002")).rows
                await client.cancel(task, "enough")
            await runner.stop()

    asyncio.run(run())
