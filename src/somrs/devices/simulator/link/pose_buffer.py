"""Buffers the lines of a subscription to poses. Lines that have not been read yet are merged."""

from __future__ import annotations

import asyncio
from itertools import accumulate

from somrs.devices.simulator.link.lines import Mover, Poses


class PoseBuffer:
    """The poses that were received and not read yet."""

    def __init__(self) -> None:
        self._movers: tuple[Mover, ...] | None = None
        self._waiting: Poses | None = None
        self._end: Exception | None = None
        self._wake = asyncio.Event()

    def add_line(self, line: Poses) -> None:
        if line.movers is not None:
            self._movers, self._waiting = line.movers, line
        elif self._movers is None:
            return  # it belongs to an earlier subscription
        else:
            self._waiting = line if self._waiting is None else _merge(self._waiting, line, self._movers)
        self._wake.set()

    def fail(self, error: Exception) -> None:
        """End the subscription: `next_poses` raises the error when the buffer is empty."""
        self._end = error
        self._wake.set()

    async def next_poses(self) -> Poses:
        """Wait for poses, and return all since the last call, merged. Raises the error given to `fail`."""
        while self._waiting is None:
            if self._end is not None:
                raise self._end
            self._wake.clear()
            await self._wake.wait()
        line, self._waiting = self._waiting, None
        return line


def _merge(first: Poses, second: Poses, movers: tuple[Mover, ...]) -> Poses:
    """Merge two lines; the values of the second take precedence."""
    values = {**_by_mover(first, movers), **_by_mover(second, movers)}
    return Poses(
        time=second.time,
        clock=second.clock,
        movers=first.movers,
        moved=tuple(sorted(values)),
        values=tuple(value for mover in sorted(values) for value in values[mover]),
        robots={**first.robots, **second.robots},
    )


def _by_mover(line: Poses, movers: tuple[Mover, ...]) -> dict[int, tuple[float, ...]]:
    ends = [*accumulate((movers[i].numbers for i in line.moved), initial=0)]
    return {i: line.values[start:end] for i, start, end in zip(line.moved, ends, ends[1:], strict=False)}
