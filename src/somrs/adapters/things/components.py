"""What each kind of entity of Home Assistant's discovery becomes: attributes, and services (home-assistant.io, "MQTT Sensor" and so on)."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

from msgspec import Struct

from somrs.adapters.things.library import library
from somrs.adapters.things.mapping import AttributeEntry, AvailabilityEntry, InputEntry, ServiceEntry, WriteEntry
from somrs.adapters.things.model import AvailabilityMode
from somrs.adapters.things.naming import is_unit
from somrs.ontology.files.loading import upper
from somrs.ontology.types import AttributeType
from somrs.ontology.units import convert_unit

Config = Mapping[str, Any]

_TEMPLATE = re.compile(
    r"\{\{\s*(value_json((?:\.[A-Za-z_]\w*|\['[^']+'\]|\[\"[^\"]+\"\]|\[\d+\])+)|value)\s*(?:\|\s*(?:float|int|round)(?:\([^)]*\))?\s*)*\}\}"
)
SENSOR_ATTRIBUTES = {
    "temperature": "Temperature", "humidity": "Humidity", "illuminance": "Illuminance", "pressure": "Pressure",
    "atmospheric_pressure": "Pressure", "carbon_dioxide": "CarbonDioxide", "power": "Power", "energy": "Energy", "voltage": "Voltage",
    "current": "Current", "weight": "MeasuredWeight", "battery": "Charge",
}  # fmt: skip
"""The attributes for device classes of sensors."""
OPENINGS = ("door", "window", "opening", "garage_door")
MODES = {"off": "Off", "heat": "Heating", "cool": "Cooling", "auto": "Automatic", "heat_cool": "Automatic"}
SENT_ALL = "sent"


class Entity(Struct, kw_only=True):
    """An entity: the type of the thing that has it, its attributes and services, and what of it is not mapped."""

    name: str
    type: str = "Sensor"
    attributes: dict[str, AttributeEntry] = {}
    services: dict[str, ServiceEntry] = {}
    available: list[AvailabilityEntry] = []
    availability_mode: AvailabilityMode = AvailabilityMode.LATEST
    unsupported: tuple[str, ...] = ()

    @property
    def rank(self) -> int:
        """Entities of lower rank determine what a thing with several is."""
        return 1 if self.type == "Sensor" else 0


class _Unsupported(Exception):
    """Something that cannot be mapped."""


def entity_of(component: str, name: str, config: Config) -> Entity:
    """What an entity becomes. What cannot be mapped is said in `unsupported`."""
    entity = Entity(name=name, attributes={}, services={})
    read = COMPONENTS.get(component)
    if read is None:
        entity.unsupported = (f"an entity of the kind {component}",)
        return entity
    noted = _NotedConfig(config)
    try:
        read(entity, noted)
        _read_availability(entity, noted)
        if unread := sorted(key for key in noted.keys() - noted.read_keys if key.endswith(_PLACES) and key not in _OF_NO_EFFECT):
            entity.unsupported = (*entity.unsupported, f"its {', '.join(unread)}")
    except _Unsupported as error:
        entity.unsupported = (*entity.unsupported, str(error))
    except (ArithmeticError, TypeError, ValueError) as error:
        entity.unsupported = (*entity.unsupported, f"its announcement has values that make no sense: {error}")
    return entity


def _sensor(entity: Entity, config: Config) -> None:
    unit, device_class = config.get("unit_of_measurement"), str(config.get("device_class") or "")
    path = SENSOR_ATTRIBUTES.get(device_class, "Reading" if unit is not None or config.get("state_class") is not None else "State")
    own_unit = _units().get(path)
    is_convertible = own_unit is not None and isinstance(unit, str) and is_unit(unit) and convert_unit(1.0, unit, own_unit) is not None
    if unit is not None and not is_convertible:
        if path in SENSOR_ATTRIBUTES.values():
            raise _Unsupported(f"its unit {unit!r}, in which {path} is not measured")
        entity.unsupported = (f"its unit {unit!r}: a {path} has none",)
    value = _attribute(config, "state_topic", "value_template", unit=unit if is_convertible else None)
    entity.attributes[path] = value.model_copy(update=_lapses(config))


@lru_cache(maxsize=1)
def _units() -> dict[str, str | None]:
    """The units of the attributes of sensors."""
    definitions = [*upper(1), *library()]
    attributes = [definition for definition in definitions if isinstance(definition, AttributeType)]
    return {attribute.name: attribute.unit for attribute in attributes if attribute.name in SENSOR_ATTRIBUTES.values()}


def _binary_sensor(entity: Entity, config: Config) -> None:
    path = "Open" if config.get("device_class") in OPENINGS else "Detected"
    value = _attribute(config, "state_topic", "value_template", values=_switch_values(config))
    entity.attributes[path] = value.model_copy(update=_lapses(config))


def _lapses(config: Config) -> dict[str, float]:
    """After how many seconds a value goes back to FALSE, and is not known any more. 0: never."""
    keys = [key for key in ("off_delay", "expire_after") if config.get(key)]
    return {key: float(config[key]) for key in keys}


def _switch(entity: Entity, config: Config, type: str = "Switch") -> None:
    entity.type = type
    is_read = "state_topic" in config
    if is_read:
        template = "state_value_template" if "state_value_template" in config else "value_template"
        entity.attributes["On"] = _attribute(config, "state_topic", template, values=_switch_values(config, "state_on", "state_off"))
    for service, key, default in (("SwitchOn", "payload_on", "ON"), ("SwitchOff", "payload_off", "OFF")):
        entity.services[service] = _service(config, "command_topic", str(config.get(key, default)), is_read=is_read)


def _fan(entity: Entity, config: Config) -> None:
    _switch(entity, config, "Fan")


def _light(entity: Entity, config: Config) -> None:
    schema = config.get("schema", "default")
    if schema == "json":
        _json_light(entity, config)
        return
    if schema != "default":
        raise _Unsupported(f"a light with the schema {schema}")
    _switch(entity, config, "Light")
    if "brightness_command_topic" in config:
        scale = 100 / float(config.get("brightness_scale", 255))
        is_read = "brightness_state_topic" in config
        if is_read:
            entity.attributes["Brightness"] = _attribute(config, "brightness_state_topic", "brightness_value_template", scale=scale)
        convert = {"Brightness": InputEntry(scale=scale, decimals=0.0)}
        entity.services["SetBrightness"] = _service(
            config, "brightness_command_topic", "?Brightness", convert, is_read=is_read, template="brightness_command_template"
        )


def _json_light(entity: Entity, config: Config) -> None:
    entity.type = "Light"
    topic, is_read = config.get("state_topic"), "state_topic" in config
    if isinstance(topic, str):
        entity.attributes["On"] = AttributeEntry(topic=topic, json="state", values={"ON": True, "OFF": False})
    entity.services["SwitchOn"] = _service(config, "command_topic", '{"state": "ON"}', is_read=is_read)
    entity.services["SwitchOff"] = _service(config, "command_topic", '{"state": "OFF"}', is_read=is_read)
    modes = config.get("supported_color_modes")
    if config.get("brightness") is True or (isinstance(modes, list) and not {*map(str, modes)} <= {"onoff", "unknown"}):
        scale = 100 / float(config.get("brightness_scale", 255))
        if isinstance(topic, str):
            entity.attributes["Brightness"] = AttributeEntry(topic=topic, json="brightness", scale=scale)
        convert = {"Brightness": InputEntry(scale=scale, decimals=0.0)}
        payload = '{"state": "ON", "brightness": ?Brightness}'
        entity.services["SetBrightness"] = _service(config, "command_topic", payload, convert, is_read=is_read)


def _cover(entity: Entity, config: Config) -> None:
    entity.type = "Cover"
    is_read = "state_topic" in config or "position_topic" in config
    if "state_topic" in config:
        words = ("open", True), ("opening", False), ("closed", False), ("closing", True)
        values = {str(config.get(f"state_{word}", word)): is_open for word, is_open in words} | {"stopped": True}
        entity.attributes["Open"] = _attribute(config, "state_topic", "value_template", values=values)
    for service, key, default in (("OpenCover", "payload_open", "OPEN"), ("CloseCover", "payload_close", "CLOSE")):
        payload = config.get(key, default)
        if "command_topic" in config and payload is not None:  # null: there is no such command
            entity.services[service] = _service(config, "command_topic", str(payload), is_read=is_read)
    closed, opened = float(config.get("position_closed", 0)), float(config.get("position_open", 100))
    if "position_topic" in config and opened != closed:
        scale = 100 / (opened - closed)
        offset = -closed * scale
        position = _attribute(config, "position_topic", "position_template", scale=scale, offset=offset)
        entity.attributes["Position"] = position
        if "state_topic" not in config:  # a move has not ended between the ends, and neither end holds
            entity.attributes["Open"] = position.model_copy(update={"true_from": 100.0, "false_to": 0.0})
        if "set_position_topic" in config:
            convert = {"Position": InputEntry(scale=scale, offset=offset, decimals=0.0)}
            template = "set_position_template"
            entity.services["SetPosition"] = _service(config, "set_position_topic", "?Position", convert, is_read=True, template=template)


def _lock(entity: Entity, config: Config) -> None:
    entity.type = "Lock"
    is_read = "state_topic" in config
    if is_read:
        words = ("locked", "LOCKED", True), ("locking", "LOCKING", False), ("unlocked", "UNLOCKED", False), ("unlocking", "UNLOCKING", True)
        values = {str(config.get(f"state_{word}", default)): is_locked for word, default, is_locked in words} | {"JAMMED": False}
        entity.attributes["Locked"] = _attribute(config, "state_topic", "value_template", values=values)
    for service, key, default in (("LockDoor", "payload_lock", "LOCK"), ("UnlockDoor", "payload_unlock", "UNLOCK")):
        entity.services[service] = _service(config, "command_topic", str(config.get(key, default)), is_read=is_read)


def _climate(entity: Entity, config: Config) -> None:
    entity.type = "Heater"
    unit = "degF" if config.get("temperature_unit") == "F" else "degC"
    if "current_temperature_topic" in config:
        template = "current_temperature_template"
        entity.attributes["Temperature"] = _attribute(config, "current_temperature_topic", template, unit=unit)
    is_read = "temperature_state_topic" in config
    if is_read:
        template = "temperature_state_template"
        entity.attributes["TargetTemperature"] = _attribute(config, "temperature_state_topic", template, unit=unit)
    if "mode_state_topic" in config:
        entity.attributes["HeatingMode"] = _attribute(config, "mode_state_topic", "mode_state_template", values=MODES)
    if "temperature_command_topic" in config:
        least, most = (float(config.get(key, default[unit])) for key, default in _TEMPERATURES.items())
        limits = [_in_degrees_celsius(least, unit), _in_degrees_celsius(most, unit)]
        step = abs(float(config.get("temp_step") or 0.0)) or None
        way = InputEntry(inverse_of="TargetTemperature") if is_read else InputEntry(unit=unit)
        convert = {"Temperature": way.model_copy(update={"range": limits, "step": step})}
        topic, template = "temperature_command_topic", "temperature_command_template"
        entity.services["SetTemperature"] = _service(config, topic, "?Temperature", convert, is_read=is_read, template=template)


_TEMPERATURES = {"min_temp": {"degC": 7.0, "degF": 44.6}, "max_temp": {"degC": 35.0, "degF": 95.0}}
"""The keys for what a thermostat can be set to, and what counts without them."""


def _in_degrees_celsius(temperature: float, unit: str) -> float:
    converted = convert_unit(temperature, unit, "degC")
    assert converted is not None, "both are units of temperature"
    return round(converted, 2)


COMPONENTS: dict[str, Callable[[Entity, Config], None]] = {
    "sensor": _sensor,
    "binary_sensor": _binary_sensor,
    "switch": _switch,
    "light": _light,
    "fan": _fan,
    "cover": _cover,
    "lock": _lock,
    "climate": _climate,
}


def _attribute(
    config: Config,
    topic_key: str,
    template_key: str,
    *,
    values: Mapping[str, bool | str] | None = None,
    scale: float = 1.0,
    offset: float = 0.0,
    unit: str | None = None,
) -> AttributeEntry:
    return AttributeEntry(
        topic=_topic(config, topic_key),
        json=_json_path(config, template_key),
        values=dict(values or {}),
        scale=scale,
        offset=offset,
        unit=unit,
    )


def _service(
    config: Config,
    topic_key: str,
    payload: str,
    convert: Mapping[str, InputEntry] | None = None,
    *,
    is_read: bool,
    template: str = "command_template",
) -> ServiceEntry:
    """A service of one message. If nothing says what the entity does then, it is done as soon as it is sent."""
    if template in config and _TEMPLATE.fullmatch(str(config[template]).strip()) is None:
        raise _Unsupported(f"{template} {config[template]!r}")
    write = WriteEntry(topic=_topic(config, topic_key), payload=payload, retain=config.get("retain") is True, convert=dict(convert or {}))
    return ServiceEntry(write=[write], done_when=None if is_read else SENT_ALL)


def _topic(config: Config, key: str) -> str:
    topic = config.get(key)
    if not isinstance(topic, str) or not topic:
        raise _Unsupported(f"it says no {key}")
    return topic


def _json_path(config: Config, key: str) -> str | None:
    """The path that a template reads: templates that do more than this are not supported."""
    template = config.get(key)
    if template is None:
        return None
    match = _TEMPLATE.fullmatch(str(template).strip())
    if match is None:
        raise _Unsupported(f"{key} {template!r}, which is more than a path")
    return f"${match[2]}" if match[2] is not None else None


def _switch_values(config: Config, on_key: str = "payload_on", off_key: str = "payload_off") -> dict[str, bool]:
    """What is said for TRUE and FALSE. A state for which nothing is given is the payload of the command."""
    texts = {key: config.get(key, config.get(payload, default)) for key, payload, default in _SWITCH_KEYS if key in (on_key, off_key)}
    return {_json_text(texts[on_key]): True, _json_text(texts[off_key]): False}


_SWITCH_KEYS = (
    ("payload_on", "payload_on", "ON"),
    ("payload_off", "payload_off", "OFF"),
    ("state_on", "payload_on", "ON"),
    ("state_off", "payload_off", "OFF"),
)


def _json_text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _read_availability(entity: Entity, config: Config) -> None:
    """Where an entity says whether it works: in a list, or at one topic."""
    entries = config.get("availability")
    places = [(place, "value_template") for place in entries if isinstance(place, dict)] if isinstance(entries, list) else []
    if not places and isinstance(topic := config.get("availability_topic"), str):
        places = [({**config, "topic": topic}, "availability_template")]
    for place, key in places:
        topic, online = _topic(place, "topic"), str(place.get("payload_available", "online"))
        entity.available.append(AvailabilityEntry(topic=topic, json=_json_path(place, key), online=online))
    entity.availability_mode = AvailabilityMode(config.get("availability_mode", AvailabilityMode.LATEST))


class _NotedConfig(dict[str, Any]):
    """An announcement that notes which of its keys are read."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.read_keys: set[str] = {"availability_topic", "availability_template", "availability"}

    def get(self, key: str, default: Any = None) -> Any:
        self.read_keys.add(key)
        return super().get(key, default)

    def __getitem__(self, key: str) -> Any:
        self.read_keys.add(key)
        return super().__getitem__(key)


_PLACES = ("_topic", "_t")
"""How keys end that say where something more is read or written; the latter of those that are abbreviated."""
_OF_NO_EFFECT = ("json_attributes_topic", "json_attr_t", "last_reset_topic", "lrst_t")
"""Those that say only what people are shown besides."""
