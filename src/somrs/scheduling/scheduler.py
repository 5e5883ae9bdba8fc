"""Has the tasks of standing orders stated when they are due, each time once, and notes what comes of them.

The id of the message that states a task is made of the order and the time at which it was due. So it can be sent again, after an answer
that never came, or after a restart, and is one task. What was due while nobody was there is not made up for; it is told.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine
from datetime import tzinfo
from typing import Protocol

from msgspec import structs

from somrs.client.client import PATIENCE, Client
from somrs.client.task_report import reasons
from somrs.errors import InputError, RemoteError
from somrs.protocol.messages.clients import Phase, ReadRecords, Submit, TaskView, WatchTask
from somrs.protocol.messages.envelope import message_id
from somrs.runtime.wire import Unanswered
from somrs.scheduling.recurrence import due_after, due_between
from somrs.scheduling.standing_orders import Run, RunState, StandingOrder
from somrs.scheduling.store import Book

log = logging.getLogger(__name__)

LATE = 60.0
"""Seconds after which a time is missed: until then a task is stated late, after a restart, say."""

LOOK = 30.0
"""Seconds after which the clock is looked at in any case: it may be put forward."""

AGAIN = 2.0
"""Seconds after which a Task Manager that does not answer is asked again."""

WAIT = 50.0
"""Seconds that a question waits for a task to end."""

ALL_EVENTS = 10**9
"""More than any task has: only its end is news then."""


class Clock(Protocol):
    def now(self) -> float:
        """Seconds since 1970."""

    async def sleep(self, seconds: float) -> None: ...


class WallClock:
    """The machine's."""

    def now(self) -> float:
        return time.time()

    async def sleep(self, seconds: float) -> None:
        await asyncio.sleep(seconds)


class Scheduler:
    """`task_of` gives the task of an order, as it is to be stated now, and raises InputError when there is none; `tell` is called
    whenever something is another way than before."""

    def __init__(
        self,
        book: Book,
        client: Client,
        task_of: Callable[[StandingOrder], Submit],
        tell: Callable[[], None],
        clock: Clock,
        zone: tzinfo | None = None,
    ) -> None:
        self._book, self._client, self._task_of, self._tell, self._clock, self._zone = book, client, task_of, tell, clock, zone
        self._changed = asyncio.Event()
        self._under_way: set[asyncio.Task[None]] = set()

    def seen(self, order: StandingOrder) -> StandingOrder:
        """The order, with when it is due next, and what came of the last time."""
        runs = self._book.runs_of(order.id)
        next = due_after(order.when, max(self._considered(order), self._clock.now()), self._zone) if order.enabled else None
        return structs.replace(order, next=next, last=runs[-1] if runs else None)

    def changed(self) -> None:
        """The orders are others than before."""
        self._changed.set()

    async def run(self) -> None:
        """Until it is cancelled."""
        try:
            for id, runs in [*self._book.runs.items()]:
                for run in runs:
                    if run.open:
                        self._begin(self._resume(id, run))
            while True:
                self._changed.clear()
                try:
                    await self._state_what_is_due()
                except InputError as error:  # the disk is full, say: nothing was stated that is not noted
                    log.error("%s", error)
                    await asyncio.sleep(LOOK)
                await self._until_something_is_due()
        finally:
            for task in self._under_way:
                task.cancel()
            await asyncio.gather(*self._under_way, return_exceptions=True)

    # When

    def _considered(self, order: StandingOrder) -> float:
        """Until when all times were dealt with."""
        runs = self._book.runs_of(order.id)
        return max(order.changed_at, runs[-1].due if runs else 0.0)

    async def _until_something_is_due(self) -> None:
        dues = [due_after(order.when, self._considered(order), self._zone) for order in self._book.orders.values() if order.enabled]
        pause = min((due - self._clock.now() for due in dues if due is not None), default=LOOK)
        sleeping = asyncio.ensure_future(self._clock.sleep(min(max(pause, 0.0), LOOK)))
        waiting = asyncio.ensure_future(self._changed.wait())
        try:
            await asyncio.wait({sleeping, waiting}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            sleeping.cancel()
            waiting.cancel()

    async def _state_what_is_due(self) -> None:
        """Of each order the last time at which it was due, unless that is long ago; those before were missed."""
        now = self._clock.now()
        for order in [*self._book.orders.values()]:
            times, last = due_between(order.when, self._considered(order), now, self._zone) if order.enabled else (0, None)
            if last is None:
                continue
            late = now - last > LATE
            missed = times if late else times - 1
            if missed:
                of = last if late else due_between(order.when, self._considered(order), last - 0.001, self._zone)[1] or last - 0.001
                await self._note(order.id, Run(due=of, state=RunState.MISSED, at=now, times=missed, note="the windows were not running"))
            if not late:
                run = Run(due=last, state=RunState.SUBMITTING, at=now, task=_task_id(order.id, last))
                await self._note(order.id, run)
                self._begin(self._state(order, run))

    # What

    def _begin(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(work)
        self._under_way.add(task)
        task.add_done_callback(self._over)

    def _over(self, task: asyncio.Task[None]) -> None:
        self._under_way.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("a standing order could not be dealt with", exc_info=error)

    async def _state(self, order: StandingOrder, run: Run) -> None:
        """State its task, unless the one before runs."""
        if order.skip and (before := await self._running_before(order.id, run)) is not None:
            note = f"the task before ({before}) was still under way"
            await self._note(order.id, structs.replace(run, state=RunState.SKIPPED, task=None, note=note))
            return
        try:
            task = self._task_of(order)
            await self._client.submit(task, patience=PATIENCE, id=_message_id(order.id, run.due), by=f"order {order.name}")
        except Unanswered:
            await self._resume(order.id, run)
        except (InputError, RemoteError) as error:
            await self._note(order.id, structs.replace(run, state=RunState.REFUSED, task=None, note=str(error)))
        else:
            await self._follow(order.id, structs.replace(run, state=RunState.SUBMITTED))

    async def _running_before(self, id: str, run: Run) -> str | None:
        """The task of a time before, if it runs."""
        for before in reversed(self._book.runs_of(id)):
            if before.due < run.due and before.open and before.task is not None:
                try:
                    seen = await self._looked(before.task, wait=0.0)
                except RemoteError:
                    return before.task  # as far as is known
                if seen is not None and seen.phase is not Phase.ENDED:
                    return before.task
        return None

    async def _resume(self, id: str, run: Run) -> None:
        """It was not heard whether the task was taken, or it was, and ran when this process ended."""
        if run.state is RunState.SUBMITTED:
            await self._follow(id, run)
        elif await self._patiently(run, wait=0.0) is not None:
            await self._follow(id, structs.replace(run, state=RunState.SUBMITTED))
        elif self._clock.now() - run.due <= LATE and (order := self._book.orders.get(id)) is not None:
            await self._state(order, run)
        else:
            note = "the Task Manager was not there, and has not taken the task"
            await self._note(id, structs.replace(run, state=RunState.MISSED, task=None, note=note))

    async def _follow(self, id: str, run: Run) -> None:
        """Until its task is over."""
        await self._note(id, run)
        seen: TaskView | None = None
        while seen is None or seen.phase is not Phase.ENDED:
            seen = await self._patiently(run, WAIT)
            if seen is None:
                told = "nothing is known of its task any more"
                await self._note(id, structs.replace(run, ended_at=self._clock.now(), note=told))
                return
        why = next(iter(reasons(seen)), "")
        await self._note(id, structs.replace(run, outcome=seen.outcome, ended_at=seen.ended_at or self._clock.now(), note=why))

    async def _patiently(self, run: Run, wait: float) -> TaskView | None:
        """Its task as it is, once somebody answers; None if nobody knows of it."""
        assert run.task is not None, "what is stated has an id"
        while True:
            try:
                return await self._looked(run.task, wait)
            except RemoteError:
                await asyncio.sleep(AGAIN)

    async def _looked(self, task: str, wait: float) -> TaskView | None:
        """The task as it is, at the latest after so many seconds; None if nobody knows of it."""
        try:
            return (await self._client.watch(WatchTask(task=task, after=ALL_EVENTS, wait=wait))).view
        except Unanswered:
            raise
        except RemoteError:
            records = (await self._client.records(ReadRecords(task=task, brief=True, limit=1))).records
        if not records:
            return None
        kept = records[0]
        return TaskView(
            task=kept.task,
            effect=kept.effect,
            phase=Phase.ENDED,
            submitted_at=kept.submitted_at,
            outcome=kept.outcome,
            ended_at=kept.ended_at,
            explanation=kept.explanation,
            reasons=kept.reasons,
        )

    async def _note(self, id: str, run: Run) -> None:
        await self._book.note(id, run)
        self._tell()


def _message_id(order: str, due: float) -> str:
    """Of the message that states the order's task of that time."""
    return message_id("order", order, f"{due:.3f}")


def _task_id(order: str, due: float) -> str:
    """As the Task Manager calls it."""
    return message_id("task", _message_id(order, due))
