"""The changes from one map to another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.paged import changed_keys


def differences(map_before: Map, map_after: Map) -> Iterator[Change]:
    """The changes from one map to the other. This is fast when one map was derived from the other with `changed`."""
    changed_facts = {
        relation: [*changed_keys(map_before._facts.get(relation, {}), map_after._facts.get(relation, {}))]
        for relation in map_after._facts.keys() | map_before._facts.keys()
    }
    removed_names = {name for name in changed_keys(map_before.objects, map_after.objects) if name not in map_after.objects}
    for relation, tuples in changed_facts.items():
        yield from (FactRemoved(Fact(relation, arguments)) for arguments in tuples if not map_after.has_fact(relation, arguments))
    yield from _object_differences(map_before.objects, map_after.objects)
    for relation in map_after._facts:
        # A fact of an object that is removed goes with it: if it is there afterwards, it is added again.
        kept = (arguments for name in removed_names for arguments in _tuples_about(map_after, relation, name))
        new = (arguments for arguments in changed_facts[relation] if map_after.has_fact(relation, arguments))
        yield from (FactAdded(Fact(relation, arguments)) for arguments in dict.fromkeys((*new, *kept)))


def _tuples_about(map: Map, relation: str, name: str) -> Iterator[tuple[str, ...]]:
    return (fact.arguments for fact in map.facts_about(name) if fact.relation == relation)


def _object_differences(objects_before: Mapping[str, Object], objects_after: Mapping[str, Object]) -> Iterator[Change]:
    changed_names = [*changed_keys(objects_before, objects_after)]
    yield from (ObjectRemoved(name) for name in changed_names if name not in objects_after)
    for name in changed_names:
        old, object = objects_before.get(name), objects_after.get(name)
        if object is None:
            continue
        if old is None or old.type != object.type:
            yield ObjectAdded(object)
            continue
        for path in old.values.keys() | object.values.keys():
            value = object.values.get(path)
            if value != old.values.get(path) or type(value) is not type(old.values.get(path)):
                yield ValueSet(name, path, value)
