"""The energy runs: a small fleet with one charger."""

from __future__ import annotations

import asyncio
from pathlib import Path

from tests.support import warm
from verification.energy_runs.fleet import Fleet
from verification.energy_runs.run import EnergyRun


def test_robots_with_a_low_battery_have_themselves_charged_at_one_charger_one_after_the_other(tmp_path: Path) -> None:
    fleet = Fleet(seed=0, robots=2, chargers=1, platforms=2, lowest_charge=20, highest_charge=24)
    result = asyncio.run(EnergyRun(fleet, hours=24, data=tmp_path, carried_at_once=0, launcher=warm.launcher()).play())
    assert result.hours < 24, result
    assert min(result.last_charges.values()) >= 90
    assert result.charging_tasks == 2
