"""The rim of one process: the sockets, the one clock, and the loop that feeds components and carries out their effects.

A `Host` listens at one port and holds the components of its process, each at a path. A component's inputs are handled one
at a time; its effects are carried out in order, a `Record` being on disk before anything behind it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from msgspec import structs

from somrs.app.http import Server, Wire
from somrs.errors import InputError, RemoteError
from somrs.protocol import frp
from somrs.protocol.bodies import REPORTS, REQUESTS
from somrs.protocol.component import (
    Answered,
    Ask,
    Component,
    Effect,
    Input,
    Rang,
    Received,
    Record,
    Send,
    Started,
    Undelivered,
    Wake,
    Withdraw,
)
from somrs.protocol.envelope import ANONYMOUS, Message

log = logging.getLogger(__name__)

DELIVERY_TIME = 30.0
"""Seconds for which a message without a time limit of its own is sent again."""

FIRST_PAUSE = 0.05
"""Seconds before a message is sent again the first time; each time as long again, up to a second."""

ANSWER_TIME = 120.0
"""Seconds for which an anonymous requester's connection is kept open for the answer."""

Report = Callable[[object], None]
CarryOut = Callable[[object, Report], Awaitable[object]]
"""Does what an `Ask` wants. Values reported on the way, and the result, come back as `Answered`."""

Keep = Callable[[object], None]
"""Has a `Record` on disk when it returns."""

Watch = Callable[[Message, float], None]
"""Sees each message of the Failure Recovery Protocol that a component sends or receives, once."""


class Clock:
    """Seconds since 1970 that never go back while the process lives."""

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()

    def now(self) -> float:
        return time.monotonic() + self._offset


async def _nothing_to_do(task: object, report: Report) -> object:
    raise RemoteError(f"this node cannot do {type(task).__name__}")


def _no_disk(entry: object) -> None:
    raise RemoteError(f"this node keeps nothing, and was asked to keep {type(entry).__name__}")


@dataclass(slots=True, kw_only=True)
class _Outbox:
    """What waits to be sent to one address, in order, and who sends it."""

    waiting: deque[tuple[Send, float]] = field(default_factory=deque)
    sender: asyncio.Task[None] | None = None


class Node:
    """One component at its address: inputs in, effects out."""

    def __init__(self, host: Host, address: str, component: Component, carry_out: CarryOut, keep: Keep, watch: Watch | None) -> None:
        self.address, self.component = address, component
        self._host, self._carry_out, self._keep, self._watch = host, carry_out, keep, watch
        self._inputs: deque[Input] = deque()
        self._handling = False
        self._broken = False
        self._timers: dict[str, asyncio.TimerHandle] = {}
        self._asked: dict[str, asyncio.Task[None]] = {}
        self._outboxes: dict[str, _Outbox] = {}
        self._waiting: dict[asyncio.Future[Message], Message] = {}

    def feed(self, event: Input) -> None:
        """Have the component handle an input, after those that wait already.

        A component whose record could not be kept is ahead of its disk: it takes no more inputs. Raises RemoteError then.
        """
        if self._broken:
            raise RemoteError(f"{self.address} stopped, because it could not keep what it had to; see its log")
        self._inputs.append(event)
        if self._handling:
            return
        self._handling = True
        try:
            while self._inputs:
                for effect in self.component.handle(self._inputs.popleft(), self._host.clock.now()):
                    self._do(effect)
        finally:
            self._handling = False

    async def receive(self, message: Message) -> Message | None:
        """A message from the wire; the answer, when the sender waits for it on the same connection."""
        self._seen(message)
        if message.header.reply_to != ANONYMOUS:
            self.feed(Received(message))
            return None
        wanted: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._waiting[wanted] = message
        try:
            self.feed(Received(message))
            if not wanted.done() and not _is_waited_for(message):
                return None
            return await asyncio.wait_for(wanted, ANSWER_TIME)
        except TimeoutError:
            raise RemoteError(f"no answer to {type(message.body).__name__} within {ANSWER_TIME:.0f} s") from None
        finally:
            del self._waiting[wanted]

    async def close(self) -> None:
        """Stop everything under way. Nothing more is fed to the component."""
        for timer in self._timers.values():
            timer.cancel()
        running = [*self._asked.values(), *(box.sender for box in self._outboxes.values() if box.sender)]
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)

    async def flush(self, seconds: float) -> None:
        """Wait until what was sent is delivered, but no longer than this."""
        senders = [box.sender for box in self._outboxes.values() if box.sender]
        if senders:
            await asyncio.wait(senders, timeout=seconds)

    def _seen(self, message: Message) -> None:
        if self._watch is not None and message.header.transaction is not None:
            self._watch(message, self._host.clock.now())

    def _do(self, effect: Effect) -> None:
        match effect:
            case Send(message):
                self._send(effect, message)
            case Wake(timer, at):
                if (old := self._timers.pop(timer, None)) is not None:
                    old.cancel()
                if at is not None:
                    delay = max(0.0, at - self._host.clock.now())
                    self._timers[timer] = asyncio.get_running_loop().call_later(delay, self._ring, timer)
            case Ask(question, task):
                self._asked[question] = asyncio.create_task(self._carry(question, task))
            case Withdraw(question):
                if (asked := self._asked.get(question)) is not None:
                    asked.cancel()
            case Record(entry):
                try:
                    self._keep(entry)
                except BaseException as error:
                    log.critical("%s: a record could not be kept; nothing more is taken", self.address, exc_info=True)
                    self._broken = True
                    if isinstance(error, InputError):  # it is this node that was given a bad disk, not the sender that is wrong
                        raise RemoteError(f"{self.address} could not keep what it had to: {error}") from error
                    raise

    def _ring(self, timer: str) -> None:
        self._timers.pop(timer, None)
        self.feed(Rang(timer))

    async def _carry(self, question: str, task: object) -> None:
        value: object
        try:
            value = await self._carry_out(task, lambda partial: self.feed(Answered(question, partial)))
        except asyncio.CancelledError as error:
            value = error
        except Exception as error:  # whatever went wrong is the answer; the component says what it means
            log.debug("%s: %s failed", self.address, question, exc_info=True)
            value = error
        self._asked.pop(question, None)
        self.feed(Answered(question, value))

    def _send(self, effect: Send, message: Message) -> None:
        self._seen(message)
        recipient = message.header.recipient
        if recipient == ANONYMOUS:
            waiting = [one for one, asked in self._waiting.items() if not one.done() and _answers(message, asked)]
            for one in waiting:
                one.set_result(message)
            if not waiting:
                log.debug("%s: nobody waits for this %s any more", self.address, type(message.body).__name__)
            return
        until = effect.until if effect.until is not None else self._host.clock.now() + DELIVERY_TIME
        box = self._outboxes.setdefault(recipient, _Outbox())
        box.waiting.append((effect, until))
        if box.sender is None:
            box.sender = asyncio.create_task(self._deliver(recipient, box))

    async def _deliver(self, recipient: str, box: _Outbox) -> None:
        """Send what waits, in order. While nobody answers, whatever has run out of time is given up, wherever it stands."""
        pause = FIRST_PAUSE
        while box.waiting:
            effect, until = box.waiting[0]
            try:
                await self._host.post(recipient, effect.message, min(max(until - self._host.clock.now(), 1.0), 10.0))
            except RemoteError as error:
                await asyncio.sleep(pause)
                pause = min(pause * 2, 1.0)
                self._give_up_late(box, str(error))
            except Exception as error:  # a defect in one message must not hold back those behind it
                log.exception("%s: a %s could not be sent", self.address, type(effect.message.body).__name__)
                box.waiting.popleft()
                self.feed(Undelivered(effect.message, f"{type(error).__name__}: {error}"))
            else:
                pause = FIRST_PAUSE
                box.waiting.popleft()
        box.sender = None

    def _give_up_late(self, box: _Outbox, reason: str) -> None:
        now = self._host.clock.now()
        late = [effect.message for effect, until in box.waiting if until <= now]
        box.waiting = deque((effect, until) for effect, until in box.waiting if until > now)
        for message in late:
            self.feed(Undelivered(message, reason))


def _is_waited_for(message: Message) -> bool:
    """Whether the connection of a message without ReplyTo is kept open: for the answer to a request, or a participant's report
    to a coordinator that has no address."""
    kind = type(message.body)
    return kind in REQUESTS or (kind in REPORTS and message.header.sender == ANONYMOUS)


def _answers(answer: Message, asked: Message) -> bool:
    """Whether it is what the one who asked waits for. Signs of life are not; a report that is sent again relates to what was
    told first, and answers those who told it since."""
    if answer.header.relates_to == asked.header.message_id:
        return not isinstance(answer.body, frp.Progress)
    session, other = ((header.transaction, header.participant) for header in (answer.header, asked.header))
    return session == other and type(answer.body) in REPORTS.get(type(asked.body), ())


def _in_session(answer: Message, message: Message) -> Message:
    """The answer, related to the message and in its session: the Fault of a node that could not read it does not know either."""
    asked, answered = message.header, answer.header
    header = structs.replace(
        answered,
        relates_to=answered.relates_to or asked.message_id,
        transaction=answered.transaction or asked.transaction,
        participant=answered.participant or asked.participant,
    )
    return structs.replace(answer, header=header)


class Host:
    """The components of one process behind one port. Binds the loopback address unless told otherwise."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0, watch: Watch | None = None) -> None:
        self.clock = Clock()
        self.wire = Wire()
        self._nodes: dict[str, Node] = {}
        self._server = Server(host, port, {})
        self._watch = watch

    @property
    def url(self) -> str:
        return self._server.url

    async def start(self) -> None:
        await self._server.start()

    def add(
        self,
        path: str,
        make: Callable[[str], Component],
        *,
        carry_out: CarryOut = _nothing_to_do,
        keep: Keep = _no_disk,
    ) -> Node:
        """Put a component, made for its address, at a path such as `/repository`, and start it."""
        address = f"{self.url}{path}"
        node = Node(self, address, make(address), carry_out, keep, self._watch)
        self._nodes[address] = node
        self._server.parts[path] = node.receive
        node.feed(Started(address))
        return node

    async def post(self, recipient: str, message: Message, seconds: float) -> None:
        """Hand a message to whoever is at the address, in this process or another."""
        if (local := self._nodes.get(recipient)) is not None:
            local.feed(Received(message))
        else:
            answer = await self.wire.post(message, timeout=seconds)
            if answer is not None and (sender := self._nodes.get(message.header.sender)) is not None:
                sender.feed(Received(_in_session(answer, message)))

    async def request(self, message: Message, timeout: float = 30.0) -> Message:
        """Ask and wait for the answer on the same connection. Raises RemoteError."""
        if (local := self._nodes.get(message.header.recipient)) is not None:
            answer = await local.receive(message)
        else:
            answer = await self.wire.post(message, timeout=timeout)
        if answer is None:
            raise RemoteError(f"{message.header.recipient} did not answer {type(message.body).__name__}")
        return answer

    async def stop(self) -> None:
        for node in self._nodes.values():
            await node.close()
        with contextlib.suppress(RemoteError):
            await self._server.stop()
        await self.wire.close()
