"""A device: what it really does when its Service Manager has it work, and what it says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from somrs.entish.parse import parse
from somrs.kernel.component import Answered, Ask, Effect, Input, Withdraw
from somrs.runtime.virtual import Work
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.sdk.orders import Advance, Done, Halt, Kept, Order, Perform, Profile, Quote, Quoted, Refusal, ServiceFailed, Undo
from verification.fault_runs.site import FLOOR, LOOKING
from verification.fault_runs.story import Act, Character
from verification.fault_runs.story import Undo as Undoing
from verification.fault_runs.truth import Place, Reality, parts

NEVER = 1e7
"""Seconds."""


class Silence:
    """Time passed in which the device said nothing."""


SILENCE = Silence()


@dataclass(frozen=True, slots=True)
class Labour:
    """Work that a device really does, from its first move until it is done or interrupted. Looking moves nothing."""

    transaction: str
    participant: str
    kind: str
    order: Order

    @property
    def object(self) -> str:
        return next(iter(self.order.inputs.values()))


@dataclass
class Hands:
    """`misdeeds` tells what goes wrong in its next work, if anything; `began` hears of each piece of work that begins; `dies` is called
    when the device breaks without a word."""

    character: Character
    reality: Reality
    misdeeds: Callable[[], Act | None]
    now: Callable[[], float]
    began: Callable[[Hands, Labour], None]
    dies: Callable[[Character], None]
    labours: dict[str, Labour] = field(default_factory=dict)
    """What it does now."""
    _left: dict[str, Place | bool] = field(default_factory=dict)
    """Where it put what it worked on last."""
    _questions: dict[int, tuple[object, str]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.character.name

    # What its Service Manager tells it

    def asked(self, question: str, task: object) -> None:
        self._questions[id(task)] = task, question

    def interrupted(self, question: str) -> None:
        """It stops moving."""
        self.labours.pop(question, None)

    def died(self) -> None:
        """Its program is dead: a watchdog stops it."""
        if self.character.drops:
            self.reality.drop_all(self.name, self.now(), [labour.object for labour in self.labours.values()])
        self.labours.clear()
        self._questions.clear()

    def carry_out(self, task: object) -> Work:
        _, question = self._questions.pop(id(task), (None, ""))
        transaction = question.rpartition(" ")[2]
        match task:
            case Quote():
                return self._quote()
            case Perform(order):
                return self._perform(order, question, transaction)
            case Undo(order, situation):
                return self._undo(order, situation, question, transaction)
            case Halt(order):
                return self._halt(order, transaction)
            case _:
                return iter(((0.0, None),))

    # What it does

    def _quote(self) -> Work:
        if self.character.mute:
            return
        if self.character.refuses:
            yield 0.1, Refusal("it is too heavy for me")
        else:
            yield 0.1, Quoted(price=self.character.price, duration=self.character.duration)

    def _perform(self, order: Order, question: str, transaction: str) -> Work:
        act = self.misdeeds()
        work = self._look(order, act) if order.method == LOOKING else self._work(order, act, transaction)
        yield from self._laboured("Perform", order, question, transaction, work)

    def _laboured(self, kind: str, order: Order, question: str, transaction: str, work: Work) -> Work:
        """The work, which is real until its end is reported."""
        labour = Labour(transaction, order.participant, kind, order)
        if order.method != LOOKING:
            self.labours[question] = labour
        self.began(self, labour)
        for seconds, value in work:
            if not isinstance(value, Silence | Advance):
                self.labours.pop(question, None)
                yield seconds, value
                return
            yield seconds, value

    def _work(self, order: Order, act: Act | None, transaction: str) -> Work:
        seconds = self.character.duration * (15 if act is Act.SLOW else 1)
        moves, spent = [*self._moves(order)], 0.0
        for number, (share, object, to) in enumerate(moves, 1):
            yield (share - spent) * seconds, SILENCE
            spent = share
            if number == len(moves) and act is not None and act not in (Act.SLOW, Act.CARRY):
                yield from self._goes_wrong(act, order, object, to, transaction)
                return
            if (failed := self._move(order, object, to, transaction)) is not None:
                yield 0.0, failed
                return
            if number < len(moves) and act is Act.CARRY:
                yield 0.0, Advance(fraction=share, situation=self.reality.said(object))
        yield 0.0, Done(situation=self._promised(order))

    def _look(self, order: Order, act: Act | None) -> Work:
        """Cognitive services tell the truth, or nothing."""
        yield self.character.duration, SILENCE
        if act is Act.DIE:
            self.dies(self.character)
        if act in (Act.DIE, Act.HANG):
            yield NEVER, SILENCE
        if act is not None:
            yield 0.0, ServiceFailed("it sees nothing", None)
        object = order.inputs["Object"]
        yield 0.0, Done(situation=f"{self.reality.said(object)} AND {object}.Unknown = FALSE")

    def _moves(self, order: Order) -> Iterator[tuple[float, str, Place | bool]]:
        """After which share of the time which object comes where."""
        for object, to in parts(parse(self._promised(order))):
            if not isinstance(to, bool) and to[0] == "isOn" and order.method != "PutDown":
                yield 0.4, object, ("isHeldBy", self.name)
            yield 1.0, object, to

    def _promised(self, order: Order) -> str:
        return order.effect.replace("?Provider", self.name)

    def _move(self, order: Order, object: str, to: Place | bool, transaction: str) -> ServiceFailed | None:
        """Bring the object there; what it says when that cannot be done."""
        if isinstance(to, bool):
            self._put(object, to, transaction)
            return None
        reality = self.reality
        mine = reality.where[object] == ("isHeldBy", self.name)
        if to == ("isHeldBy", self.name):
            told = dict(parts(parse(order.precondition))) if order.precondition is not None else {}
            if not mine and (reality.where[object][0] == "isHeldBy" or told.get(object) != reality.where[object]):
                return ServiceFailed(f"{object} is not where it is said to be", None)
        elif not mine:
            return ServiceFailed(f"{object} is gone from the gripper", None)
        elif not reality.reachable(to[1]):
            self._put(object, ("isOn", FLOOR), transaction)
            return ServiceFailed("the door is closed", f"{reality.said(object)} AND {reality.said(reality.behind[to[1]])}")
        self._put(object, to, transaction)
        return None

    def _goes_wrong(self, act: Act, order: Order, object: str, to: Place | bool, transaction: str) -> Work:
        """What happens instead of the last move."""
        reality, mine = self.reality, self.reality.state(object) == ("isHeldBy", self.name)
        match act:
            case Act.DROP | Act.MISPUT:
                if mine:
                    self._put(object, ("isOn", FLOOR), transaction)
                said = reality.said(object)
                yield 0.0, ServiceFailed("it slipped", said) if act is Act.DROP else Done(situation=said)
            case Act.FAIL:
                yield 0.0, ServiceFailed("it is stuck", None)
            case Act.ERROR:
                yield 0.0, ZeroDivisionError("division by zero")
            case Act.FALSE:
                reality.doubtful.add(object)
                yield 0.0, Done(situation=self._promised(order))
            case Act.RAVE:
                failed = self._move(order, object, to, transaction)
                yield 0.0, failed or Done(situation=f"{object} isOn Nowhere")
            case Act.DIE:
                self.dies(self.character)
        yield NEVER, SILENCE

    def _undo(self, order: Order, situation: str, question: str, transaction: str) -> Work:
        yield from self._laboured("Undo", order, question, transaction, self._restore(order, situation, transaction))

    def _restore(self, order: Order, situation: str, transaction: str) -> Work:
        reality, wanted = self.reality, [*parts(parse(situation))]
        yield self.character.duration, SILENCE
        if self.character.undo is Undoing.HANG:
            yield NEVER, SILENCE
        for object, to in wanted:
            there = reality.state(object)
            known = there in (to, ("isHeldBy", self.name), self._left.get(object))
            if self.character.undo is Undoing.FAIL or not known or not self._can_bring(to):
                yield 0.0, ServiceFailed("it cannot be undone", reality.said(object) if known else None)
            self._put(object, to, transaction)
        yield 0.0, Done(situation=" AND ".join(reality.said(object) for object, _ in wanted) or situation)

    def _can_bring(self, to: Place | bool) -> bool:
        return isinstance(to, bool) or (self.reality.reachable(to[1]) if to[0] == "isOn" else to[1] == self.name)

    def _halt(self, order: Order, transaction: str) -> Work:
        """Reach a safe state, and say what is known of the thing."""
        yield self.character.halts, SILENCE
        object = next(iter(order.inputs.values()))
        mine = self.reality.state(object) == ("isHeldBy", self.name)
        if mine and self.character.lays_down:
            self._put(object, ("isOn", FLOOR), transaction)
        known = mine or self.reality.state(object) == self._left.get(object)
        yield 0.0, Done(situation=self.reality.said(object) if known else None)

    def _put(self, object: str, to: Place | bool, transaction: str) -> None:
        self._left[object] = to
        self.reality.put(object, to, self.now(), transaction, self.name)


class DeviceManager(ServiceManager):
    """A Service Manager whose device is told what it is asked, and is not bothered with the device's silence."""

    def __init__(self, profile: Profile, hands: Hands, kept: list[Kept], saw: Callable[[str, Input], None]) -> None:
        super().__init__(profile, repository="repository", registry="registry", kept=kept)
        self._hands, self._saw = hands, saw

    def forgotten_by(self, after: DeviceManager) -> str | None:
        """What this one knew and its next life does not."""
        for job in self._jobs:
            known = after.state(*job.key)
            if known is not job.session.state:
                return f"{job.key[1]} in {job.key[0]} was {job.session.state}, and is {known}"
        return None

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Answered) and isinstance(event.value, Silence):
            return []
        self._saw(self._hands.character.address, event)
        effects = super().handle(event, now)
        for effect in effects:
            match effect:
                case Ask(question, task):
                    self._hands.asked(str(question), task)
                case Withdraw(question):
                    self._hands.interrupted(str(question))
        return effects
