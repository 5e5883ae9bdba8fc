"""What an operator who follows poses was told and has not taken yet. One who takes it late finds it as one news."""

from __future__ import annotations

import asyncio
from itertools import accumulate

from somrs.devices.simulator.link.lines import Mover, Poses


class PoseBuffer:
    """Poses between the connection and whoever follows them."""

    def __init__(self) -> None:
        self._movers: tuple[Mover, ...] | None = None
        self._waiting: Poses | None = None
        self._end: Exception | None = None
        self._wake = asyncio.Event()

    def add_line(self, line: Poses) -> None:
        if line.movers is not None:
            self._movers, self._waiting = line.movers, line
        elif self._movers is None:
            return  # of a telling that was ended
        else:
            self._waiting = line if self._waiting is None else _merge(self._waiting, line, self._movers)
        self._wake.set()

    def fail(self, error: Exception) -> None:
        """No more comes."""
        self._end = error
        self._wake.set()

    async def next_poses(self) -> Poses:
        """All that came since this was asked last. Raises what it was failed with."""
        while self._waiting is None:
            if self._end is not None:
                raise self._end
            self._wake.clear()
            await self._wake.wait()
        line, self._waiting = self._waiting, None
        return line


def _merge(first: Poses, second: Poses, movers: tuple[Mover, ...]) -> Poses:
    """Both as one: what the second says counts."""
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
