"""The runtime of one component: passes it one input at a time, and performs its effects on sockets, timers, disks and devices.

Effects are performed in order, each when everything it may depend on is on disk; the sender of a message is acknowledged under the same
condition. All nodes of a process share one `Host`, which has the sockets and the clock.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Awaitable, Callable, Hashable, Sequence

from somrs.errors import RemoteError, UsageError
from somrs.kernel.admission import Admitting
from somrs.kernel.component import (
    Answered,
    Ask,
    Component,
    DeliveryFailed,
    Effect,
    Input,
    Notified,
    PartialAnswer,
    Received,
    Record,
    Send,
    SetTimer,
    Started,
    TimerFired,
    Withdraw,
)
from somrs.kernel.durability import DELIVERY_TIME, JournaledComponent
from somrs.limits import limits
from somrs.protocol.messages.envelope import ANONYMOUS, Message
from somrs.runtime.clock import Clock
from somrs.runtime.outbox import OutgoingMessage
from somrs.runtime.output import Output
from somrs.runtime.pending_replies import PendingReplies, in_session, is_waited_for
from somrs.runtime.reception import NotTaken
from somrs.runtime.timers import Timers
from somrs.storage.disk import TRY_PAUSE, WriteFailed
from somrs.storage.journal import Journal
from somrs.storage.stored_copy import Replaced

log = logging.getLogger(__name__)

ANSWER_TIME = 120.0
"""Seconds for which a connection stays open for the answer to a request with anonymous ReplyTo."""

QUIET = 0.05
"""Seconds without an input after which a snapshot that is due is taken."""

DISK_TIME = 5.0
"""Seconds within which the disk must finish writing when the node stops."""

Report = Callable[[object], None]
CarryOut = Callable[[object, Report], Awaitable[object]]
"""Performs the task of an `Ask`. Reported values and the result come back as `Answered`."""

Watch = Callable[[Message, float], None]
"""Called once for each message of the Failure Recovery Protocol that a component sends or receives."""


async def refuse_work(task: object, report: Report) -> object:
    """Performs no task."""
    raise RemoteError(f"this node cannot do {type(task).__name__}")


class Node:
    """A component at its address: inputs in, effects out.

    `send` delivers a message to its recipient, and repeats it until it is acknowledged; `delivered` waits until no message is under way,
    for at most this number of seconds.

    With `journaled`, each input is in the journal before any of its effects is visible outside. Read-only inputs are not stored, but wait
    for those before them. Without `journaled`, nothing is stored, and nothing waits.

    `recovers`: after a failed write, continue as the journal has it when it can be written again, and meanwhile handle inputs that read.
    """

    def __init__(
        self,
        address: str,
        component: Component,
        carry_out: CarryOut,
        *,
        clock: Clock,
        send: Callable[[OutgoingMessage], None],
        delivered: Callable[[float], Awaitable[None]],
        journal: Journal | None = None,
        journaled: JournaledComponent | None = None,
        watch: Watch | None = None,
        recovers: bool = False,
    ) -> None:
        self.address, self.component = address, component
        self._clock, self._send, self._delivered = clock, send, delivered
        self._carry_out, self._watch, self._bounds = carry_out, watch, limits()
        self._journal, self._journaled = journal, journaled
        self._inputs: deque[Input] = deque()
        self._handling = self._closed = False
        self._broken = ""
        self._recovers = recovers
        self._recovery: asyncio.Task[None] | None = None
        self._is_readable = False  # while nothing can be stored: whether the component is as its journal has it
        self._notices: Sequence[object] = ()
        self._is_replaced = False
        """Whether another process continues the component; senders have to try again, and reach that one."""
        self.broken = asyncio.Event()
        """Set when an input could not be stored: the component takes no more inputs."""
        self._timers = Timers(clock, lambda timer: self._feed_late(TimerFired(timer)))
        self._work_tasks: dict[Hashable, asyncio.Task[None]] = {}
        self._pending_replies = PendingReplies()
        self._snapshot: asyncio.TimerHandle | None = None
        self._last_input = 0.0
        self.output = Output(journal.disk if journal is not None else None, self._perform, self._break)

    # Inputs

    def feed(self, event: Input) -> None:
        """Let the component handle an input, after those that wait already.

        Raises:
            RemoteError: the node is stopping, or could not store an earlier input: the component is then ahead of its disk.
        """
        if self._closed:
            raise NotTaken(f"{self.address} is stopping")
        if self._broken and not (self._is_readable and self._only_reads(event)):
            raise NotTaken(self._broken)
        self._inputs.append(event)
        if self._handling:
            return
        self._handling = True
        try:
            while self._inputs:
                self._handle(self._inputs.popleft())
        finally:
            self._handling = False
            if self._inputs:  # behind one that raised an error
                asyncio.get_running_loop().call_soon(self._continue_inputs)

    def _only_reads(self, event: Input) -> bool:
        return self._journaled is not None and self._journaled.schema.is_read_only(event)

    def _continue_inputs(self) -> None:
        if self._inputs and not self._closed and not self._broken:
            self.feed(self._inputs.popleft())

    def _handle(self, event: Input) -> None:
        now = self._clock.now()
        if self._journaled is None or self._journal is None or self._only_reads(event):
            for effect in self.component.handle(event, now):
                self._dispatch(effect, 0)
            return
        journal, journaled = self._journal, self._journaled
        entry = journaled.make_entry(event, now)
        journal.append(entry)
        try:
            effects = journaled.handle(entry)
            for effect, _ in effects:
                if isinstance(effect, Record):
                    journal.store_record(effect.entry)
        finally:
            journal.note(journaled.component)
            self.output.position = journal.disk.position
        for effect, number in effects:
            self._dispatch(effect, number)
        self._last_input = time.monotonic()
        if journal.due and self._snapshot is None:
            self._snapshot = asyncio.get_running_loop().call_later(QUIET, self._take_snapshot)

    async def receive(self, message: Message) -> Message | None:
        """Handle a message from the network. Return the answer, when the sender waits for it on the same connection.

        Raises UsageError for a request that would be one too many.
        """
        if isinstance(self.component, Admitting):
            self.component.check_admitted(message, self._bounds)
        self._show_watcher(message)
        if message.header.reply_to != ANONYMOUS:
            self.feed(Received(message))
            await self.output.on_disk()
            return None
        with self._pending_replies.waiting(message) as reply:
            try:
                self.feed(Received(message))
                await self.output.on_disk()
                if not reply.done() and not is_waited_for(message):
                    return None
                async with asyncio.timeout(ANSWER_TIME):
                    return await reply
            except TimeoutError:
                raise RemoteError(f"no answer to {type(message.body).__name__} within {ANSWER_TIME:.0f} s") from None
            except NotTaken as error:
                if self._closed or self._is_replaced or self._recovers:
                    raise
                raise RemoteError(str(error)) from None  # a sender that waits for an answer gets the error at once

    # From start to stop

    def start(self, *, is_resumed: bool, notices: Sequence[object] = ()) -> None:
        """Start the component, after passing it the `notices`. `is_resumed`: first continue what was under way when the process ended."""
        self._notices = notices
        if is_resumed and self._journaled is not None:
            self._resume(self._journaled)
        for notice in notices:
            self.feed(Notified(notice))
        self.feed(Started(self.address))

    def _resume(self, journaled: JournaledComponent) -> None:
        loop, now, pending = asyncio.get_running_loop(), self._clock.now(), journaled.pending
        for number, sent_message in [*pending.messages.items()]:
            outgoing = OutgoingMessage(self, sent_message.message, sent_message.expiry_after_restart(now), number)
            if outgoing.deadline <= now:
                loop.call_soon(self.handle_delivery_failure, outgoing, "it expired while its sender was not running")
            else:
                self._send(outgoing)
        for timer, fire_time in pending.timers.items():
            self._timers.set(timer, fire_time)
        answers = dict(pending.find_abandoned_questions(journaled.schema.volatile))
        for question, task in pending.questions.items():
            if question in answers:
                loop.call_soon(self._answer, question, answers[question])
            else:
                self._ask(question, task)

    async def close(self) -> None:
        """Stop everything under way. The component gets no more inputs."""
        self._closed = True
        if self._recovery is not None:
            self._recovery.cancel()
        await self._stop_work()
        if self._journal is not None and self._journaled is not None and not self._broken:
            self._journal.snapshot(self._journaled)
            self.output.position = self._journal.disk.position
        with contextlib.suppress(RemoteError, TimeoutError):  # every waiting request gets the error; there is no other place to report it
            async with asyncio.timeout(DISK_TIME):
                await self.output.on_disk()

    async def _stop_work(self) -> None:
        self._timers.cancel_all()
        if self._snapshot is not None:
            self._snapshot.cancel()
        for task in (running := [*self._work_tasks.values()]):
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)

    async def flush(self, seconds: float) -> None:
        """Wait until the sent messages are delivered, for at most `seconds`."""
        with contextlib.suppress(RemoteError, TimeoutError):
            async with asyncio.timeout(seconds):
                await self.output.on_disk()
        await self._delivered(seconds)

    def _take_snapshot(self) -> None:
        self._snapshot = None
        if self._journal is None or self._journaled is None or self._closed or self._broken:
            return
        if self._journal.overdue or time.monotonic() - self._last_input >= QUIET / 2:
            self._journal.snapshot(self._journaled)
            self.output.position = self._journal.disk.position
        else:
            self._snapshot = asyncio.get_running_loop().call_later(QUIET, self._take_snapshot)

    # Effects

    def _dispatch(self, effect: Effect, number: int) -> None:
        """Perform an effect, now or when everything it may depend on is on disk."""
        # Every effect comes this way, and class patterns take longer.
        if isinstance(effect, SetTimer):
            self._timers.set(effect.timer, effect.at)  # not visible outside; the effects of its firing wait in their turn
        elif not isinstance(effect, Record):  # the journal stores records
            self.output.add_effect(effect, number)

    def _break(self, error: Exception) -> None:
        """Stop after a failed write: discard the effects behind it, and fail every waiting request."""
        # The sender is not at fault; it has to send the message again.
        refusal = NotTaken(f"{self.address} accepts no more inputs, because it could not store one: {error}")
        if not self._broken:
            log.critical("%s", refusal)
        self._broken, self._is_replaced = str(refusal), isinstance(error, Replaced)
        self.broken.set()
        self.output.drop(refusal)
        self._pending_replies.fail_all(refusal)
        if self._recovers and isinstance(error, WriteFailed) and (self._recovery is None or self._recovery.done()):
            self._recovery = asyncio.create_task(self._recover())

    async def _recover(self) -> None:
        """Continue as the journal has it: with what only reads at once, with everything when the journal can be written again."""
        assert self._journal is not None, "something could not be stored"
        await self._stop_work()
        self._work_tasks, self._snapshot = {}, None
        self._inputs.clear()
        disk = self._journal.disk
        while self._broken:
            try:
                if not self._is_readable:
                    self._journaled = self._journal.reread()
                    self.component, self.output.position = self._journaled.component, disk.durable
                    self._is_readable = True
                await disk.try_writing()
            except UsageError as error:
                log.debug("%s: %s", self.address, error)
                await asyncio.sleep(TRY_PAUSE)
            else:
                disk.resume()
                self._broken, self._is_readable, self.output.position = "", False, disk.position
                self.broken.clear()
        log.warning("%s accepts inputs again: they can be stored", self.address)
        self.start(is_resumed=True, notices=self._notices)

    def _perform(self, effect: Effect, number: int) -> None:
        match effect:
            case Send(message, deadline):
                self._show_watcher(message)
                if message.header.recipient == ANONYMOUS:
                    self._pending_replies.answer(message)
                elif not self._closed:
                    self._send(
                        OutgoingMessage(self, message, deadline if deadline is not None else self._clock.now() + DELIVERY_TIME, number)
                    )
            case Ask(question, task) if not self._closed:
                self._ask(question, task)
            case Withdraw(question):
                if (running_task := self._work_tasks.get(question)) is not None:
                    running_task.cancel()

    def _ask(self, question: Hashable, task: object) -> None:
        self._work_tasks[question] = asyncio.create_task(self._carry(question, task))

    async def _carry(self, question: Hashable, task: object) -> None:
        value: object

        def report(partial: object) -> None:
            assert isinstance(partial, PartialAnswer), f"only a PartialAnswer is reported before the answer, not a {type(partial).__name__}"
            self.feed(Answered(question, partial))

        try:
            value = await self._carry_out(task, report)
        except asyncio.CancelledError as error:
            value = error
        except Exception as error:  # any error is the answer; the component interprets it
            log.debug("%s: %s failed", self.address, question, exc_info=True)
            value = error
        if self._work_tasks.get(question) is asyncio.current_task():
            del self._work_tasks[question]
            self._answer(question, value)

    def _answer(self, question: Hashable, value: object) -> None:
        self._feed_late(Answered(question, value))

    def _feed_late(self, event: Input) -> None:
        """Pass an input for which no request waits. A stopped component misses it; one with a journal gets it after a restart."""
        try:
            self.feed(event)
        except RemoteError as error:
            log.debug("%s: %s", self.address, error)

    # Messages

    def _show_watcher(self, message: Message) -> None:
        if self._watch is not None and message.header.transaction is not None:
            self._watch(message, self._clock.now())

    def handle_acknowledgement(self, outgoing: OutgoingMessage, answer: Message | None = None) -> None:
        """Handle the acknowledgement of a message, and the answer if one came on the same connection."""
        if self._closed:
            return  # with a journal, the message is sent again after a restart
        if self._journaled is not None:
            self._journaled.mark_delivered(outgoing.number)
        if answer is not None:
            try:
                self.feed(Received(in_session(answer, outgoing.message)))
            except Exception:  # the recipient accepted the message, whatever its answer causes here
                log.exception("%s: a %s could not be handled", self.address, type(answer.body).__name__)

    def handle_delivery_failure(self, outgoing: OutgoingMessage, reason: str) -> None:
        """Handle the expiry of a message that was not acknowledged."""
        if self._closed:
            return
        if self._journaled is not None:
            self._journaled.mark_delivered(outgoing.number)
        try:
            self._feed_late(DeliveryFailed(outgoing.message, reason))
        except Exception:  # a defect here must not hold back messages of others
            log.exception("%s: it could not be handled that a message was not delivered", self.address)
