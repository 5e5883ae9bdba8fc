"""Computes the outcome of a map update: the net changes, and the rules that the new map breaks."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace

from msgspec import structs

from somrs.entish.parse import nearest
from somrs.errors import FormulaError
from somrs.ontology.conformance import Violation, malformed, root_violations, violations_of
from somrs.ontology.homes import absence_text
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, ObjectAdded, ObjectRemoved, ValueSet, objects_of
from somrs.ontology.qualified_names import plain_name
from somrs.ontology.types import ABSTRACT, UNKNOWN, Ontology
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.observations import Observation, Reception
from somrs.repository.association import DEVICE
from somrs.repository.former_names import with_current_names
from somrs.repository.hidden_objects import shown_situation
from somrs.repository.names import is_name, text_problem
from somrs.repository.outcome import SITUATION, Outcome
from somrs.repository.provenance import Aspect, Provenance, aspects_of, fact_aspect, location_aspect
from somrs.repository.reports import read_report
from somrs.space.standing import BESIDE, ON, beside_supports, beside_text


def update_outcome(
    map: Map,
    ontology: Ontology,
    update: UpdateMap,
    provenance: Provenance | None = None,
    now: float = math.inf,
    reserved: Collection[str] = (),
    homes: Collection[str] = (),
) -> Outcome:
    """The outcome of an update that arrives `now`: first its single changes are applied, then its situation.

    Of an update that was observed earlier, only what is newer than the `provenance` of the map is applied. `reserved`: names that the
    update gives to no new object. `homes`: the maps of neighbours, which may have objects that are not on the map: because they
    do not show them or, in a report, because what they show has not arrived yet.
    """
    provenance = provenance if provenance is not None else Provenance()
    update = with_current_names(update, map, ontology, provenance)
    observation = update.observation or Observation()
    at = observation.holds_from(now)
    if impossible := (*_impossible(map, ontology, update.changes), *_wrong_observation(map, ontology, observation, provenance)):
        return Outcome(map=map, ontology=ontology, broken=impossible)
    changes, aspects, superseded = _newer_changes(_both_ways(update.changes, ontology), map, ontology, provenance, at)
    if update.observation is not None:
        changes = [*_left_places(changes, map, ontology), *changes]
    changed = map.changed(changes)
    is_edit = update.observation is None and update.reservation is None
    hiding = [home for home in homes if not (is_edit and home in map.complete)]
    try:
        situation = shown_situation(update.situation, changed, ontology, hiding)
        report = read_report(situation, observation, changed, ontology, provenance, at, reserved)
    except FormulaError as error:
        violation = Violation(subject=SITUATION, rule="formula", message=str(error), section=SITUATION)
        return Outcome(map=map, ontology=ontology, broken=(violation,))
    changes += report.changes
    changed = changed.changed(report.changes)
    clearing = [clear for clear in _clear_unknown(changed, changes, report.recognized) if provenance.time((clear.object, UNKNOWN)) <= at]
    reception = structs.replace(report.reception, superseded=(*superseded, *report.reception.superseded))
    outcome = changes_outcome(map, ontology, [*changes, *clearing])
    if is_edit and not outcome.broken:
        outcome = replace(outcome, broken=tuple(_beside_supports(outcome)))
    return replace(
        outcome,
        at=at,
        aspects=(*aspects, *report.aspects),
        reception=reception if reception != Reception() else None,
        merged=report.merged,
    )


def _beside_supports(outcome: Outcome) -> Iterator[Violation]:
    """Violations for things of which the changes say that they are on something, and that they are where this is not. Reports are not
    rejected for that: they say what was measured."""
    changes = outcome.changes
    placed = {change.fact.arguments[0] for change in changes if isinstance(change, FactAdded) and change.fact.relation == ON}
    located = {objects_of(change)[0] for change in changes if isinstance(change, ObjectAdded) or _is_position(change)}
    for name, support, distance in beside_supports(outcome.map, outcome.ontology, sorted(placed & located)):
        yield Violation(subject=name, rule=BESIDE, message=beside_text(support, distance), path="PositionX")


def _is_position(change: Change) -> bool:
    return isinstance(change, ValueSet) and change.path in ("PositionX", "PositionY")


def _wrong_observation(map: Map, ontology: Ontology, observation: Observation, provenance: Provenance) -> Iterator[Violation]:
    """Violations for objects that an observation names and that it cannot be about."""
    for name in dict.fromkeys((*observation.gone, *observation.searched, *observation.sought, *observation.missed)):
        object = map.objects.get(name)
        if object is None and name not in provenance.departures:
            yield Violation(subject=name, rule="unknown-object", message=_unknown(name, map, map.similar_names(name)))
        elif object is not None and name in observation.gone and ontology.is_subtype(object.type, DEVICE):
            yield Violation(subject=name, rule="device", message="is a device; a person removes it from the map, and no report does")


def _newer_changes(
    changes: Iterable[Change], map: Map, ontology: Ontology, provenance: Provenance, at: float
) -> tuple[list[Change], list[Aspect], tuple[str, ...]]:
    """The changes about which the map has nothing newer, what is news, and the other changes as text."""
    newer: list[Change] = []
    aspects: list[Aspect] = []
    superseded: list[str] = []
    for change in changes:
        if _latest_news(change, map, ontology, provenance) <= at:
            newer.append(change)
        else:
            superseded.append(format_change(change))
            if not _was_so(change, ontology, provenance, at):
                continue
        aspects += aspects_of(change, ontology)
    return newer, aspects, tuple(superseded)


def _left_places(changes: Iterable[Change], map: Map, ontology: Ontology) -> Iterator[FactRemoved]:
    """The removal of the places where objects were that were seen elsewhere. Whoever reports them may not know where the map has them."""
    for change in changes:
        location = location_aspect(change.fact, ontology) if isinstance(change, FactAdded) else None
        for fact in map.facts_from(location[0]) if location is not None else ():
            if location_aspect(fact, ontology) == location:
                yield FactRemoved(fact)


def _was_so(change: Change, ontology: Ontology, provenance: Provenance, at: float) -> bool:
    """Whether the change is the latest news of where an object was, although the object has left that place since."""
    location = location_aspect(change.fact, ontology) if isinstance(change, FactAdded) else None
    return location is not None and provenance.time(location) <= at


def _latest_news(change: Change, map: Map, ontology: Ontology, provenance: Provenance) -> float:
    """When the latest news held that the change may contradict."""
    match change:
        case ObjectRemoved(name):
            return provenance.latest(name)
        case FactRemoved(fact) if not map.has_fact(fact.relation, fact.arguments):
            return provenance.time(fact_aspect(fact, ontology))
        case FactAdded(fact) | FactRemoved(fact):
            # Who says where the object is says so of all its locations, and confirms the one that the map has.
            aspects = [fact_aspect(fact, ontology), location_aspect(fact, ontology)]
            return max(provenance.time(aspect) for aspect in aspects if aspect is not None)
        case ValueSet(name, path):
            return provenance.time((name, path))
        case ObjectAdded():
            return 0.0


def format_change(change: Change) -> str:
    """What the change says, for people."""
    match change:
        case ValueSet(name, path, value):
            return f"{name}.{path} = {value}" if value is not None else f"{name} has no {path}"
        case FactAdded(fact):
            return str(fact)
        case FactRemoved(fact):
            return f"NOT {fact}"
        case ObjectRemoved(name):
            return f"{name} is gone"
        case ObjectAdded(object):
            return f"{object.name} is a {object.type}"


def changes_outcome(map: Map, ontology: Ontology, changes: Sequence[Change]) -> Outcome:
    """The outcome of changes that are known to be possible."""
    net = tuple(_net_changes(map, map.changed(changes), changes))
    result = Outcome(map=map.changed(net), ontology=ontology, changes=net)
    broken = tuple(_text_violations(net)) or tuple(_violations(map, result, ontology))
    return replace(result, broken=broken) if broken else result


def _clear_unknown(map: Map, changes: Iterable[Change], recognized: Iterable[str]) -> Iterator[ValueSet]:
    """Changes that clear the attribute Unknown of each object about which the update states a fact or a value."""
    assertions = [change for change in changes if not isinstance(change, FactRemoved)]
    flagged = {change.object for change in assertions if isinstance(change, ValueSet) and change.path == UNKNOWN and change.value}
    for name in dict.fromkeys((*(objects_of(change)[0] for change in assertions), *sorted(recognized))):
        if name not in flagged and (object := map.objects.get(name)) is not None and object.values.get(UNKNOWN) is True:
            yield ValueSet(name, UNKNOWN, None)


def _impossible(map: Map, ontology: Ontology, changes: Iterable[Change]) -> Iterator[Violation]:
    """Violations for changes that are impossible, whatever the types allow."""
    presence: dict[str, bool] = {}
    """Whether the objects that earlier changes added or removed are there."""
    for change in changes:
        match change:
            case ObjectAdded(object):
                if presence.get(object.name, object.name in map.objects):
                    message = "is on the map already; set its values, or give the new object another name"
                    yield Violation(subject=object.name, rule="duplicate", message=message)
                if not is_name(plain_name(object.name)):
                    message = f"{object.name!r} is not a name that formulas can use; use letters, digits, _ and -, and begin with a letter"
                    yield Violation(subject=object.name, rule="name", message=message)
                presence[object.name] = True
            case ObjectRemoved(name) | ValueSet(name):
                if not presence.get(name, name in map.objects):
                    known_names = (known for known in (*map.similar_names(name), *presence) if presence.get(known, True))
                    yield Violation(subject=name, rule="unknown-object", message=_unknown(name, map, known_names))
                elif isinstance(change, ObjectRemoved):
                    presence[name] = False
            case FactAdded(fact) | FactRemoved(fact):
                if (violation := malformed(fact, ontology)) is not None:
                    yield violation


def _unknown(name: str, map: Map, known_names: Iterable[str]) -> str:
    return f"{absence_text(name, map)}; {nearest(name, known_names) or 'add it first'}"


def _both_ways(changes: Iterable[Change], ontology: Ontology) -> Iterator[Change]:
    """The changes. A removed fact of a symmetric relation is removed in both orders of its arguments."""
    for change in changes:
        yield change
        if isinstance(change, FactRemoved) and ontology.relations[change.fact.relation].symmetric:
            yield FactRemoved(Fact(change.fact.relation, change.fact.arguments[::-1]))


def _net_changes(map_before: Map, map_after: Map, changes: Iterable[Change]) -> Iterator[Change]:
    """The smallest set of changes from one map to the other. The maps differ only in what `changes` mention.

    Facts are removed before their objects and added after them. Each is listed, so that it is in the history of every object in it.
    """
    names: dict[str, None] = {}
    facts: dict[Fact, None] = {}
    for change in changes:
        match change:
            case FactAdded(fact) | FactRemoved(fact):
                facts[fact] = None
            case ObjectRemoved(name):
                names[name] = None
                facts.update(dict.fromkeys(map_before.facts_about(name)))
            case _:
                names[objects_of(change)[0]] = None
    removed = {name for name in names if name in map_before.objects and name not in map_after.objects}
    held = {fact: (map_before.has_fact(fact.relation, fact.arguments), map_after.has_fact(fact.relation, fact.arguments)) for fact in facts}
    yield from (FactRemoved(fact) for fact, (held_before, held_after) in held.items() if held_before and not held_after)
    for name in names:
        old, new = map_before.objects.get(name), map_after.objects.get(name)
        if new is None:
            if old is not None:
                yield ObjectRemoved(name)
        elif old is None or old.type != new.type:
            yield ObjectAdded(new)
        else:
            for path in {**old.values, **new.values}:
                if old.values.get(path) != new.values.get(path):
                    yield ValueSet(name, path, new.values.get(path))
    # A fact of an object that is removed goes with it; if it is stated all the same, that is a change, and breaks a rule.
    yield from (
        FactAdded(fact) for fact, (before, after) in held.items() if after and (not before or not removed.isdisjoint(fact.arguments))
    )


def _text_violations(changes: Iterable[Change]) -> Iterator[Violation]:
    """Violations for texts that no message can carry."""
    for change in changes:
        match change:
            case ObjectAdded(object):
                name, values = object.name, object.values
            case ValueSet(name, path, value) if value is not None:
                values = {path: value}
            case _:
                continue
        for path, value in values.items():
            if isinstance(value, str) and (message := text_problem(value)):
                yield Violation(subject=name, rule="text", message=f"{path}: {message}", path=path)


def _violations(map_before: Map, outcome: Outcome, ontology: Ontology) -> list[Violation]:
    """The rules that the changes break."""
    if not outcome.changes:
        return []
    broken = violations_of(outcome.map, ontology, outcome.objects, map_before)
    removed = [map_before.objects[change.name].type for change in outcome.changes if isinstance(change, ObjectRemoved)]
    if any(ontology.is_subtype(type_name, ABSTRACT) for type_name in removed):
        broken += root_violations(outcome.map, ontology)  # the removed object may have been the root
    return broken
