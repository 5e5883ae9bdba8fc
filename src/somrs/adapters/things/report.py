"""What a mapping file, a Thing Description or discovery messages become, for `somrs thing check`."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import aiohttp
from msgspec import Struct

from somrs.adapters.things.connections import parse_connection
from somrs.adapters.things.conversion import Conversion
from somrs.adapters.things.described_things import ADDRESS, load_description, resolve_description, resolve_discovered
from somrs.adapters.things.home_assistant import Discovery
from somrs.adapters.things.library import ontology_below
from somrs.adapters.things.mapping import ConnectionEntry
from somrs.adapters.things.mapping_checks import common_oddities, oddities
from somrs.adapters.things.mapping_file import read_mapping
from somrs.adapters.things.model import Command, Connection, Signal, Thing
from somrs.errors import InputError
from somrs.ontology.files.loading import load
from somrs.ontology.types import Ontology

NOTHING = "there are no things in it, so that nothing comes onto the map; write things: {NAME: {type: ..., attributes: ...}}"
BROKER = "broker"
"""The connection that the settings of the adapter may have, and of discovery messages in a file, which do not say where they come from."""


class ThingRow(Struct, frozen=True):
    """A thing. `kind`: whether it is a device, a passage, or an object with attributes only."""

    name: str
    type: str
    kind: str
    availability: str


class AttributeRow(Struct, frozen=True):
    """An attribute with its source, how it is converted, and when it is news for the map."""

    thing: str
    path: str
    source: str
    conversion: str
    news: str


class ServiceRow(Struct, frozen=True):
    """A service with its formulas, and what is sent."""

    thing: str
    type: str
    effect: str
    messages: str
    done_when: str
    failed_when: str


class ThingsReport(Struct, frozen=True):
    """What a file becomes, and what is not mapped."""

    things: tuple[ThingRow, ...]
    attributes: tuple[AttributeRow, ...]
    services: tuple[ServiceRow, ...]
    missing: tuple[str, ...]
    oddities: tuple[str, ...] = ()
    """What may be meant, and is probably not."""


def check_file(file: str, used_files: Sequence[Path] = ()) -> ThingsReport:
    """What a file becomes. Raises InputError with all problems."""
    if file.endswith((".yaml", ".yml")):
        if not Path(file).is_file():
            raise InputError(f"there is no file {file}")
        return _report(read_mapping(Path(file), _broker(), used_files).things)
    try:
        text, address = asyncio.run(load_description(file, Path()))
    except (aiohttp.ClientError, OSError) as error:
        raise InputError(f"{file} cannot be read: {error}") from error
    ontology = load(used_files, ontology_below(used_files)).ontology
    if not ADDRESS.match(file) and (messages := _discovery_messages(text)) is not None:
        return _report(_discovered(messages, ontology))
    return _report([resolve_description(text, address, ontology, {}).thing])


def _discovery_messages(text: str) -> dict[str, str] | None:
    """The payloads of discovery by topics, if the file has some: it is an object of JSON, or has lines with a topic and a payload."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        document = dict(line.split(" ", 1) for line in text.splitlines() if " " in line)
    if not isinstance(document, dict):
        return None
    payloads = {topic: payload for topic, payload in document.items() if topic.endswith("/config") and "/" in topic.removesuffix("/config")}
    return {topic: payload if isinstance(payload, str) else json.dumps(payload) for topic, payload in payloads.items()} or None


def _discovered(messages: dict[str, str], ontology: Ontology) -> Iterable[Thing]:
    discovery = Discovery(BROKER, next(iter(messages)).partition("/")[0])
    for topic, payload in messages.items():
        discovery.received(topic, payload.encode())
    if discovery.complaints:
        raise InputError("\n".join(discovery.complaints))
    return [resolve_discovered(discovered, ontology, _broker()).thing for discovered in discovery.things()]


def _broker() -> dict[str, Connection]:
    return {BROKER: parse_connection(BROKER, ConnectionEntry(url="mqtt://localhost"))}


def _report(things: Iterable[Thing]) -> ThingsReport:
    rows = [*things]
    return ThingsReport(
        things=tuple(
            ThingRow(thing.name, thing.type, _kind(thing), _availability(thing))
            for thing in rows
            if thing.signals or thing.is_device or not thing.unsupported
        ),
        attributes=tuple(_attribute_row(thing.name, signal) for thing in rows for signal in thing.signals),
        services=tuple(row for thing in rows for row in _service_rows(thing)),
        missing=tuple(f"{thing.name}: {text}" for thing in rows for text in thing.unsupported),
        oddities=(*(text for thing in rows for text in oddities(thing)), *common_oddities(rows)) if rows else (NOTHING,),
    )


def _kind(thing: Thing) -> str:
    if thing.is_lift:
        return "lift"
    if thing.door is not None or thing.session is not None:
        return "automatic door"
    return "device" if thing.services else "object with attributes"


def _availability(thing: Thing) -> str:
    places = [f"{place.source} = {place.online}" for place in thing.availabilities]
    if len(places) > 1:
        places.append(f"({thing.availability_mode})")
    return "\n".join(places) or "-"


def _attribute_row(name: str, signal: Signal) -> AttributeRow:
    path = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in signal.steps or ())
    conversion = signal.conversion
    unit = f" {conversion.attribute.unit}" if conversion.attribute.unit else ""
    news = [f"change of more than {signal.dead_band:g}{unit}"] if signal.dead_band else ["each change"]
    if signal.interval:
        news.append(f"every {signal.interval:g} s at most")
    if signal.off_delay is not None:
        news.append(f"FALSE after {signal.off_delay:g} s")
    if signal.expire_after is not None:
        news.append(f"unknown after {signal.expire_after:g} s")
    return AttributeRow(name, signal.path, f"{signal.source}{f' {path}' if path else ''}", _conversion(conversion), ", ".join(news))


def _conversion(conversion: Conversion) -> str:
    if conversion.values:
        return ", ".join(f"{text}: {_entish(value)}" for text, value in conversion.values.items())
    parts = [f"* {conversion.scale:g}"] if conversion.scale != 1 else []
    parts += [f"+ {conversion.offset:g}"] if conversion.offset else []
    own_unit = conversion.attribute.unit
    parts += [f"{conversion.unit} to {own_unit}"] if conversion.unit is not None and conversion.unit != own_unit else []
    if (conversion.minimum, conversion.maximum) != (-math.inf, math.inf):
        parts.append(f"from {conversion.minimum:g} to {conversion.maximum:g}")
    if conversion.true_from is not None:
        parts.append(f"TRUE from {conversion.true_from:g}, FALSE to {conversion.false_to:g}")
    return " ".join([str(conversion.attribute.kind), *parts])


def _entish(value: object) -> str:
    return str(value).upper() if isinstance(value, bool) else str(value)


def _service_rows(thing: Thing) -> Iterable[ServiceRow]:
    for service in thing.services:
        messages = "\n".join(map(_message, service.commands))
        yield ServiceRow(thing.name, service.type, service.effect, messages, service.done_when or "all is sent", service.failed_when or "-")
    if thing.door is not None:
        for type, commands, is_open in (("OpenDoor", thing.door.open, "TRUE"), ("CloseDoor", thing.door.close, "FALSE")):
            yield ServiceRow(thing.name, type, f"?Door.Open = {is_open}", "\n".join(map(_message, commands)), f"Open = {is_open}", "-")
    if thing.session is not None:
        place = f"{thing.session.connection}: {thing.session.place}"
        types = ("CallLift",) if thing.is_lift else ("OpenDoor", "CloseDoor")
        for type in types:
            yield ServiceRow(thing.name, type, "by its session", f"{place}/...", "its state shows it", "-")


def _message(command: Command) -> str:
    method = f"{command.method} " if command.method else ""
    return f"{command.connection}: {method}{command.place} <- {command.payload}"
