"""A problem in its optimistic readings, for goals that cannot be reached by what is known (`model/reading.py`)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

from msgspec import structs

from somrs.entish.formula import conjuncts, literals
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactRemoved, Object, ObjectAdded
from somrs.ontology.types import ROOT
from somrs.planner.model.problem import Problem
from somrs.planner.model.reading import Reading, looked_for_in, tells
from somrs.planner.model.world import VALUES

MOST_USES = 8
"""The maximum number of uses of a service with outputs in one plan."""


def optimistic(problem: Problem) -> Iterator[Problem]:
    """The problem in its optimistic readings, the most cautious first; none if no service on offer could tell what is not known."""
    telling = [available.service_type for available in problem.services if tells(available.service_type) and available.providers]
    if not telling:
        return
    devices = {name for available in problem.services for name in available.providers}
    marked = sorted(name for name in problem.unknown - devices if name in problem.map.objects)
    names = _Names(problem.map)
    ontology = problem.ontology
    exclusive = [relation for relation in ontology.relations.values() if relation.excludes is not None]
    looks = any(looked_for_in(part) is not None for service in telling for part in conjuncts(parse(service.effect)))
    place_types = dict.fromkeys(type for relation in exclusive for type in relation.joins[1:]) if looks else {}
    places = tuple((type, names.new("Somewhere" if type == ROOT else f"Some-{type}")) for type in place_types)
    uses = min(MOST_USES, sum(1 for _ in literals(problem.goal)))
    outputs = tuple(
        ((service.name, output.name), tuple(names.new(f"Some-{output.name}") for _ in range(uses)))
        for service in telling
        for output in service.outputs
        if output.type not in VALUES
    )
    types = {(service.name, output.name): output.type for service in telling for output in service.outputs}
    fresh = [Object(name=name, type=types[key]) for key, fresh_names in outputs for name in fresh_names]
    changes: list[Change] = [ObjectAdded(object) for object in (*fresh, *(Object(name=name, type=type) for type, name in places))]
    changes += [
        FactRemoved(Fact(relation.name, arguments))
        for name in marked
        for relation in exclusive
        for arguments in problem.map.facts_with(relation.name, 0, name)
    ]
    unknown = (*((name, problem.map.objects[name].type) for name in marked), *((object.name, object.type) for object in fresh))
    excluded = problem.excluded - set(marked) | {name for _, name in places}
    map = problem.map.changed(changes) if changes else problem.map
    for favourable in (False, True) if looks else (False,):
        reading = Reading(unknown=unknown, outputs=outputs, places=places, favourable=favourable)
        yield structs.replace(problem, map=map, excluded=excluded, unknown=frozenset(), reading=reading, rest=(), explained=False)


class _Names:
    """Names for objects that the map does not have."""

    def __init__(self, map: Map) -> None:
        self._map = map
        self._new_names: set[str] = set()

    def new(self, name: str) -> str:
        candidates = (name if number == 1 else f"{name}-{number}" for number in count(1))
        new_name = next(candidate for candidate in candidates if candidate not in self._map.objects and candidate not in self._new_names)
        self._new_names.add(new_name)
        return new_name
