"""Makes things of the entries of mappings: resolves connections, units, formulas and types, and collects what is wrong with them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from somrs.adapters.things.conversion import Conversion
from somrs.adapters.things.endpoints import Endpoints
from somrs.adapters.things.json_path import Steps, json_steps
from somrs.adapters.things.mapping import (
    AttributeEntry,
    AvailabilityEntry,
    ConversionEntry,
    InputEntry,
    KeyPath,
    ServiceEntry,
    ThingEntry,
    WriteEntry,
)
from somrs.adapters.things.mapping_checks import fits_register, thing_problems, unread
from somrs.adapters.things.messages import PLACEHOLDER
from somrs.adapters.things.model import (
    Availability,
    AvailabilityMode,
    Command,
    Connection,
    Door,
    Session,
    Signal,
    Source,
    Thing,
    ThingService,
)
from somrs.adapters.things.thing_objects import definitions_for, initial_values
from somrs.entish.formula import Attribute, Comparison, Variable, literals
from somrs.entish.parse import nearest, parse
from somrs.errors import FormulaError, InputError
from somrs.ontology.check import check
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.types import PROBLEM, WORKING, AttributeType, Kind, Ontology
from somrs.ontology.units import convert_unit
from somrs.service_manager.sdk.values import money, seconds

SENT_ALL = "sent"
"""Of `done_when`: the service is done as soon as all is sent."""
SESSION_TYPES = ("Lift", "AutomaticDoor")

SHORTEST_POLL = 0.05
"""Seconds between two readings at least."""


class Resolver:
    """Makes one thing of its entry. `default_connection`: that of entries which say none; None: the only one, if there is one.

    `problems`: what is wrong, each with the path of the key below the thing.
    """

    def __init__(self, name: str, ontology: Ontology, connections: Mapping[str, Connection], default_connection: str | None = None) -> None:
        self.name, self.ontology = name, ontology
        self.problems: list[tuple[KeyPath, str]] = []
        self._attributes: Mapping[str, AttributeType] = {}
        self._endpoints = Endpoints(connections, default_connection, self._problem)

    def thing(self, entry: ThingEntry) -> Thing | None:
        """The thing; None if there are problems."""
        if entry.type not in self.ontology.types:
            self._problem(
                ("type",), f"there is no type {entry.type}; {nearest(entry.type, self.ontology.types) or 'define it under types:'}"
            )
            return None
        self._attributes = self.ontology.attributes_of(entry.type)
        self._endpoints.default = entry.connection or self._endpoints.default
        values, value_problems = initial_values(self.name, entry, self.ontology)
        self.problems += value_problems
        signals = tuple(filter(None, (self._signal(path, attribute) for path, attribute in entry.attributes.items())))
        read_paths = frozenset(entry.attributes)
        services = tuple(filter(None, (self._service(type, service, entry, read_paths) for type, service in entry.services.items())))
        thing = Thing(
            name=self.name,
            type=entry.type,
            values=values,
            situation=self._formula(("situation",), entry.situation) if entry.situation is not None else None,
            area=entry.area,
            signals=signals,
            availabilities=self._availabilities(entry),
            availability_mode=AvailabilityMode(entry.availability_mode),
            services=services,
            door=self._door(entry),
            session=self._session(entry) if entry.session is not None else None,
            is_lift=self.ontology.is_subtype(entry.type, "Lift"),
            has_working=WORKING in self._attributes,
            has_problem=PROBLEM in self._attributes,
            definitions=definitions_for(entry.type, (service.type for service in services), self.ontology),
        )
        if not self.problems:
            self.problems += thing_problems(thing)
        return thing if not self.problems else None

    # Where values are read

    def _signal(self, path: str, entry: AttributeEntry) -> Signal | None:
        key: KeyPath = ("attributes", path)
        attribute = self._attributes.get(path)
        if attribute is None or attribute.kind is Kind.COMPLEX:
            hint = nearest(path, self._attributes) or "define it under attributes:, and name it in its type"
            self._problem(key, f"objects of its type have no attribute {path} with a value; {hint}")
            return None
        source, conversion = self._source(key, entry), self._conversion(key, entry, attribute)
        interval = self._seconds((*key, "interval"), entry.interval)
        if source is None or conversion is None:
            return None
        dead_band = attribute.tolerance if entry.dead_band is None else entry.dead_band
        lapses = {
            name: self._seconds((*key, name), amount)
            for name, amount in (("off_delay", entry.off_delay), ("expire_after", entry.expire_after))
            if amount is not None
        }
        if entry.off_delay is not None and attribute.kind is not Kind.TRUTH:
            self._problem((*key, "off_delay"), f"{path} is no truth value, which could go back to FALSE")
        steps = self._steps(key, entry.json_path)
        return Signal(path=path, source=source, conversion=conversion, steps=steps, dead_band=dead_band, interval=interval, **lapses)

    def _availabilities(self, entry: ThingEntry) -> tuple[Availability, ...]:
        entries: list[tuple[KeyPath, AvailabilityEntry]] = [(("available",), entry.available)] if entry.available is not None else []
        entries += [(("availability", index), place) for index, place in enumerate(entry.availability)]
        if entries and WORKING not in self._attributes:
            text = f"objects of its type have no attribute {WORKING}; let it be a StationaryDevice, or leave this out"
            self._problem(entries[0][0], text)
        places = []
        for key, place in entries:
            source, steps = self._source(key, place), self._steps(key, place.json_path)
            if source is not None:
                places.append(Availability(source=source, steps=steps, online=place.online))
        return tuple(places)

    def _source(self, key: KeyPath, entry: AttributeEntry | AvailabilityEntry) -> Source | None:
        places = {"topic": entry.topic, "path": entry.path, "register": entry.register_}
        endpoint = self._endpoints.find(key, entry.connection, places, entry.encoding)
        if endpoint is None:
            return None
        if endpoint.register is not None and entry.json_path is not None:
            self._problem((*key, "json"), "a register has a value, and no document; leave out json:")
        if endpoint.connection.kind == "mqtt" and "poll" in entry.model_fields_set:
            self._problem((*key, "poll"), "a topic says its messages by itself; leave out poll:")
        poll = self._poll(key, entry.poll)
        return Source(connection=endpoint.connection.name, place=endpoint.place, register=endpoint.register, poll=poll)

    def _steps(self, key: KeyPath, path: str | None) -> Steps | None:
        try:
            return json_steps(path) if path is not None else None
        except InputError as error:
            self._problem((*key, "json"), str(error))
            return None

    def _conversion(self, key: KeyPath, entry: ConversionEntry, attribute: AttributeType) -> Conversion | None:
        if entry.unit is not None and (attribute.unit is None or convert_unit(1.0, entry.unit, attribute.unit) is None):
            unit = f"is in {attribute.unit}" if attribute.unit is not None else "has no unit"
            self._problem((*key, "unit"), f"{attribute.name} {unit}, and {entry.unit} cannot be expressed in it")
            return None
        if entry.scale == 0:
            self._problem((*key, "scale"), "scale cannot be 0")
        minimum, maximum = entry.range or (
            attribute.minimum if attribute.minimum is not None else -math.inf,
            attribute.maximum if attribute.maximum is not None else math.inf,
        )
        if minimum > maximum:
            self._problem((*key, "range"), "write the least value first")
        true_from, false_to = (entry.true_from, entry.false_to) if isinstance(entry, AttributeEntry) else (None, None)
        if (true_from, false_to) != (None, None) and (attribute.kind is not Kind.TRUTH or None in (true_from, false_to)):
            self._problem((*key, "true_from"), "true_from and false_to are for truth values, and belong together")
        kinds = {Kind.NUMBER: float, Kind.TRUTH: bool}
        for text, value in entry.values.items():
            if not isinstance(value, kinds.get(attribute.kind, str)) or (
                attribute.kind is Kind.ENUMERATION and value not in attribute.values
            ):
                expected = ", ".join(attribute.values) if attribute.kind is Kind.ENUMERATION else f"a {attribute.kind}"
                self._problem((*key, "values", text), f"{attribute.name} is {expected}, not {value}")
        decimals = int(entry.decimals) if entry.decimals is not None else None
        return Conversion(
            attribute=attribute,
            values=dict(entry.values),
            scale=entry.scale,
            offset=entry.offset,
            unit=entry.unit,
            decimals=decimals,
            step=entry.step,
            minimum=minimum,
            maximum=maximum,
            true_from=true_from,
            false_to=false_to,
        )

    # What is written

    def _service(self, type: str, entry: ServiceEntry, thing: ThingEntry, read_paths: frozenset[str]) -> ThingService | None:
        key: KeyPath = ("services", type)
        definition = self.ontology.services.get(type)
        if definition is None:
            hint = nearest(type, self.ontology.services) or "define it under services:"
            self._problem(key, f"there is no type of service {type}; {hint}")
            return None
        variables = {**{parameter.name: parameter.type for parameter in definition.inputs}, PROVIDER: thing.type}
        inputs = self._inputs(definition)
        for written, text in (("done_when", entry.done_when), ("failed_when", entry.failed_when), ("condition", entry.condition)):
            if text is not None and text != SENT_ALL:
                self._observable((*key, written), text, read_paths, variables)
        if entry.demand is not None:
            self._formula((*key, "demand"), entry.demand, variables)
        self._check_outputs(key, entry, definition, read_paths)
        done_when = entry.done_when
        if done_when is None and (missing := unread(definition.effect, read_paths)):
            self._problem(key, f"no message says {', '.join(missing)}; write done_when: and what is read, or {SENT_ALL}")
        if not entry.write:
            self._problem(key, "sends nothing; write write: and its messages")
        self._amounts(key, entry)
        return ThingService(
            type=type,
            commands=tuple(self._commands((*key, "write"), entry.write, thing, inputs)),
            effect=definition.effect,
            inputs=tuple(inputs),
            outputs=dict(entry.outputs),
            demand=entry.demand,
            price=entry.price,
            duration=entry.duration,
            condition=entry.condition,
            done_when=None if done_when == SENT_ALL else done_when or definition.effect,
            failed_when=entry.failed_when,
            interrupt=tuple(self._commands((*key, "interrupt"), entry.interrupt, thing, inputs)),
        )

    def _check_outputs(self, key: KeyPath, entry: ServiceEntry, definition: ServiceType, read_paths: frozenset[str]) -> None:
        names = {parameter.name for parameter in definition.outputs}
        for name, path in entry.outputs.items():
            if path not in read_paths:
                self._problem((*key, "outputs", name), f"no message says {path}; {nearest(path, read_paths) or 'say where it is read'}")
            if name not in names:
                expected = nearest(name, names) or f"it has {', '.join(sorted(names)) or 'none'}"
                self._problem((*key, "outputs", name), f"{definition.name} has no output {name}; {expected}")
        if missing := sorted(names - entry.outputs.keys()):
            self._problem((*key, "outputs"), f"{definition.name} has the outputs {', '.join(missing)}; write where each is read")

    def _inputs(self, definition: ServiceType) -> dict[str, AttributeType]:
        """For each input, the attribute of the thing that the effect sets to it, whose limits it has; else one of its kind."""
        inputs = {}
        for parameter in definition.inputs:
            kind = Kind(parameter.type) if parameter.type in tuple(Kind) else Kind.TEXT
            inputs[parameter.name] = AttributeType(name=parameter.name, kind=kind)
        for literal in literals(parse(definition.effect)):
            match literal:
                case Comparison(Attribute(Variable(owner), path), "=", Variable(name)) if owner == PROVIDER and name in inputs:
                    attribute = self._attributes.get(path)
                    if attribute is not None and attribute.kind is inputs[name].kind:
                        inputs[name] = attribute
        return inputs

    def _commands(
        self, key: KeyPath, entries: list[WriteEntry], thing: ThingEntry, inputs: Mapping[str, AttributeType]
    ) -> Iterator[Command]:
        for index, entry in enumerate(entries):
            if (command := self._command((*key, index), entry, thing, inputs)) is not None:
                yield command

    def _command(self, key: KeyPath, entry: WriteEntry, thing: ThingEntry, inputs: Mapping[str, AttributeType]) -> Command | None:
        places = {"topic": entry.topic, "put": entry.put, "post": entry.post, "register": entry.register_}
        endpoint = self._endpoints.find(key, entry.connection, places, entry.encoding)
        if endpoint is None:
            return None
        register = endpoint.register
        if register is not None and not register.table.is_writable:
            self._problem((*key, "register"), f"{endpoint.place} can only be read; write to a coil or to a holding register")
        if register is not None and register.encoding.startswith("bit"):
            self._problem((*key, "as"), "one bit of a register cannot be written alone; write the whole register, or a coil")
        if register is not None and not fits_register(entry.payload):
            self._problem((*key, "payload"), "a register gets a number, true or false, or an input of the service: payload: '?Temperature'")
        placeholders = dict.fromkeys(PLACEHOLDER.findall(entry.payload)) if isinstance(entry.payload, str) else {}
        for variable in placeholders:
            if variable not in inputs:
                self._problem((*key, "payload"), f"?{variable} is no input of the service; it has {', '.join(inputs) or 'none'}")
        ways = {**{name: InputEntry() for name in placeholders if name in inputs}, **entry.convert}
        conversions = {name: self._input(key, name, way, thing, inputs) for name, way in ways.items()}
        return Command(
            connection=endpoint.connection.name,
            place=endpoint.place,
            payload=entry.payload,
            register=register,
            method=endpoint.key.upper() if endpoint.connection.kind == "http" else "",
            content_type=entry.content_type,
            retain=entry.retain,
            conversions={name: conversion for name, conversion in conversions.items() if conversion is not None},
        )

    def _input(self, key: KeyPath, name: str, way: InputEntry, thing: ThingEntry, inputs: Mapping[str, AttributeType]) -> Conversion | None:
        """How an input is written: as its entry says, or as an attribute is read, the other way round."""
        key = (*key, "convert", name)
        if name not in inputs:
            self._problem(key, f"{name} is no input of the service; it has {', '.join(inputs) or 'none'}")
            return None
        if way.inverse_of is None:
            return self._conversion(key, way, inputs[name])
        if way.inverse_of not in thing.attributes or way.inverse_of not in self._attributes:
            hint = nearest(way.inverse_of, thing.attributes) or "write scale:, values: or decimals: instead"
            self._problem(key, f"no message says {way.inverse_of}; {hint}")
            return None
        attribute, read = self._attributes[way.inverse_of], thing.attributes[way.inverse_of]
        own_limits = {name: limit for name, limit in (("range", way.range), ("step", way.step)) if limit is not None}
        if not own_limits:
            return self._conversion(("attributes", way.inverse_of), read, attribute)
        return self._conversion(key, read.model_copy(update=own_limits), attribute)

    # Doors and lifts

    def _door(self, entry: ThingEntry) -> Door | None:
        if entry.door is None:
            return None
        if not self.ontology.is_subtype(entry.type, "AutomaticDoor"):
            self._problem(("door",), f"a {entry.type} is no AutomaticDoor, which opens for robots; choose this type, or use services:")
        if "Open" not in entry.attributes:
            self._problem(("door",), "robots drive through when it is open; write under attributes: where Open is read")
        sides = (
            self._commands(("door", side), entries, entry, {}) for side, entries in (("open", entry.door.open), ("close", entry.door.close))
        )
        opening, closing = (tuple(side) for side in sides)
        return Door(open=opening, close=closing)

    def _session(self, entry: ThingEntry) -> Session | None:
        assert entry.session is not None, "the caller looks"
        session = entry.session
        if not any(self.ontology.is_subtype(entry.type, type) for type in SESSION_TYPES):
            self._problem(("session",), f"a {entry.type} is neither a Lift nor an AutomaticDoor; choose one of these types")
        if entry.door is not None or entry.services:
            self._problem(("session",), "has its services by its session; leave out door: and services:")
        if self.ontology.is_subtype(entry.type, "Lift") and not session.levels:
            self._problem(
                ("session", "levels"), "a lift needs the names of its levels, by the storeys of the map: {Ground: '0', First: '1'}"
            )
        places = {"topic": session.topic, "path": session.path}
        endpoint = self._endpoints.find(("session",), session.connection, places)
        if endpoint is None:
            return None
        place, poll = endpoint.place.rstrip("/"), self._poll(("session",), session.poll)
        return Session(connection=endpoint.connection.name, place=place, poll=poll, levels=dict(session.levels))

    # Formulas and amounts

    def _formula(self, key: KeyPath, text: str, variables: Mapping[str, str] | None = None) -> str | None:
        try:
            return str(check(text, self.ontology, variables=variables))
        except FormulaError as error:
            self._problem(key, str(error))
            return None

    def _observable(self, key: KeyPath, text: str, read_paths: frozenset[str], variables: Mapping[str, str]) -> None:
        """Check a formula about what messages say."""
        if self._formula(key, text, variables) is None:
            return
        if missing := unread(text, read_paths):
            self._problem(key, f"no message says {', '.join(missing)}; say under attributes: where it is read")

    def _amounts(self, key: KeyPath, entry: ServiceEntry) -> None:
        for written, read, amount in (("price", money, entry.price), ("duration", seconds, entry.duration)):
            try:
                read(amount)
            except InputError as error:
                self._problem((*key, written), str(error))

    def _seconds(self, key: KeyPath, amount: float | str) -> float:
        try:
            return seconds(amount)
        except InputError as error:
            self._problem(key, str(error))
            return 1.0

    def _poll(self, key: KeyPath, amount: float | str) -> float:
        pause = self._seconds((*key, "poll"), amount)
        if pause < SHORTEST_POLL:
            self._problem((*key, "poll"), f"poll is the pause between two readings, at least {SHORTEST_POLL:g} s")
        return pause

    def _problem(self, key: KeyPath, message: str) -> None:
        self.problems.append((key, message))
