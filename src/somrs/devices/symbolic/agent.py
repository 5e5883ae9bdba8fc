"""A device of a symbolic world on virtual time: what its Service Manager asks of it, and what it says when."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from somrs.devices.symbolic.world import SymbolicWorld
from somrs.ontology.objects import Change
from somrs.ontology.services import ServiceType
from somrs.service_manager.sdk.orders import (
    Advance,
    Capability,
    Halt,
    Order,
    Perform,
    Profile,
    Quote,
    Quoted,
    ServiceFailed,
    Undo,
    WorkDone,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mishap:
    """How a service goes wrong: which of its changes come about all the same; and `goes_offline`: nobody hears of the device again."""

    select_changes: Callable[[Sequence[Change]], Sequence[Change]] = lambda changes: ()
    goes_offline: bool = False


Faults = Callable[[Order], Mishap | None]
"""What goes wrong when a device is told to do this; None: nothing."""


@dataclass(slots=True, kw_only=True)
class SymbolicAgent:
    """One device. Each service takes `seconds`, or as many as it costs (one, if it costs nothing).

    What it does holds in the world when its time is over, not before. Who left answers nothing any more: `is_offline` says so, and
    whoever runs the system ends its Service Manager then.
    """

    name: str
    world: SymbolicWorld
    services: Sequence[ServiceType]
    faults: Faults = lambda order: None
    seconds: float | None = None
    is_offline: bool = False
    orders: list[Order] = field(default_factory=list)
    """What it was told to do."""

    def profile(self, *, lease: float = 3600.0, valid_for: float = 3600.0) -> Profile:
        """What its Service Manager has to know. Every service is a method of the same name."""
        capabilities = tuple(Capability(type=service.name, method=service.name, stoppable=True) for service in self.services)
        kind = self.world.map.objects[self.name].type
        return Profile(name=self.name, type=kind, capabilities=capabilities, lease=lease, valid_for=valid_for)

    def carry_out(self, task: object) -> Iterator[tuple[float, object]]:
        """Pairs of seconds and what is said then."""
        if self.is_offline:
            return
        match task:
            case Quote(order):
                cost = self.world.cost(order.method, order.inputs, self.name)
                yield 0.0, Quoted(price=cost, duration=self._duration(cost))
            case Perform(order):
                self.orders.append(order)
                yield from self._perform(order)
            case Halt(order):
                yield 0.0, WorkDone(situation=self.world.describe(order.effect, self.name, order.inputs))
            case Undo():
                yield 0.0, ServiceFailed(f"{self.name} can only go on, not back")
            case _:
                yield 0.0, None

    def _perform(self, order: Order) -> Iterator[tuple[float, object]]:
        service, inputs = order.method, order.inputs
        mishap = self.faults(order)
        seconds = self._duration(self.world.cost(service, inputs, self.name))
        if (refusal := self.world.refusal(service, inputs, self.name)) is not None:
            self.world.perform(service, inputs, self.name)  # which the world notes
            yield 0.0, self._failed(order, refusal)
            return
        # An answer that is none yet, so that what is worked out below is so when the time is over, and only if nobody said stop.
        yield seconds, Advance(fraction=1.0)
        if mishap is not None:
            situation = self.world.partly(service, inputs, self.name, mishap.select_changes)
            self.is_offline = mishap.goes_offline
            if not self.is_offline:
                yield 0.0, ServiceFailed(f"{self.name} failed on the way", situation)
        elif (refusal := self.world.perform(service, inputs, self.name)) is not None:
            yield 0.0, self._failed(order, refusal)
        else:
            yield 0.0, WorkDone(situation=self.world.describe(order.effect, self.name, inputs))

    def _duration(self, cost: float) -> float:
        return self.seconds if self.seconds is not None else cost or 1.0

    def _failed(self, order: Order, refusal: str) -> ServiceFailed:
        return ServiceFailed(f"{self.name} cannot: {refusal}", self.world.describe_failure(order.method, order.inputs, self.name))
