"""The adapter for things: what the mapping files name, and what announces or describes itself."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import aiohttp

from somrs.adapters.adapter import Fleet
from somrs.adapters.settings import valid_settings
from somrs.adapters.things.connections import parse_connection
from somrs.adapters.things.connector import FIRST_PAUSE, LONGEST_PAUSE
from somrs.adapters.things.described_things import ADDRESS, ResolvedThing, load_description, resolve_description, resolve_discovered
from somrs.adapters.things.gateway import gateway
from somrs.adapters.things.home_assistant import Discovery
from somrs.adapters.things.hub import Hub
from somrs.adapters.things.library import library, ontology_below
from somrs.adapters.things.mapping import ConnectionEntry
from somrs.adapters.things.mapping_file import read_mapping
from somrs.adapters.things.model import Connection, Session, Thing
from somrs.adapters.things.mqtt import MqttConnector
from somrs.adapters.things.passages import passage_device
from somrs.adapters.things.settings import HomeAssistantEntry, Settings
from somrs.adapters.things.state import Payload, SourceKey
from somrs.adapters.things.thing_device import thing_device
from somrs.adapters.things.thing_names import ThingNames
from somrs.adapters.things.thing_objects import area_problem, type_problem
from somrs.entish.parse import nearest
from somrs.errors import InputError, Mistake, SettingsError
from somrs.ontology.files.loading import NAME, load
from somrs.ontology.naming import DefinitionKey, key_of
from somrs.ontology.types import Definition, Ontology
from somrs.service_manager.sdk.device import Device
from somrs.sites.references import Site

log = logging.getLogger(__name__)

SETTLING = 1.0
"""Seconds after an announcement in which further ones of the same thing are waited for."""


def _reject(mistakes: Sequence[Mistake]) -> None:
    if mistakes:
        raise SettingsError("things", mistakes)


class ThingsAdapter:
    """Connects things over MQTT, HTTP and Modbus TCP (somrs.adapters.adapter.Adapter)."""

    def __init__(self, settings: Mapping[str, Any], folder: Path) -> None:
        self.settings, self._folder = valid_settings("things", settings, Settings), folder
        self._used_files = [folder / file for file in self.settings.uses]
        self.connections: dict[str, Connection] = {}
        url, certificates = self.settings.broker, self.settings.certificates
        broker = {"broker": ConnectionEntry(url=url, certificates=certificates)} if url is not None else {}
        mistakes = [*self._absent_files()]
        for name, entry in {**broker, **self.settings.connections}.items():
            try:
                self.connections[name] = parse_connection(name, entry, folder)
            except InputError as error:
                mistakes.append((("connections", name) if name in self.settings.connections else ("broker",), str(error)))
        _reject(mistakes)
        self.mappings = [read_mapping(folder / file, self.connections, self._used_files) for file in self.settings.mappings]
        for index, mapping in enumerate(self.mappings):
            for name, connection in mapping.connections.items():
                if self.connections.setdefault(name, connection) != connection:
                    mistakes.append((("mappings", index), f"another file has another connection {name}; give one another name"))
        _reject([*mistakes, *self._mistakes()])

    def _absent_files(self) -> Iterator[Mistake]:
        settings = self.settings
        for key, files in (("mappings", settings.mappings), ("uses", settings.uses), ("descriptions", settings.descriptions)):
            for index, file in enumerate(files):
                path = self._folder / file
                if not ADDRESS.match(file) and not path.is_file():
                    yield (key, index), f"there is no file {path}; correct the name, which is relative to the site file"

    def _mistakes(self) -> Iterator[Mistake]:
        """What of the settings does not fit the things of the mapping files."""
        if NAME.fullmatch(self.settings.gateway) is None:
            yield ("gateway",), f"{self.settings.gateway!r} is not a name of an object: write a letter, and then letters, digits, _ or -"
        if self.settings.broker is not None and self.connections["broker"].kind != "mqtt":
            yield ("broker",), f"{self.settings.broker!r} is no broker: write mqtt://HOST:PORT, or name it under connections"
        names = [thing.name for mapping in self.mappings for thing in mapping.things] + [self.settings.gateway]
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            yield ("mappings",), f"several things are called {', '.join(repeated)}; give each a name of its own"
        for name, heights in self.settings.simulated.items():
            session = self._sessions.get(name)
            if session is None:
                yield ("simulated", name), f"no mapping has {name} with a session; {nearest(name, self._sessions) or 'correct the name'}"
            elif lacking := [level for level in session.levels.values() if level not in heights]:
                yield ("simulated", name), f"write the heights of its levels: {', '.join(lacking)}"
        brokers = [name for name, connection in self.connections.items() if connection.kind == "mqtt"]
        for index, entry in enumerate(self.settings.home_assistant):
            if entry.connection not in brokers:
                hint = nearest(entry.connection, brokers) or "name one"
                yield ("home_assistant", index, "connection"), f"{entry.connection} is no connection to an MQTT broker; {hint}"

    @property
    def names(self) -> Collection[str]:
        return [self.settings.gateway, *(thing.name for mapping in self.mappings for thing in mapping.things if thing.is_device)]

    def misfits(self, site: Site) -> Iterable[Mistake]:
        """Things whose area the map of the site does not have, and those that are something else there."""
        if self.settings.gateway in site.map.objects:
            yield from site.named("gateway", [self.settings.gateway], "Device")
        for mapping in self.mappings:
            for thing in mapping.things:
                problem = area_problem(thing, site.map, mapping.ontology) or type_problem(thing, site.map, mapping.ontology, site.ontology)
                if problem is not None:
                    yield ("mappings",), f"{thing.name}: {problem}"

    @property
    def simulated(self) -> Collection[str]:
        """The doors and lifts of the simulator that are behind the session interface."""
        return self.settings.simulated.keys()

    async def simulate(self, simulator: str, storeys: Mapping[str, float]) -> None:
        """Be the controllers of doors and lifts of the simulator, until it is cancelled."""
        from somrs.adapters.things.simulated.program import SimulatedPassage, serve_passages

        passages = []
        for name, heights in self.settings.simulated.items():
            session = self._sessions[name]
            passages.append(SimulatedPassage(name, self.connections[session.connection], session.place, heights))
        await serve_passages(passages, simulator)

    @property
    def _sessions(self) -> dict[str, Session]:
        things = (thing for mapping in self.mappings for thing in mapping.things)
        return {thing.name: thing.session for thing in things if thing.session is not None}

    async def run(self, fleet: Fleet) -> None:
        """Connect all things, until it is cancelled."""
        async with asyncio.TaskGroup() as group:
            await _Run(self, fleet, group, self._folder).start()

    def common_ontology(self) -> Ontology:
        """What things that announce or describe themselves are defined by."""
        return load(self._used_files, ontology_below(self._used_files)).ontology


class _Run:
    """A run of the adapter."""

    def __init__(self, adapter: ThingsAdapter, fleet: Fleet, group: asyncio.TaskGroup, folder: Path) -> None:
        self._adapter, self._fleet, self._group, self._folder = adapter, fleet, group, folder
        self._hub = Hub()
        self._names = ThingNames(fleet.data / "things" / f"{adapter.settings.gateway}.json")
        self._definitions: dict[DefinitionKey, Definition] = {}
        """That the gateway brings."""
        self._mapped_names = frozenset(adapter.names) | {thing.name for mapping in adapter.mappings for thing in mapping.things}

    async def start(self) -> None:
        settings = self._adapter.settings
        for connection in self._adapter.connections.values():
            self._connect(connection)
        announces = bool(settings.home_assistant or settings.descriptions)
        self._bring(library() if announces else (definition for definition in library() if definition.name == "Gateway"))
        devices = [self._join(thing, mapping.ontology) for mapping in self._adapter.mappings for thing in mapping.things]
        self._add_gateway()
        for device in devices:
            if device is not None:
                self._fleet.add(device)
        for entry in settings.home_assistant:
            self._group.create_task(self._discover(entry))
        for place in settings.descriptions:
            self._group.create_task(self._describe(place))

    def _connect(self, connection: Connection) -> None:
        if connection.name not in self._hub.connectors:
            self._group.create_task(self._hub.connect(connection).run())

    def _bring(self, definitions: Iterable[Definition]) -> bool:
        """Have the gateway bring definitions, and return whether it did not do so before."""
        fresh = {key_of(definition): definition for definition in definitions}
        is_more = not fresh.keys() <= self._definitions.keys()
        self._definitions = {**fresh, **self._definitions}
        return is_more

    def _add_gateway(self) -> None:
        self._fleet.add(gateway(self._adapter.settings.gateway, self._hub, tuple(self._definitions.values())))

    def _join(self, thing: Thing, ontology: Ontology) -> Device | None:
        """Let a thing take part, and return its device; None if it only has attributes, which the gateway reports."""
        self._hub.add(thing, ontology)
        if thing.is_device:
            return device_for(thing, self._hub)
        self._bring(thing.definitions)
        return None

    def _add_resolved(self, resolved: ResolvedThing) -> None:
        for connection in resolved.connections.values():
            self._connect(connection)
        brings_more = not resolved.thing.is_device and self._bring(resolved.thing.definitions)
        device = self._join(resolved.thing, resolved.ontology)
        if device is not None:
            self._fleet.add(device)
        elif brings_more:
            self._add_gateway()

    # Things that announce themselves

    async def _discover(self, entry: HomeAssistantEntry) -> None:
        """Let the things join that announce themselves at a broker, and leave again."""
        discovery, changed = Discovery(entry.connection, entry.prefix, self._names), asyncio.Event()

        def received(key: SourceKey, payload: Payload) -> None:
            if key[0] == entry.connection and isinstance(payload, bytes) and discovery.received(key[1], payload):
                changed.set()

        self._hub.any_message_observers.append(received)
        connector = self._hub.connectors[entry.connection]
        assert isinstance(connector, MqttConnector), "the settings are checked"
        connector.subscribe(discovery.topic)
        ontology = self._adapter.common_ontology()
        joined: dict[str, Thing] = {}
        while True:
            await changed.wait()
            await asyncio.sleep(SETTLING)
            changed.clear()
            while discovery.complaints:
                log.warning("%s", discovery.complaints.pop())
            await self._apply(discovery, ontology, joined)

    async def _apply(self, discovery: Discovery, ontology: Ontology, joined: dict[str, Thing]) -> None:
        """Let things join and leave as they are announced. `joined`: those that have joined by name."""
        announced: dict[str, ResolvedThing] = {}
        for discovered in discovery.things():
            try:
                resolved = resolve_discovered(discovered, ontology, self._adapter.connections)
            except InputError as error:
                log.warning("%s", error)
                continue
            if resolved.thing.name not in self._mapped_names:  # a mapping file knows better
                announced[resolved.thing.name] = resolved
        for name, thing in [*joined.items()]:
            resolved_thing = announced.get(name)
            if resolved_thing is None:
                self._hub.remove(joined.pop(name).name)
            if thing.is_device and (resolved_thing is None or not resolved_thing.thing.is_device):
                await self._fleet.remove(name)
        for name, resolved in announced.items():
            if joined.get(name) != resolved.thing:
                _log_unsupported(resolved.thing)
                joined[name] = resolved.thing
                if resolved.thing.signals or resolved.thing.services:
                    self._add_resolved(resolved)

    # Things that are described

    async def _describe(self, place: str) -> None:
        """Let the thing of a description join, as soon as it can be read."""
        pause, complaint = FIRST_PAUSE, ""
        while True:
            try:
                text, address = await load_description(place, self._folder)
                ontology, connections = self._adapter.common_ontology(), self._adapter.connections
                resolved = resolve_description(text, address, ontology, connections, self._names, self._mapped_names)
            except (aiohttp.ClientError, OSError, InputError) as error:
                if str(error) != complaint:
                    log.warning("%s; it is tried again", error)
                complaint = str(error)
                await asyncio.sleep(pause)
                pause = min(2 * pause, LONGEST_PAUSE)
            else:
                _log_unsupported(resolved.thing)
                self._add_resolved(resolved)
                return


def _log_unsupported(thing: Thing) -> None:
    for text in thing.unsupported:
        log.warning("%s: not mapped: %s", thing.name, text)


def device_for(thing: Thing, hub: Hub) -> Device:
    """The device of a thing that has services, or moves for robots."""
    return passage_device(thing, hub) if thing.door is not None or thing.session is not None else thing_device(thing, hub)
