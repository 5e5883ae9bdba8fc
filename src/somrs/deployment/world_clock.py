"""Tells a Task Manager the time of a simulated world, as the simulator's clock has it.

Not all the time: the Task Manager reckons that the world's time goes on at the last rate, and is told when that is wrong.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING

from somrs.errors import SomrsError
from somrs.kernel.component import Notified
from somrs.runtime.reception import NotTaken
from somrs.task_manager.world_clock import WorldClock, WorldTimePassed

if TYPE_CHECKING:
    from somrs.devices.simulator.link.link import Reading
    from somrs.runtime.clock import Clock
    from somrs.runtime.node import Node

LOOK = 1.0
"""Seconds between two readings of the simulator's clock."""

PATIENCE = 3.0
"""Seconds without a reading after which the world stands still, until there is one again."""

TOLERANCE = 0.25
"""By how many seconds, of the wall's clock, the reckoning may be wrong."""

STEADY = 0.05
"""Within this part of the speed that was asked for, the simulation keeps it."""


class Reckoning:
    """Compares readings of the simulator's clock with what the Task Manager reckons. `now` is in seconds since 1970."""

    def __init__(self, clock: WorldClock) -> None:
        self._clock = clock
        """That of the Task Manager, which has every notice when the next reading comes."""
        self._noticed_time: float | None = None
        """The simulated time at the last notice."""
        self._last_reading: tuple[float, float] | None = None
        """The time of the last reading, and the simulated time then."""

    def read(self, reading: Reading, now: float) -> WorldTimePassed | None:
        """What the Task Manager has to be told after a reading."""
        rate, expected_seconds = self._rate(reading, now), self._clock.time_at(now) - self._clock.time
        is_first = self._last_reading is None or reading.time < self._last_reading[1]  # the simulator may have begun anew
        self._last_reading = now, reading.time
        seconds = expected_seconds if is_first or self._noticed_time is None else reading.time - self._noticed_time
        if reading.speed is None:
            seconds = max(seconds, expected_seconds)  # as it stands still while nothing moves, which may be for ever
        is_wrong = abs(seconds - expected_seconds) > TOLERANCE * max(1.0, rate)
        if not (is_first or is_wrong or (rate > 0) != (self._clock.rate > 0)):
            return None
        self._noticed_time = reading.time
        return WorldTimePassed(seconds=seconds, rate=rate)

    def lose(self, now: float) -> WorldTimePassed | None:
        """What the Task Manager has to be told if the clock cannot be read: the world stands still."""
        if self._clock.rate == 0:
            return None
        if self._noticed_time is None or self._last_reading is None:
            return WorldTimePassed(seconds=self._clock.time_at(now) - self._clock.time, rate=0.0)
        time = self._last_reading[1]
        seconds, self._noticed_time, self._last_reading = time - self._noticed_time, time, (now, time)
        return WorldTimePassed(seconds=seconds, rate=0.0)

    def _rate(self, reading: Reading, now: float) -> float:
        """How fast the world's time passes: as was asked for, or as it did since the last reading."""
        requested_rate = reading.speed if reading.speed is not None else 1.0
        if self._last_reading is None or now <= self._last_reading[0] or reading.time < self._last_reading[1]:
            return requested_rate
        measured_rate = (reading.time - self._last_reading[1]) / (now - self._last_reading[0])
        if reading.speed is None:
            return max(1.0, measured_rate)
        return reading.speed if abs(measured_rate - reading.speed) <= STEADY * reading.speed else measured_rate


@contextlib.asynccontextmanager
async def clock_follower(node: Node, clock: Clock, simulator: str | None) -> AsyncIterator[None]:
    """A context in which the Task Manager of this node is told the time of the simulator at this address (host:port), if there is one."""
    from somrs.task_manager.manager import TaskManager

    assert isinstance(node.component, TaskManager), "it was added as such"
    world_clock = node.component.state.clock
    if simulator is None:
        if world_clock.rate != 1.0:  # there was a simulator in an earlier run
            node.feed(Notified(WorldTimePassed(seconds=world_clock.time_at(clock.now()) - world_clock.time, rate=1.0)))
        yield
        return
    reckoning = Reckoning(world_clock)
    if world_clock.wall == 0.0:  # it was never told: the world's time begins to pass when it is known how fast
        _tell(node, reckoning.lose(clock.now()))
    task = asyncio.create_task(_follow(node, clock, reckoning, simulator))
    try:
        yield
    finally:
        task.cancel()
        await asyncio.wait({task})


async def _follow(node: Node, clock: Clock, reckoning: Reckoning, simulator: str) -> None:
    from somrs.devices.simulator.link.link import OperatorLink

    with contextlib.suppress(NotTaken):
        while True:
            try:
                async with OperatorLink.at(simulator) as operator:
                    while True:
                        async with asyncio.timeout(PATIENCE):
                            reading = await operator.clock()
                        _tell(node, reckoning.read(reading, clock.now()))
                        await asyncio.sleep(LOOK)
            except NotTaken:
                raise
            except (SomrsError, TimeoutError):
                _tell(node, reckoning.lose(clock.now()))
                await asyncio.sleep(LOOK)


def _tell(node: Node, notice: WorldTimePassed | None) -> None:
    if notice is not None:
        node.feed(Notified(notice))
