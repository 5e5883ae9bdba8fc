"""A device of a symbolic world on virtual time: takes the orders of its Service Manager, and returns timed replies."""

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
    """A fault of a service. `select_changes`: the changes that occur nevertheless; `goes_offline`: the device sends nothing more."""

    select_changes: Callable[[Sequence[Change]], Sequence[Change]] = lambda changes: ()
    goes_offline: bool = False


Faults = Callable[[Order], Mishap | None]
"""Returns the fault that occurs when a device carries out an order, or None."""


@dataclass(slots=True, kw_only=True)
class SymbolicAgent:
    """One device. Each service takes `seconds`; with None, as many seconds as it costs (one, if it costs nothing).

    The effect of a service holds in the world when its time is over, not before. A device that `is_offline` does not reply; the code
    that runs the system then ends its Service Manager.
    """

    name: str
    world: SymbolicWorld
    services: Sequence[ServiceType]
    faults: Faults = lambda order: None
    seconds: float | None = None
    is_offline: bool = False
    orders: list[Order] = field(default_factory=list)
    """The orders to perform that it has received."""

    def profile(self, *, lease: float = 3600.0, valid_for: float = 3600.0) -> Profile:
        """The profile for its Service Manager. Each service has a method of the same name."""
        capabilities = tuple(Capability(type=service.name, method=service.name, stoppable=True) for service in self.services)
        kind = self.world.map.objects[self.name].type
        return Profile(name=self.name, type=kind, capabilities=capabilities, lease=lease, valid_for=valid_for)

    def carry_out(self, task: object) -> Iterator[tuple[float, object]]:
        """Carry out an order. Yield pairs of a delay in seconds and the reply after it."""
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
                yield 0.0, ServiceFailed(f"{self.name} cannot compensate: symbolic devices undo nothing")
            case _:
                yield 0.0, None

    def _perform(self, order: Order) -> Iterator[tuple[float, object]]:
        service, inputs = order.method, order.inputs
        mishap = self.faults(order)
        seconds = self._duration(self.world.cost(service, inputs, self.name))
        if (refusal := self.world.refusal(service, inputs, self.name)) is not None:
            self.world.perform(service, inputs, self.name)  # the world records the rejection
            yield 0.0, self._failed(order, refusal)
            return
        # Progress only: the effect below is applied when the time is over, and only if the service was not stopped.
        yield seconds, Advance(fraction=1.0)
        if mishap is not None:
            situation = self.world.partly(service, inputs, self.name, mishap.select_changes)
            self.is_offline = mishap.goes_offline
            if not self.is_offline:
                yield 0.0, ServiceFailed(f"{self.name} failed on the way", situation)
        elif (refusal := self.world.perform(service, inputs, self.name)) is not None:
            yield 0.0, self._failed(order, refusal)
        else:
            yield 0.0, WorkDone(situation=self.world.result(service, inputs, self.name))

    def _duration(self, cost: float) -> float:
        return self.seconds if self.seconds is not None else cost or 1.0

    def _failed(self, order: Order, refusal: str) -> ServiceFailed:
        return ServiceFailed(f"{self.name} cannot: {refusal}", self.world.describe_failure(order.method, order.inputs, self.name))
