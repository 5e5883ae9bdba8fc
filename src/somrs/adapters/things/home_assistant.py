"""Reads the messages by which things announce themselves to Home Assistant over MQTT (home-assistant.io, "MQTT", "MQTT Discovery").

`components.py` says what each of their entities becomes. Entities of one device are one thing, as far as their attributes and services
differ.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from msgspec import Struct

from somrs.adapters.things.components import Entity, entity_of
from somrs.adapters.things.home_assistant_keys import full_keys
from somrs.adapters.things.mapping import ThingEntry
from somrs.adapters.things.thing_names import ThingNames

_TOPIC = re.compile(r"(?P<component>[^/]+)/(?:(?P<node>[^/]+)/)?(?P<object>[^/]+)/config")
TYPES = ("Light", "Heater", "Cover", "Lock", "Fan", "Switch", "Sensor")
"""What a thing with several entities is: the first type that one of them has."""


class Announcement(Struct, frozen=True, kw_only=True):
    """An entity that a message announces. `device`: tells the device that it belongs to from others; `device_name`: for people."""

    entity: Entity
    device: str
    device_name: str
    area: str = ""


class Discovered(Struct, frozen=True, kw_only=True):
    """A thing that messages announce, and what of it is not mapped."""

    name: str
    entry: ThingEntry
    unsupported: tuple[str, ...] = ()


class Discovery:
    """What the messages below one discovery prefix announce."""

    def __init__(self, connection: str, prefix: str = "homeassistant", names: ThingNames | None = None) -> None:
        self._connection, self._prefix = connection, prefix
        self._names = names if names is not None else ThingNames()
        self._announcements: dict[str, dict[str, Announcement]] = {}
        """By topics, and by entities."""
        self.complaints: list[str] = []
        """Messages that are not understood; whoever reads it empties it."""

    @property
    def topic(self) -> str:
        """The topic, with a wildcard, of all announcements."""
        return f"{self._prefix}/#"

    def received(self, topic: str, payload: bytes) -> bool:
        """Take in a message, and return whether it changed what is announced. An empty one withdraws what the topic announced."""
        match = _TOPIC.fullmatch(topic.removeprefix(f"{self._prefix}/"))
        if not topic.startswith(f"{self._prefix}/") or match is None:
            return False
        if not payload:
            return self._announcements.pop(topic, None) is not None
        try:
            document = json.loads(payload)
        except (ValueError, RecursionError):
            document = None
        if not isinstance(document, dict):
            self.complaints.append(f"{topic}: {payload[:60]!r} is no announcement, which is an object of JSON")
            return False
        announced = dict(self._read(match["component"], match["node"], match["object"], full_keys(document)))
        is_changed = announced != self._announcements.get(topic)
        self._announcements[topic] = announced
        return is_changed

    def _read(self, component: str, node: str | None, identity: str, config: Mapping[str, Any]) -> Iterator[tuple[str, Announcement]]:
        device = config.get("device")
        device = device if isinstance(device, dict) else {}
        components = config.get("components")
        if component == "device" and isinstance(components, dict):
            common = {key: value for key, value in config.items() if key not in ("components", "device", "origin")}
            for key, part in components.items():
                if isinstance(part, dict):
                    entity_config = {**common, **full_keys(part)}
                    yield key, self._announcement(str(entity_config.get("platform", "")), f"{identity}_{key}", entity_config, device)
            return
        yield identity, self._announcement(component, f"{node}_{identity}" if node else identity, config, device)

    def _announcement(self, component: str, identity: str, config: Mapping[str, Any], device: Mapping[str, Any]) -> Announcement:
        identifiers = device.get("identifiers") or device.get("connections") or []
        first_identifier = json.dumps(identifiers[0]) if isinstance(identifiers, list) and identifiers else str(identifiers or "")
        texts = (config.get(key) for key in ("name", "object_id", "unique_id"))
        name = next((text for text in texts if isinstance(text, str) and text), identity)
        device_name = device.get("name")
        return Announcement(
            entity=entity_of(component, name, config),
            device=first_identifier or str(config.get("unique_id") or identity),
            device_name=device_name if isinstance(device_name, str) and device_name else name,
            area=str(device.get("suggested_area") or ""),
        )

    def things(self) -> list[Discovered]:
        """What is announced now."""
        groups: dict[str, list[Announcement]] = {}
        for announcements in self._announcements.values():
            for announcement in announcements.values():
                groups.setdefault(announcement.device, []).append(announcement)
        return [thing for device, group in sorted(groups.items()) for thing in self._things_of(device, group)]

    def _things_of(self, device: str, group: list[Announcement]) -> Iterator[Discovered]:
        """The things of a device: one, and one more for each entity that says or does the same as another of its entities."""
        entities = sorted((announcement.entity for announcement in group), key=lambda entity: (entity.rank, entity.name))
        name, unsupported = group[0].device_name, tuple(f"{entity.name}: {text}" for entity in entities for text in entity.unsupported)
        heeded = next((entity for entity in entities if entity.available), None)
        for entity in entities:
            if heeded is not None and entity.available and entity.available != heeded.available:
                topics = ", ".join(str(place.topic) for place in entity.available)
                unsupported += (f"{entity.name}: where it says whether it works ({topics}): {heeded.name} says it for the device",)
        main = [entity for entity in entities if entity.attributes or entity.services]
        while main:
            united, further = _unite(main)
            yield Discovered(name=self._name(f"{device}/{name}", name), entry=self._entry(united, group[0].area), unsupported=unsupported)
            main, unsupported = further, ()
            name = f"{group[0].device_name} {further[0].name}" if further else ""
        if unsupported:
            yield Discovered(name=self._name(f"{device}/{name}", name), entry=ThingEntry(type="Sensor"), unsupported=unsupported)

    def _name(self, identity: str, text: str) -> str:
        return self._names.name(f"{self._connection}/{self._prefix}/{identity}", text)

    def _entry(self, entities: list[Entity], area: str) -> ThingEntry:
        types = {entity.type for entity in entities}
        heeded = next((entity for entity in entities if entity.available), entities[0])
        return ThingEntry(
            type=next(type for type in TYPES if type in types),
            connection=self._connection,
            area=area,
            availability=heeded.available,
            availability_mode=heeded.availability_mode.value,
            attributes={path: attribute for entity in entities for path, attribute in entity.attributes.items()},
            services={type: service for entity in entities for type, service in entity.services.items()},
        )


def _unite(entities: list[Entity]) -> tuple[list[Entity], list[Entity]]:
    """The entities that can be one thing, and those that cannot."""
    united: list[Entity] = []
    further: list[Entity] = []
    for entity in entities:
        keys = {*entity.attributes, *entity.services}
        is_alike = any(keys & {*other_entity.attributes, *other_entity.services} for other_entity in united)
        is_second_main = bool(united) and entity.type != "Sensor"
        (further if is_alike or is_second_main else united).append(entity)
    return united, further
