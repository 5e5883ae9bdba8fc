"""A whole system in one process on virtual time: the rim without sockets, disks or waiting. What takes an hour takes none.

The same components run here as in `node.py`; only who carries their effects out is another. Any of them may be killed at any
point, and those that have a journal can be revived from it.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

from somrs.errors import RemoteError, UsageError
from somrs.kernel.codec import Schema
from somrs.kernel.component import (
    Answered,
    Ask,
    Component,
    DeliveryFailed,
    Effect,
    Input,
    Notified,
    Received,
    Record,
    Send,
    SetTimer,
    Started,
    TimerFired,
    Withdraw,
)
from somrs.kernel.pending import DELIVERY_TIME, FIRST_PAUSE, LONGEST_PAUSE, JournaledComponent
from somrs.protocol.messages.envelope import Message
from somrs.runtime.virtual_journal import VirtualJournal

LATENCY = 0.001
"""Seconds that a message takes."""

Work = Iterator[tuple[float, object]]
"""What an `Ask` comes to: pairs of seconds and the value reported then; the last is the result. `QUIET`: nothing is reported then."""

QUIET = object()

CarryOut = Callable[[object], Work]

Medium = Callable[[Message], Sequence[float]]
"""The seconds that a message takes: more than one for a message that comes again, none for one that is lost on the way. What is
lost is sent again after a pause, as long as its time is not over."""

Watch = Callable[[str, Input], None]
"""Sees each input, and whose it was, when its effects have been carried out."""

Restored = Callable[[str, Component], None]
"""Sees each component that comes back from its journal, as its journal has it: before it hears anything new."""


class Moment(StrEnum):
    """The point at which a component is killed. Its next input is not acknowledged then, so that a message comes again."""

    AT_ONCE = "between two inputs"
    UNSEEN = "at its next input, of which nothing is on disk yet"
    KEPT = "at its next input, when that is in its journal, with what it records, and nothing else was done"
    AMID = "at its next input, after some of the effects were carried out"


@dataclass(slots=True, eq=False)
class _Life:
    """A component from one start to its end. `doom`: when it ends, and after how many effects."""

    address: str
    component: Component
    journaled: JournaledComponent | None
    doom: tuple[Moment, int] | None = None


@dataclass(slots=True, eq=False)
class _Sent:
    """A message on its way; `by` is who sends it again until `until`, and knows it by its number. None: it is from outside."""

    message: Message
    until: float
    by: _Life | None = None
    number: int = 0
    pause: float = FIRST_PAUSE
    waiting: bool = False
    """No copy is on its way: it waits for its recipient, or for being sent again."""
    over: bool = False
    """It was acknowledged, or given up."""


def promptly(message: Message) -> Sequence[float]:
    """Nothing is late, nothing comes twice, and nothing is lost."""
    return (LATENCY,)


def at_once(answer: Callable[[object], object]) -> CarryOut:
    """Work that takes no time; what it raises is its answer."""

    def work(task: object) -> Work:
        try:
            yield 0.0, answer(task)
        except Exception as error:  # noqa: BLE001  # the component says what it means, as in node.py
            yield 0.0, error

    return work


def _cannot(task: object) -> object:
    raise RemoteError(f"nobody here can do {type(task).__name__}")


class World:
    """Components at their addresses, the messages between them, and the time."""

    def __init__(
        self,
        start: float = 1_000_000.0,
        *,
        medium: Medium = promptly,
        watch: Watch = lambda address, event: None,
        restored: Restored = lambda address, component: None,
    ) -> None:
        self.now = start
        self.messages: list[Message] = []
        """Every message that was sent, in order; a delivery that is tried again counts once."""
        self.components: dict[str, Component] = {}
        self.records: dict[str, list[object]] = {}
        """What each component recorded, by its address."""
        self._medium, self._watch, self._restored = medium, watch, restored
        self._lives: dict[str, _Life] = {}
        self._carry_out: dict[str, CarryOut] = {}
        self._journals: dict[str, VirtualJournal] = {}
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._count = itertools.count()
        self._timers: dict[tuple[str, Hashable], int] = {}
        self._work: dict[tuple[str, Hashable], int] = {}
        self._parked: list[_Sent] = []
        self._cut_off: set[str] = set()
        self._posted: set[str] = set()

    # Components

    def add(self, address: str, component: Component, carry_out: CarryOut | None = None, *, journaled: Schema | None = None) -> None:
        """Put a component at an address, where nothing is known of one before, and start it. `journaled`: its inputs are kept, as data of
        this schema."""
        self.records[address] = []
        self._journals.pop(address, None)
        self._carry_out[address] = carry_out or at_once(_cannot)
        if journaled is not None:
            self._journals[address] = VirtualJournal(component, journaled)
        self._begin(address, component)

    def remove(self, address: str) -> None:
        """It is gone, without a word, and whatever it had under way with it."""
        self.components.pop(address, None)
        life = self._lives.pop(address, None)
        for kept in (self._timers, self._work):
            for key in [key for key in kept if key[0] == address]:
                del kept[key]
        if life is not None:
            self._parked = [sent for sent in self._parked if sent.by is not life]

    def kill(self, address: str, moment: Moment = Moment.AT_ONCE, effects: int = 0) -> None:
        """Kill the component at that moment, `AMID` after so many effects; `alive` tells whether it came. Its disk stays."""
        if address not in self._lives:
            raise UsageError(f"{address} cannot be killed: nobody is there")
        if moment is Moment.AT_ONCE:
            self.remove(address)
        else:
            self._lives[address].doom = moment, effects

    def alive(self, address: str) -> bool:
        return address in self._lives

    def revive(self, address: str) -> None:
        """Start the component again with its journal: it goes on where it stopped. It is killed before, if it has not been yet."""
        journal = self._journal(address)
        self.remove(address)
        known = self.records[address]
        known += [record for record in journal.restart() if record not in known]
        self._restored(address, journal.journaled.component)
        self._begin(address, journal.journaled.component)

    def snapshot(self, address: str) -> None:
        """What a node does from time to time: the journal of a component begins anew with its state."""
        self._journal(address).snapshot()

    def _journal(self, address: str) -> VirtualJournal:
        if address not in self._journals:
            raise UsageError(f"{address} keeps no journal")
        return self._journals[address]

    def _begin(self, address: str, component: Component) -> None:
        journal = self._journals.get(address)
        self.components[address] = component
        self._lives[address] = life = _Life(address, component, journal.journaled if journal is not None else None)
        if life.journaled is not None:
            self._resume(life, life.journaled)
        self._feed(address, Started(address))
        self._deliver_parked()

    def _resume(self, life: _Life, journaled: JournaledComponent) -> None:
        """Take up what the component had under way when it was killed."""
        address, pending = life.address, journaled.pending
        for number, sent in pending.messages.items():
            again = _Sent(sent.message, sent.expiry_after_restart(self.now), life, number)
            again.waiting = overdue = again.until <= self.now
            if not overdue:
                self._count_once(sent.message)
            self._at(self.now, partial(self._give_up if overdue else self._try, again))
        for timer, at in pending.timers.items():
            self._set(address, timer, at)
        answers = dict(pending.find_abandoned_questions(journaled.schema.volatile))
        for question, task in pending.questions.items():
            if question in answers:
                self._at(self.now, partial(self._answer, address, question, answers[question], life))
            else:
                self._ask(address, question, task)

    def ring(self, address: str, timer: Hashable) -> None:
        """Ring a timer that is rung from outside."""
        self._feed(address, TimerFired(timer))

    def notify(self, address: str, notice: object) -> None:
        """Tell the component what its program would."""
        self._feed(address, Notified(notice))

    def cut_off(self, address: str) -> None:
        """It goes on, but nothing reaches it, and nothing that it sends arrives."""
        self._cut_off.add(address)

    def reconnect(self, address: str) -> None:
        self._cut_off.discard(address)
        self._deliver_parked()

    def timers(self, address: str) -> set[Hashable]:
        """The timers of a component that have yet to ring."""
        return {timer for owner, timer in self._timers if owner == address}

    def send(self, message: Message) -> None:
        """Send a message from outside."""
        self._post(_Sent(message, self.now + DELIVERY_TIME))

    # Time

    def run(self, seconds: float = 3600.0, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass until the condition holds (True), or for so long, or until nothing is left to happen."""
        end = self.now + seconds
        while not until():
            if not self._events or self._events[0][0] > end:
                self.now = end
                return until()
            self.now, _, happen = heapq.heappop(self._events)
            happen()
        return True

    def _at(self, when: float, happen: Callable[[], None]) -> None:
        heapq.heappush(self._events, (max(when, self.now), next(self._count), happen))

    # Inputs and effects

    def _feed(self, address: str, event: Input) -> bool:
        """Have the component handle an input. Whether it is acknowledged: somebody is there, and was not killed meanwhile."""
        life = self._lives.get(address)
        if life is None:
            return False
        if life.doom is not None and life.doom[0] is Moment.UNSEEN:
            self.remove(address)
            return False
        journal = self._journals.get(address)
        effects = journal.handle(event, self.now) if journal else [(effect, 0) for effect in life.component.handle(event, self.now)]
        if life.doom is not None:
            self._end(address, life, effects, *life.doom)
            return False
        for effect, number in effects:
            self._do(address, life, effect, number)
        self._watch(address, event)
        return True

    def _end(self, address: str, life: _Life, effects: list[tuple[Effect, int]], moment: Moment, count: int) -> None:
        """Carry out what of the effects still comes to be, and no more."""
        kept = [(effect, number) for effect, number in effects if isinstance(effect, Record)]
        for effect, number in effects[:count] if moment is Moment.AMID else kept:
            self._do(address, life, effect, number)
        self.remove(address)

    def _do(self, address: str, life: _Life, effect: Effect, number: int) -> None:
        match effect:
            case Send(message, until):
                self._post(_Sent(message, until if until is not None else self.now + DELIVERY_TIME, life, number))
            case SetTimer(timer, at):
                self._set(address, timer, at)
            case Ask(question, task):
                self._ask(address, question, task)
            case Withdraw(question):
                if self._work.pop((address, question), None) is not None:
                    self._at(self.now, partial(self._answer, address, question, RemoteError("withdrawn"), life))
            case Record(entry):
                self.records[address].append(entry)

    def _set(self, address: str, timer: Hashable, at: float | None) -> None:
        self._timers.pop((address, timer), None)
        if at is not None:
            serial = self._timers[address, timer] = next(self._count)
            self._at(at, partial(self._ring, address, timer, serial))

    def _ring(self, address: str, timer: Hashable, serial: int) -> None:
        if self._timers.get((address, timer)) == serial:
            del self._timers[address, timer]
            self._feed(address, TimerFired(timer))

    def _ask(self, address: str, question: Hashable, task: object) -> None:
        serial = self._work[address, question] = next(self._count)
        self._continue(address, question, serial, self._carry_out[address](task))

    def _answer(self, address: str, question: Hashable, value: object, life: _Life) -> None:
        if self._lives.get(address) is life:
            self._feed(address, Answered(question, value))

    def _continue(self, address: str, question: Hashable, serial: int, work: Work) -> None:
        step = next(work, None)
        if step is not None:
            self._at(self.now + step[0], partial(self._come, address, question, serial, work, step[1]))

    def _come(self, address: str, question: Hashable, serial: int, work: Work, value: object) -> None:
        if self._work.get((address, question)) == serial:
            if value is not QUIET:
                self._feed(address, Answered(question, value))
            if self._work.get((address, question)) == serial:
                self._continue(address, question, serial, work)

    # Messages

    def _count_once(self, message: Message) -> None:
        """Of what is taken up after a kill, some was sent before, and some was not."""
        if message.header.message_id not in self._posted:
            self._posted.add(message.header.message_id)
            self.messages.append(message)

    def _post(self, sent: _Sent) -> None:
        self._posted.add(sent.message.header.message_id)
        self.messages.append(sent.message)
        self._try(sent)

    def _try(self, sent: _Sent) -> None:
        """Send the message, for the first time or again."""
        if self._abandoned(sent):
            return
        sent.waiting = False
        times = self._medium(sent.message)
        for late in times:
            self._at(self.now + late, partial(self._arrive, sent))
        if not times:
            sent.waiting = True
            again = self.now + sent.pause
            sent.pause = min(sent.pause * 2, LONGEST_PAUSE)
            self._at(min(again, sent.until), partial(self._try if again < sent.until else self._give_up, sent))

    def _arrive(self, sent: _Sent) -> None:
        """At its recipient; or its sender repeats it, until it gets through or its time is over."""
        if self._reaches(sent.message) and self._feed(sent.message.header.recipient, Received(sent.message)):
            if not sent.over:
                self._over(sent)
        elif not (sent.over or sent.waiting or self._abandoned(sent)):
            sent.waiting = True
            self._parked.append(sent)
            self._at(sent.until, partial(self._give_up, sent))

    def _reaches(self, message: Message) -> bool:
        sender, recipient = message.header.sender, message.header.recipient
        return recipient in self.components and not self._cut_off & {sender, recipient}

    def _abandoned(self, sent: _Sent) -> bool:
        """Whether nobody sends it again, because its sender was killed. What is on its way may still arrive."""
        return sent.by is not None and self._lives.get(sent.by.address) is not sent.by

    def _over(self, sent: _Sent) -> None:
        sent.over, sent.waiting = True, False
        if sent.by is not None and sent.by.journaled is not None and not self._abandoned(sent):
            sent.by.journaled.mark_delivered(sent.number)

    def _deliver_parked(self) -> None:
        parked, self._parked = self._parked, []
        for sent in parked:
            if self._reaches(sent.message):
                sent.waiting = False
                self._at(self.now + LATENCY, partial(self._arrive, sent))
            else:
                self._parked.append(sent)

    def _give_up(self, sent: _Sent) -> None:
        if not sent.waiting or self._abandoned(sent):
            return
        if sent in self._parked:
            self._parked.remove(sent)
        self._over(sent)
        self._feed(sent.by.address if sent.by is not None else sent.message.header.sender, DeliveryFailed(sent.message, "nobody is there"))
