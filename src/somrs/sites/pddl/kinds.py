"""Maps PDDL types to types of the ontology: agents are below `Device`, all other objects below `PhysicalObject`.

A PDDL type with both agents and other objects (drivers, trucks and packages, which all have a location) is therefore not a single type in
the ontology. An action on it uses the nearest common ancestor as type, and a relation that selects the objects. So does an action on a type
with objects that are below several types.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from somrs.ontology.types import PHYSICAL, ObjectType
from somrs.sites.pddl.names import Names
from somrs.sites.pddl.syntax import OBJECT, Domain, Typed

DEVICE = "Device"
DRIVER = "somrs.devices.symbolic.device:SymbolicDevice"
"""The driver of symbolic devices, which only change facts."""

Sorts = frozenset[str]
"""The possible PDDL types of an object, each without its subtypes."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A type of the ontology, and a relation that selects some of its objects if not all are meant."""

    type: str
    relation: str | None = None


class Kinds:
    """The types of one domain and the objects of one problem."""

    def __init__(self, domain: Domain, objects: Iterable[Typed], names: Names, relations: Names) -> None:
        self.names, self.relations = names, relations
        self.picked: dict[str, Sorts] = {}
        """The relations that select objects, with the types of the selected objects."""
        self._parents: dict[str, tuple[str, ...]] = {OBJECT: (), **domain.parents}
        self.inhabited = frozenset(thing.types[0] for thing in objects)
        acting = [action.agent for action in domain.actions.values() if action.agent is not None]
        parameters = [parameter for action in domain.actions.values() for parameter in action.parameters]
        self._root_used = OBJECT in self.inhabited or any(OBJECT in thing.types for thing in (*acting, *parameters))
        descendants: dict[str, set[str]] = {name: set() for name in self._parents}
        for name in self._parents:
            for ancestor in self._ancestors(name):
                descendants[ancestor].add(name)
        self._descendants = {name: frozenset(type_names) for name, type_names in descendants.items()}
        self.acting = self._acting(frozenset().union(*(self.sorts(agent) for agent in acting)))
        for name in self._parents:
            if name != OBJECT or self._root_used:
                names.add(name, domain.types[name].written if name in domain.types else name)

    def _ancestors(self, name: str) -> frozenset[str]:
        """The type itself and everything above it."""
        return frozenset({name}).union(*map(self._ancestors, self._parents[name]))

    def _line(self, name: str) -> Iterator[str]:
        """The type and its ancestors along first parents: a type of the ontology has one parent. Relations stand for the other parents."""
        yield name
        for parent in self._parents[name][:1]:
            yield from self._line(parent)

    def _acting(self, named: Sorts) -> Sorts:
        """The types of agents, and those ancestors of them that have only such subtypes and no objects of their own."""
        acting_types = set(named)
        for name in sorted(self._parents, key=lambda name: -len([*self._line(name)])):
            inner = self._descendants[name] - {name}
            if inner and inner <= acting_types and name not in self.inhabited and (name != OBJECT or self._root_used):
                acting_types.add(name)
        return frozenset(acting_types)

    def sorts(self, thing: Typed) -> Sorts:
        """The possible types of an object with this declaration."""
        return frozenset[str]().union(*(self._descendants[name] for name in thing.types if name in self._descendants))

    def kind(self, sorts: Sorts, declared: Typed | None = None) -> Kind:
        """The kind of a variable for objects of these types; the declared type, if it has exactly these objects."""
        exact = self._exact(sorts & self.inhabited, declared)
        if exact is not None:
            return Kind(exact)
        return Kind(self._common(sorts & self.inhabited), self._relation(sorts & self.inhabited, declared))

    def joined(self, thing: Typed) -> str:
        """The type of a parameter of a predicate or function. It may have more objects than the parameter allows; no fact has them."""
        target_sorts = self.sorts(thing) & self.inhabited
        return self._exact(target_sorts, thing) or self._common(target_sorts)

    def _exact(self, target_sorts: Sorts, declared: Typed | None) -> str | None:
        """The type of the ontology with exactly these objects; None without one."""
        for name in (*(declared.types if declared is not None else ()), *self._parents):
            if self._is_included(name) and self._objects_of(name) == target_sorts:
                return self.names.entish(name)
        return None

    def _common(self, target_sorts: Sorts) -> str:
        """The nearest common ancestor of these types in the ontology."""
        lines = [[*map(self.names.entish, self._entish_line(sort)), *self._tops(sort)] for sort in target_sorts]
        return next((name for name in lines[0] if all(name in line for line in lines)), PHYSICAL) if lines else PHYSICAL

    def _is_included(self, name: str) -> bool:
        return name != OBJECT or self._root_used

    def _objects_of(self, name: str) -> Sorts:
        """The PDDL types of the objects that the type has in the ontology."""
        return frozenset(sort for sort in self._descendants[name] & self.inhabited if name in self._entish_line(sort))

    def _entish_line(self, name: str) -> list[str]:
        """The type and its ancestors that remain ancestors in the ontology: those that are agents as well, or are not."""
        side = name in self.acting
        return [ancestor for ancestor in self._line(name) if self._is_included(ancestor) and (ancestor in self.acting) is side]

    def _tops(self, name: str) -> list[str]:
        return [DEVICE, PHYSICAL] if name in self.acting else [PHYSICAL]

    def _relation(self, target_sorts: Sorts, declared: Typed | None) -> str:
        for existing_relation, sorts in self.picked.items():
            if sorts == target_sorts:
                return existing_relation
        type_text = "-or-".join(declared.types if declared is not None else sorted(target_sorts)) or "nothing"
        relation = self.relations.fresh(f"is-{type_text}")
        self.picked[relation] = target_sorts
        return relation

    def relation(self, sorts: Sorts, declared: Typed) -> str:
        """The relation that selects objects of these types, even if a type has exactly these objects."""
        return self._relation(sorts & self.inhabited, declared)

    def of_picked(self, relation: str) -> str:
        """The type from which the relation selects objects."""
        return self._common(self.picked[relation])

    def covering(self, thing: Typed) -> list[str]:
        """The topmost types of the ontology that together have all possible objects of a parameter. An attribute is added to each."""
        sorts = [name for name in self.sorts(thing) if self._is_included(name)]
        return [self.names.entish(name) for name in sorts if self._nearest_ancestor(name) not in sorts]

    def _nearest_ancestor(self, name: str) -> str | None:
        line = self._entish_line(name)
        return line[1] if len(line) > 1 else None

    def definitions(self, attributes: dict[str, list[str]]) -> Iterator[ObjectType]:
        """The object types; `attributes` are their attributes, by the types' names in the ontology."""
        for name in self._parents:
            if not self._is_included(name):
                continue
            entish_name, ancestor = self.names.entish(name), self._nearest_ancestor(name)
            parent = self.names.entish(ancestor) if ancestor is not None else DEVICE if name in self.acting else PHYSICAL
            yield ObjectType(
                name=entish_name,
                parent=parent,
                attributes=tuple(attributes.get(entish_name, ())),
                driver=DRIVER if parent == DEVICE else None,
            )
