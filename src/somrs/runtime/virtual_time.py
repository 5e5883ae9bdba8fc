"""A whole system in one process on virtual time: a runtime without sockets, disks or waiting.

The components are the same as in `node.py`; only their effects are performed differently. A component can be killed at any point and, if it
has a journal, revived from it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

from somrs.errors import RemoteError, UsageError
from somrs.kernel.codec import Schema
from somrs.kernel.component import Answered, Ask, Component, Effect, Input, Notified, Record, Send, SetTimer, Started, TimerFired, Withdraw
from somrs.kernel.durability import JournaledComponent
from somrs.protocol.messages.envelope import Message
from somrs.runtime.virtual_clock import VirtualClock
from somrs.runtime.virtual_journal import VirtualJournal
from somrs.runtime.virtual_network import Medium, Sender, VirtualNetwork, promptly

Work = Iterator[tuple[float, object]]
"""The steps of the work for an `Ask`: pairs of seconds and a value to report then; the last value is the result.

`QUIET` stands for no value.
"""

QUIET = object()

CarryOut = Callable[[object], Work]

Watch = Callable[[str, Input], None]
"""Called with each input and the address of its component, after the effects have been performed."""

Restored = Callable[[str, Component], None]
"""Called with each component that was restored from its journal, before its next input."""


class KillPoint(StrEnum):
    """The point at which a component is killed. The input at that point is not acknowledged, so its message is sent again."""

    BETWEEN_INPUTS = "between two inputs"
    UNSEEN = "at its next input, of which nothing is on disk yet"
    JOURNALED = "at its next input, when that is in its journal, with what it records, and nothing else was done"
    AMID = "at its next input, after some of the effects were carried out"


@dataclass(slots=True, eq=False)
class _Life(Sender):
    """A component from one start to its end. `planned_kill`: the point of its end, and the number of effects before it."""

    component: Component
    planned_kill: tuple[KillPoint, int] | None = None


def _immediate_work(answer: Callable[[object], object]) -> CarryOut:
    """Return work that takes no time. An exception of `answer` is the answer."""

    def work(task: object) -> Work:
        try:
            yield 0.0, answer(task)
        except Exception as error:  # noqa: BLE001  # the component interprets it, as in node.py
            yield 0.0, error

    return work


def _refuse_work(task: object) -> object:
    raise RemoteError(f"this component cannot do {type(task).__name__}")


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
        self.components: dict[str, Component] = {}
        self.records: dict[str, list[object]] = {}
        """The records of each component, by its address."""
        self._watch, self._restored = watch, restored
        self._lives: dict[str, _Life] = {}
        self._clock = VirtualClock(start)
        self._network = VirtualNetwork(self._clock, medium, self._lives, self._feed)
        self._carry_out: dict[str, CarryOut] = {}
        self._journals: dict[str, VirtualJournal] = {}
        self._count = itertools.count()
        self._timers: dict[tuple[str, Hashable], int] = {}
        self._work: dict[tuple[str, Hashable], int] = {}

    @property
    def messages(self) -> list[Message]:
        """Every message that was sent, in order; repetitions are not counted."""
        return self._network.messages

    # Components

    def add(self, address: str, component: Component, carry_out: CarryOut | None = None, *, journaled: Schema | None = None) -> None:
        """Add a component at a new address, and start it. `journaled`: store its inputs as data of this schema."""
        self.records[address] = []
        self._journals.pop(address, None)
        self._carry_out[address] = carry_out or _immediate_work(_refuse_work)
        if journaled is not None:
            self._journals[address] = VirtualJournal(component, journaled)
        self._begin(address, component)

    def remove(self, address: str) -> None:
        """Remove the component and everything that it had under way, without a message."""
        self.components.pop(address, None)
        life = self._lives.pop(address, None)
        for entries in (self._timers, self._work):
            for key in [key for key in entries if key[0] == address]:
                del entries[key]
        if life is not None:
            self._network.abandon(life)

    def kill(self, address: str, moment: KillPoint = KillPoint.BETWEEN_INPUTS, effects: int = 0) -> None:
        """Kill the component at this moment, for `AMID` after this number of effects; its disk stays. `alive` is False after that."""
        if address not in self._lives:
            raise UsageError(f"{address} cannot be killed: there is no component")
        if moment is KillPoint.BETWEEN_INPUTS:
            self.remove(address)
        else:
            self._lives[address].planned_kill = moment, effects

    def alive(self, address: str) -> bool:
        return address in self._lives

    def revive(self, address: str) -> None:
        """Start the component again from its journal, at the point where it stopped. Kill it first, if it is alive."""
        journal = self._journal(address)
        self.remove(address)
        self._restore(address, journal, journal.restart())

    def add_standby(self, address: str) -> None:
        """Let a standby on another host follow the component's journal from now on."""
        self._journal(address).add_standby()

    def take_over(self, address: str, lingering: float = 0.0) -> None:
        """Let the standby continue the component. The earlier process, if it is alive, cannot write to the journal any more, and so handles
        nothing; but it goes on sending what it had under way for `lingering` seconds."""
        journal, life = self._journal(address), self._lives.get(address)
        if life is not None and lingering:
            self._network.linger(life, lingering)
        self.remove(address)
        self._restore(address, journal, journal.take_over())

    def _restore(self, address: str, journal: VirtualJournal, known_records: list[object]) -> None:
        records = self.records[address]
        records += [record for record in known_records if record not in records]
        self._restored(address, journal.journaled.component)
        self._begin(address, journal.journaled.component)

    def snapshot(self, address: str) -> None:
        """Take a snapshot of the component, as a node does from time to time."""
        self._journal(address).snapshot()

    def _journal(self, address: str) -> VirtualJournal:
        if address not in self._journals:
            raise UsageError(f"{address} has no journal")
        return self._journals[address]

    def _begin(self, address: str, component: Component) -> None:
        journal = self._journals.get(address)
        self.components[address] = component
        self._lives[address] = life = _Life(address, journal.journaled if journal is not None else None, component)
        if life.journaled is not None:
            self._resume(life, life.journaled)
        self._feed(address, Started(address))
        self._network.deliver_parked()

    def _resume(self, life: _Life, journaled: JournaledComponent) -> None:
        """Continue what the component had under way when it was killed."""
        address, pending = life.address, journaled.pending
        for number, sent_message in pending.messages.items():
            self._network.resume(sent_message.message, sent_message.expiry_after_restart(self.now), life, number)
        for timer, fire_time in pending.timers.items():
            self._set_timer(address, timer, fire_time)
        answers = dict(pending.find_abandoned_questions(journaled.schema.volatile))
        for question, task in pending.questions.items():
            if question in answers:
                self._clock.schedule(self.now, partial(self._answer, address, question, answers[question], life))
            else:
                self._ask(address, question, task)

    def fire_timer(self, address: str, timer: Hashable) -> None:
        """Fire a timer from outside."""
        self._feed(address, TimerFired(timer))

    def notify(self, address: str, notice: object) -> None:
        """Pass a notice to the component, as its program does."""
        self._feed(address, Notified(notice))

    def cut_off(self, address: str) -> None:
        """Disconnect the component: it keeps running, but no message reaches it or arrives from it."""
        self._network.cut_off(address)

    def reconnect(self, address: str) -> None:
        self._network.reconnect(address)

    def separate(self, address: str, other_address: str) -> None:
        """Let no message pass between two components. Each of them reaches all others."""
        self._network.separate(address, other_address)

    def join(self, address: str, other_address: str) -> None:
        """End what `separate` began."""
        self._network.join(address, other_address)

    def timers(self, address: str) -> set[Hashable]:
        """Return the timers of a component that are set."""
        return {timer for owner, timer in self._timers if owner == address}

    def send(self, message: Message) -> None:
        """Send a message from outside."""
        self._network.send(message)

    # Time

    @property
    def now(self) -> float:
        return self._clock.now

    def run(self, seconds: float = 3600.0, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass until the condition holds, for `seconds`, or until no event is left. Return whether the condition holds."""
        return self._clock.run(seconds, until)

    # Inputs and effects

    def _feed(self, address: str, event: Input) -> bool:
        """Let the component handle an input. Return whether it is acknowledged: the component is alive, before and after."""
        life = self._lives.get(address)
        if life is None:
            return False
        if life.planned_kill is not None and life.planned_kill[0] is KillPoint.UNSEEN:
            self.remove(address)
            return False
        journal = self._journals.get(address)
        effects = journal.handle(event, self.now) if journal else [(effect, 0) for effect in life.component.handle(event, self.now)]
        if life.planned_kill is not None:
            self._end(address, life, effects, *life.planned_kill)
            return False
        for effect, number in effects:
            self._perform(address, life, effect, number)
        self._watch(address, event)
        return True

    def _end(self, address: str, life: _Life, effects: list[tuple[Effect, int]], moment: KillPoint, count: int) -> None:
        """Perform the effects that precede the kill, and remove the component."""
        recorded_effects = [(effect, number) for effect, number in effects if isinstance(effect, Record)]
        for effect, number in effects[:count] if moment is KillPoint.AMID else recorded_effects:
            self._perform(address, life, effect, number)
        self.remove(address)

    def _perform(self, address: str, life: _Life, effect: Effect, number: int) -> None:
        match effect:
            case Send(message, deadline):
                self._network.send(message, deadline, life, number)
            case SetTimer(timer, fire_time):
                self._set_timer(address, timer, fire_time)
            case Ask(question, task):
                self._ask(address, question, task)
            case Withdraw(question):
                if self._work.pop((address, question), None) is not None:
                    self._clock.schedule(self.now, partial(self._answer, address, question, RemoteError("withdrawn"), life))
            case Record(entry):
                self.records[address].append(entry)

    def _set_timer(self, address: str, timer: Hashable, fire_time: float | None) -> None:
        self._timers.pop((address, timer), None)
        if fire_time is not None:
            serial = self._timers[address, timer] = next(self._count)
            self._clock.schedule(fire_time, partial(self._fire_timer, address, timer, serial))

    def _fire_timer(self, address: str, timer: Hashable, serial: int) -> None:
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
            self._clock.schedule(self.now + step[0], partial(self._finish_work_step, address, question, serial, work, step[1]))

    def _finish_work_step(self, address: str, question: Hashable, serial: int, work: Work, value: object) -> None:
        if self._work.get((address, question)) == serial:
            if value is not QUIET:
                self._feed(address, Answered(question, value))
            if self._work.get((address, question)) == serial:
                self._continue(address, question, serial, work)
