"""Reliability of services and utilisation of devices: how often a service completed its work, and how much of the time a device worked."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable

import msgspec

from somrs.client.task_history import TaskHistory
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.records import ReadRecords, TaskRecord
from somrs.protocol.messages.task_views import WorkView

MOST_TASKS = 1000
"""Maximum number of tasks read at the first request, the latest ones; older ones say little about the present."""

WINDOW = 600.0
"""Seconds over which the utilisation of a device is computed."""

MIN_SAMPLE_SIZE = 5
"""Number of attempts below which no percentage is given."""


class Tally(msgspec.Struct, frozen=True, kw_only=True):
    """How often a service began work in ended tasks (`started`; JSON: `began`), and with which results. `failed` includes work of a service
    that became unreachable; `stopped`: work that the Task Manager stopped."""

    started: int = msgspec.field(default=0, name="began")
    completed: int = 0
    failed: int = 0
    stopped: int = 0

    def in_words(self) -> str:
        """The counts as text; with a percentage if there are enough attempts for one."""
        attempts = self.completed + self.failed
        stopped = f", {self.stopped} stopped" if self.stopped else ""
        if not attempts:
            return f"nothing done yet{stopped}"
        percent = f" ({100 * self.completed / attempts:.0f} %)" if attempts >= MIN_SAMPLE_SIZE else ""
        return f"{self.completed} of {attempts} done{percent}{stopped}"


class ReliabilityStats:
    """Statistics of the records of ended tasks; each record is read once."""

    def __init__(self) -> None:
        self._counts: dict[str, Counter[State]] = {}
        self._spans: list[tuple[str, float, float]] = []
        """Device, start and end of each piece of work in the window, seconds since 1970."""
        self._latest_end: float | None = None
        self._latest_tasks: set[str] = set()
        """Tasks that ended at `_latest_end`."""
        self._learning = asyncio.Lock()

    async def learn(self, history: TaskHistory) -> None:
        """Read the records that are new since the last call."""
        async with self._learning:
            latest_end, record_count = self._latest_end, 0
            new: list[TaskRecord] = []
            async for page in history.pages(ReadRecords(since=latest_end, brief=True, limit=200)):
                new += [record for record in page.records if record.task not in self._latest_tasks]
                record_count += len(page.records)
                if latest_end is None and record_count >= MOST_TASKS:
                    break
            for record in new:
                self._add(record)
            if new:
                latest = max(record.ended_at for record in new)
                earlier_tasks = self._latest_tasks if latest == self._latest_end else set()
                self._latest_tasks = earlier_tasks | {record.task for record in new if record.ended_at == latest}
                self._latest_end = latest

    def _add(self, record: TaskRecord) -> None:
        for work in record.work:
            self._counts.setdefault(work.service, Counter())[work.result or work.state] += 1
            self._spans.append(_span(work, record.ended_at))

    def tally(self, service: str) -> Tally:
        counts = self._counts.get(service, Counter())
        failed = counts[State.FAILED] + counts[State.UNREACHABLE] + counts[State.STRANDED]
        # Records of early versions have no result of compensated work; it counts as completed.
        completed = counts[State.COMPLETED] + counts[State.COMPENSATED]
        return Tally(started=counts.total(), completed=completed, failed=failed, stopped=counts[State.STOPPED])

    def utilisations(self, under_way: Iterable[WorkView], now: float) -> dict[str, float]:
        """The utilisation of each device: the share of the window that ends now in which it was busy with steps of tasks."""
        self._spans = [span for span in self._spans if span[2] > now - WINDOW]
        spans: dict[str, list[tuple[float, float]]] = {}
        for device, started_at, ended_at in [*self._spans, *(_span(work, now) for work in under_way)]:
            if ended_at > now - WINDOW:
                spans.setdefault(device, []).append((max(started_at, now - WINDOW), min(ended_at, now)))
        return {device: _covered(parts) / WINDOW for device, parts in spans.items()}


def _span(work: WorkView, end: float) -> tuple[str, float, float]:
    return device_of(work.service), work.began, work.ended if work.ended is not None else end


def device_of(service: str) -> str:
    """The name of the device that offers a service: `Robot1` for `Robot1.TransferObject`."""
    return service.partition(".")[0]


def _covered(spans: Iterable[tuple[float, float]]) -> float:
    """The total time covered by at least one of the spans, in seconds."""
    total, end = 0.0, float("-inf")
    for started_at, ended_at in sorted(spans):
        total += max(0.0, ended_at - max(started_at, end))
        end = max(end, ended_at)
    return total
