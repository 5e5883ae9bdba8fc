"""The interface for authors of devices: a base class, a decorator, and the task that a service works on.

    class Forklift(Device):
        type = "Forklift"

        @service(TransferObject, price="4 EUR", duration="30 s")
        async def transfer(self, task: Task) -> Situation: ...

        @transfer.stopping
        async def put_down(self, task: Task) -> Situation: ...

        @transfer.compensation
        async def bring_back(self, task: Task, situation: Formula) -> Situation: ...

The Service Manager does the rest: terms, the protocol, the calendar, joining and leaving.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Awaitable, Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import msgspec
from msgspec import Struct

from somrs.entish.formula import Formula
from somrs.entish.parse import parse
from somrs.errors import DeviceError, RemoteError
from somrs.ontology.service_kinds import kind_problems
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Definition, ObjectType, Value
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import UpdateMap, by_kind
from somrs.protocol.messages.observations import Observation, Reception
from somrs.service_manager.sdk.map_reader import Ask, MapReader
from somrs.service_manager.sdk.orders import Advance, Capability, Order, Profile
from somrs.service_manager.sdk.tasks import TaskSubmitter
from somrs.service_manager.sdk.values import fill_in, money, python_value, seconds

Situation = str | Formula | None
"""The situation, in Entish. None, returned by a service: the effect that was arranged."""


class Result(Struct, frozen=True, kw_only=True):
    """The result of a service with outputs, or with more to say about its situation than that it holds."""

    outputs: dict[str, Value] = {}
    situation: Situation = None
    observation: Observation | None = None


# The types of the decorated functions. Their first argument is the device, whose class differs from author to author.
PerformFunction = Callable[[Any, "Task"], Awaitable["Situation | Result"]]
StopFunction = Callable[[Any, "Task"], Awaitable[Situation]]
UndoFunction = Callable[[Any, "Task", Formula], Awaitable[Situation]]
Amount = float | str
Amounts = Amount | Callable[[Any, "Task"], Amount | Awaitable[Amount]]
AbilityCheck = Callable[[Any, "Task"], Awaitable[None] | None]


class Task:
    """The order for a service: its inputs, effect and precondition, the map, and a way to report progress.

    While the service is `quoting`, `situation` is what earlier steps of the plan will have changed when it starts (None: nothing), and
    `map` is read as it will be then. Afterwards `map` is the map as it is.
    """

    def __init__(self, provider: str, order: Order, ask: Ask, report: Callable[[object], None], *, quoting: bool = False) -> None:
        self.provider, self.order = provider, order
        self.inputs: Mapping[str, Value] = {name: python_value(text) for name, text in order.inputs.items()}
        """The inputs by name: numbers, texts and truth values as Python values, objects by their names on the map."""
        self.effect: Formula = fill_in(order.effect, provider, order.inputs)
        self.precondition: Formula | None = fill_in(order.precondition, provider, order.inputs) if order.precondition else None
        situation = order.situation if quoting else None
        self.situation: Formula | None = parse(situation) if situation is not None else None
        self.map = MapReader(ask, situation)
        self.conditions: tuple[Formula, ...] = ()
        """What has to hold when the service starts, as far as the author has demanded it."""
        self.invariants: tuple[Formula, ...] = ()
        """The conditions that have to hold until the service ends, too."""
        self._report = report

    def demand(self, condition: str | Formula, *, throughout: bool = False) -> None:
        """Offer the service on a condition: the formula has to hold when it starts. Call it in `price`, `duration` or `able`.

        The Task Manager makes it true before, by other services, or chooses another service. Several demands have to hold together.
        `throughout`: it has to hold until the service ends. The Task Manager stops the service at once when it does not hold any more.
        """
        demand = fill_in(str(condition), self.provider, self.order.inputs)
        self.conditions = (*self.conditions, demand)
        if throughout:
            self.invariants = (*self.invariants, demand)

    async def progress(
        self, fraction: float, situation: Situation = None, note: str = "", observation: Observation | None = None, *, waits: bool = False
    ) -> None:
        """Report the fraction done (0 to 1), the situation if it changed, and a note for people.

        `waits`: something that will pass keeps the service from going on. As long as it says so, it is not too late.
        """
        text = str(situation) if situation is not None else None
        self._report(Advance(fraction=min(max(fraction, 0.0), 1.0), situation=text, note=note, observation=observation, waits=waits))


class Service:
    """A service of a class of devices; `@service` creates it from a method."""

    def __init__(
        self,
        performs: PerformFunction,
        type: ServiceType | str,
        price: Amounts,
        duration: Amounts,
        able: AbilityCheck | None,
        penalty: Amounts | None = None,
        *,
        occupies: bool = True,
        inputs: tuple[str, ...] | None = None,
        outputs: tuple[str, ...] = (),
    ) -> None:
        self.performs, self.type, self.price, self.duration, self.able = performs, type, price, duration, able
        self.penalty, self.occupies, self.inputs, self.outputs = penalty, occupies, inputs, outputs
        self.stops: StopFunction | None = None
        self.undoes: UndoFunction | None = None
        self.name = performs.__name__
        for amount, read in ((price, money), (duration, seconds), (penalty, money)):
            if amount is not None and not callable(amount):
                read(amount)
        if not inspect.iscoroutinefunction(performs):
            raise DeviceError(f"{performs.__qualname__} has to be `async def`: a service takes time, and can be stopped")

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, device: object, owner: type) -> Any:
        return self if device is None else self.performs.__get__(device, owner)

    def stopping(self, stops: StopFunction) -> StopFunction:
        """Decorate the method that brings an interrupted service to a safe state and returns the situation."""
        self.stops = stops
        return stops

    def compensation(self, undoes: UndoFunction) -> UndoFunction:
        """Decorate the method that undoes the service: it restores the given situation, or an equivalent one."""
        self.undoes = undoes
        return undoes

    def capability(self, features: Mapping[str, Value]) -> Capability:
        attributes = dict(features)
        if not callable(self.price):
            attributes["Price"] = money(self.price)[0]
        if not callable(self.duration):
            attributes["Duration"] = seconds(self.duration)
        return Capability(
            type=self.type,
            method=self.name,
            attributes=attributes,
            stoppable=self.stops is not None,
            undoable=self.undoes is not None,
            occupies=self.occupies,
            inputs=self.inputs,
            outputs=self.outputs,
        )


def service(
    type: ServiceType | str,
    *,
    price: Amounts = 0.0,
    duration: Amounts,
    able: AbilityCheck | None = None,
    penalty: Amounts | None = None,
    occupies: bool = True,
    inputs: tuple[str, ...] | None = None,
    outputs: tuple[str, ...] = (),
) -> Callable[[PerformFunction], Service]:
    """Make a method a service of this type, or of the type with this name in the common ontology.

    `price`, `duration` and `penalty` are amounts, or functions of the device and the task. `able` may raise Refusal. `penalty` is what it
    costs to have the work undone by the device; the Task Manager then weighs undoing against going on after a failure. A service that does
    not occupy the device is performed beside others, whatever the device's `capacity`. `inputs` and `outputs` are the names that the method
    reads and returns: if the common ontology defines the type with other names, the service is withheld. Without `inputs`, it serves any
    definition.
    """
    return lambda performs: Service(performs, type, price, duration, able, penalty, occupies=occupies, inputs=inputs, outputs=outputs)


def _check_definition(definition: Definition, owner: type[object]) -> Definition:
    """Return the definition with all values checked against their types, which Structs do not check on creation."""
    try:
        return msgspec.convert(msgspec.to_builtins(definition), type=type(definition))
    except (msgspec.ValidationError, TypeError) as error:
        name = getattr(definition, "name", definition)
        raise DeviceError(f"{owner.__name__} brings {type(definition).__name__} {name}, which is not valid: {error}") from None


def _ignore_observation(situation: str | None, observation: Observation) -> None:
    """Do nothing: no program runs the device."""


def _ignore_problem(problem: str | None) -> None:
    """Do nothing: no program runs the device."""


async def _no_task_manager(body: Body) -> Body:
    raise RemoteError("no program runs the device, so that it cannot submit tasks")


def _publish_nothing() -> None:
    """Do nothing: no program runs the device."""


class Device:
    """A device with services. Authors derive a class and set class attributes where the defaults do not fit.

    `values` and `situation` describe a device that is not on the map yet. `types` are definitions that the device adds to the common
    ontology: its object type, service types, and others that these use.
    """

    type: ClassVar[str | ObjectType]
    types: ClassVar[tuple[Definition, ...]] = ()
    values: Mapping[str, Value] = {}
    situation: str | None = None
    attributes: Mapping[str, Value] = {}
    """Static attributes of its services, such as OperationRange, by which clients can discover them."""
    map: MapReader
    """Reads the Repository's map; available from `open` on."""
    tasks: TaskSubmitter = TaskSubmitter(_no_task_manager)
    """Submits tasks to the Task Manager; the program that runs the device sets it."""
    data: Path = Path(".somrs")
    """The data folder of the running system, where a device may store data; it may not exist yet."""
    capacity: int = 1
    """How many of the services that occupy the device it can perform at the same time."""
    heartbeat: float = 5.0
    """Seconds between two heartbeats during work."""
    valid_for: float = 120.0
    """Seconds for which terms are valid."""
    lease: float = 30.0
    """Seconds after which the Service Registry drops a device that does not renew its lease."""

    def __init__(self, name: str, simulator: str | None = None) -> None:
        self.name, self.simulator = name, simulator

    observer: Callable[[str | None, Observation], None] = staticmethod(_ignore_observation)
    """Receives the observations of the device; the program that runs the device sets it."""

    def observed(
        self,
        situation: str | Formula | None = None,
        *,
        as_of: float | None = None,
        gone: Iterable[str] = (),
        searched: Iterable[str] = (),
        missed: Iterable[str] = (),
    ) -> None:
        """Report to the map what the device observed outside of its services: a situation, and objects that are `gone`.

        A typed variable of the situation is a sighted object: `?Seen: Jar isOn Table001`. The Repository finds out which object of the map
        it is, or adds it. `as_of`: when it was observed, in seconds since 1970 (None: now). `searched`: supports and spaces that were seen
        whole; objects that the map has there, and that the situation does not mention, become unknown. So do `missed` objects, which are
        not where the map has them.

        Reports arrive in their order, after the device has joined; they are repeated while the Repository is not available. Services return
        their results instead. `report` returns the names of the sighted objects.
        """
        observation = Observation(as_of=as_of, gone=tuple(gone), searched=tuple(searched), missed=tuple(missed))
        self.observer(str(parse(str(situation))) if situation is not None else None, observation)

    problem_observer: Callable[[str | None], None] = staticmethod(_ignore_problem)
    """Receives the problems of the device; the program that runs the device sets it."""

    def report_problem(self, problem: str | None) -> None:
        """Say why the device does not work, or cannot be reached, after its name (`cannot drive: its stop is pressed`); None: it has no
        problem.

        People read it with the device; it is the attribute `Problem` on the map, too. Call it also before the device has joined, as in
        `open`. The last one counts until the next, or until the device is started anew.
        """
        self.problem_observer(problem)

    publisher: Callable[[], None] = staticmethod(_publish_nothing)
    """Offers the services anew; the program that runs the device sets it."""

    def services_changed(self) -> None:
        """Offer the services anew, because `services` returns others than before. Contracts for the former services stay."""
        self.publisher()

    async def report(self, situation: str | Formula | None = None, observation: Observation | None = None) -> Reception:
        """Report to the map at once, and return what became of the report: the names of the sighted objects, and what was old news.

        Raises RemoteError when the Repository rejects the report.
        """
        text = str(parse(str(situation))) if situation is not None else None
        return await self.map.report(UpdateMap(situation=text, author=self.name, observation=observation))

    async def open(self) -> None:
        """Connect to the hardware. Called once before the device joins."""

    async def close(self) -> None:
        """Release the hardware. Called once after the device has left, or after `open` failed."""

    def services(self) -> Mapping[str, Service]:
        """Return the services, including inherited ones, by the names of their methods.

        A subclass may return others as time goes by; it then calls `services_changed`.
        """
        return _services(type(self))  # type: ignore[arg-type]  # classes are hashable; mypy takes the attribute `type` for the metaclass's

    def find_service(self, method: str) -> Service | None:
        """Return the service with which the device carries out a contract; None if it cannot any more."""
        return self.services().get(method)

    def profile(self) -> Profile:
        """Return the description of the device for the Service Manager. Raises DeviceError when the class is not complete."""
        cls = type(self)
        kind = getattr(cls, "type", None)
        if not isinstance(kind, str | ObjectType):
            raise DeviceError(f"{cls.__name__} has no object type: set the class attribute `type`, such as 'MobileRobot'")
        services = self.services()
        if not services:
            raise DeviceError(f"{cls.__name__} has no services: decorate an `async def` method with @service(...), and keep its name")
        for name in services:
            if hasattr(Device, name):
                raise DeviceError(f"{cls.__name__}.{name} is a service, but every device has an attribute {name}: rename the service")
        definitions = [*cls.types, *([kind] if isinstance(kind, ObjectType) else [])]
        definitions += [s.type for s in services.values() if isinstance(s.type, ServiceType)]
        for definition in definitions:
            if isinstance(definition, ServiceType) and (problem := next(kind_problems(definition), None)) is not None:
                raise DeviceError(f"{cls.__name__} brings the service type {definition.name}: {problem}")
        return Profile(
            name=self.name,
            type=kind if isinstance(kind, str) else kind.name,
            capabilities=tuple(offered_service.capability(self.attributes) for offered_service in services.values()),
            definitions=by_kind({repr(definition): _check_definition(definition, cls) for definition in definitions}.values()),
            values=dict(self.values),
            situation=self.situation,
            capacity=self.capacity,
            heartbeat=self.heartbeat,
            valid_for=self.valid_for,
            lease=self.lease,
        )


@functools.cache
def _services(kind: type[Device]) -> Mapping[str, Service]:
    services_by_name: dict[str, Service] = {}
    for owner in reversed(kind.__mro__):
        for name, value in vars(owner).items():
            services_by_name.pop(name, None)
            if isinstance(value, Service):
                services_by_name[name] = value
    return MappingProxyType(services_by_name)
