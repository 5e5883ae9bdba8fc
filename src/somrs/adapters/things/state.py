"""What a thing has said so far, and which formulas hold with it; who is told of which message."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping

from msgspec import Struct

from somrs.adapters.things.conversion import raw_text
from somrs.adapters.things.json_path import Steps, json_value
from somrs.adapters.things.model import Availability, Signal, Source, Thing
from somrs.entish.formula import Attribute, Comparison, Formula, Name, conjunction
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import Ontology, Value
from somrs.ontology.values import constant

Payload = bytes | str | float | bool
"""Of a message: bytes of a topic or an answer, or the value of a register."""
SourceKey = tuple[str, str, object]


def source_key(source: Source) -> SourceKey:
    """What tells the messages of one source from those of others."""
    return source.connection, source.place, source.register


class ThingState:
    """The values of a thing by paths, as it said them last. `is_online` None: it has not said whether it works."""

    def __init__(self, thing: Thing, ontology: Ontology) -> None:
        self.thing, self._ontology = thing, ontology
        self.values: dict[str, Value] = {}
        self.is_online: bool | None = None

    def holds(self, formula: Formula) -> bool:
        """Whether the formula holds with what the thing said. It is not, if it is about something that the thing has not said."""
        map = Map([Object(name=self.thing.name, type=self.thing.type, values=self.values)])
        return formula_holds(formula, map, self._ontology)

    def situation(self, paths: Iterable[str] | None = None) -> Formula | None:
        """What the thing said, as a formula; None if it said nothing."""
        values = {path: value for path, value in self.values.items() if paths is None or path in paths}
        return situation_of(
            {(self.thing.name, path): value for path, value in values.items()}, {self.thing.name: self.thing}, self._ontology
        )


def situation_of(values: Mapping[tuple[str, str], Value], things: Mapping[str, Thing], ontology: Ontology) -> Formula | None:
    """The values of things as a formula; None without any."""
    atoms = [
        Comparison(Attribute(Name(name), path), "=", constant(value, ontology.attributes_of(things[name].type).get(path)))
        for (name, path), value in values.items()
    ]
    return conjunction(*atoms) if atoms else None


class News(Struct, frozen=True, kw_only=True):
    """What a message says of a thing: a value of an attribute, or (`signal` None) whether it works."""

    state: ThingState
    signal: Signal | None = None
    value: Value = True


class Router:
    """Finds out what a message says of which things. `complaint`: of what is not understood, once for each source and text."""

    def __init__(self) -> None:
        self._readers: dict[SourceKey, list[tuple[ThingState, Signal | Availability]]] = {}
        self._complaints: dict[tuple[str, str], str] = {}
        self.complaints: list[str] = []
        """What was not understood; whoever reads it empties it."""

    def add(self, state: ThingState) -> None:
        """Let a thing receive messages."""
        thing = state.thing
        for reader in (*thing.signals, *((thing.availability,) if thing.availability is not None else ())):
            self._readers.setdefault(source_key(reader.source), []).append((state, reader))

    def remove(self, state: ThingState) -> None:
        for key, readers in [*self._readers.items()]:
            self._readers[key] = [entry for entry in readers if entry[0] is not state]
            if not self._readers[key]:
                del self._readers[key]

    def reads(self, key: SourceKey) -> bool:
        """Whether a thing needs the messages of a source."""
        return key in self._readers

    def received(self, key: SourceKey, payload: Payload) -> Iterator[News]:
        """What a message says."""
        text = payload.decode("utf-8", "replace") if isinstance(payload, bytes) else payload
        document: object = None
        is_parsed = False
        for state, reader in self._readers.get(key, ()):
            if reader.steps is not None and not is_parsed:
                document, is_parsed = _parsed(text), True
            raw = json_value(document, reader.steps) if reader.steps is not None else text
            news = self._news(state, reader, raw, reader.steps)
            if news is not None:
                yield news

    def _news(self, state: ThingState, reader: Signal | Availability, raw: object, steps: Steps | None) -> News | None:
        if raw is None:
            return None  # the message is about something else
        name = reader.path if isinstance(reader, Signal) else "available"
        try:
            if isinstance(reader, Availability):
                is_online = raw_text(raw) == reader.online
                state.is_online = is_online
                return News(state=state, value=is_online)
            value = reader.conversion.read(raw)
        except ValueError as error:
            complaint = f"{state.thing.name}: {name} from {reader.source}: {error}"
            if self._complaints.get((state.thing.name, name)) != complaint:
                self._complaints[state.thing.name, name] = complaint
                self.complaints.append(complaint)
            return None
        self._complaints.pop((state.thing.name, name), None)
        state.values[reader.path] = value
        return News(state=state, signal=reader, value=value)


def _parsed(text: object) -> object:
    if not isinstance(text, str):
        return None
    try:
        document: object = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return document
