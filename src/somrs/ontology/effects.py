"""Computes the changes of a map that make an effect true. The definitions of the relations determine which facts are removed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress

from somrs.entish.formula import (
    Arithmetic,
    Attribute,
    Comparison,
    Formula,
    Name,
    Not,
    Number,
    Or,
    Relation,
    Term,
    Text,
    Truth,
    conjunction,
    conjuncts,
    literals,
    names,
    variables,
)
from somrs.entish.parse import nearest, read
from somrs.errors import FormulaError
from somrs.ontology.differences import differences
from somrs.ontology.homes import absence_text
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, ValueSet
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import AttributeType, Kind, Ontology, RelationType, Value
from somrs.ontology.units import convert_unit
from somrs.ontology.values import constant, measure


def vague_problem(part: Formula) -> tuple[str, str] | None:
    """Why a part of an effect does not say what becomes true, and what to write instead; None if it says it."""
    match part:
        case Relation() | Not(Relation()) | Comparison(Attribute(), "=", _) | Comparison(_, "=", Attribute()):
            return None
        case Or():
            return "an effect with OR does not say what becomes true", "choose one of its alternatives"
        case Comparison():
            return "this does not say what becomes true", "write Object.Attribute = value"
    return "this does not say what becomes true", "say which value the attribute gets"


def changes(effect: Formula, map: Map, ontology: Ontology) -> list[Change]:
    """The smallest set of changes that makes an effect without variables true; none when it already holds.

    A new fact of a functional relation replaces the old fact with the same first argument, and the facts of the relations that it
    excludes. Attributes that a relation implies (the position of an object that is put on another) are not computed.

    Raises:
        FormulaError: the effect has a variable, contradicts itself, or does not say what becomes true.
    """
    return _make_changes(effect, map, ontology)[0]


def apply_effect(effect: Formula, map: Map, ontology: Ontology) -> Map:
    """The map after an effect without variables: `map` with its `changes`."""
    return _make_changes(effect, map, ontology)[1]


def net_effect(effects: Sequence[Formula], map: Map, ontology: Ontology) -> Formula | None:
    """What the effects, which come true one after the other, change on the map in the end; None if nothing. Formulas without variables.

    Effects that the map cannot make true (an object is not on it) are left out. `apply_effect` on the map gives the map after the others.
    """
    last = _last_stated(effects, map, ontology)
    if last is not None:
        with suppress(FormulaError):
            return _changed_part(last, map, ontology)
    return _net_effect_stepwise(effects, map, ontology)


def _net_effect_stepwise(effects: Sequence[Formula], map: Map, ontology: Ontology) -> Formula | None:
    """The net effect, by making one effect after the other true."""
    concerned = dict.fromkeys(name for effect in effects for name in names(effect) if name in map.objects)
    part_of_map = Map((map.objects[name] for name in concerned), (fact for name in concerned for fact in map.facts_about(name)))
    map_after = part_of_map
    for effect in effects:
        with suppress(FormulaError):
            map_after = apply_effect(effect, map_after, ontology)
    stated = sorted(_stated(differences(part_of_map, map_after), map_after, ontology), key=str)
    map_stated = apply_effect(conjunction(*stated), part_of_map, ontology) if stated else part_of_map
    ended = sorted((Not(_atom(c.fact)) for c in differences(map_stated, map_after) if isinstance(c, FactRemoved)), key=str)
    return conjunction(*stated, *ended) if stated or ended else None


def _changed_part(effect: Formula, map: Map, ontology: Ontology) -> Formula | None:
    """What of an effect that does not contradict itself is not so yet, without what follows from the rest of it. Raises FormulaError."""
    builder = _ChangeBuilder(effect, map, ontology)
    new: list[Change] = []
    removed: dict[Change, None] = {}
    """By facts that hold already, or that end: the new ones need not say so."""
    replaced: set[Change] = set()
    for part in conjuncts(effect):
        changes_of_part = [*builder.changes_for(part)]
        added = [change for change in changes_of_part if not isinstance(change, FactRemoved)]
        new += added
        if added:
            replaced.update(changes_of_part)
        else:
            removed.update(dict.fromkeys(changes_of_part))
    stated = sorted(_stated(new, map, ontology), key=str)
    ended = sorted((Not(_atom(change.fact)) for change in removed if isinstance(change, FactRemoved) and change not in replaced), key=str)
    return conjunction(*stated, *ended) if stated or ended else None


def _last_stated(effects: Sequence[Formula], map: Map, ontology: Ontology) -> Formula | None:
    """One effect that leads to the same map: what the effects state, without what a later one states otherwise. None if there is none.

    A plan may have hundreds of steps, and each is promised the effects of all steps before it.
    """
    facts: dict[Relation, bool] = {}
    """Whether the facts that the effects mention hold after them."""
    holding: dict[tuple[str, Term], dict[Relation, None]] = {}
    """Those that hold, by relation and first argument."""
    replaced: dict[tuple[str, int, Term], None] = {}
    """The relations, places and objects there whose facts were replaced by others."""
    values: dict[Term, Comparison] = {}

    def state(fact: Relation, holds: bool) -> None:
        facts[fact] = holds
        same_start = holding.setdefault((fact.relation, fact.arguments[0]), {})
        if holds:
            same_start[fact] = None
        else:
            same_start.pop(fact, None)

    for effect in effects:
        stated: dict[Relation, bool] = {}
        assigned: dict[Term, Comparison] = {}
        for part in conjuncts(effect):
            match part:
                case (Relation() as fact) | Not(Relation() as fact):
                    relation = ontology.relations.get(fact.relation)
                    if relation is None or relation.symmetric:
                        return None  # a symmetric fact is written in two ways
                    stated[fact] = fact is part
                case Comparison(Attribute() as target, "=", Name() | Number() | Text() | Truth()):
                    if assigned.setdefault(target, part) != part:
                        return None  # the effect contradicts itself
                case _:
                    return None
        values |= assigned
        for fact, holds in stated.items():
            if holds:
                for name, place in ontology.rivals(ontology.relations[fact.relation]):
                    replaced[name, place, fact.arguments[0]] = None
                    for rival in [*holding.get((name, fact.arguments[0]), ())]:
                        state(rival, holds=False)
            state(fact, holds)
        if any(facts[fact] is not holds for fact, holds in stated.items()):
            return None  # the effect contradicts itself
    for name, place, object in replaced:
        if not holding.get((name, object)) and isinstance(object, Name):
            for arguments in map.facts_with(name, place, object.name):
                facts.setdefault(Relation(name, tuple(Name(argument) for argument in arguments)), False)
    return conjunction(*(fact if holds else Not(fact) for fact, holds in facts.items()), *values.values())


def _stated(difference: Iterable[Change], map_after: Map, ontology: Ontology) -> Iterator[Formula]:
    """The new facts and values. They replace most of the facts that the map has not any more."""
    for change in difference:
        match change:
            case FactAdded(fact):
                yield _atom(fact)
            case ValueSet(object, path, value) if value is not None:
                attribute = ontology.attributes_of(map_after.objects[object].type)[path]
                yield Comparison(Attribute(Name(object), path), "=", constant(value, attribute))


def _atom(fact: Fact) -> Relation:
    return Relation(fact.relation, tuple(Name(argument) for argument in fact.arguments))


def evaluate_effect(effect: Formula, map: Map, ontology: Ontology) -> Formula:
    """The effect with its arithmetic evaluated on the map, so that `?A.Charge = ?A.Charge - 5` states the value after the effect."""
    parts = conjuncts(effect)
    if not any(isinstance(part, Comparison) for part in parts):
        return effect
    return conjunction(*(_evaluate_part(part, map, ontology) for part in parts))


def _evaluate_part(part: Formula, map: Map, ontology: Ontology) -> Formula:
    if isinstance(part, Comparison) and part.operator == "=":
        target, source = (part.left, part.right) if isinstance(part.left, Attribute) else (part.right, part.left)
        measured = measure(source, map, ontology) if isinstance(source, Arithmetic) else None
        if measured is not None:
            return Comparison(target, "=", measured.constant)
    return part


def _make_changes(effect: Formula, map: Map, ontology: Ontology) -> tuple[list[Change], Map]:
    effect = evaluate_effect(effect, map, ontology)
    builder = _ChangeBuilder(effect, map, ontology)
    parts = conjuncts(effect)
    needed_changes = [change for part in parts for change in builder.changes_for(part)]
    change_keys = [*dict.fromkeys(_key(change) for change in needed_changes)]
    change_by_key = {_key(change): change for change in needed_changes}
    final_changes = [change_by_key[key] for key in change_keys]
    map_after = map.changed(final_changes) if final_changes else map
    builder_after = _ChangeBuilder(effect, map_after, ontology)
    for part in parts:
        if any(builder_after.changes_for(part)):
            raise builder.error(part, None, "this contradicts the rest of the effect", "an effect says what holds at one moment")
    return final_changes, map_after


def _key(change: Change) -> object:
    """The subject of a change. Of two changes with the same key, the later one applies."""
    match change:
        case ValueSet(object, path):
            return object, path
        case FactAdded(fact) | FactRemoved(fact):
            return fact
    return change


class _ChangeBuilder:
    """Builds the changes for one effect on one map."""

    def __init__(self, effect: Formula, map: Map, ontology: Ontology) -> None:
        self.effect, self.map, self.ontology = effect, map, ontology

    def error(self, part: Formula, term: Term | None, problem: str, hint: str = "") -> FormulaError:
        """The error for a term in a part of the effect, or for the part itself (`term` None)."""
        first = next(literals(part))
        return read(str(self.effect)).error(first.atom if isinstance(first, Not) else first, term, problem, hint)

    def changes_for(self, part: Formula) -> Iterator[Change]:
        for variable in variables(part).values():
            raise self.error(part, variable, f"?{variable.name} is not bound", "an effect is made true of named objects and values")
        if (vague := vague_problem(part)) is not None:
            raise self.error(part, None, *vague)
        match part:
            case Relation():
                yield from self._relation_added(part)
            case Not(Relation() as atom):
                yield from self._relation_removed(atom)
            case Comparison():
                yield from self._value_set(part)

    # Relations

    def _fact(self, atom: Relation) -> tuple[RelationType, Fact]:
        relation = self.ontology.relations.get(atom.relation)
        if relation is None:
            raise self.error(atom, None, f"there is no relation {atom.relation}", nearest(atom.relation, self.ontology.relations))
        if len(atom.arguments) != len(relation.joins):
            raise self.error(atom, None, f"{atom.relation} joins {len(relation.joins)} objects, not {len(atom.arguments)}")
        for argument in atom.arguments:
            self._require_object(atom, argument)
        return relation, Fact(atom.relation, tuple(argument.name for argument in atom.arguments))

    def _require_object(self, part: Formula, term: Term) -> None:
        if not isinstance(term, Name) or term.name not in self.map.objects:
            raise self.error(part, term, absence_text(str(term), self.map), nearest(str(term), self.map.similar_names(str(term))))

    def _orders(self, relation: RelationType, arguments: tuple[str, ...]) -> list[tuple[str, ...]]:
        return [arguments, arguments[::-1]] if relation.symmetric and len(arguments) == 2 else [arguments]

    def _relation_added(self, atom: Relation) -> Iterator[Change]:
        relation, fact = self._fact(atom)
        orders = self._orders(relation, fact.arguments)
        for arguments in orders:
            for rival in self._rivals(relation, arguments[0]):
                if not (rival.relation == relation.name and rival.arguments in orders):
                    yield FactRemoved(rival)
        if not any(self.map.has_fact(relation.name, arguments) for arguments in orders):
            yield FactAdded(fact)

    def _rivals(self, relation: RelationType, first: str) -> Iterator[Fact]:
        """The facts about `first` that a new fact of the relation with this first argument replaces."""
        for other, place in self.ontology.rivals(relation):
            for arguments in self.map.facts_with(other, place, first):
                yield Fact(other, arguments)

    def _relation_removed(self, atom: Relation) -> Iterator[Change]:
        relation, fact = self._fact(atom)
        for arguments in dict.fromkeys(self._orders(relation, fact.arguments)):
            if self.map.has_fact(relation.name, arguments):
                yield FactRemoved(Fact(relation.name, arguments))

    # Values

    def _value_set(self, part: Comparison) -> Iterator[Change]:
        target, source = (part.left, part.right) if isinstance(part.left, Attribute) else (part.right, part.left)
        assert isinstance(target, Attribute), "the part is not vague"
        self._require_object(part, target.owner)
        assert isinstance(target.owner, Name)
        attribute = self._attribute(part, target)
        value = self._value(part, attribute, source)
        if not formula_holds(part, self.map, self.ontology):
            yield ValueSet(target.owner.name, target.path, value)

    def _attribute(self, part: Comparison, target: Attribute) -> AttributeType:
        type_name = self.map.objects[target.owner.name].type
        attributes = self.ontology.attributes_of(type_name)
        if target.path not in attributes:
            raise self.error(part, target, f"a {type_name} has no attribute {target.path}", nearest(target.path, attributes))
        return attributes[target.path]

    def _value(self, part: Comparison, attribute: AttributeType, source: Term) -> Value:
        """The value of the source on the map, converted to a value of the attribute."""
        measured = measure(source, self.map, self.ontology)
        if measured is None:
            raise self.error(part, source, f"{source} has no value")
        match attribute.kind, measured.constant:
            case Kind.NUMBER, Number(value, unit):
                if unit is None or attribute.unit is None:
                    return value
                number = convert_unit(value, unit, attribute.unit)
                if number is None:
                    raise self.error(part, source, f"{unit} cannot be converted to {attribute.unit}, the unit of {attribute.name}")
                return number
            case Kind.TRUTH, Truth(truth):
                return truth
            case Kind.TEXT, Text(text):
                return text
            case Kind.ENUMERATION, (Name(word) | Text(word)):
                if attribute.values and word not in attribute.values:
                    raise self.error(part, source, f"{word} is no {attribute.name}", nearest(word, attribute.values))
                return word
        raise self.error(part, source, f"{source} is no value of {attribute.name}, a {attribute.kind}")
