"""Inverse changes, and the past states of the map and the ontology that they lead to."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from msgspec import structs

from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Event, Revision
from somrs.protocol.messages.paging import PAGE_BYTES, PAGE_ITEMS, fit_page, size


@dataclass(frozen=True, slots=True, kw_only=True)
class PastState:
    """The map and the ontology in a past version; `changed_at` is the version in which the ontology had changed last."""

    map: Map
    ontology: Ontology
    changed_at: int


def inverse(map: Map, changes: Iterable[Change]) -> tuple[Change, ...]:
    """The changes that undo `changes` and restore `map`. Changes that remove an object must list its facts as well."""
    objects: dict[str, Object | None] = {}
    facts: dict[Fact, bool] = {}
    inverse_changes: list[Change] = []
    for change in changes:
        match change:
            case ObjectAdded(object):
                old = objects.get(object.name, map.objects.get(object.name))
                inverse_changes.append(ObjectAdded(old) if old is not None else ObjectRemoved(object.name))
                objects[object.name] = object
            case ObjectRemoved(name):
                if (old := objects.get(name, map.objects.get(name))) is not None:
                    inverse_changes.append(ObjectAdded(old))
                objects[name] = None
            case ValueSet(name, path, value):
                if (old := objects.get(name, map.objects.get(name))) is not None:
                    inverse_changes.append(ValueSet(name, path, old.values.get(path)))
                    objects[name] = _with_value(old, path, value)
            case FactAdded(fact):
                if not facts.get(fact, map.has_fact(fact.relation, fact.arguments)):
                    inverse_changes.append(FactRemoved(fact))
                facts[fact] = True
            case FactRemoved(fact):
                if facts.get(fact, map.has_fact(fact.relation, fact.arguments)):
                    inverse_changes.append(FactAdded(fact))
                facts[fact] = False
    return tuple(reversed(inverse_changes))


def _with_value(object: Object, path: str, value: float | str | bool | None) -> Object:
    values = {**object.values, path: value} if value is not None else {p: v for p, v in object.values.items() if p != path}
    return structs.replace(object, values=values)


def rewind_map(map: Map, inverses: Iterable[Iterable[Change]]) -> Map:
    """The past map: applies the inverse changes of each event, latest event first. Like `Map.changed`, but fast for 100,000 events."""
    objects = dict(map.objects)
    facts = dict.fromkeys(map.facts())
    for changes in inverses:
        for change in changes:
            match change:
                case ValueSet(name, path, value):
                    objects[name] = _with_value(objects[name], path, value)
                case ObjectAdded(object):
                    objects[object.name] = object
                case ObjectRemoved(name):
                    objects.pop(name, None)  # changes of their own remove its facts
                case FactAdded(fact):
                    facts[fact] = None
                case FactRemoved(fact):
                    facts.pop(fact, None)
    return Map(objects.values(), facts, map.name)


def shorten_event(event: Event, room: int = PAGE_BYTES) -> Event:
    """The event cut to `room` bytes: an event that is too long keeps its first changes and their total number."""
    if size(event) <= room:
        return event
    changes = tuple(fit_page(event.changes, PAGE_ITEMS, room // 2))
    revision = event.revision
    if revision is not None and size(revision) > room // 2:
        revision = Revision()
    return structs.replace(event, changes=changes, revision=revision, before=(), all_changes=len(event.changes))
