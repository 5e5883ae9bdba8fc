"""The structure of mapping files: which messages are which attributes and services of things. `mapping_file.py` reads and checks them."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict, Field

from somrs.ontology.files.documents import Entry

Plain = str | float | bool
Amount = str | float
KeyPath = tuple[str | int, ...]
"""The keys, and positions in lists, that lead to something in an entry."""


class _Entry(Entry):
    model_config = ConfigDict(populate_by_name=True)


class Certificates(_Entry):
    """Files in PEM, for TLS."""

    authority: str | None = Field(default=None, description="Who signed the certificate of the other end; by default, those of the system")
    certificate: str | None = Field(default=None, description="The own one, if the other end wants one")
    key: str | None = Field(default=None, description="The key of the own one, if it is in another file")


class ConnectionEntry(_Entry):
    """A broker, a server or a Modbus device."""

    url: str = Field(description="mqtt://HOST:1883, mqtts://, http://, https:// or modbus://HOST:502/UNIT")
    user: str | None = None
    password_file: str | None = Field(default=None, description="A file with the password, or the bearer token of a server")
    certificates: Certificates = Certificates()


class _Place(_Entry):
    """Where a value is read or written."""

    connection: str | None = Field(default=None, description="A name under connections; needed if there are several")
    topic: str | None = Field(default=None, min_length=1, description="Of MQTT")
    register_: str | None = Field(
        default=None, alias="register", description="Of Modbus: coil, discrete, input or holding, and the address from 0"
    )
    encoding: str | None = Field(
        default=None, alias="as", description="Of registers: int16, uint16, int32, float32, ...; int32 swapped; bit 3"
    )


class ConversionEntry(_Entry):
    """How values are written in messages."""

    values: dict[str, Plain] = Field(default={}, description="The value for each text of the messages: {heat: Heating, 'off': Idle}")
    scale: float = Field(default=1.0, description="The value is what was read, times scale, plus offset")
    offset: float = 0.0
    unit: str | None = Field(default=None, description="The unit of the value, if it is not that of the attribute: degF")
    range: list[float] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="The least and the greatest value: what is read beyond it is not believed, and nothing beyond it is written",
    )
    decimals: float | None = Field(default=None, ge=0, multiple_of=1, description="To how many decimals numbers are rounded in messages")
    step: float | None = Field(default=None, gt=0, description="Numbers in messages to the thing are multiples of it")


class AttributeEntry(_Place, ConversionEntry):
    """Where the value of an attribute is read."""

    path: str | None = Field(default=None, description="Of HTTP: what is read")
    json_path: str | None = Field(default=None, alias="json", description="The value in a document: state.temperature, $.sensors[0].value")
    true_from: float | None = Field(default=None, description="Of a truth value that is said as a number: from which on it is TRUE")
    false_to: float | None = Field(default=None, description="Up to which number it is FALSE; between the two, it stays as it was")
    poll: Amount = Field(default="5 s", description="How often a path or a register is read")
    dead_band: float | None = Field(
        default=None, ge=0, description="Smaller changes of a number are no news; by default the attribute's tolerance"
    )
    interval: Amount = Field(default=0.0, description="The shortest time between two reports of it to the map")
    off_delay: Amount | None = Field(default=None, description="After which TRUE goes back to FALSE")
    expire_after: Amount | None = Field(default=None, description="After which, without a message, the value is not known any more")


class AvailabilityEntry(_Place):
    """Where it is read whether the thing works."""

    path: str | None = None
    json_path: str | None = Field(default=None, alias="json")
    poll: Amount = "5 s"
    online: str = Field(default="online", description="The text that says that it works; all others say that it does not")


class InputEntry(ConversionEntry):
    """How an input of a service is written in messages."""

    inverse_of: str | None = Field(
        default=None, description="The attribute whose reading is turned round: what is read for a value is written for it"
    )


class WriteEntry(_Place):
    """A message to the thing, with `?Input` where a value of the order comes in."""

    put: str | None = Field(default=None, description="Of HTTP: the path to which the payload is sent")
    post: str | None = None
    payload: Plain = Field(default="", description='?Brightness, or {"brightness": ?Brightness}')
    content_type: str = "application/json"
    retain: bool = False
    convert: dict[str, InputEntry] = Field(default={}, description="How inputs are written")


class ServiceEntry(_Entry):
    """A service of a thing."""

    write: list[WriteEntry] = Field(default=[], description="What is sent, one after the other")
    outputs: dict[str, str] = Field(default={}, description="The outputs of the service, and the attributes that they are read from")
    demand: str | None = Field(default=None, description="Entish; what has to hold on the map when it starts, for which a plan has to see")
    price: Amount = 0.0
    duration: Amount = "5 s"
    condition: str | None = Field(default=None, description="Entish about ?Provider; the service is refused, for now, unless it holds")
    done_when: str | None = Field(
        default=None,
        description="Entish about ?Provider and the inputs; when it holds, the service is done. By default its effect; `sent`: at once",
    )
    failed_when: str | None = Field(default=None, description="Entish; when it holds after the first message, the service has failed")
    interrupt: list[WriteEntry] = Field(default=[], description="What is sent when the service is stopped")


class SessionEntry(_Entry):
    """The session interface of a lift or a door (docs/how-to/connect-things.md)."""

    connection: str | None = None
    topic: str | None = Field(default=None, description="Of MQTT: TOPIC/request and TOPIC/state")
    path: str | None = Field(default=None, description="Of HTTP: PATH/session and PATH/state")
    poll: Amount = "500 ms"
    levels: dict[str, str] = Field(default={}, description="Of a lift: the names of its levels, by the storeys of the map")


class DoorEntry(_Entry):
    """What opens and closes an automatic door."""

    open: list[WriteEntry] = Field(min_length=1)
    close: list[WriteEntry] = Field(min_length=1)


class ThingEntry(_Entry):
    """A thing: an object of the map, its attributes and services."""

    type: str
    at: list[Amount] | None = Field(default=None, min_length=2, max_length=3, description="Where it is, if it is not on the map yet")
    values: dict[str, Plain] = Field(default={}, description="Values of its attributes, if it is not on the map yet")
    area: str = Field(default="", description="The room or storey that it is a part of, by name or label, if nothing else says where it is")
    situation: str | None = Field(default=None, description="What holds of it, if it is not on the map yet: Lamp1 isPartOf Hall")
    connection: str | None = Field(default=None, description="That of all its entries without one")
    available: AvailabilityEntry | None = None
    availability: list[AvailabilityEntry] = Field(default=[], description="Several places where it is read whether it works")
    availability_mode: Literal["all", "any", "latest"] = Field(
        default="all", description="Which of several places have to say that it works"
    )
    attributes: dict[str, AttributeEntry] = {}
    services: dict[str, ServiceEntry] = {}
    door: DoorEntry | None = None
    session: SessionEntry | None = Field(default=None, description="Of a lift, or of an automatic door")


class MappingFile(_Entry):
    """The keys of a mapping file besides those of a file with definitions."""

    connections: dict[str, ConnectionEntry] = {}
    things: dict[str, ThingEntry] = {}


SECTIONS = tuple(MappingFile.model_fields)
