"""The clocks of a process: neither goes back, whatever the machine's does."""

from __future__ import annotations

import time

import pytest

from somrs.runtime.clock import Clock, TimeOfDay, local_zone


@pytest.mark.parametrize("kind", [Clock, TimeOfDay])
def test_a_clock_does_not_go_back_before_what_a_journal_holds(kind: type[Clock]) -> None:
    clock = kind()
    assert abs(clock.now() - time.time()) < 5
    clock.advance_to(time.time() + 3600)
    assert clock.now() >= time.time() + 3590
    clock.advance_to(0.0)
    assert clock.now() >= time.time() + 3590


def test_the_time_of_day_stands_still_while_the_machine_s_is_put_back(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = TimeOfDay()
    start_time = clock.now()
    for machine, expected in ((start_time - 3600, start_time), (start_time - 1, start_time), (start_time + 3600, start_time + 3600)):
        monkeypatch.setattr(time, "time", lambda machine=machine: machine)
        assert clock.now() == expected


@pytest.mark.parametrize(
    ("set", "named"), [("Europe/Berlin", "Europe/Berlin"), (":UTC", "UTC"), ("CET-1CEST", ""), ("", ""), ("/etc/x", "")]
)
def test_the_zone_has_a_name_if_the_machine_says_so(set: str, named: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", set)
    assert local_zone() == named
