"""Working out what an update does to a map: what it comes to in the end, and whether the map would still obey its types."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from somrs.entish.formula import Comparison, Name
from somrs.entish.parse import nearest, parse
from somrs.errors import FormulaError
from somrs.ontology.check import check
from somrs.ontology.conformance import Violation, violations, violations_of
from somrs.ontology.effects import changes as changes_by
from somrs.ontology.objects import (
    Change,
    Fact,
    FactAdded,
    FactRemoved,
    Map,
    ObjectAdded,
    ObjectRemoved,
    ValueSet,
    objects_of,
)
from somrs.ontology.types import ABSTRACT, UNKNOWN, Ontology
from somrs.protocol.knowledge import Rejected, UpdateMap

MOST_PROBLEMS = 50
"""So many problems are told at once."""

NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 (clause 2.2) has no way to say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The map after an update, and what changed on the way there, at the least; nothing for an update that says what is."""

    map: Map
    changes: tuple[Change, ...]

    @property
    def objects(self) -> tuple[str, ...]:
        """The objects that the changes are about, each once."""
        return tuple(dict.fromkeys(name for change in self.changes for name in objects_of(change)))


def rejected(problems: Iterable[str]) -> Rejected:
    """The problems, each once, and not too many of them for one message."""
    each = list(dict.fromkeys(problems))
    if len(each) > MOST_PROBLEMS:
        each[MOST_PROBLEMS:] = [f"and {len(each) - MOST_PROBLEMS} more problems"]
    return Rejected(problems=tuple(each))


def outcome(map: Map, ontology: Ontology, update: UpdateMap) -> Outcome | Rejected:
    """What the single changes, and then the situation, make of the map."""
    if problems := list(_impossible(map, ontology, update.changes)):
        return rejected(problems)
    wanted = [*_both_ways(update.changes, ontology)]
    changed = map.changed(wanted)
    if update.situation is not None:
        try:
            wanted += (more := changes_by(check(update.situation, ontology, changed), changed, ontology))
        except FormulaError as error:
            return rejected([str(error)])
        changed = changed.changed(more)
    found = [*_found(changed, wanted)]
    net = tuple(_net(map, changed.changed(found), [*wanted, *found]))
    result = Outcome(map=map.changed(net), changes=net)
    if problems := [*_unspeakable(net)] or [str(violation) for violation in _violations(map, result, ontology)]:
        return rejected(problems)
    return result


def _found(map: Map, changes: Iterable[Change]) -> Iterator[Change]:
    """An object that nothing was known of is known again once anybody says where or how it is."""
    said = [change for change in changes if not isinstance(change, FactRemoved)]
    flagged = {change.object for change in said if isinstance(change, ValueSet) and change.path == UNKNOWN and change.value}
    for name in dict.fromkeys(objects_of(change)[0] for change in said):
        if name not in flagged and (object := map.objects.get(name)) is not None and object.values.get(UNKNOWN) is True:
            yield ValueSet(name, UNKNOWN, None)


def is_name(text: str) -> bool:
    """Whether formulas can speak of what is called so."""
    try:
        return parse(f"{text} = {text}") == Comparison(Name(text), "=", Name(text))
    except FormulaError:
        return False


def _impossible(map: Map, ontology: Ontology, changes: Iterable[Change]) -> Iterator[str]:
    """What cannot be done at all, whatever the types say."""
    there = dict.fromkeys(map.objects, True)
    for change in changes:
        match change:
            case ObjectAdded(object):
                if there.get(object.name):
                    yield f"{object.name}: is on the map already; set its values, or give the new object another name"
                if not is_name(object.name):
                    yield f"{object.name!r} is no name that formulas can use; take letters, digits, _ and -, a letter first"
                there[object.name] = True
            case ObjectRemoved(name) | ValueSet(name):
                if not there.get(name):
                    yield _unknown(name, there)
                elif isinstance(change, ObjectRemoved):
                    there[name] = False
            case FactRemoved(fact) if fact.relation not in ontology.relations:
                yield f"{fact}: the ontology has no relation {fact.relation}. {nearest(fact.relation, ontology.relations)}".rstrip()


def _unknown(name: str, there: dict[str, bool]) -> str:
    hint = nearest(name, (known for known, present in there.items() if present))
    return f"there is no object {name} on the map; {hint or 'add it first'}"


def _both_ways(changes: Iterable[Change], ontology: Ontology) -> Iterator[Change]:
    """The changes; what is said of a symmetric relation is taken back whichever way round it was said."""
    for change in changes:
        yield change
        if isinstance(change, FactRemoved) and ontology.relations[change.fact.relation].symmetric:
            yield FactRemoved(Fact(change.fact.relation, change.fact.arguments[::-1]))


def _net(before: Map, after: Map, changes: Iterable[Change]) -> Iterator[Change]:
    """The least changes that lead from the one map to the other, which differ in nothing but what `changes` speak of.

    Facts go before their objects and come after them, each by name: so a change is in the history of all it concerns.
    """
    names: dict[str, None] = {}
    facts: dict[Fact, None] = {}
    for change in changes:
        match change:
            case FactAdded(fact) | FactRemoved(fact):
                facts[fact] = None
            case ObjectRemoved(name):
                names[name] = None
                facts.update(dict.fromkeys(before.facts_about(name)))
            case _:
                names[objects_of(change)[0]] = None
    held = {fact: (before.holds(fact.relation, fact.arguments), after.holds(fact.relation, fact.arguments)) for fact in facts}
    yield from (FactRemoved(fact) for fact, (was, now) in held.items() if was and not now)
    for name in names:
        old, new = before.objects.get(name), after.objects.get(name)
        if new is None:
            if old is not None:
                yield ObjectRemoved(name)
        elif old is None or old.type != new.type:
            yield ObjectAdded(new)
        else:
            for path in {**old.values, **new.values}:
                if old.values.get(path) != new.values.get(path):
                    yield ValueSet(name, path, new.values.get(path))
    yield from (FactAdded(fact) for fact, (was, now) in held.items() if now and not was)


def _unspeakable(changes: Iterable[Change]) -> Iterator[str]:
    """Texts that would make every message unreadable in which they are."""
    for change in changes:
        match change:
            case ObjectAdded(object):
                values = {f"{object.name}.{path}": value for path, value in object.values.items()}
            case ValueSet(name, path, value) if value is not None:
                values = {f"{name}.{path}": value}
            case _:
                continue
        for place, value in values.items():
            if isinstance(value, str) and (found := NOT_XML.search(value)):
                yield f"{place}: the character U+{ord(found[0]):04X} cannot be sent to anybody; leave it out"


def _violations(before: Map, outcome: Outcome, ontology: Ontology) -> list[Violation]:
    """Which rules would be broken by what changed."""
    removed = [before.objects[change.name].type for change in outcome.changes if isinstance(change, ObjectRemoved)]
    if any(ontology.is_a(type_name, ABSTRACT) for type_name in removed):
        return violations(outcome.map, ontology)  # it may have been the root, which is nobody's part
    return violations_of(outcome.map, ontology, outcome.objects, before) if outcome.changes else []
