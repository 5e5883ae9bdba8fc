"""Reads W3C Thing Descriptions (WoT TD 1.1): properties become attributes, and services that set them; forms say how they are reached.

Forms with http, https and mqtt are used. An action has no formula that says what holds after it, so that it becomes no service.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import urljoin, urlsplit

from msgspec import Struct

from somrs.adapters.things.mapping import AttributeEntry, ConnectionEntry, InputEntry, ServiceEntry, ThingEntry, WriteEntry
from somrs.adapters.things.naming import definition_name, is_unit
from somrs.adapters.things.thing_names import ThingNames
from somrs.errors import InputError
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Definition, Kind, ObjectType, Ontology
from somrs.ontology.units import convert_unit

PROPERTIES = {
    "on": "On", "onoff": "On", "onoffproperty": "On", "power": "On", "brightness": "Brightness", "brightnessproperty": "Brightness",
    "temperature": "Temperature", "temperatureproperty": "Temperature", "targettemperature": "TargetTemperature",
    "targettemperatureproperty": "TargetTemperature", "humidity": "Humidity", "humidityproperty": "Humidity",
    "illuminance": "Illuminance", "open": "Open", "openproperty": "Open", "locked": "Locked", "lockedproperty": "Locked",
    "motion": "Detected", "motionproperty": "Detected", "leakproperty": "Detected", "co2": "CarbonDioxide", "voltage": "Voltage",
    "voltageproperty": "Voltage", "current": "Current", "currentproperty": "Current", "weight": "MeasuredWeight",
    "instantaneouspowerproperty": "Power",
}  # fmt: skip
"""Attributes for names of properties, and for their @type as of the WebThings schemas."""
TYPES = {"Brightness": "Light", "TargetTemperature": "Heater", "Locked": "Lock", "On": "Switch"}
"""What a thing is that has such an attribute: the first that fits."""
THING_TYPES = {
    "light": "Light", "lamp": "Light", "onoffswitch": "Switch", "multilevelswitch": "Switch", "switch": "Switch", "smartplug": "Switch",
    "thermostat": "Heater", "heater": "Heater", "lock": "Lock", "fan": "Fan", "cover": "Cover", "blind": "Cover", "shutter": "Cover",
}  # fmt: skip
"""Types for the @type of a description, of the WebThings schemas and others."""
SETTERS = {"Brightness": "SetBrightness", "TargetTemperature": "SetTemperature"}
SWITCHES = {"On": ("SwitchOn", "SwitchOff"), "Open": ("OpenCover", "CloseCover"), "Locked": ("LockDoor", "UnlockDoor")}
UNITS = {"celsius": "degC", "degree celsius": "degC", "fahrenheit": "degF", "degree fahrenheit": "degF", "%": "percent", "lux": "lx"}
KINDS = {"boolean": Kind.TRUTH, "number": Kind.NUMBER, "integer": Kind.NUMBER, "string": Kind.TEXT}
SCHEMES = ("http", "https", "mqtt", "mqtts")


class Described(Struct, frozen=True, kw_only=True):
    """What a description becomes: a thing, its connections, the definitions that it brings, and what is not mapped."""

    name: str
    entry: ThingEntry
    connections: Mapping[str, ConnectionEntry]
    securities: Mapping[str, str | None] = {}
    """By connections, the security scheme that its forms name (WoT TD 1.1, 5.3.3); None: they name none."""
    definitions: tuple[Definition, ...] = ()
    unsupported: tuple[str, ...] = ()


class _Endpoint(Struct, frozen=True, kw_only=True):
    """How a property is read or written: the connection, its place there, and the method of HTTP."""

    connection: str
    place: str
    is_mqtt: bool
    method: str = ""
    content_type: str = "application/json"


def read_description(
    text: str, base_address: str, ontology: Ontology, names: ThingNames, taken_names: frozenset[str] = frozenset()
) -> Described:
    """What a Thing Description becomes. `base_address`: where it was read, to which its addresses are relative. Raises InputError."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{base_address}: this is not JSON: {error}") from None
    if not isinstance(document, dict) or not isinstance(document.get("title"), str):
        raise InputError(f"{base_address}: this is no Thing Description, which has a title and properties (WoT TD 1.1)")
    name = names.name(str(document.get("id") or base_address), document["title"], taken_names)
    return _Reading(document, base_address, ontology).finish(name)


class _Reading:
    def __init__(self, document: Mapping[str, Any], base_address: str, ontology: Ontology) -> None:
        self.document, self.ontology = document, ontology
        self.base = urljoin(base_address, str(document.get("base", "")))
        self.connections: dict[str, ConnectionEntry] = {}
        self.securities: dict[str, str | None] = {}
        self.definitions: dict[str, Definition] = {}
        self.unsupported: list[str] = []
        self.attributes: dict[str, AttributeEntry] = {}
        self.services: dict[str, ServiceEntry] = {}

    def finish(self, name: str) -> Described:
        title = str(self.document["title"])
        for key, schema in _entries(self.document.get("properties")):
            self._property(key, schema)
        for key, _ in _entries(self.document.get("actions")):
            self.unsupported.append(
                f"the action {key}: the description does not say what holds after it; map it by a service in a mapping file"
            )
        for key, _ in _entries(self.document.get("events")):
            self.unsupported.append(f"the event {key}")
        entry = ThingEntry(type=self._type(title), attributes=self.attributes, services=self.services)
        return Described(
            name=name,
            entry=entry,
            connections=self.connections,
            securities=self.securities,
            definitions=tuple(self.definitions.values()),
            unsupported=tuple(self.unsupported),
        )

    def _security(self, form: Mapping[str, Any]) -> str | None:
        """The security scheme of a form: its own one, or that of the thing; None if neither is said."""
        names = form.get("security", self.document.get("security"))
        name = names[0] if isinstance(names, list) and names else names
        definitions = dict(_entries(self.document.get("securityDefinitions")))
        definition = definitions.get(name) if isinstance(name, str) else None
        return str(definition.get("scheme")) if definition is not None else None

    def _type(self, title: str) -> str:
        """The type of the thing: one of those for things, or one below it, if it has attributes that no other thing has."""
        named_types = (THING_TYPES[word] for word in _annotations(self.document) if word in THING_TYPES)
        parent = next(named_types, next((type for path, type in TYPES.items() if path in self.attributes), "Sensor"))
        missing = [path for path in self.attributes if path not in self.ontology.attributes_of(parent)]
        if not missing:
            return parent
        name = definition_name(title)
        if name in self.ontology.types:
            name = f"{name}Thing"
        self.definitions[name] = ObjectType(
            name=name, parent=parent, attributes=tuple(missing), doc=str(self.document.get("description", ""))
        )
        return name

    def _property(self, name: str, schema: Mapping[str, Any]) -> None:
        kind = KINDS.get(str(schema.get("type")))
        if kind is None:
            self.unsupported.append(f"the property {name}: of the type {schema.get('type')}")
            return
        attribute, unit = self._attribute(name, schema, kind)
        reading = None if schema.get("writeOnly") is True else self._endpoint(schema, ("readproperty", "observeproperty"))
        if reading is not None:
            self.attributes[attribute.name] = AttributeEntry(
                connection=reading.connection,
                topic=reading.place if reading.is_mqtt else None,
                path=None if reading.is_mqtt else reading.place,
                json="$" if "json" in reading.content_type else None,
                unit=unit,
                range=_limits(schema, attribute, unit),
                step=_step(schema, attribute),
            )
        writing = None if schema.get("readOnly") is True else self._endpoint(schema, ("writeproperty",))
        if writing is not None:
            self._setters(attribute, writing, is_read=reading is not None)
        if reading is None and writing is None:
            self.unsupported.append(f"the property {name}: it has no form with http, https or mqtt")

    def _attribute(self, name: str, schema: Mapping[str, Any], kind: Kind) -> tuple[AttributeType, str | None]:
        """The attribute for a property, and the unit of the property, where it is another one."""
        words = [*_annotations(schema), *filter(None, [re.sub(r"[\W_]", "", name).lower()])]
        unit = UNITS.get(str(schema.get("unit", "")).lower(), schema.get("unit"))
        unit = unit if isinstance(unit, str) and kind is Kind.NUMBER and is_unit(unit) else None
        for path in (PROPERTIES[word] for word in words if word in PROPERTIES):
            known_attribute = self.ontology.attributes[path]
            if known_attribute.kind is kind and (unit is None or convert_unit(1.0, unit, known_attribute.unit or "") is not None):
                return known_attribute, unit if unit != known_attribute.unit else None
        values = [str(value) for value in schema.get("enum", ()) if re.fullmatch(r"[^\W\d]\w*", str(value))] if kind is Kind.TEXT else []
        attribute = AttributeType(
            name=self._definition_name(name),
            kind=Kind.ENUMERATION if values and len(values) == len(schema["enum"]) else kind,
            unit=unit,
            minimum=_number(schema.get("minimum")) if kind is Kind.NUMBER else None,
            maximum=_number(schema.get("maximum")) if kind is Kind.NUMBER else None,
            values=tuple(values) if values and len(values) == len(schema["enum"]) else (),
            doc=str(schema.get("description", "")),
        )
        self.definitions[attribute.name] = attribute
        return attribute, None

    def _definition_name(self, name: str) -> str:
        """A name for an attribute, other than those with another meaning."""
        candidate = definition_name(name)
        return f"{definition_name(str(self.document['title']))}{candidate}" if candidate in self.ontology.attributes else candidate

    def _setters(self, attribute: AttributeType, endpoint: _Endpoint, *, is_read: bool) -> None:
        if attribute.kind is Kind.TRUTH:
            names = SWITCHES.get(attribute.name, (f"Set{attribute.name}", f"Reset{attribute.name}"))
            for name, value in zip(names, (True, False), strict=True):
                self._service(
                    name, f"?Provider.{attribute.name} = {str(value).upper()}", {}, endpoint, "true" if value else "false", is_read=is_read
                )
            return
        name, path = SETTERS.get(attribute.name, f"Set{attribute.name}"), attribute.name
        known_service = self.ontology.services.get(name)
        parameter = known_service.inputs[0].name if known_service is not None and known_service.inputs else path
        type = "number" if attribute.kind is Kind.NUMBER else "text"
        payload = f"?{parameter}" if attribute.kind is Kind.NUMBER or endpoint.is_mqtt else f'"?{parameter}"'
        self._service(name, f"?Provider.{path} = ?{parameter}", {parameter: type}, endpoint, payload, is_read=is_read)

    def _service(self, name: str, effect: str, inputs: Mapping[str, str], endpoint: _Endpoint, payload: str, *, is_read: bool) -> None:
        if name not in self.ontology.services:
            parameters = tuple(Parameter(name=parameter, type=type) for parameter, type in inputs.items())
            self.definitions[f"service {name}"] = ServiceType(name=name, effect=effect, inputs=parameters)
        converted = {
            parameter: InputEntry(inverse_of=path) for parameter in inputs for path in self.attributes if f".{path} =" in effect and is_read
        }
        write = WriteEntry(
            connection=endpoint.connection,
            topic=endpoint.place if endpoint.is_mqtt else None,
            put=endpoint.place if endpoint.method == "PUT" else None,
            post=endpoint.place if endpoint.method == "POST" else None,
            payload=payload,
            content_type=endpoint.content_type,
            convert=converted,
        )
        self.services[name] = ServiceEntry(write=[write], done_when=None if is_read else "sent")

    def _endpoint(self, schema: Mapping[str, Any], operations: tuple[str, ...]) -> _Endpoint | None:
        """The first form for one of the operations whose protocol is spoken here."""
        forms = schema.get("forms")
        for form in forms if isinstance(forms, list) else ():
            operation = form.get("op", ["readproperty", "writeproperty"])
            supported = {operation} if isinstance(operation, str) else {*operation}
            href = urljoin(self.base, str(form.get("href", "")))
            if not supported.isdisjoint(operations) and urlsplit(href).scheme in SCHEMES:
                return self._place(href, form, "writeproperty" in operations)
        return None

    def _place(self, href: str, form: Mapping[str, Any], writes: bool) -> _Endpoint:
        parts = urlsplit(href)
        is_mqtt = parts.scheme.startswith("mqtt")
        address, security = f"{parts.scheme}://{parts.netloc}", self._security(form)
        name = address if security in (None, "nosec") else f"{address} with {security}"
        self.connections.setdefault(name, ConnectionEntry(url=address))
        self.securities[name] = security
        method = str(form.get("htv:methodName", "PUT")) if writes and not is_mqtt else ""
        place = str(form.get("mqv:topic") or form.get("mqv:filter") or parts.path.removeprefix("/")) if is_mqtt else parts.path or "/"
        if parts.query and not is_mqtt:
            place = f"{place}?{parts.query}"
        return _Endpoint(
            connection=name,
            place=place,
            is_mqtt=is_mqtt,
            method="POST" if method == "POST" else "PUT" if method else "",
            content_type=str(form.get("contentType", "application/json")),
        )


def _annotations(schema: Mapping[str, Any]) -> list[str]:
    """The words of an @type, without their vocabularies."""
    types = schema.get("@type")
    return [str(word).rpartition(":")[2].rpartition("#")[2].lower() for word in (types if isinstance(types, list) else [types]) if word]


def _entries(value: object) -> Iterator[tuple[str, Mapping[str, Any]]]:
    if isinstance(value, dict):
        yield from ((key, entry) for key, entry in value.items() if isinstance(entry, dict))


def _limits(schema: Mapping[str, Any], attribute: AttributeType, unit: str | None) -> list[float] | None:
    """The least and the greatest value of a property in the unit of its attribute; None: it says neither."""
    said_limits = [_number(schema.get(key)) for key in ("minimum", "maximum")]
    if attribute.kind is not Kind.NUMBER or said_limits == [None, None]:
        return None
    limits = []
    for limit, default in zip(said_limits, (attribute.minimum, attribute.maximum), strict=True):
        converted = convert_unit(limit, unit, attribute.unit or "") if limit is not None and unit is not None else limit
        limits.append(converted if converted is not None else default)
    least, most = limits
    return [least if least is not None else -math.inf, most if most is not None else math.inf]


def _step(schema: Mapping[str, Any], attribute: AttributeType) -> float | None:
    step = _number(schema.get("multipleOf")) if attribute.kind is Kind.NUMBER else None
    return step if step is not None and step > 0 else None


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
