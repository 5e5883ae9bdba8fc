"""The map: the objects of an environment and the facts between them, with what the changes make of it."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, MutableMapping, Set
from itertools import islice
from typing import TypeVar

from msgspec import structs

from somrs.ontology.indexes import Index
from somrs.ontology.map_indexes import IndexDraft, MapIndexes, ValueKey, value_key
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
        self._indexes = MapIndexes()
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
        places = self._indexes.by_argument.setdefault(relation, {})
        if place not in places:
            tuples = self._facts.get(relation, {})
            pairs = ((arguments[place], arguments) for arguments in tuples if place < len(arguments))
            places[place] = Index(pairs, isinstance(tuples, PagedDict))
        return places[place]

    def _arity(self, relation: str) -> int:
        """The most arguments that a fact of the relation had."""
        if (arity := self._indexes.arities.get(relation)) is None:
            arity = self._indexes.arities[relation] = max(map(len, self._facts[relation]), default=0)
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
        if self._indexes.by_type is None:
            self._indexes.by_type = self._index((object.type, object.name) for object in self.objects.values())
        return self._indexes.by_type

    def wholes_of_type(self, type_name: str) -> Collection[str]:
        """Those objects of exactly this type that are part of nothing."""
        return self._whole_index().values_for(type_name)

    def _whole_index(self) -> Index[str, str]:
        if self._indexes.wholes_by_type is None:
            wholes = ((object.type, object.name) for object in self.objects.values() if self._is_whole(object.name))
            self._indexes.wholes_by_type = self._index(wholes)
        return self._indexes.wholes_by_type

    def _is_whole(self, name: str) -> bool:
        return not self.facts_with(PART_OF, 0, name)

    def with_value(self, path: str, value: Value) -> Collection[str]:
        """The names of the objects that set the value themselves, without those that have it by default."""
        return self._value_index(path).values_for(value_key(value))

    def _value_index(self, path: str) -> Index[ValueKey, str]:
        if path not in self._indexes.by_value:
            value_pairs = ((object.values.get(path), object.name) for object in self.objects.values())
            self._indexes.by_value[path] = self._index((value_key(value), name) for value, name in value_pairs if value is not None)
        return self._indexes.by_value[path]

    @property
    def places(self) -> PlaceIndex:
        """Where the objects state that they are."""
        if self._indexes.places is None:
            self._indexes.places = PlaceIndex(self.objects.values())
        return self._indexes.places

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
        if self._indexes.homes is None:
            self._indexes.homes = dict(Counter(home for name in self.objects if (home := home_of(name))))
        return self._indexes.homes

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
        self.base, self._indexes = base, IndexDraft(base._indexes)
        self.map = map = Map.__new__(Map)
        map.objects, map._facts, map._indexes = base.objects, dict(base._facts), self._indexes.indexes
        map.name, map.complete = base.name, base.complete
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
                self._own_objects()[object.name] = object
                self._regrouped[object.name] = self._moved[object.name] = None
                self._indexes.add_object(object)
            case ObjectRemoved(name):
                self._unindex_object(name)
                self._own_objects().pop(name, None)
                for fact in [*self.map.facts_about(name)]:
                    self._remove(fact)
            case ValueSet(name, path, value):
                object = self.map.objects[name]
                self._indexes.set_value(object, path, value)
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
        map, base, indexes = self.map, self.base, self._indexes
        if self._objects is None and not self._relations:
            return base
        for relation in self._relations:
            map._facts[relation] = facts = settled(map._facts[relation])
            is_reordered = isinstance(facts, PagedDict) is not isinstance(base._facts.get(relation), PagedDict)
            indexes.finish_relation(relation, is_reordered=is_reordered)
        if self._objects is not None:
            map.objects = settled(self._objects)
            if isinstance(map.objects, PagedDict) is not isinstance(base.objects, PagedDict):
                indexes.forget_objects()
        if self._regrouped:
            indexes.regroup_wholes((_whole_of(base, name), _whole_of(map, name)) for name in self._regrouped)
        indexes.finish_objects([(base.objects.get(name), map.objects.get(name)) for name in self._moved])
        map._index_large()
        return map

    def _own_objects(self) -> MutableMapping[str, Object]:
        if self._objects is None:
            self.map.objects = self._objects = mutable_copy(self.map.objects)
        return self._objects

    def _unindex_object(self, name: str) -> None:
        """Remove an object from the indexes, if it is there."""
        object = self.map.objects.get(name)
        if object is not None:
            self._regrouped[name] = self._moved[name] = None
            self._indexes.remove_object(object)

    def _add(self, fact: Fact) -> None:
        if not self.map.has_fact(fact.relation, fact.arguments):
            self._own_relation(fact.relation)[fact.arguments] = None
            self._indexes.add_fact(fact.relation, fact.arguments)
            self._note_part(fact)

    def _remove(self, fact: Fact) -> None:
        if self.map.has_fact(fact.relation, fact.arguments):
            del self._own_relation(fact.relation)[fact.arguments]
            self._indexes.remove_fact(fact.relation, fact.arguments)
            self._note_part(fact)

    def _note_part(self, fact: Fact) -> None:
        if fact.relation == PART_OF and fact.arguments:
            self._regrouped[fact.arguments[0]] = None

    def _own_relation(self, name: str) -> MutableMapping[tuple[str, ...], None]:
        if name not in self._relations:
            self.map._facts[name] = self._relations[name] = mutable_copy(self.map._facts.get(name, {}))
            self._indexes.own_relation(name)
        return self._relations[name]


def _whole_of(map: Map, name: str) -> Object | None:
    """The object, if it is there and part of nothing."""
    object = map.objects.get(name)
    return object if object is not None and map._is_whole(name) else None
