"""The energy runs: a small fleet with one charger."""

from __future__ import annotations

import asyncio
from pathlib import Path

from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from tests.support import warm
from verification.energy_runs.fleet import Fleet
from verification.energy_runs.run import EnergyRun


def test_robots_with_a_low_battery_have_themselves_charged_at_one_charger_one_after_the_other(tmp_path: Path) -> None:
    fleet = Fleet(seed=0, robots=2, chargers=1, platforms=2, lowest_charge=20, highest_charge=24)
    result = asyncio.run(EnergyRun(fleet, hours=24, data=tmp_path, carried_at_once=0, launcher=warm.launcher()).play())
    assert result.hours < 24, result
    assert min(result.last_charges.values()) >= 90
    assert result.charging_tasks == 2


def test_a_robot_without_the_charge_for_a_task_is_charged_first(tmp_path: Path) -> None:
    site = tmp_path / "hall.yaml"
    site.write_text(Fleet(seed=0, robots=1, chargers=1, platforms=2, lowest_charge=12, highest_charge=12).site())

    async def run() -> None:
        async with (
            System([site], tmp_path / "run", speed="max", world=WorldKind.KINEMATIC, launcher=warm.launcher()) as system,
            Client(system.addresses) as client,
        ):
            task = await client.submit(Submit(effect="Box01 isOn Platform02"))
            views = [news.view async for news in client.news(task)]
            assert views[-1].outcome is Outcome.ACCOMPLISHED, views[-1].explanation
            # On a slow machine, the robot may have submitted a task of its own to be charged before it was asked.
            services = sorted(work.service for view in await client.tasks() for work in view.work)
            assert services == ["Robot01.ChargeBattery", "Robot01.TransferObject"]
            (charge,) = (await client.query("Robot01.Charge = ?Charge")).rows
            assert float(charge.bindings["Charge"].split()[0]) > 90

    asyncio.run(run())
