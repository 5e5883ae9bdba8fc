"""The battery of a simulated robot."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.devices.simulator.battery import CHARGING, PER_SECOND, Battery, charging_time

USES = st.lists(st.tuples(st.sampled_from(["use", "add", "time"]), st.floats(0, 200)), max_size=30)


@given(st.floats(-10, 120), USES)
def test_the_charge_stays_between_empty_and_full(charge: float, uses: list[tuple[str, float]]) -> None:
    battery, now = Battery(charge, 0.0), 0.0
    for action, amount in uses:
        earlier_charge = battery.charge
        match action:
            case "use":
                battery.use(amount)
            case "add":
                battery.add(amount)
            case _:
                now += amount
                battery.pass_time(now)
        assert 0.0 <= battery.charge <= 100.0
        assert battery.charge >= earlier_charge if action == "add" else battery.charge <= earlier_charge


@given(st.lists(st.floats(0, 3600), min_size=1, max_size=20))
def test_it_drains_by_the_time_that_passes_however_often_one_looks(pauses: list[float]) -> None:
    battery, now = Battery(100.0, 5.0), 5.0
    for pause in pauses:
        now += pause
        battery.pass_time(now)
        battery.pass_time(now - pause / 2)  # a clock that is read late changes nothing
    assert battery.charge == pytest.approx(max(0.0, 100.0 - PER_SECOND * sum(pauses)))


@given(st.floats(0, 99))
def test_it_is_full_when_the_charging_time_is_over(charge: float) -> None:
    battery, seconds, step = Battery(charge, 0.0), 0.0, 10.0
    while battery.charge < 100.0:
        seconds += step
        battery.pass_time(seconds)
        battery.add(CHARGING * step)
    assert seconds == pytest.approx(charging_time(charge), abs=2 * step)
