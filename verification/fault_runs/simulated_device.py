"""A simulated device: its real actions when its Service Manager gives it work, and its reports."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from typing import Self

from somrs.entish.parse import parse
from somrs.kernel.component import Effect, Input, Withdraw
from somrs.ontology.qualified_names import plain_name
from somrs.runtime.virtual_time import QUIET, Work
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.participant.timers import Activity, WorkWanted
from somrs.service_manager.sdk.orders import Advance, Halt, Order, Perform, Quote, Quoted, Refusal, ServiceFailed, Undo, WorkDone
from verification.fault_runs.ground_truth import Place, Reality, placements
from verification.fault_runs.names import DeviceNames
from verification.fault_runs.scenario import DeviceTraits, Store, WorkFaultKind
from verification.fault_runs.scenario import Undo as Undoing
from verification.fault_runs.site import RECOGNITION, RESERVATION, TELLING

FOREVER = 1e7
"""Seconds."""

InputObserver = Callable[[str, Input], None]
"""A function that gets the address and each input of a device's Service Manager before it is handled."""


@dataclass(frozen=True, slots=True)
class DeviceWork:
    """Work that a device really does, from its first move until it is done or interrupted. Observation moves nothing."""

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
        return plain_name(next(iter(self.order.inputs.values())))


@dataclass
class SimulatedDevice:
    """A device. `next_fault` returns the fault of its next execution, if any. `on_start` is called when work begins, `on_break` when the
    device breaks without a message."""

    traits: DeviceTraits
    names: DeviceNames
    reality: Reality
    next_fault: Callable[[], WorkFaultKind | None]
    now: Callable[[], float]
    on_start: Callable[[SimulatedDevice, DeviceWork], None]
    on_break: Callable[[DeviceTraits], None]
    current_work: dict[Hashable, DeviceWork] = field(default_factory=dict)
    """The work that it does now."""
    _last_places: dict[str, Place | bool] = field(default_factory=dict)
    """The last place of each object that it worked on."""

    def __post_init__(self) -> None:
        self._started_at = self.now()

    @property
    def name(self) -> str:
        return self.traits.name

    # Calls of its Service Manager

    def interrupted(self, question: Hashable) -> None:
        """Stop moving."""
        self.current_work.pop(question, None)

    def died(self) -> None:
        """Stop, because the program is dead and a watchdog cuts in."""
        if self.traits.drops:
            self.reality.drop_all(self.name, self.now(), [device_work.object for device_work in self.current_work.values()])
        self.current_work.clear()

    def carry_out(self, task: object) -> Work:
        return self.names.answers(task, self._carry_out(self.names.understood(task)))

    def _carry_out(self, task: object) -> Work:
        match task:
            case Quote(order):
                return self._quote(order)
            case Perform(order):
                return self._perform(order)
            case Undo(order, situation):
                return self._undo(order, situation)
            case Halt(order):
                return self._halt(order)
            case _:
                return iter(((0.0, None),))

    # Its actions

    def _quote(self, order: Order) -> Work:
        if self.traits.mute:
            return
        condition = self._condition(order) if order.method == Store.CONDITION else None
        if self.traits.refuses:
            yield 0.1, Refusal("it is too heavy for me")
        elif self.now() < self._started_at + self.traits.mended_at:
            yield 0.1, Refusal("it is out of order", not_now=True)
        elif condition is not None and self.traits.refuses_conditionally:
            yield 0.1, Refusal("the door is shut", condition=condition)
        else:
            yield 0.1, Quoted(price=self.traits.price, duration=self.traits.duration, condition=condition, penalty=self.traits.penalty)

    def _condition(self, order: Order) -> str | None:
        """What it demands: that the door of the shelf is open, unless it will be in the promised situation."""
        door = self.reality.shelf_doors.get(order.inputs["Shelf"], "")
        promised = dict(placements(parse(order.situation))) if order.situation is not None else {}
        is_open = promised.get(door, self.reality.open.get(door, True))
        return f"{door}.Open = TRUE" if not is_open else None

    def _perform(self, order: Order) -> Work:
        fault_kind = self.next_fault()
        work = self._tell(order, fault_kind) if order.method in TELLING else self._work(order, fault_kind)
        yield from self._track_work(Activity.PERFORM, order, work)

    def _track_work(self, activity: Activity, order: Order, work: Work) -> Work:
        """Carry the work out, and count it as real until its end is reported."""
        device_work = DeviceWork(activity, order)
        question = WorkWanted(order.transaction, order.participant, activity)
        if order.method not in TELLING:
            self.current_work[question] = device_work
        self.on_start(self, device_work)
        for seconds, value in work:
            if value is not QUIET and not isinstance(value, Advance):
                self.current_work.pop(question, None)
                yield seconds, value
                return
            yield seconds, value

    def _work(self, order: Order, fault_kind: WorkFaultKind | None) -> Work:
        seconds = self.traits.duration * (15 if fault_kind is WorkFaultKind.SLOW else 1)
        moves, spent = [*self._moves(order)], 0.0
        for number, (share, object, target) in enumerate(moves, 1):
            yield (share - spent) * seconds, QUIET
            spent = share
            if number == len(moves) and fault_kind is not None and fault_kind not in (WorkFaultKind.SLOW, WorkFaultKind.CARRY):
                yield from self._goes_wrong(fault_kind, order, object, target)
                return
            if (failed := self._move(order, object, target)) is not None:
                yield 0.0, failed
                return
            if number < len(moves) and fault_kind is WorkFaultKind.CARRY:
                yield 0.0, Advance(fraction=share, situation=self.reality.situation_of(object))
        yield 0.0, WorkDone(situation=self._promised(order))

    def _tell(self, order: Order, fault_kind: WorkFaultKind | None) -> Work:
        """Observe or compute, and report the truth or nothing."""
        yield self.traits.duration, QUIET
        if fault_kind is WorkFaultKind.DIE:
            self.on_break(self.traits)
        if fault_kind in (WorkFaultKind.DIE, WorkFaultKind.HANG):
            yield FOREVER, QUIET
        if fault_kind is not None:
            yield 0.0, ServiceFailed("it sees nothing", None)
        yield 0.0, self._findings(order.method, order.inputs["Object"])

    def _findings(self, method: str, object: str) -> WorkDone:
        if method == RECOGNITION:
            return WorkDone(situation=f"{self.reality.situation_of(object)} AND {object}.Unknown = FALSE")
        if method == RESERVATION:
            table = self.reality.reserve_table(object)
            return WorkDone(situation=f"{table} isReservedFor {object}", outputs={"Table": table})
        weight = self.reality.weights[object]
        return WorkDone(situation=f"{object}.Weight = {weight:g}", outputs={"Weight": weight})

    def _moves(self, order: Order) -> Iterator[tuple[float, str, Place | bool]]:
        """Yield the moves of the work: the share of the duration, the object and its new place."""
        for object, target in placements(parse(self._promised(order))):
            if not isinstance(target, bool) and target[0] == "isOn" and order.method != "PutDown":
                yield 0.4, object, ("isHeldBy", self.name)
            yield 1.0, object, target

    def _promised(self, order: Order) -> str:
        return order.effect.replace("?Provider", self.name)

    def _move(self, order: Order, object: str, target: Place | bool) -> ServiceFailed | None:
        """Move the object; return the failure if that is impossible."""
        if isinstance(target, bool):
            self._place_object(object, target, order.transaction)
            return None
        reality = self.reality
        mine = reality.places[object] == ("isHeldBy", self.name)
        if target == ("isHeldBy", self.name):
            expected_places = dict(placements(parse(order.precondition))) if order.precondition is not None else {}
            if not mine and (reality.places[object][0] == "isHeldBy" or expected_places.get(object) != reality.places[object]):
                return ServiceFailed(f"{object} is not at its place", None)
        elif not mine:
            return ServiceFailed(f"{object} is not in the gripper any more", None)
        elif not reality.reachable(target[1]):
            self._place_object(object, ("isOn", self.reality.floors[self.name]), order.transaction)
            return ServiceFailed(
                "the door is closed", f"{reality.situation_of(object)} AND {reality.situation_of(reality.shelf_doors[target[1]])}"
            )
        self._place_object(object, target, order.transaction)
        return None

    def _goes_wrong(self, fault_kind: WorkFaultKind, order: Order, object: str, target: Place | bool) -> Work:
        """Carry the fault out instead of the last move."""
        reality, mine = self.reality, self.reality.state(object) == ("isHeldBy", self.name)
        match fault_kind:
            case WorkFaultKind.DROP | WorkFaultKind.MISPUT:
                if mine:
                    self._place_object(object, ("isOn", self.reality.floors[self.name]), order.transaction)
                situation = reality.situation_of(object)
                yield 0.0, ServiceFailed("it slipped", situation) if fault_kind is WorkFaultKind.DROP else WorkDone(situation=situation)
            case WorkFaultKind.FAIL:
                yield 0.0, ServiceFailed("it is stuck", None)
            case WorkFaultKind.ERROR:
                yield 0.0, ZeroDivisionError("division by zero")
            case WorkFaultKind.FALSE:
                reality.doubtful.add(object)
                yield 0.0, WorkDone(situation=self._promised(order))
            case WorkFaultKind.RAVE:
                failed = self._move(order, object, target)
                # Another map takes an unknown place for one that is not shown to it; an unknown relation is none anywhere.
                lost = f"isLostAt {self.reality.floors[self.name]}" if self.names.is_qualifying else "isOn Nowhere"
                yield 0.0, failed or WorkDone(situation=f"{object} {lost}")
            case WorkFaultKind.DIE:
                self.on_break(self.traits)
        yield FOREVER, QUIET

    def _undo(self, order: Order, situation: str) -> Work:
        yield from self._track_work(Activity.UNDO, order, self._restore(order, situation))

    def _restore(self, order: Order, situation: str) -> Work:
        reality, goals = self.reality, [*placements(parse(situation))]
        yield self.traits.duration, QUIET
        if self.traits.undo is Undoing.HANG:
            yield FOREVER, QUIET
        for object, target in goals:
            place = reality.state(object)
            is_certain = place in (target, ("isHeldBy", self.name), self._last_places.get(object))
            if self.traits.undo is Undoing.FAIL or not is_certain or not self._can_deliver(target):
                yield 0.0, ServiceFailed("it cannot be undone", reality.situation_of(object) if is_certain else None)
            self._place_object(object, target, order.transaction)
        yield 0.0, WorkDone(situation=" AND ".join(reality.situation_of(object) for object, _ in goals) or situation)

    def _can_deliver(self, target: Place | bool) -> bool:
        return isinstance(target, bool) or (self.reality.reachable(target[1]) if target[0] == "isOn" else target[1] == self.name)

    def _halt(self, order: Order) -> Work:
        """Reach a safe state, and report what is known of the object."""
        yield self.traits.halts, QUIET
        object = next(iter(order.inputs.values()))
        mine = self.reality.state(object) == ("isHeldBy", self.name)
        if mine and self.traits.lays_down:
            self._place_object(object, ("isOn", self.reality.floors[self.name]), order.transaction)
        is_certain = mine or self.reality.state(object) == self._last_places.get(object)
        yield 0.0, WorkDone(situation=self.reality.situation_of(object) if is_certain else None)

    def _place_object(self, object: str, target: Place | bool, transaction: str) -> None:
        self._last_places[object] = target
        self.reality.move_object(object, target, self.now(), transaction, self.name)


class DeviceManager(ServiceManager):
    """A Service Manager that informs its device immediately when work is interrupted."""

    _simulated_device: SimulatedDevice
    _observe_input: InputObserver

    def attach(self, simulated_device: SimulatedDevice, observe_input: InputObserver) -> Self:
        self._simulated_device, self._observe_input = simulated_device, observe_input
        return self

    def handle(self, event: Input, now: float) -> list[Effect]:
        self._observe_input(self._simulated_device.traits.address, event)
        effects = super().handle(event, now)
        for effect in effects:
            if isinstance(effect, Withdraw):
                self._simulated_device.interrupted(effect.question)
        return effects
