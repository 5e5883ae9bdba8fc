"""The interface of a contestant, and the loop in which its process measures it on request."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import msgspec

BIDDERS = 10
MAX_CONVERSATIONS = 16
"""The maximum number of conversations at the same time."""

MESSAGES = 3 * BIDDERS + 3
"""Arrange and Terms with each, Accept with one, Cancel with the others, Execute, Completed and End."""


class Contestant(Protocol):
    """A contestant. `line` distinguishes simultaneous conversations; a line holds one conversation after the other."""

    async def start(self, data: Path) -> None: ...

    async def converse(self, line: int) -> None:
        """Hold a whole conversation, from the request for the work to the knowledge that it has ended."""
        ...

    async def stop(self) -> None: ...


class Round(msgspec.Struct, frozen=True, kw_only=True):
    """A request for a measurement: its duration in seconds, and the number of conversations at a time."""

    seconds: float
    concurrency: int


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """The duration of a measurement, and of each conversation in it, in seconds."""

    elapsed: float
    latencies: list[float]


class Ready(msgspec.Struct, frozen=True, kw_only=True):
    """The contestant is ready for conversations."""

    name: str


async def measure(contestant: Contestant, round: Round) -> Measured:
    """Hold conversations until the time is over. Conversations that have begun by then are finished, and count."""
    latencies: list[float] = []
    started_at = time.perf_counter()
    end = started_at + round.seconds

    async def hold(line: int) -> None:
        while (start := time.perf_counter()) < end:
            await contestant.converse(line)
            latencies.append(time.perf_counter() - start)

    async with asyncio.TaskGroup() as group:
        for line in range(round.concurrency):
            group.create_task(hold(line))
    return Measured(elapsed=time.perf_counter() - started_at, latencies=latencies)


async def take_part(name: str, create: Callable[[], Contestant], data: Path) -> None:
    """Run measurements as the lines on standard input request, until its end."""
    contestant = create()
    loop = asyncio.get_running_loop()
    try:
        await contestant.start(data)
        write_message(Ready(name=name))
        while line := await loop.run_in_executor(None, sys.stdin.readline):
            write_message(await measure(contestant, msgspec.json.decode(line, type=Round)))
    finally:
        await contestant.stop()


def write_message(message: msgspec.Struct) -> None:
    print(msgspec.json.encode(message).decode(), flush=True)
