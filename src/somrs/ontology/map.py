"""The map: the objects of an environment and the facts between them, with what the changes make of it."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, MutableMapping, Set
from itertools import islice
from typing import TypeVar

from msgspec import structs

from somrs.ontology.indexes import Index
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.paged import PagedDict, mutable_copy, settled
from somrs.ontology.places import PlaceIndex, X, Y
from somrs.ontology.qualified_names import home_of
from somrs.ontology.types import PART_OF, UNKNOWN, Value

SIMILAR_NAMES = 5000
"""So many names with a beginning are looked through for a misspelt one on a large map."""

_K = TypeVar("_K", bound=Hashable)

_Contents = tuple[str, frozenset[str], dict[str, Object], dict[str, dict[tuple[str, ...], None]]]
"""The name of a map, the maps of which it has all objects, its objects, and the arguments of its facts."""


class Map:
    """The objects of an environment and the facts between them. One object, the root, contains all others.

    `name`: under which other maps know it. It also has objects of theirs, with qualified names (`qualified_names.py`). `complete`: the
    maps of which it has all objects.

    A map is immutable: `changed` returns a new map that shares the unchanged data (`paged.py`).
    """

    def __init__(
        self, objects: Iterable[Object] = (), facts: Iterable[Fact] = (), name: str = "", complete: Collection[str] = frozenset()
    ) -> None:
        self.name, self.complete = name, frozenset(complete)
        by_relation: dict[str, dict[tuple[str, ...], None]] = {}
        for fact in facts:
            by_relation.setdefault(fact.relation, {})[fact.arguments] = None
        self._load({object.name: object for object in objects}, by_relation)

    def _load(self, objects: Mapping[str, Object], facts: Mapping[str, Mapping[tuple[str, ...], None]]) -> None:
        self.objects: Mapping[str, Object] = settled(objects)
        self._facts: dict[str, Mapping[tuple[str, ...], None]] = {relation: settled(tuples) for relation, tuples in facts.items()}
        # Indexes, built on first use: the facts of a relation by the object at a place, and the most arguments that one of them had; the
        # objects by exact type, those of them that are part of nothing, and the objects by the values of an attribute.
        self._by_argument: dict[str, dict[int, Index[str, tuple[str, ...]]]] = {}
        self._arities: dict[str, int] = {}
        self._by_type: Index[str, str] | None = None
        self._wholes_by_type: Index[str, str] | None = None
        self._by_value: dict[str, Index[_ValueKey, str]] = {}
        self._places: PlaceIndex | None = None
        self._homes: dict[str, int] | None = None
        self._index_large()

    def _index_large(self) -> None:
        """Build at once the indexes that every task needs of what is large. What a derived map builds is lost if it is dropped."""
        for relation, tuples in self._facts.items():
            if isinstance(tuples, PagedDict):
                for place in range(self._arity(relation)):
                    self._argument_index(relation, place)
        if isinstance(self.objects, PagedDict):
            self._type_index()
            self._whole_index()
            self._value_index(UNKNOWN)
            self._count_homes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Map) and self.objects == other.objects and set(self.facts()) == set(other.facts())

    __hash__ = None  # type: ignore[assignment]  # compared by content, too large to be a key

    def __getstate__(self) -> _Contents:
        # Building the indexes is faster than loading them.
        facts = {relation: dict(tuples.items()) for relation, tuples in self._facts.items()}
        return self.name, self.complete, dict(self.objects.items()), facts

    def __setstate__(self, state: _Contents) -> None:
        self.name, self.complete, objects, facts = state
        self._load(objects, facts)

    def has_fact(self, relation: str, arguments: tuple[str, ...]) -> bool:
        """Whether the fact is on the map as written. `truth.py` handles symmetric relations."""
        return arguments in self._facts.get(relation, ())

    def facts(self, relation: str | None = None) -> Iterator[Fact]:
        """All facts, or those of one relation."""
        for name in (relation,) if relation is not None else self._facts:
            for arguments in self._facts.get(name, ()):
                yield Fact(name, arguments)

    def tuples(self) -> Iterable[tuple[str, Mapping[tuple[str, ...], None]]]:
        """The relations, each with the arguments of its facts."""
        return self._facts.items()

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
            tuples = self._facts.get(relation, {})
            pairs = ((arguments[place], arguments) for arguments in tuples if place < len(arguments))
            places[place] = Index(pairs, isinstance(tuples, PagedDict))
        return places[place]

    def _arity(self, relation: str) -> int:
        """The most arguments that a fact of the relation had."""
        if (arity := self._arities.get(relation)) is None:
            arity = self._arities[relation] = max(map(len, self._facts[relation]), default=0)
        return arity

    def facts_about(self, name: str) -> Iterator[Fact]:
        """The facts in which the object takes part."""
        for relation in self._facts:
            argument_tuples = (arguments for place in range(self._arity(relation)) for arguments in self.facts_with(relation, place, name))
            yield from (Fact(relation, arguments) for arguments in dict.fromkeys(argument_tuples))

    def facts_from(self, name: str) -> Iterator[Fact]:
        """The facts that have the object as their first argument."""
        for relation in self._facts:
            yield from (Fact(relation, arguments) for arguments in self.facts_with(relation, 0, name))

    def facts_without_arguments(self) -> Iterator[Fact]:
        return (Fact(relation, ()) for relation in self._facts if self.has_fact(relation, ()))

    def of_type(self, type_name: str) -> Collection[str]:
        """The names of the objects of exactly this type, without its subtypes."""
        return self._type_index().values_for(type_name)

    def types(self) -> Iterator[str]:
        """The types that objects have."""
        return self._type_index().keys()

    def _type_index(self) -> Index[str, str]:
        if self._by_type is None:
            self._by_type = self._index((object.type, object.name) for object in self.objects.values())
        return self._by_type

    def wholes_of_type(self, type_name: str) -> Collection[str]:
        """Those objects of exactly this type that are part of nothing."""
        return self._whole_index().values_for(type_name)

    def _whole_index(self) -> Index[str, str]:
        if self._wholes_by_type is None:
            self._wholes_by_type = self._index(
                (object.type, object.name) for object in self.objects.values() if self._is_whole(object.name)
            )
        return self._wholes_by_type

    def _is_whole(self, name: str) -> bool:
        return not self.facts_with(PART_OF, 0, name)

    def with_value(self, path: str, value: Value) -> Collection[str]:
        """The names of the objects that set the value themselves, without those that have it by default."""
        return self._value_index(path).values_for(_value_key(value))

    def _value_index(self, path: str) -> Index[_ValueKey, str]:
        if path not in self._by_value:
            value_pairs = ((object.values.get(path), object.name) for object in self.objects.values())
            self._by_value[path] = self._index((_value_key(value), name) for value, name in value_pairs if value is not None)
        return self._by_value[path]

    @property
    def places(self) -> PlaceIndex:
        """Where the objects state that they are."""
        if self._places is None:
            self._places = PlaceIndex(self.objects.values())
        return self._places

    def _index(self, pairs: Iterable[tuple[_K, str]]) -> Index[_K, str]:
        """An index of objects."""
        return Index(pairs, isinstance(self.objects, PagedDict))

    def names_after(self, name: str) -> Iterator[str]:
        """The names of the objects that follow this one in their order; all for an empty name."""
        if isinstance(self.objects, PagedDict):
            return self.objects.keys_after(name)
        names = sorted(self.objects)
        return iter(names[bisect_right(names, name) :])

    def in_order(self, names: Set[str]) -> list[str]:
        """The objects with these names, in the order of the map."""
        return sorted(names) if len(names) < 2 or isinstance(self.objects, PagedDict) else [name for name in self.objects if name in names]

    def similar_names(self, name: str) -> Iterable[str]:
        """The names among which a misspelt one is looked for: all, or on a large map the first ones that begin alike."""
        if not isinstance(self.objects, PagedDict):
            return self.objects
        return (similar for beginning in (name[:-1], name[:1]) for similar in islice(self.names_after(beginning), SIMILAR_NAMES))

    @property
    def homes(self) -> Collection[str]:
        """The maps of neighbours whose objects this map has."""
        return self._count_homes().keys()

    def count_from(self, home: str) -> int:
        """The number of objects that a neighbour's map owns."""
        return self._count_homes().get(home, 0)

    def _count_homes(self) -> dict[str, int]:
        if self._homes is None:
            self._homes = dict(Counter(home for name in self.objects if (home := home_of(name))))
        return self._homes

    def named(self, name: str) -> Map:
        """The same map under another name."""
        map = _Draft(self).map
        map.name = name
        return map

    def completed(self, homes: Collection[str]) -> Map:
        """The same map, with all objects of exactly these maps of neighbours."""
        map = _Draft(self).map
        map.complete = frozenset(homes)
        return map

    def parts(self, whole: str) -> Iterator[Object]:
        """The direct sub-objects."""
        return (self.objects[arguments[0]] for arguments in self.facts_with(PART_OF, 1, whole) if arguments[0] in self.objects)

    def whole(self, part: str) -> str | None:
        """The object that `part` is a direct part of; None for a root."""
        return next((arguments[1] for arguments in self.facts_with(PART_OF, 0, part)), None)

    def roots(self) -> list[str]:
        """The own objects that are part of no other; a valid map has one abstract object among them."""
        return [name for name in self.objects if self._is_whole(name) and not home_of(name)]

    def changed(self, changes: Iterable[Change]) -> Map:
        """The map after the changes. `conformance.py` checks whether it conforms to the ontology."""
        draft = _Draft(self)
        for change in changes:
            draft.apply(change)
        return draft.finished()


class _Draft:
    """A map that is being derived from another: it is changed in place, and copies what both share before that."""

    def __init__(self, base: Map) -> None:
        self.base = base
        self.map = map = Map.__new__(Map)
        map.objects, map._facts = base.objects, dict(base._facts)
        map._by_argument, map._arities = dict(base._by_argument), dict(base._arities)
        map._by_type, map._wholes_by_type, map._by_value = base._by_type, base._wholes_by_type, dict(base._by_value)
        map._places, map._homes, map.name, map.complete = base._places, base._homes, base.name, base.complete
        self._objects: MutableMapping[str, Object] | None = None
        self._relations: dict[str, MutableMapping[tuple[str, ...], None]] = {}
        """The facts of the relations that have changed."""
        self._regrouped: dict[str, None] = {}
        """The objects that were added or removed, or that became part of something else."""
        self._moved: dict[str, None] = {}
        """The objects that were added or removed, or that have another position."""

    def apply(self, change: Change) -> None:
        match change:
            case ObjectAdded(object):
                self._unindex_object(object.name)
                self._insert_object(object)
            case ObjectRemoved(name):
                self._unindex_object(name)
                self._own_objects().pop(name, None)
                for fact in [*self.map.facts_about(name)]:
                    self._remove(fact)
            case ValueSet(name, path, value):
                object = self.map.objects[name]
                self._reindex_value(object, path, value)
                if path in (X, Y):
                    self._moved[name] = None
                values = {**object.values, path: value} if value is not None else {p: v for p, v in object.values.items() if p != path}
                self._own_objects()[name] = structs.replace(object, values=values)
            case FactAdded(fact):
                self._add(fact)
            case FactRemoved(fact):
                self._remove(fact)

    def finished(self) -> Map:
        """The map, when all changes have been applied; the old one, if they changed nothing."""
        map, base = self.map, self.base
        if self._objects is None and not self._relations:
            return base
        for relation in self._relations:
            map._facts[relation] = settled(map._facts[relation])
            if isinstance(map._facts[relation], PagedDict) is not isinstance(base._facts.get(relation), PagedDict):
                map._by_argument.pop(relation, None)  # the order of its facts is another one
            for index in map._by_argument.get(relation, {}).values():
                index.settle()
        if self._objects is not None:
            map.objects = settled(self._objects)
            if isinstance(map.objects, PagedDict) is not isinstance(base.objects, PagedDict):
                map._by_type, map._wholes_by_type, map._by_value = None, None, {}
        if self._regrouped and map._wholes_by_type is not None:
            self._reindex_wholes(map._wholes_by_type.copy())
        if map._by_type is not None:
            map._by_type.settle()
        for values in map._by_value.values():
            values.settle()
        if self._moved and map._places is not None:
            map._places = map._places.changed((base.objects.get(name), map.objects.get(name)) for name in self._moved)
        map._index_large()
        return map

    def _own_objects(self) -> MutableMapping[str, Object]:
        if self._objects is None:
            self.map.objects = self._objects = mutable_copy(self.map.objects)
        return self._objects

    def _insert_object(self, object: Object) -> None:
        self._own_objects()[object.name] = object
        self._count_home(object.name, 1)
        self._regrouped[object.name] = self._moved[object.name] = None
        if self.map._by_type is not None:
            self._own_types().add(object.type, object.name)
        for path in self.map._by_value:
            if (value := object.values.get(path)) is not None:
                self._own_values(path).add(_value_key(value), object.name)

    def _unindex_object(self, name: str) -> None:
        """Remove an object from the indexes, if it is there."""
        object = self.map.objects.get(name)
        if object is None:
            return
        self._count_home(name, -1)
        self._regrouped[name] = self._moved[name] = None
        if self.map._by_type is not None:
            self._own_types().remove(object.type, name)
        for path in self.map._by_value:
            self._reindex_value(object, path, None)

    def _count_home(self, name: str, difference: int) -> None:
        if (home := home_of(name)) and self.map._homes is not None:
            count = self.map._homes.get(home, 0) + difference
            self.map._homes = {**self.map._homes, home: count}
            if not count:
                del self.map._homes[home]

    def _reindex_value(self, object: Object, path: str, value: Value | None) -> None:
        """Replace the old value of an object in the index of the attribute's values."""
        old_value = object.values.get(path)
        if path not in self.map._by_value or (old_value is None and value is None):
            return
        index = self._own_values(path)
        if old_value is not None:
            index.remove(_value_key(old_value), object.name)
        if value is not None:
            index.add(_value_key(value), object.name)

    def _reindex_wholes(self, index: Index[str, str]) -> None:
        for name in self._regrouped:
            old_object, new_object = self.base.objects.get(name), self.map.objects.get(name)
            if old_object is not None and self.base._is_whole(name):
                index.remove(old_object.type, name)
            if new_object is not None and self.map._is_whole(name):
                index.add(new_object.type, name)
        index.settle()
        self.map._wholes_by_type = index

    def _add(self, fact: Fact) -> None:
        relation, arguments = fact.relation, fact.arguments
        if self.map.has_fact(relation, arguments):
            return
        self._own_relation(relation)[arguments] = None
        if len(arguments) > self.map._arities.get(relation, len(arguments)):
            self.map._arities[relation] = len(arguments)
        for place, index in self.map._by_argument.get(relation, {}).items():
            if place < len(arguments):
                index.add(arguments[place], arguments)
        self._note_part(fact)

    def _remove(self, fact: Fact) -> None:
        if not self.map.has_fact(fact.relation, fact.arguments):
            return
        del self._own_relation(fact.relation)[fact.arguments]
        for place, index in self.map._by_argument.get(fact.relation, {}).items():
            if place < len(fact.arguments):
                index.remove(fact.arguments[place], fact.arguments)
        self._note_part(fact)

    def _note_part(self, fact: Fact) -> None:
        if fact.relation == PART_OF and fact.arguments:
            self._regrouped[fact.arguments[0]] = None

    def _own_relation(self, name: str) -> MutableMapping[tuple[str, ...], None]:
        if name not in self._relations:
            self.map._facts[name] = self._relations[name] = mutable_copy(self.map._facts.get(name, {}))
            if name in self.map._by_argument:
                self.map._by_argument[name] = {place: index.copy() for place, index in self.map._by_argument[name].items()}
        return self._relations[name]

    def _own_types(self) -> Index[str, str]:
        assert self.map._by_type is not None
        if self.map._by_type is self.base._by_type:
            self.map._by_type = self.map._by_type.copy()
        return self.map._by_type

    def _own_values(self, path: str) -> Index[_ValueKey, str]:
        if self.map._by_value[path] is self.base._by_value.get(path):
            self.map._by_value[path] = self.map._by_value[path].copy()
        return self.map._by_value[path]


_ValueKey = tuple[bool, Value]
"""A value as a key of an index: texts cannot be compared with numbers."""


def _value_key(value: Value) -> _ValueKey:
    return isinstance(value, str), value
