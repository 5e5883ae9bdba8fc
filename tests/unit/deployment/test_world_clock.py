"""The Task Manager is told the simulated time when what it reckons is wrong, and not otherwise."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.deployment.world_clock import TOLERANCE, Reckoning, clock_follower
from somrs.devices.simulator.link.link import Reading
from somrs.kernel.component import Notified
from somrs.runtime.clock import Clock
from somrs.runtime.node import Node
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.world_clock import WorldClock, WorldTimePassed

MORNING = 1_800_000_000.0


class ClockReadings:
    """A Task Manager's clock, and readings of a simulator's clock for it."""

    def __init__(self, speed: float | None) -> None:
        self.clock, self.speed = WorldClock(), speed
        self.reckoning = Reckoning(self.clock)
        self.notices: list[WorldTimePassed] = []

    def read(self, time: float, now: float) -> None:
        self._tell(self.reckoning.read(Reading(time=time, speed=self.speed), MORNING + now), now)

    def lose(self, now: float) -> None:
        self._tell(self.reckoning.lose(MORNING + now), now)

    def _tell(self, passed: WorldTimePassed | None, now: float) -> None:
        if passed is not None:
            self.notices.append(passed)
            self.clock.adjust(passed, MORNING + now)

    def passed(self, start: float, end: float) -> float:
        return self.clock.time_at(MORNING + end) - self.clock.time_at(MORNING + start)


def test_a_simulation_that_keeps_its_speed_is_told_once() -> None:
    system = ClockReadings(4.0)
    for second in range(100):
        system.read(7.0 + 4.0 * second, second)
    assert [passed.rate for passed in system.notices] == [4.0]
    assert system.passed(50.0, 60.0) == 40.0


def test_a_slow_machine_makes_the_world_slow() -> None:
    system = ClockReadings(4.0)
    for second in range(10):
        system.read(4.0 * second, second)
    time_before = system.clock.time_at(MORNING + 9)
    for second in range(1, 21):
        system.read(36.0 + second, 9.0 + second)
    assert system.clock.time_at(MORNING + 29) - time_before == pytest.approx(20.0, abs=1.0)
    assert len(system.notices) <= 4, "a new rate is told, and not each second of it"


def test_the_world_stands_still_while_nobody_simulates_it() -> None:
    system = ClockReadings(1.0)
    system.read(50.0, 0.0)
    system.read(60.0, 10.0)
    system.lose(13.0)
    system.lose(14.0)
    time_before = system.clock.time_at(MORNING + 14)
    assert system.clock.wall_time(time_before + 1.0) is None
    system.read(0.0, 100.0)  # the simulator begins anew
    assert system.clock.time_at(MORNING + 100) == time_before
    system.read(10.0, 110.0)
    assert system.clock.time_at(MORNING + 110) == time_before + 10.0
    assert system.clock.wall_time(time_before + 30.0) == MORNING + 130


@dataclass
class ClockedNode:
    """A Task Manager, and what it is told."""

    component: TaskManager

    def feed(self, notice: Notified) -> None:
        self.component.handle(notice, MORNING)


def test_no_time_passes_for_deadlines_before_the_clock_of_the_simulator_was_read() -> None:
    """However long its start takes: a machine may be busy."""

    class Morning(Clock):
        def now(self) -> float:
            return MORNING

    async def wall_time_of_a_deadline(simulator: str | None) -> float | None:
        node = ClockedNode(TaskManager("tm", repository="r", registry="g"))
        async with clock_follower(cast(Node, node), Morning(), simulator):
            clock = node.component.state.clock
            return clock.wall_time(clock.time_at(MORNING) + 10.0)

    assert asyncio.run(wall_time_of_a_deadline("127.0.0.1:1")) is None
    assert asyncio.run(wall_time_of_a_deadline(None)) == MORNING + 10.0


@given(
    st.sampled_from([None, 0.5, 1.0, 8.0]),
    st.lists(st.tuples(st.floats(0.2, 5.0), st.floats(0.0, 40.0), st.booleans()), min_size=1, max_size=30),
)
def test_it_is_never_wrong_by_more_than_the_tolerance(speed: float | None, pieces: list[tuple[float, float, bool]]) -> None:
    system = ClockReadings(speed)
    now = time = 0.0
    system.read(time, now)
    origin = system.clock.time_at(MORNING + now)
    for seconds, rate, answers in pieces:
        now, time = now + seconds, time + seconds * rate
        if answers:
            system.read(time, now)
            error = system.clock.time_at(MORNING + now) - origin - time
            tolerance = TOLERANCE * max(1.0, rate, speed or 1.0) + 1e-4
            assert error >= -tolerance
            assert error <= tolerance or speed is None, "without a speed, time goes on while nothing moves"
        else:
            system.lose(now)
