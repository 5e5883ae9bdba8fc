"""Objects, the facts between them, and maps; and the changes that lead from one map to the next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from msgspec import Struct, structs

from somrs.ontology.types import PART_OF, Value


class Object(Struct, frozen=True, kw_only=True):
    """An instance of a type. `values` are by attribute path (`PositionX`, `Shape.Height`), numbers in the attribute's unit."""

    name: str
    type: str
    values: dict[str, Value] = {}


class Fact(Struct, frozen=True):
    """A relation that holds between objects, named by the relation."""

    relation: str
    arguments: tuple[str, ...]

    def __str__(self) -> str:
        if len(self.arguments) == 2:
            return f"{self.arguments[0]} {self.relation} {self.arguments[1]}"
        return f"{self.relation}({', '.join(self.arguments)})"


class ObjectAdded(Struct, frozen=True, tag=True):
    object: Object


class ObjectRemoved(Struct, frozen=True, tag=True):
    """The object goes, and with it every fact about it."""

    name: str


class ValueSet(Struct, frozen=True, tag=True):
    """An attribute of an object gets a value; None takes the value away."""

    object: str
    path: str
    value: Value | None


class FactAdded(Struct, frozen=True, tag=True):
    fact: Fact


class FactRemoved(Struct, frozen=True, tag=True):
    fact: Fact


Change = ObjectAdded | ObjectRemoved | ValueSet | FactAdded | FactRemoved


def objects_of(change: Change) -> tuple[str, ...]:
    """The names of the objects that a change is about."""
    match change:
        case ObjectAdded(object):
            return (object.name,)
        case ObjectRemoved(name) | ValueSet(name):
            return (name,)
        case FactAdded(fact) | FactRemoved(fact):
            return fact.arguments


class Map:
    """The objects of an environment and the facts between them, of which one object, the root, holds all others.

    A value: `changed` returns another map and shares what did not change.
    """

    def __init__(self, objects: Iterable[Object] = (), facts: Iterable[Fact] = ()) -> None:
        self.objects: dict[str, Object] = {object.name: object for object in objects}
        self._facts: dict[str, dict[tuple[str, ...], None]] = {}
        # Made when first asked for: the facts of a relation by the object at a place in them, the objects by exact type.
        self._by_argument: dict[str, dict[int, dict[str, list[tuple[str, ...]]]]] = {}
        self._by_type: dict[str, list[str]] | None = None
        for fact in facts:
            self._facts.setdefault(fact.relation, {})[fact.arguments] = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Map) and self.objects == other.objects and set(self.facts()) == set(other.facts())

    __hash__ = None  # type: ignore[assignment]  # compared by content, too large to be a key

    def holds(self, relation: str, arguments: tuple[str, ...]) -> bool:
        """Whether the fact is on the map as written; symmetry is `truth`'s business."""
        return arguments in self._facts.get(relation, ())

    def facts(self, relation: str | None = None) -> Iterator[Fact]:
        """All facts, or those of one relation."""
        for name in (relation,) if relation is not None else self._facts:
            for arguments in self._facts.get(name, ()):
                yield Fact(name, arguments)

    def count(self, relation: str) -> int:
        """How many facts of the relation there are."""
        return len(self._facts.get(relation, ()))

    def facts_with(self, relation: str, place: int, name: str) -> Sequence[tuple[str, ...]]:
        """The arguments of the relation's facts in which the object is the argument at `place`, counted from 0."""
        return self._index(relation, place).get(name, ())

    def _index(self, relation: str, place: int) -> Mapping[str, list[tuple[str, ...]]]:
        places = self._by_argument.setdefault(relation, {})
        if place not in places:
            index: dict[str, list[tuple[str, ...]]] = {}
            for arguments in self._facts.get(relation, ()):
                if place < len(arguments):
                    index.setdefault(arguments[place], []).append(arguments)
            places[place] = index
        return places[place]

    def facts_about(self, name: str) -> Iterator[Fact]:
        """The facts in which the object takes part."""
        for relation, tuples in self._facts.items():
            arity = max(map(len, tuples), default=0)
            about = (arguments for place in range(arity) for arguments in self.facts_with(relation, place, name))
            yield from (Fact(relation, arguments) for arguments in dict.fromkeys(about))

    def of_type(self, type_name: str) -> Sequence[str]:
        """The names of the objects of exactly this type; sub-types are the ontology's business."""
        if self._by_type is None:
            by_type: dict[str, list[str]] = {}
            for object in self.objects.values():
                by_type.setdefault(object.type, []).append(object.name)
            self._by_type = by_type
        return self._by_type.get(type_name, ())

    def parts(self, whole: str) -> Iterator[Object]:
        """The direct sub-objects."""
        return (self.objects[a[0]] for a in self.facts_with(PART_OF, 1, whole) if a[0] in self.objects)

    def whole(self, part: str) -> str | None:
        """The object that this one is a direct part of."""
        return next((a[1] for a in self.facts_with(PART_OF, 0, part)), None)

    def roots(self) -> list[str]:
        """The objects that are part of nothing; a map has one."""
        parts = {a[0] for a in self._facts.get(PART_OF, ())}
        return [name for name in self.objects if name not in parts]

    def changed(self, changes: Iterable[Change]) -> Map:
        """The map after the changes. Conformance is not checked here."""
        after = Map()
        after.objects = dict(self.objects)
        after._facts = dict(self._facts)
        after._by_argument = dict(self._by_argument)
        after._by_type = self._by_type
        copied: set[str] = set()

        def relation(name: str) -> dict[tuple[str, ...], None]:
            if name not in copied:
                after._facts[name] = dict(after._facts.get(name, ()))
                copied.add(name)
                after._by_argument.pop(name, None)
            return after._facts[name]

        for change in changes:
            match change:
                case ObjectAdded(object):
                    after.objects[object.name] = object
                    after._by_type = None
                case ObjectRemoved(name):
                    after.objects.pop(name, None)
                    after._by_type = None
                    for fact in [fact for fact in after.facts() if name in fact.arguments]:
                        relation(fact.relation).pop(fact.arguments)
                case ValueSet(name, path, value):
                    object = after.objects[name]
                    values = {**object.values, path: value} if value is not None else {p: v for p, v in object.values.items() if p != path}
                    after.objects[name] = structs.replace(object, values=values)
                case FactAdded(fact):
                    relation(fact.relation)[fact.arguments] = None
                case FactRemoved(fact):
                    relation(fact.relation).pop(fact.arguments, None)
        return after
