"""Two systems with certificates of authorities of their own, which are neighbours: real programs, and what others cannot do."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.protocol.messages.frp import Outcome
from somrs.trust.authority import Authority
from tests.support.accomplishing import accomplish
from tests.support.hang import HANG_TIME
from tests.support.two_sites import two_sites

pytestmark = pytest.mark.long


def denials(system: System) -> str:
    """What the programs of a system have denied, as their logs have it."""
    return "\n".join(
        line for file in sorted((system.data / "logs").glob("*.log")) for line in file.read_text().splitlines() if "denied" in line
    )


def test_a_robot_and_a_jar_are_shared_by_systems_with_authorities_of_their_own(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with asyncio.timeout(HANG_TIME), two_sites(tmp_path) as (barn, yard), Client(yard.addresses) as client:
            while "Barn:Jar1" not in (await client.map()).objects or not any(
                offer.provider == "Barn:BarnRobot" for offer in await client.services()
            ):
                await asyncio.sleep(0.2)
            view = await accomplish(client, "Barn:Jar1 isOn BarnBench")
            assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
            assert [work.service for work in view.work] == ["Barn:BarnRobot.TransferObject"]
            async with Client(barn.addresses) as at_home:
                assert (await at_home.map()).has_fact("isOn", ("Jar1", "BarnBench"))
            assert denials(barn) + denials(yard) == ""
            # The barn finds out that its Repository's key was stolen.
            Authority.of_data(barn.data).revoke("repository", datetime.now(UTC))
            while "is revoked: its owner has to enrol it again at Barn" not in denials(yard):
                await asyncio.sleep(0.2)

    asyncio.run(scenario())
