"""A whole system with a Pioneer robot that is driven by ARCOS: traffic grants its ways, and its controller drives, grips and stops."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.deployment.system import System
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from tests.support import warm
from tests.support.accomplishing import accomplish
from tests.support.building import DELIVERY_LAB

pytestmark = pytest.mark.long


@contextlib.asynccontextmanager
async def running_system(folder: Path) -> AsyncIterator[tuple[Client, OperatorLink]]:
    """A system whose Robot1 has an ARCOS controller: a client of it, and the operator of its simulator."""
    site = folder / "site.yaml"
    site.write_text(DELIVERY_LAB)
    async with (
        System((site,), folder / "data", speed="1", world=WorldKind.KINEMATIC, launcher=warm.launcher(), arcos=True) as system,
        Client(system.addresses) as client,
        operator_link(system.addresses) as operator,
    ):
        yield client, operator


def test_a_task_is_accomplished_by_a_robot_with_arcos(tmp_path: Path) -> None:
    async def run() -> None:
        async with running_system(tmp_path) as (client, operator):
            view = await accomplish(client, "Jar1 isOn Table2")
            assert view.outcome == "accomplished", view.explanation
            assert (await operator.observe("Jar1")).support == "Table2"

    asyncio.run(run())
