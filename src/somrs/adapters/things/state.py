"""What a thing has said so far, and which formulas hold with it; who is told of which message."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping

from msgspec import Struct

from somrs.adapters.things.conversion import raw_text
from somrs.adapters.things.json_path import Steps, json_value
from somrs.adapters.things.model import Availability, AvailabilityMode, Signal, Source, Thing
from somrs.entish.formula import Attribute, Comparison, Formula, Name, conjunction
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import Ontology, Value
from somrs.ontology.values import constant

Payload = bytes | str | float | bool
"""Of a message: bytes of a topic or an answer, or the value of a register."""
SourceKey = tuple[str, str, object]
LONGEST_QUOTE = 80
"""Characters of a message that are shown."""


def source_key(source: Source) -> SourceKey:
    """What tells the messages of one source from those of others."""
    return source.connection, source.place, source.register


def readers_of(thing: Thing) -> tuple[Signal | Availability, ...]:
    """What is read in the messages of a thing."""
    return (*thing.signals, *thing.availabilities)


class ThingState:
    """The values of a thing by paths, as it said them last. `heard_at`: when, in seconds since 1970. `is_online` None: it has not said
    whether it works. `misread`: the paths whose last message was not understood, or not believed; `expired`: those of which nothing was
    heard for too long."""

    def __init__(self, thing: Thing, ontology: Ontology) -> None:
        self.thing, self._ontology = thing, ontology
        self.values: dict[str, Value] = {}
        self.heard_at: dict[str, float] = {}
        self.misread: set[str] = set()
        self.expired: set[str] = set()
        self.availability: dict[Availability, bool] = {}
        """Whether it works, by where it says so."""
        self.is_online: bool | None = None

    def heard_available(self, place: Availability, is_online: bool) -> None:
        """Take in that the thing says at this place whether it works."""
        self.availability[place] = is_online
        words = [self.availability.get(place) for place in self.thing.availabilities]
        match self.thing.availability_mode:
            case AvailabilityMode.LATEST:
                self.is_online = is_online
            case AvailabilityMode.ALL:
                self.is_online = False if False in words else None if None in words else True
            case AvailabilityMode.ANY:
                self.is_online = True if True in words else None if None in words else False

    @property
    def doubtful(self) -> set[str]:
        """The paths whose values are not known any more."""
        return self.misread | self.expired

    def holds(self, formula: Formula) -> bool:
        """Whether the formula holds with what the thing said. It is not, if it is about something that the thing has not said."""
        map = Map([Object(name=self.thing.name, type=self.thing.type, values=self.values)])
        return formula_holds(formula, map, self._ontology)

    @property
    def known_at(self) -> float | None:
        """When it was known last how it is, in seconds since 1970: at its last message; or at that before the first that was not
        understood, or did not come. None: never."""
        doubtful_times = [self.heard_at[path] for path in self.doubtful if path in self.heard_at]
        return min(doubtful_times) if doubtful_times else max(self.heard_at.values(), default=None)

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
    """Finds out what a message says of which things."""

    def __init__(self) -> None:
        self._readers: dict[SourceKey, list[tuple[ThingState, Signal | Availability]]] = {}
        self.complaints: list[str] = []
        """What was not understood, or not believed, once until it is again; whoever reads it empties it."""

    def add(self, state: ThingState) -> None:
        """Let a thing receive messages."""
        thing = state.thing
        for reader in readers_of(thing):
            self._readers.setdefault(source_key(reader.source), []).append((state, reader))

    def remove(self, state: ThingState) -> None:
        for key, readers in [*self._readers.items()]:
            self._readers[key] = [entry for entry in readers if entry[0] is not state]
            if not self._readers[key]:
                del self._readers[key]

    def states_of(self, key: SourceKey) -> list[ThingState]:
        """The things that need the messages of a source."""
        return [*{id(state): state for state, _ in self._readers.get(key, ())}.values()]

    def reads(self, key: SourceKey) -> bool:
        """Whether a thing needs the messages of a source."""
        return key in self._readers

    def received(self, key: SourceKey, payload: Payload, now: float) -> Iterator[News]:
        """What a message says that comes at the time `now`, in seconds since 1970."""
        text = payload.decode("utf-8", "replace") if isinstance(payload, bytes) else payload
        readers = self._readers.get(key, ())
        has_documents = any(reader.steps is not None for _, reader in readers)
        document = _Document(text) if has_documents else None
        for state, reader in readers:
            try:
                raw = text if reader.steps is None or document is None else document.value(reader.steps)
                news = _news(state, reader, raw)
            except ValueError as error:
                self._misread(state, reader, str(error))
                continue
            if news is None:
                continue
            state.misread.discard(_name_of(reader))
            state.expired.discard(_name_of(reader))
            if isinstance(reader, Signal):
                state.heard_at[reader.path] = now
            yield news

    def _misread(self, state: ThingState, reader: Signal | Availability, problem: str) -> None:
        name = _name_of(reader)
        if name not in state.misread:
            state.misread.add(name)
            self.complaints.append(f"{state.thing.name}: {name} from {reader.source}: {problem}")


def _news(state: ThingState, reader: Signal | Availability, raw: object) -> News | None:
    """What a value in a message says; None: it is about something else. Raises ValueError."""
    if raw is None:
        return None
    if isinstance(reader, Availability):
        state.heard_available(reader, raw_text(raw) == reader.online)
        return News(state=state, value=state.is_online) if state.is_online is not None else None
    value = reader.conversion.read(raw)
    if value is None:
        return None
    state.values[reader.path] = value
    return News(state=state, signal=reader, value=value)


def _name_of(reader: Signal | Availability) -> str:
    return reader.path if isinstance(reader, Signal) else "available"


class _Document:
    """A message in JSON."""

    def __init__(self, text: Payload) -> None:
        self._text = text
        self._document: object = None
        self._is_json = True
        try:
            self._document = json.loads(text) if isinstance(text, str) else text
        except (ValueError, RecursionError):
            self._is_json = False

    def value(self, steps: Steps) -> object:
        """The value at a path; None without one. Raises ValueError, if the message is not JSON."""
        if not self._is_json:
            raise ValueError(f"{str(self._text)[:LONGEST_QUOTE]!r} is not JSON")
        return json_value(self._document, steps)
