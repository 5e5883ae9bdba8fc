"""Objects, facts, maps, and the changes from one map to the next."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

from msgspec import Struct, structs

from somrs.ontology.indexes import Index
from somrs.ontology.types import PART_OF, Value


class Object(Struct, frozen=True, kw_only=True):
    """An instance of a type. `values` has attribute paths as keys (`PositionX`, `Shape.Height`); numbers are in the attribute's unit."""

    name: str
    type: str
    values: dict[str, Value] = {}


class Fact(Struct, frozen=True):
    """A relation that holds between objects."""

    relation: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        if len(self.arguments) == 2:
            return f"{self.arguments[0]} {self.relation} {self.arguments[1]}"
        return f"{self.relation}({', '.join(self.arguments)})"


class ObjectAdded(Struct, frozen=True, tag=True):
    object: Object


class ObjectRemoved(Struct, frozen=True, tag=True):
    """An object is removed, and with it every fact about it."""

    name: str


class ValueSet(Struct, frozen=True, tag=True):
    """An attribute of an object gets a value; None removes the value."""

    object: str
    path: str
    value: Value | None


class FactAdded(Struct, frozen=True, tag=True):
    fact: Fact


class FactRemoved(Struct, frozen=True, tag=True):
    fact: Fact


Change = ObjectAdded | ObjectRemoved | ValueSet | FactAdded | FactRemoved


def objects_of(change: Change) -> tuple[str, ...]:
    """The names of the objects that a change concerns."""
    match change:
        case ObjectAdded(object):
            return (object.name,)
        case ObjectRemoved(name) | ValueSet(name):
            return (name,)
        case FactAdded(fact) | FactRemoved(fact):
            return fact.arguments


class Map:
    """The objects of an environment and the facts between them. One object, the root, contains all others.

    A map is immutable: `changed` returns a new map that shares the unchanged data.
    """

    def __init__(self, objects: Iterable[Object] = (), facts: Iterable[Fact] = ()) -> None:
        self.objects: dict[str, Object] = {object.name: object for object in objects}
        self._facts: dict[str, dict[tuple[str, ...], None]] = {}
        # Indexes, built on first use: the facts of a relation by the object at a place, and the most arguments that one of them had; the
        # objects by exact type, and by the values of an attribute.
        self._by_argument: dict[str, dict[int, Index[str, tuple[str, ...]]]] = {}
        self._arities: dict[str, int] = {}
        self._by_type: Index[str, str] | None = None
        self._by_value: dict[str, Index[Value, str]] = {}
        for fact in facts:
            self._facts.setdefault(fact.relation, {})[fact.arguments] = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Map) and self.objects == other.objects and set(self.facts()) == set(other.facts())

    __hash__ = None  # type: ignore[assignment]  # compared by content, too large to be a key

    def __getstate__(self) -> tuple[dict[str, Object], dict[str, dict[tuple[str, ...], None]]]:
        return self.objects, self._facts  # building the indexes is faster than loading them

    def __setstate__(self, state: tuple[dict[str, Object], dict[str, dict[tuple[str, ...], None]]]) -> None:
        Map.__init__(self)
        self.objects, self._facts = state

    def has_fact(self, relation: str, arguments: tuple[str, ...]) -> bool:
        """Whether the fact is on the map as written. `truth.py` handles symmetric relations."""
        return arguments in self._facts.get(relation, ())

    def facts(self, relation: str | None = None) -> Iterator[Fact]:
        """All facts, or those of one relation."""
        for name in (relation,) if relation is not None else self._facts:
            for arguments in self._facts.get(name, ()):
                yield Fact(name, arguments)

    def count(self, relation: str) -> int:
        """The number of facts of the relation."""
        return len(self._facts.get(relation, ()))

    def facts_with(self, relation: str, place: int, name: str) -> Collection[tuple[str, ...]]:
        """The argument tuples of the relation's facts that have the object at `place`, counted from 0."""
        return self._argument_index(relation, place).values_for(name)

    def objects_at(self, relation: str, place: int) -> Iterable[str]:
        """The objects at `place` in the relation's facts."""
        return self._argument_index(relation, place).keys()

    def _argument_index(self, relation: str, place: int) -> Index[str, tuple[str, ...]]:
        places = self._by_argument.setdefault(relation, {})
        if place not in places:
            tuples = self._facts.get(relation, ())
            places[place] = Index((arguments[place], arguments) for arguments in tuples if place < len(arguments))
        return places[place]

    def facts_about(self, name: str) -> Iterator[Fact]:
        """The facts in which the object takes part."""
        for relation, tuples in self._facts.items():
            if (arity := self._arities.get(relation)) is None:
                arity = self._arities[relation] = max(map(len, tuples), default=0)
            argument_tuples = (arguments for place in range(arity) for arguments in self.facts_with(relation, place, name))
            yield from (Fact(relation, arguments) for arguments in dict.fromkeys(argument_tuples))

    def of_type(self, type_name: str) -> Collection[str]:
        """The names of the objects of exactly this type, without its subtypes."""
        if self._by_type is None:
            self._by_type = Index((object.type, object.name) for object in self.objects.values())
        return self._by_type.values_for(type_name)

    def with_value(self, path: str, value: Value) -> Collection[str]:
        """The names of the objects that set the value themselves, without those that have it by default."""
        if path not in self._by_value:
            value_pairs = ((object.values.get(path), object.name) for object in self.objects.values())
            self._by_value[path] = Index((value, name) for value, name in value_pairs if value is not None)
        return self._by_value[path].values_for(value)

    def parts(self, whole: str) -> Iterator[Object]:
        """The direct sub-objects."""
        return (self.objects[arguments[0]] for arguments in self.facts_with(PART_OF, 1, whole) if arguments[0] in self.objects)

    def whole(self, part: str) -> str | None:
        """The object that `part` is a direct part of; None for a root."""
        return next((arguments[1] for arguments in self.facts_with(PART_OF, 0, part)), None)

    def roots(self) -> list[str]:
        """The objects that are part of no other; a valid map has one abstract object among them."""
        parts = {arguments[0] for arguments in self._facts.get(PART_OF, ())}
        return [name for name in self.objects if name not in parts]

    def changed(self, changes: Iterable[Change]) -> Map:
        """The map after the changes. `conformance.py` checks whether it conforms to the ontology."""
        map_after = Map()
        map_after.objects = self.objects
        map_after._facts = dict(self._facts)
        map_after._by_argument, map_after._arities = dict(self._by_argument), dict(self._arities)
        map_after._by_type = self._by_type.copy() if self._by_type is not None else None
        map_after._by_value = dict(self._by_value)
        owned_keys: set[str] = set()
        """The relations and attributes whose facts and indexes `map_after` has copied already."""
        for change in changes:
            if map_after.objects is self.objects and not isinstance(change, FactAdded | FactRemoved):
                map_after.objects = dict(self.objects)
            match change:
                case ObjectAdded(object):
                    map_after._unindex_object(object.name, owned_keys)
                    map_after._insert_object(object, owned_keys)
                case ObjectRemoved(name):
                    map_after._unindex_object(name, owned_keys)
                    map_after.objects.pop(name, None)
                    for fact in [fact for fact in map_after.facts() if name in fact.arguments]:
                        map_after._remove(fact, owned_keys)
                case ValueSet(name, path, value):
                    object = map_after.objects[name]
                    map_after._set(object, path, value, owned_keys)
                    values = {**object.values, path: value} if value is not None else {p: v for p, v in object.values.items() if p != path}
                    map_after.objects[name] = structs.replace(object, values=values)
                case FactAdded(fact):
                    map_after._own_relation(fact.relation, owned_keys)[fact.arguments] = None
                    if len(fact.arguments) > map_after._arities.get(fact.relation, len(fact.arguments)):
                        map_after._arities[fact.relation] = len(fact.arguments)
                    for place, index in map_after._by_argument.get(fact.relation, {}).items():
                        if place < len(fact.arguments):
                            index.add(fact.arguments[place], fact.arguments)
                case FactRemoved(fact):
                    map_after._remove(fact, owned_keys)
        return map_after

    # Changes in place, of a map that no other code refers to yet

    def _insert_object(self, object: Object, owned_keys: set[str]) -> None:
        self.objects[object.name] = object
        if self._by_type is not None:
            self._by_type.add(object.type, object.name)
        for path in self._by_value:
            if (value := object.values.get(path)) is not None:
                self._own_values(path, owned_keys).add(value, object.name)

    def _unindex_object(self, name: str, owned_keys: set[str]) -> None:
        """Remove an object from the indexes, if it is there."""
        object = self.objects.get(name)
        if object is None:
            return
        if self._by_type is not None:
            self._by_type.remove(object.type, name)
        for path in self._by_value:
            self._set(object, path, None, owned_keys)

    def _set(self, object: Object, path: str, value: Value | None, owned_keys: set[str]) -> None:
        """Replace the old value of an object in the index of the attribute's values."""
        if path not in self._by_value:
            return
        index = self._own_values(path, owned_keys)
        if (old_value := object.values.get(path)) is not None:
            index.remove(old_value, object.name)
        if value is not None:
            index.add(value, object.name)

    def _remove(self, fact: Fact, owned_keys: set[str]) -> None:
        if not self.has_fact(fact.relation, fact.arguments):
            return
        del self._own_relation(fact.relation, owned_keys)[fact.arguments]
        for place, index in self._by_argument.get(fact.relation, {}).items():
            if place < len(fact.arguments):
                index.remove(fact.arguments[place], fact.arguments)

    def _own_relation(self, name: str, owned_keys: set[str]) -> dict[tuple[str, ...], None]:
        if name not in owned_keys:
            owned_keys.add(name)
            self._facts[name] = dict(self._facts.get(name, ()))
            if name in self._by_argument:
                self._by_argument[name] = {place: index.copy() for place, index in self._by_argument[name].items()}
        return self._facts[name]

    def _own_values(self, path: str, owned_keys: set[str]) -> Index[Value, str]:
        if "." + path not in owned_keys:
            owned_keys.add("." + path)
            self._by_value[path] = self._by_value[path].copy()
        return self._by_value[path]


def differences(map_before: Map, map_after: Map) -> Iterator[Change]:
    """The changes from one map to the other. This is fast when one map was derived from the other with `changed`."""
    for relation in map_after._facts.keys() | map_before._facts.keys():
        old, new = map_before._facts.get(relation, {}), map_after._facts.get(relation, {})
        if old is not new:
            yield from (FactRemoved(Fact(relation, arguments)) for arguments in old if arguments not in new)
    if map_before.objects is not map_after.objects:
        yield from _object_differences(map_before.objects, map_after.objects)
    removed_names = map_before.objects.keys() - map_after.objects.keys() if map_before.objects is not map_after.objects else set()
    for relation, new in map_after._facts.items():
        old = map_before._facts.get(relation, {})
        if old is not new or removed_names:
            yield from (FactAdded(Fact(relation, args)) for args in new if args not in old or not removed_names.isdisjoint(args))


def _object_differences(objects_before: dict[str, Object], objects_after: dict[str, Object]) -> Iterator[Change]:
    yield from (ObjectRemoved(name) for name in objects_before if name not in objects_after)
    for name, object in objects_after.items():
        old = objects_before.get(name)
        if old is None or (old is not object and old.type != object.type):
            yield ObjectAdded(object)
        elif old is not object:
            for path in old.values.keys() | object.values.keys():
                value = object.values.get(path)
                if value != old.values.get(path) or type(value) is not type(old.values.get(path)):
                    yield ValueSet(name, path, value)
