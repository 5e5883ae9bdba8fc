"""What a device author writes with: a class, a decorator, and what a service is given while it works.

    class Forklift(Device):
        type = "Forklift"

        @service(TransferObject, price="4 EUR", duration="30 s")
        async def transfer(self, task: Task) -> Situation: ...

        @transfer.stopping
        async def put_down(self, task: Task) -> Situation: ...

        @transfer.compensation
        async def bring_back(self, task: Task, situation: Formula) -> Situation: ...

Everything else (terms, the protocol, the calendar, joining and leaving) is the Service Manager's, in `participant.py`.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import msgspec
from msgspec import Struct

from somrs.entish.formula import Formula
from somrs.entish.parse import parse
from somrs.errors import DeviceError, RemoteError
from somrs.ontology.objects import Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Definition, ObjectType, Value
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import MapPage, QueryMap, ReadMap, Rows, by_kind
from somrs.service_manager.sdk.orders import Advance, Capability, Order, Profile
from somrs.service_manager.sdk.values import fill_in, money, python_value, seconds

Situation = str | Formula | None
"""What holds now, in Entish. None, from a service that worked: the effect, as it was arranged."""


class Result(Struct, frozen=True, kw_only=True):
    """What a service with outputs returns."""

    outputs: dict[str, Value]
    situation: Situation = None


Ask = Callable[[Body], Awaitable[Body]]
"""Asks the Repository."""

# What the decorated functions are called with besides the device itself, whose class differs from author to author.
PerformFunction = Callable[[Any, "Task"], Awaitable["Situation | Result"]]
StopFunction = Callable[[Any, "Task"], Awaitable[Situation]]
UndoFunction = Callable[[Any, "Task", Formula], Awaitable[Situation]]
Amount = float | str
Amounts = Amount | Callable[[Any, "Task"], Amount | Awaitable[Amount]]
AbilityCheck = Callable[[Any, "Task"], Awaitable[None] | None]


class MapReader:
    """Reads the map of the environment in the Repository."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    async def object(self, name: str) -> Object | None:
        """The object with the values that were given for it; None when there is no such object."""
        page = await self._answer(ReadMap(after=predecessor_name(name)))
        if not isinstance(page, MapPage):
            raise RemoteError(f"the Repository answered ReadMap with {type(page).__name__}")
        return page.objects[0] if page.objects and page.objects[0].name == name else None

    async def query(self, formula: str | Formula, limit: int = 100) -> list[dict[str, Value]]:
        """Every way in which the formula holds: a value, or the name of an object, for each of its variables."""
        rows = await self._answer(QueryMap(formula=str(formula), limit=limit))
        if not isinstance(rows, Rows):
            raise RemoteError(f"the Repository answered QueryMap with {type(rows).__name__}")
        return [{name: python_value(text) for name, text in row.bindings.items()} for row in rows.rows]

    async def holds(self, formula: str | Formula) -> bool:
        return bool(await self.query(formula, limit=1))

    async def _answer(self, body: Body) -> Body:
        answer = await self._ask(body)
        if isinstance(answer, Fault):
            raise RemoteError(answer.text)
        return answer


def predecessor_name(name: str) -> str:
    """A text that comes just before the name in the order of names, so that the page behind it begins with the name."""
    return f"{name[:-1]}{chr(ord(name[-1]) - 1)}\ufffd"


class Task:
    """What a service was asked to do, and the line back to whoever asked."""

    def __init__(self, provider: str, order: Order, ask: Ask, report: Callable[[object], None]) -> None:
        self.order = order
        self.inputs: Mapping[str, Value] = {name: python_value(text) for name, text in order.inputs.items()}
        """By name: numbers, texts and truths as Python has them, objects by their names on the map."""
        self.effect: Formula = fill_in(order.effect, provider, order.inputs)
        self.precondition: Formula | None = fill_in(order.precondition, provider, order.inputs) if order.precondition else None
        self.map = MapReader(ask)
        self._report = report

    async def progress(self, fraction: float, situation: Situation = None, note: str = "") -> None:
        """Say how far it is (0 to 1), what holds now if that changed, and a word for people."""
        self._report(Advance(fraction=min(max(fraction, 0.0), 1.0), situation=str(situation) if situation is not None else None, note=note))


class Service:
    """A service of a class of devices: what `@service` makes of a method."""

    def __init__(
        self, performs: PerformFunction, type: ServiceType | str, price: Amounts, duration: Amounts, able: AbilityCheck | None
    ) -> None:
        self.performs, self.type, self.price, self.duration, self.able = performs, type, price, duration, able
        self.stops: StopFunction | None = None
        self.undoes: UndoFunction | None = None
        self.name = performs.__name__
        for amount, read in ((price, money), (duration, seconds)):
            if not callable(amount):
                read(amount)
        if not inspect.iscoroutinefunction(performs):
            raise DeviceError(f"{performs.__qualname__} has to be `async def`: a service takes time, and can be stopped")

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, device: object, owner: type) -> Any:
        return self if device is None else self.performs.__get__(device, owner)

    def stopping(self, stops: StopFunction) -> StopFunction:
        """Decorates what to do when the service is interrupted: reach a safe state, and say what holds then."""
        self.stops = stops
        return stops

    def compensation(self, undoes: UndoFunction) -> UndoFunction:
        """Decorates what to do to undo the service: restore the situation given, or an equivalent one."""
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
        )


def service(
    type: ServiceType | str, *, price: Amounts = 0.0, duration: Amounts, able: AbilityCheck | None = None
) -> Callable[[PerformFunction], Service]:
    """Makes a method a service of the type (or of the type of that name in the common ontology).

    `price` and `duration` are amounts, or functions of the device and the task; `able` may raise Refusal.
    """
    return lambda performs: Service(performs, type, price, duration, able)


def _check_definition(definition: Definition, owner: type[object]) -> Definition:
    """The definition with every value of the kind that it has to be: Structs do not check what they are made of."""
    try:
        return msgspec.convert(msgspec.to_builtins(definition), type=type(definition))
    except (msgspec.ValidationError, TypeError) as error:
        name = getattr(definition, "name", definition)
        raise DeviceError(f"{owner.__name__} brings {type(definition).__name__} {name}, which is not well made: {error}") from None


def _ignore_observation(situation: str) -> None:
    """Nobody runs the device."""


class Device:
    """A device with services. Authors derive a class, and say in class attributes what is not as usual.

    `values` and `situation` say where it is, for a device that is not on the map yet; `types` are definitions that it brings
    to the common ontology (its object type, service types, whatever they need).
    """

    type: ClassVar[str | ObjectType]
    types: ClassVar[tuple[Definition, ...]] = ()
    values: Mapping[str, Value] = {}
    situation: str | None = None
    attributes: Mapping[str, Value] = {}
    """Static features of its services, such as OperationRange, that clients can discover them by."""
    map: MapReader
    """Reads the Repository's map; there from `open` on."""
    data: Path = Path(".somrs")
    """The data folder of the running system, for what a device keeps; it may not be there yet."""
    capacity: int = 1
    """How many services it can perform at the same time."""
    heartbeat: float = 5.0
    """Seconds between two signs of life while it works."""
    valid_for: float = 120.0
    """Seconds for which its terms hold."""
    lease: float = 30.0
    """Seconds after which the Service Registry forgets a device that fell silent."""

    def __init__(self, name: str, simulator: str | None = None) -> None:
        self.name, self.simulator = name, simulator

    observer: Callable[[str], None] = staticmethod(_ignore_observation)
    """Hears what the device observed: its program sees to that."""

    def observed(self, situation: str | Formula) -> None:
        """Have it on the map that the situation holds, which the device noticed besides its work; what work came to, services return.
        It comes there in the order in which it was noticed, once the device has joined, and again if the Repository is down."""
        self.observer(str(parse(str(situation))))

    async def open(self) -> None:
        """Called once before the device joins: connect to the hardware."""

    async def close(self) -> None:
        """Called once when the device has left."""

    def services(self) -> Mapping[str, Service]:
        """The services by the names of their methods, inherited ones included."""
        return _services(type(self))  # type: ignore[arg-type]  # classes are hashable; mypy takes the attribute `type` for the metaclass's

    def profile(self) -> Profile:
        """What the Service Manager has to know. Raises DeviceError when the class cannot be run as it is."""
        cls = type(self)
        kind = getattr(cls, "type", None)
        if not isinstance(kind, str | ObjectType):
            raise DeviceError(f"{cls.__name__} does not say what it is on the map: give it a class attribute `type`, such as 'MobileRobot'")
        services = self.services()
        if not services:
            raise DeviceError(f"{cls.__name__} has no services: decorate an `async def` method with @service(...), and keep its name")
        for name in services:
            if hasattr(Device, name):
                raise DeviceError(
                    f"{cls.__name__}.{name} is a service, but every device has a {name} of its own: call the service something else"
                )
        definitions = [*cls.types, *([kind] if isinstance(kind, ObjectType) else [])]
        definitions += [s.type for s in services.values() if isinstance(s.type, ServiceType)]
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
