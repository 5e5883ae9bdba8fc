"""A device: what it really does when its Service Manager has it work, and what it says."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from typing import Self

from somrs.entish.parse import parse
from somrs.kernel.component import Effect, Input, Withdraw
from somrs.runtime.virtual import QUIET, Work
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.participant.timers import Activity, WorkWanted
from somrs.service_manager.sdk.orders import Advance, Halt, Order, Perform, Quote, Quoted, Refusal, ServiceFailed, Undo, WorkDone
from verification.fault_runs.site import FLOOR, LOOKING
from verification.fault_runs.story import Act, Character
from verification.fault_runs.story import Undo as Undoing
from verification.fault_runs.truth import Place, Reality, parts

NEVER = 1e7
"""Seconds."""

Saw = Callable[[str, Input], None]
"""Sees each input of a device's Service Manager, and whose it is, before it is handled."""


@dataclass(frozen=True, slots=True)
class Labour:
    """Work that a device really does, from its first move until it is done or interrupted. Looking moves nothing."""

    activity: Activity
    order: Order

    @property
    def transaction(self) -> str:
        return self.order.transaction

    @property
    def participant(self) -> str:
        return self.order.participant

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
    labours: dict[Hashable, Labour] = field(default_factory=dict)
    """What it does now."""
    _left: dict[str, Place | bool] = field(default_factory=dict)
    """Where it put what it worked on last."""

    @property
    def name(self) -> str:
        return self.character.name

    # What its Service Manager tells it

    def interrupted(self, question: Hashable) -> None:
        """It stops moving."""
        self.labours.pop(question, None)

    def died(self) -> None:
        """Its program is dead: a watchdog stops it."""
        if self.character.drops:
            self.reality.drop_all(self.name, self.now(), [labour.object for labour in self.labours.values()])
        self.labours.clear()

    def carry_out(self, task: object) -> Work:
        match task:
            case Quote():
                return self._quote()
            case Perform(order):
                return self._perform(order)
            case Undo(order, situation):
                return self._undo(order, situation)
            case Halt(order):
                return self._halt(order)
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

    def _perform(self, order: Order) -> Work:
        act = self.misdeeds()
        work = self._look(order, act) if order.method == LOOKING else self._work(order, act)
        yield from self._laboured(Activity.PERFORM, order, work)

    def _laboured(self, activity: Activity, order: Order, work: Work) -> Work:
        """The work, which is real until its end is reported."""
        labour = Labour(activity, order)
        question = WorkWanted(order.transaction, order.participant, activity)
        if order.method != LOOKING:
            self.labours[question] = labour
        self.began(self, labour)
        for seconds, value in work:
            if value is not QUIET and not isinstance(value, Advance):
                self.labours.pop(question, None)
                yield seconds, value
                return
            yield seconds, value

    def _work(self, order: Order, act: Act | None) -> Work:
        seconds = self.character.duration * (15 if act is Act.SLOW else 1)
        moves, spent = [*self._moves(order)], 0.0
        for number, (share, object, to) in enumerate(moves, 1):
            yield (share - spent) * seconds, QUIET
            spent = share
            if number == len(moves) and act is not None and act not in (Act.SLOW, Act.CARRY):
                yield from self._goes_wrong(act, order, object, to)
                return
            if (failed := self._move(order, object, to)) is not None:
                yield 0.0, failed
                return
            if number < len(moves) and act is Act.CARRY:
                yield 0.0, Advance(fraction=share, situation=self.reality.said(object))
        yield 0.0, WorkDone(situation=self._promised(order))

    def _look(self, order: Order, act: Act | None) -> Work:
        """Cognitive services tell the truth, or nothing."""
        yield self.character.duration, QUIET
        if act is Act.DIE:
            self.dies(self.character)
        if act in (Act.DIE, Act.HANG):
            yield NEVER, QUIET
        if act is not None:
            yield 0.0, ServiceFailed("it sees nothing", None)
        object = order.inputs["Object"]
        yield 0.0, WorkDone(situation=f"{self.reality.said(object)} AND {object}.Unknown = FALSE")

    def _moves(self, order: Order) -> Iterator[tuple[float, str, Place | bool]]:
        """After which share of the time which object comes where."""
        for object, to in parts(parse(self._promised(order))):
            if not isinstance(to, bool) and to[0] == "isOn" and order.method != "PutDown":
                yield 0.4, object, ("isHeldBy", self.name)
            yield 1.0, object, to

    def _promised(self, order: Order) -> str:
        return order.effect.replace("?Provider", self.name)

    def _move(self, order: Order, object: str, to: Place | bool) -> ServiceFailed | None:
        """Bring the object there; what it says when that cannot be done."""
        if isinstance(to, bool):
            self._put(object, to, order.transaction)
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
            self._put(object, ("isOn", FLOOR), order.transaction)
            return ServiceFailed("the door is closed", f"{reality.said(object)} AND {reality.said(reality.behind[to[1]])}")
        self._put(object, to, order.transaction)
        return None

    def _goes_wrong(self, act: Act, order: Order, object: str, to: Place | bool) -> Work:
        """What happens instead of the last move."""
        reality, mine = self.reality, self.reality.state(object) == ("isHeldBy", self.name)
        match act:
            case Act.DROP | Act.MISPUT:
                if mine:
                    self._put(object, ("isOn", FLOOR), order.transaction)
                said = reality.said(object)
                yield 0.0, ServiceFailed("it slipped", said) if act is Act.DROP else WorkDone(situation=said)
            case Act.FAIL:
                yield 0.0, ServiceFailed("it is stuck", None)
            case Act.ERROR:
                yield 0.0, ZeroDivisionError("division by zero")
            case Act.FALSE:
                reality.doubtful.add(object)
                yield 0.0, WorkDone(situation=self._promised(order))
            case Act.RAVE:
                failed = self._move(order, object, to)
                yield 0.0, failed or WorkDone(situation=f"{object} isOn Nowhere")
            case Act.DIE:
                self.dies(self.character)
        yield NEVER, QUIET

    def _undo(self, order: Order, situation: str) -> Work:
        yield from self._laboured(Activity.UNDO, order, self._restore(order, situation))

    def _restore(self, order: Order, situation: str) -> Work:
        reality, wanted = self.reality, [*parts(parse(situation))]
        yield self.character.duration, QUIET
        if self.character.undo is Undoing.HANG:
            yield NEVER, QUIET
        for object, to in wanted:
            there = reality.state(object)
            known = there in (to, ("isHeldBy", self.name), self._left.get(object))
            if self.character.undo is Undoing.FAIL or not known or not self._can_bring(to):
                yield 0.0, ServiceFailed("it cannot be undone", reality.said(object) if known else None)
            self._put(object, to, order.transaction)
        yield 0.0, WorkDone(situation=" AND ".join(reality.said(object) for object, _ in wanted) or situation)

    def _can_bring(self, to: Place | bool) -> bool:
        return isinstance(to, bool) or (self.reality.reachable(to[1]) if to[0] == "isOn" else to[1] == self.name)

    def _halt(self, order: Order) -> Work:
        """Reach a safe state, and say what is known of the thing."""
        yield self.character.halts, QUIET
        object = next(iter(order.inputs.values()))
        mine = self.reality.state(object) == ("isHeldBy", self.name)
        if mine and self.character.lays_down:
            self._put(object, ("isOn", FLOOR), order.transaction)
        known = mine or self.reality.state(object) == self._left.get(object)
        yield 0.0, WorkDone(situation=self.reality.said(object) if known else None)

    def _put(self, object: str, to: Place | bool, transaction: str) -> None:
        self._left[object] = to
        self.reality.put(object, to, self.now(), transaction, self.name)


class DeviceManager(ServiceManager):
    """A Service Manager whose device is told at once when it is interrupted."""

    _hands: Hands
    _saw: Saw

    def given(self, hands: Hands, saw: Saw) -> Self:
        self._hands, self._saw = hands, saw
        return self

    def handle(self, event: Input, now: float) -> list[Effect]:
        self._saw(self._hands.character.address, event)
        effects = super().handle(event, now)
        for effect in effects:
            if isinstance(effect, Withdraw):
                self._hands.interrupted(effect.question)
        return effects
