"""A whole system whose components and devices prove to each other who they are."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from pathlib import Path

import pytest

from somrs.api.service import open_api_service
from somrs.cli.import_commands import import_sources
from somrs.client.client import Client
from somrs.deployment.system import OWN_BUS, System
from somrs.errors import RemoteError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.runtime.wire import Unanswered
from somrs.trust.authority import Authority
from somrs.trust.credentials import VARIABLE
from somrs.trust.identity import Identity, Role
from tests.support import warm
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT

PARCELS = ROOT / "examples" / "parcels"
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
        async with System(files, data, speed="20", launcher=warm.launcher(), certificates=True, bus=bus) as system:
            addresses = system.addresses
            components = (addresses.repository, addresses.registry, addresses.task_manager, addresses.scheduler or "")
            assert all(address.startswith("https://") for address in components)
            async with Client(addresses) as client:
                assert await outcome_of(client, GOAL) is Outcome.ACCOMPLISHED
            async with open_api_service(addresses, data) as service:  # as `somrs status` does, which the Repository tells of changes
                assert [part.name for part in (await service.system.read()).parts if part.problem] == []
            logs = {file.name: file.read_text() for file in (data / "logs").glob("*.log")}
            assert [name for name, text in logs.items() if "denied" in text] == [], logs
            viewer = Identity(name="guest", roles=frozenset({Role.VIEWER}))
            certificate, _ = Authority.of_data(data).issue_program(viewer, ("127.0.0.1",), datetime.now(UTC))
            with monkeypatch.context() as environment:
                environment.setenv(VARIABLE, str(certificate))
                async with Client(addresses) as guest:
                    assert (await guest.map()).objects
                    with pytest.raises(
                        RemoteError, match=r"guest \(viewer\) may not send Submit: that is for the roles api, client, scheduler"
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
