"""A system with several Registries: devices publish at one of them each, all list everything, and one of them may be lost."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.cli.import_commands import import_sources
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.protocol.messages.directory import Discover, Discovered
from somrs.protocol.messages.frp import Outcome
from tests.support import warm
from tests.support.accomplishing import accomplish
from tests.support.command import somrs
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT

pytestmark = pytest.mark.long

PARCELS = ROOT / "examples" / "parcels"


async def services(client: Client, address: str) -> set[str]:
    return {offer.service for offer in (await client.ask(address, Discover(), Discovered)).offers}


def test_when_a_registry_is_lost_the_devices_are_on_offer_at_the_others(tmp_path: Path) -> None:
    async def scenario() -> None:
        data = tmp_path / "run"
        data.mkdir()
        files = import_sources([PARCELS / "domain.pddl", PARCELS / "problem.pddl"], data)
        neighbours = tmp_path / "neighbours.yaml"
        neighbours.write_text("Harbour: {registry: 'http://127.0.0.1:9/registry', takes: all, gives: nothing}")
        async with asyncio.timeout(HANG_TIME):
            async with (
                System(
                    files, data, speed="20", registries=2, neighbours=neighbours, launcher=warm.launcher(), certificates=False
                ) as system,
                Client(system.addresses) as client,
            ):
                registries = system.addresses.registries
                assert [*registries] == ["Registry1", "Registry2"]
                while (listed := await services(client, registries["Registry1"])) != await services(client, registries["Registry2"]):
                    await asyncio.sleep(0.1)
                assert len({offer.provider for offer in await client.services()}) == 2
                output = (await asyncio.to_thread(somrs, "status", "--data", data)).stdout
                assert "Registry2" in output
                assert "Harbour" in output
                assert "no answer since" in output
                # Which one the devices and the Task Manager began with follows from their names.
                first = [*registries].index(
                    next(name for name, address in registries.items() if address == system.addresses.registries_for("/task-manager")[0])
                )
                program = system.programs["registry" if first == 0 else "registry-2"]
                program.process.send_signal(9)
                await program.process.wait()
                view = await accomplish(client, "letter lies market")
                assert view.outcome is Outcome.ACCOMPLISHED, view
                other = [*registries.values()][1 - first]
                while await services(client, other) != listed or any(offer.registry for offer in await client.services()):
                    await asyncio.sleep(0.5)
                assert (await accomplish(client, "crate lies mill")).outcome is Outcome.ACCOMPLISHED
            async with System(files, data, speed="20", launcher=warm.launcher()) as system:
                assert len(system.addresses.registries) == 2, "as many as in the last run"
        assert len(Addresses.read(data, "last.json").registries) == 2

    asyncio.run(scenario())
