"""Things as the adapter works with them: everything that a mapping names is resolved and checked. `resolving.py` makes them."""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct

from somrs.adapters.brokers import Server, addresses_text
from somrs.adapters.things.conversion import Conversion, Raw
from somrs.adapters.things.json_path import Steps
from somrs.adapters.things.registers import Register
from somrs.ontology.types import Definition, Value


class Connection(Struct, frozen=True, kw_only=True):
    """A broker, a server or a Modbus device. `scheme`: mqtt, mqtts, http, https or modbus; `unit`: of a Modbus device.
    `further_servers`: of a broker that has several. `authority`, `certificate`, `key`: files in PEM, for TLS."""

    name: str
    scheme: str
    host: str
    port: int
    path: str = ""
    user: str | None = None
    password_file: str | None = None
    authority: str | None = None
    certificate: str | None = None
    key: str | None = None
    unit: int = 1
    further_servers: tuple[Server, ...] = ()

    @property
    def servers(self) -> tuple[Server, ...]:
        return ((self.host, self.port), *self.further_servers)

    @property
    def kind(self) -> str:
        """mqtt, http or modbus."""
        return {"mqtts": "mqtt", "https": "http"}.get(self.scheme, self.scheme)

    def __str__(self) -> str:
        return f"{addresses_text(self.scheme, self.servers)}{self.path}"


class Source(Struct, frozen=True, kw_only=True):
    """Where messages come from: a topic, a path of a server, or a register."""

    connection: str
    place: str
    register: Register | None = None
    poll: float = 5.0
    """Seconds between two readings of a path or a register."""

    def __str__(self) -> str:
        return f"{self.connection}: {self.place}"


class Signal(Struct, frozen=True, kw_only=True):
    """The value of an attribute in messages. `dead_band`: in the attribute's unit. `interval`: seconds between two reports at least.

    `off_delay`: seconds after which TRUE goes back to FALSE (None: never). `expire_after`: seconds without a message after which the value
    is not known any more (None: it stays).
    """

    path: str
    source: Source
    conversion: Conversion
    steps: Steps | None = None
    dead_band: float = 0.0
    interval: float = 0.0
    off_delay: float | None = None
    expire_after: float | None = None


class AvailabilityMode(StrEnum):
    """When a thing works that says so at several places."""

    ALL = "all"
    """It says everywhere that it does."""
    ANY = "any"
    """It says so somewhere."""
    LATEST = "latest"
    """It said so last."""


class Availability(Struct, frozen=True, kw_only=True):
    """Where it is read whether a thing works: it says `online` then."""

    source: Source
    steps: Steps | None = None
    online: str = "online"


class Command(Struct, frozen=True, kw_only=True):
    """A message to a thing. `place`: a topic, or the path of a server. `method`: of HTTP.

    `payload`: a value, or a text in which `?Input` stands for an input of the order; `conversions` says how inputs are written.
    """

    connection: str
    place: str
    payload: Raw = ""
    register: Register | None = None
    method: str = "PUT"
    content_type: str = "application/json"
    retain: bool = False
    conversions: dict[str, Conversion] = {}

    def __str__(self) -> str:
        return f"{self.connection}: {self.place} <- {self.payload}"


class ThingService(Struct, frozen=True, kw_only=True):
    """A service of a thing. `done_when`, `failed_when`, `condition`: Entish about ?Provider and the inputs, over what the thing says.

    `done_when` None: as soon as all is sent. `outputs`: the attributes from which they are read. `demand`: what has to hold on the map.
    """

    type: str
    commands: tuple[Command, ...]
    effect: str
    inputs: tuple[str, ...] = ()
    outputs: dict[str, str] = {}
    demand: str | None = None
    price: float | str = 0.0
    duration: float | str = 5.0
    condition: str | None = None
    done_when: str | None = None
    failed_when: str | None = None
    interrupt: tuple[Command, ...] = ()


class Door(Struct, frozen=True, kw_only=True):
    """What opens and closes an automatic door."""

    open: tuple[Command, ...]
    close: tuple[Command, ...]


class Session(Struct, frozen=True, kw_only=True):
    """The session interface of a lift or a door. `place`: the topic, or the path, below which it is. `levels`: names of levels by
    storeys."""

    connection: str
    place: str
    poll: float = 0.5
    levels: dict[str, str] = {}


class Thing(Struct, frozen=True, kw_only=True):
    """A thing. `values` and `situation` put it on the map, if it is not there.

    `area`: what it is a part of, by name or label, if nothing else says where it is; empty: the whole map. `definitions`: those that it
    needs of the common ontology. `has_working`, `has_problem`: its type has the attributes Working and Problem.
    """

    name: str
    type: str
    values: dict[str, Value] = {}
    situation: str | None = None
    area: str = ""
    signals: tuple[Signal, ...] = ()
    availabilities: tuple[Availability, ...] = ()
    availability_mode: AvailabilityMode = AvailabilityMode.ALL
    services: tuple[ThingService, ...] = ()
    door: Door | None = None
    session: Session | None = None
    is_lift: bool = False
    has_working: bool = True
    has_problem: bool = True
    definitions: tuple[Definition, ...] = ()
    unsupported: tuple[str, ...] = ()
    """What a description of it has, and what becomes nothing."""

    @property
    def is_device(self) -> bool:
        """Whether it has services, or moves for robots, so that it is a device; another thing only has attributes."""
        return bool(self.services) or self.door is not None or self.session is not None
