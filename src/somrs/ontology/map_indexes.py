"""The indexes of a map: its objects by type and value, and its facts by what they are about.

They are built when they are first needed. A derived map shares them with the one that it is derived from; what its changes concern is
copied before it is changed (`IndexDraft`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from somrs.ontology.indexes import Index
from somrs.ontology.objects import Object
from somrs.ontology.places import PlaceIndex
from somrs.ontology.qualified_names import home_of
from somrs.ontology.types import Value

ValueKey = tuple[bool, Value]
"""A value as a key of an index: texts cannot be compared with numbers."""


def value_key(value: Value) -> ValueKey:
    return isinstance(value, str), value


@dataclass(slots=True)
class MapIndexes:
    """The indexes of one map, as far as they were needed; None: not yet."""

    by_argument: dict[str, dict[int, Index[str, tuple[str, ...]]]] = field(default_factory=dict)
    """The facts of a relation by the object at a place."""
    arities: dict[str, int] = field(default_factory=dict)
    """The most arguments that a fact of a relation had."""
    by_type: Index[str, str] | None = None
    """The objects by their exact type."""
    wholes_by_type: Index[str, str] | None = None
    """Those of them that are part of nothing."""
    by_value: dict[str, Index[ValueKey, str]] = field(default_factory=dict)
    """The objects by the values of an attribute."""
    places: PlaceIndex | None = None
    homes: dict[str, int] | None = None
    """How many objects each map of a neighbour owns."""


class IndexDraft:
    """The `indexes` of a map that is being derived from another."""

    def __init__(self, base: MapIndexes) -> None:
        self._base = base
        self.indexes = replace(base, by_argument=dict(base.by_argument), arities=dict(base.arities), by_value=dict(base.by_value))

    def add_object(self, object: Object) -> None:
        self._count_home(object.name, 1)
        if self.indexes.by_type is not None:
            self._own_types().add(object.type, object.name)
        for path in self.indexes.by_value:
            if (value := object.values.get(path)) is not None:
                self._own_values(path).add(value_key(value), object.name)

    def remove_object(self, object: Object) -> None:
        self._count_home(object.name, -1)
        if self.indexes.by_type is not None:
            self._own_types().remove(object.type, object.name)
        for path in self.indexes.by_value:
            self.set_value(object, path, None)

    def set_value(self, object: Object, path: str, value: Value | None) -> None:
        """Replace the old value of an object in the index of the attribute's values."""
        old_value = object.values.get(path)
        if path not in self.indexes.by_value or (old_value is None and value is None):
            return
        index = self._own_values(path)
        if old_value is not None:
            index.remove(value_key(old_value), object.name)
        if value is not None:
            index.add(value_key(value), object.name)

    def own_relation(self, relation: str) -> None:
        """Copy the indexes of a relation's facts, which change from now on."""
        if relation in self.indexes.by_argument:
            copies = {place: index.copy() for place, index in self.indexes.by_argument[relation].items()}
            self.indexes.by_argument[relation] = copies

    def add_fact(self, relation: str, arguments: tuple[str, ...]) -> None:
        """Add a fact of a relation whose indexes are copied."""
        if len(arguments) > self.indexes.arities.get(relation, len(arguments)):
            self.indexes.arities[relation] = len(arguments)
        for place, index in self.indexes.by_argument.get(relation, {}).items():
            if place < len(arguments):
                index.add(arguments[place], arguments)

    def remove_fact(self, relation: str, arguments: tuple[str, ...]) -> None:
        """Remove a fact of a relation whose indexes are copied."""
        for place, index in self.indexes.by_argument.get(relation, {}).items():
            if place < len(arguments):
                index.remove(arguments[place], arguments)

    def finish_relation(self, relation: str, *, is_reordered: bool) -> None:
        """All changes of a relation have been applied. `is_reordered`: the order of its facts is another one."""
        if is_reordered:
            self.indexes.by_argument.pop(relation, None)
        for index in self.indexes.by_argument.get(relation, {}).values():
            index.settle()

    def forget_objects(self) -> None:
        """Build the indexes of the objects anew: their order is another one."""
        self.indexes.by_type, self.indexes.wholes_by_type, self.indexes.by_value = None, None, {}

    def regroup_wholes(self, changes: Iterable[tuple[Object | None, Object | None]]) -> None:
        """Follow which objects are part of nothing: each change has the object that was it, and the one that is it."""
        if self.indexes.wholes_by_type is None:
            return
        self.indexes.wholes_by_type = index = self.indexes.wholes_by_type.copy()
        for old, new in changes:
            if old is not None:
                index.remove(old.type, old.name)
            if new is not None:
                index.add(new.type, new.name)
        index.settle()

    def finish_objects(self, moved: Sequence[tuple[Object | None, Object | None]]) -> None:
        """All changes of objects have been applied. `moved`: those whose positions have changed, as they were and as they are."""
        if self.indexes.by_type is not None:
            self.indexes.by_type.settle()
        for values in self.indexes.by_value.values():
            values.settle()
        if moved and self.indexes.places is not None:
            self.indexes.places = self.indexes.places.changed(moved)

    def _count_home(self, name: str, difference: int) -> None:
        if (home := home_of(name)) and self.indexes.homes is not None:
            count = self.indexes.homes.get(home, 0) + difference
            self.indexes.homes = {**self.indexes.homes, home: count}
            if not count:
                del self.indexes.homes[home]

    def _own_types(self) -> Index[str, str]:
        assert self.indexes.by_type is not None
        if self.indexes.by_type is self._base.by_type:
            self.indexes.by_type = self.indexes.by_type.copy()
        return self.indexes.by_type

    def _own_values(self, path: str) -> Index[ValueKey, str]:
        if self.indexes.by_value[path] is self._base.by_value.get(path):
            self.indexes.by_value[path] = self.indexes.by_value[path].copy()
        return self.indexes.by_value[path]
