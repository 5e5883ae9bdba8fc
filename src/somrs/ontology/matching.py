"""Finds the service types that can make a formula true, and with which inputs, by unification of their effects with the goal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product

from msgspec import Struct

from somrs.entish.formula import (
    Attribute,
    Comparison,
    Constant,
    Formula,
    Literal,
    Name,
    Not,
    Number,
    Relation,
    Term,
    Text,
    Truth,
    Variable,
    alternatives,
    conjuncts,
    literals,
    substitute,
    substitute_term,
    variables,
)
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.services import PROVIDER, PROVIDER_TYPE, ServiceType
from somrs.ontology.types import Ontology, RelationType
from somrs.ontology.values import MeasuredValue, attribute_at, compare

_GOAL_PREFIX = "wanted "
"""The prefix that separates variables of the goal from variables of the same name in the effect. Names in Entish have
no spaces."""

_OPPOSITE = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
_MIRRORED = {"=": "=", "!=": "!=", "<": ">", ">=": "<=", ">": "<", "<=": ">="}
_VALUE_TYPES: Mapping[str, type[Number] | type[Text] | type[Truth]] = {"number": Number, "text": Text, "truth": Truth}


def unifiers(
    offered: Formula, goal: Literal, ontology: Ontology, types: Mapping[str, str], map: Map | None = None
) -> Iterator[dict[str, Term]]:
    """The bindings with which `offered` may make `goal` true. They bind variables of `offered` to constants or variables
    of `goal`. `types` are the types of the variables of `offered`; with a map, constants must have these types.

    A binding is possible, but not certain, where a value is still open on one side, or where a goal `NOT` is reached only if an open
    destination is another place.
    """
    unifier = _Unifier(offered, ontology, map, certain=False)
    for match in unifier.ways(unifier.start(types, goal), unifier.rename_variables(goal)):
        yield unifier.result(match)


def can_achieve(service: ServiceType, goal: Formula, ontology: Ontology, map: Map | None = None) -> bool:
    """Whether the effect of the service can make at least one literal of the goal true."""
    effect, types = parse(service.effect), types_of(service, ontology)
    return any(next(unifiers(effect, literal, ontology, types, map), None) is not None for literal in literals(goal))


def achieving_bindings(service: ServiceType, goal: Formula, ontology: Ontology, map: Map | None = None) -> Iterator[dict[str, Term]]:
    """The bindings of the service's variables with which its effect certainly makes every conjunct of the goal
    true (of an OR: every conjunct of one alternative), each once. Irrelevant variables are left out.

    The current map is not considered: remove conjuncts that already hold from `goal` first. No effect certainly makes a quantified
    part true. An output is never bound to a constant,
    because its value is known only after the service.
    """
    effect, types = parse(service.effect), types_of(service, ontology)
    outputs = {output.name for output in service.outputs}
    unifier = _Unifier(effect, ontology, map, certain=True)
    results: list[dict[str, Term]] = []
    for branch in alternatives(goal):
        branch_literals = [part for part in branch if isinstance(part, Literal)]
        if len(branch_literals) < len(branch):
            continue
        matches = iter([unifier.start(types, goal)])
        for literal in branch_literals:
            matches = unifier.extend_matches(matches, unifier.rename_variables(literal))
        for match in matches:
            result = unifier.result(match)
            if result not in results and not any(isinstance(result.get(name), Constant) for name in outputs):
                results.append(result)
                yield result


def types_of(service: ServiceType, ontology: Ontology) -> dict[str, str]:
    """The types of a service's variables: its inputs, its outputs and `?Provider`."""
    provider = {PROVIDER: PROVIDER_TYPE} if PROVIDER_TYPE in ontology.types else {}
    return provider | {parameter.name: parameter.type for parameter in (*service.inputs, *service.outputs)}


class _Match(Struct, frozen=True):
    """A partial unifier: the bindings of the variables of both sides, and the types of the unbound ones."""

    bound: dict[str, Term]
    types: dict[str, str]

    def resolve(self, term: Term) -> Term:
        while isinstance(term, Variable) and term.name in self.bound:
            term = self.bound[term.name]
        return term


class _Unifier:
    """Unifies one effect with goals. `certain`: only bindings that make the goal true for any values of the unbound variables."""

    def __init__(self, effect: Formula, ontology: Ontology, map: Map | None, certain: bool) -> None:
        self.effect, self.ontology, self.map, self.certain = conjuncts(effect), ontology, map, certain
        self.variables = {name: variable for part in self.effect for name, variable in variables(part).items()}

    def start(self, types: Mapping[str, str], goal: Formula) -> _Match:
        declared = {name: variable.type for name, variable in self.variables.items() if variable.type is not None}
        goal_types = {_GOAL_PREFIX + name: variable.type for name, variable in variables(goal).items() if variable.type is not None}
        return _Match({}, declared | {name: type_name for name, type_name in types.items() if name in self.variables} | goal_types)

    def rename_variables(self, goal: Literal) -> Literal:
        renamed = substitute(goal, {name: Variable(_GOAL_PREFIX + name) for name in variables(goal)})
        assert isinstance(renamed, Relation | Comparison | Not)
        return renamed

    def result(self, match: _Match) -> dict[str, Term]:
        terms: dict[str, Term] = {}
        for name in self.variables:
            term = match.resolve(Variable(name))
            if isinstance(term, Variable):
                if not term.name.startswith(_GOAL_PREFIX):
                    continue
                term = Variable(term.name.removeprefix(_GOAL_PREFIX), match.types.get(term.name))
            terms[name] = term
        return terms

    def extend_matches(self, matches: Iterator[_Match], goal: Literal) -> Iterator[_Match]:
        for match in matches:
            yield from self.ways(match, goal)

    def ways(self, match: _Match, goal: Literal) -> Iterator[_Match]:
        """The extensions of a match with which one conjunct of the effect makes the goal literal true."""
        for part in self.effect:
            match part, goal:
                case (Relation() as effect_atom, Relation() as goal_atom) | (Not(Relation() as effect_atom), Not(Relation() as goal_atom)):
                    yield from self._unify_relations(match, effect_atom, goal_atom)
                case Relation(), Not(Relation() as atom):
                    yield from self._displaced(match, part, atom)
                case Comparison(), Not(Comparison(left_term, operator, right_term)):
                    yield from self._value(match, part, Comparison(left_term, _OPPOSITE[operator], right_term))
                case Comparison(), Comparison():
                    yield from self._value(match, part, goal)

    def _unify_relations(self, match: _Match, offered: Relation, goal: Relation) -> Iterator[_Match]:
        if offered.relation != goal.relation or len(offered.arguments) != len(goal.arguments):
            return
        relation = self.ontology.relations.get(offered.relation)
        for arguments in _orders(goal, relation):
            extended_match: _Match | None = match
            for place, (offered_argument, goal_argument) in enumerate(zip(offered.arguments, arguments, strict=True)):
                extended_match = self._join(extended_match, offered_argument, goal_argument) if extended_match is not None else None
                if extended_match is not None and relation is not None and place < len(relation.joins):
                    extended_match = self._of_type(extended_match, offered_argument, relation.joins[place])
            if extended_match is not None:
                yield extended_match

    def _displaced(self, match: _Match, offered: Relation, goal: Relation) -> Iterator[_Match]:
        """The extensions with which the offered fact makes `NOT goal` true.

        Both have the same first argument, and either their relations exclude each other, or the relation is functional and the other
        arguments differ. Each argument of a symmetric relation counts as its first.
        """
        offered_relation, goal_relation = (self.ontology.relations.get(relation) for relation in (offered.relation, goal.relation))
        if offered_relation is None or goal_relation is None or not offered.arguments or not goal.arguments:
            return
        if offered_relation.name == goal_relation.name and not offered_relation.functional:
            return
        if offered_relation.name != goal_relation.name and (
            offered_relation.excludes is None or offered_relation.excludes != goal_relation.excludes
        ):
            return
        for mine, theirs in product(_orders(offered, offered_relation), _orders(goal, goal_relation)):
            extended_match = self._join(match, mine[0], theirs[0])
            if extended_match is None:
                continue
            rest = [
                (extended_match.resolve(offered_term), extended_match.resolve(goal_term))
                for offered_term, goal_term in zip(mine[1:], theirs[1:], strict=False)
            ]
            differs = any(
                isinstance(offered_term, Name) and isinstance(goal_term, Name) and offered_term != goal_term
                for offered_term, goal_term in rest
            )
            if (
                offered_relation.name != goal_relation.name
                or differs
                or (not self.certain and any(offered_term != goal_term for offered_term, goal_term in rest))
            ):
                yield extended_match

    def _value(self, match: _Match, offered: Comparison, goal: Comparison) -> Iterator[_Match]:
        effect_equation, goal_comparison = _about_attribute(offered), _about_attribute(goal)
        if effect_equation is None or goal_comparison is None or effect_equation.operator != "=":
            return
        target, attribute = effect_equation.left, goal_comparison.left
        assert isinstance(target, Attribute)
        assert isinstance(attribute, Attribute)
        if target.path != attribute.path:
            return
        extended_match = self._join(match, target.owner, attribute.owner)
        if extended_match is None:
            return
        value, limit = extended_match.resolve(effect_equation.right), extended_match.resolve(goal_comparison.right)
        if not isinstance(value, Constant | Variable) or not isinstance(limit, Constant | Variable):
            is_equal = substitute_term(value, extended_match.bound) == substitute_term(limit, extended_match.bound)
            if not self.certain or (is_equal and goal_comparison.operator == "="):
                yield extended_match
        elif goal_comparison.operator == "=":
            joined = self._join(extended_match, value, limit, target.path)
            if joined is not None:
                yield joined
        elif isinstance(value, Constant) and isinstance(limit, Constant):
            if self._compare(value, goal_comparison.operator, limit, target.path):
                yield extended_match
        elif not self.certain:
            yield extended_match

    def _compare(self, left_value: Constant, operator: str, right_value: Constant, path: str) -> bool:
        """Compare two values of the attribute at the path, in its unit if they have none, and with its tolerance."""
        attribute = attribute_at(path, self.ontology)
        unit, tolerance = (attribute.unit, attribute.tolerance) if attribute else (None, 0.0)
        sides = [Number(side.value, side.unit or unit) if isinstance(side, Number) else side for side in (left_value, right_value)]
        is_attribute_unit = isinstance(sides[0], Number) and sides[0].unit == unit
        return compare(
            MeasuredValue(sides[0], tolerance if is_attribute_unit else 0.0),
            operator,
            MeasuredValue(sides[1], 0.0 if is_attribute_unit else tolerance),
        )

    def _join(self, match: _Match, offered: Term, goal_term: Term, path: str = "") -> _Match | None:
        """Unify two terms. Of two variables, the one of the effect is bound to the one of the goal."""
        offered_value, goal_value = match.resolve(offered), match.resolve(goal_term)
        if offered_value == goal_value:
            return match
        if isinstance(offered_value, Variable) and (
            not isinstance(goal_value, Variable) or not offered_value.name.startswith(_GOAL_PREFIX)
        ):
            return self._bind(match, offered_value.name, goal_value)
        if isinstance(goal_value, Variable):
            return self._bind(match, goal_value.name, offered_value)
        if (
            path
            and isinstance(offered_value, Constant)
            and isinstance(goal_value, Constant)
            and self._compare(offered_value, "=", goal_value, path)
        ):
            return match
        return None

    def _bind(self, match: _Match, variable: str, term: Term) -> _Match | None:
        bound = _Match({**match.bound, variable: term}, match.types)
        type_name = match.types.get(variable)
        return self._of_type(bound, term, type_name) if type_name is not None else bound

    def _of_type(self, match: _Match, term: Term, type_name: str) -> _Match | None:
        """The match, if the term can have the type; an unbound variable gets the type. None otherwise."""
        resolved_term = match.resolve(term)
        match resolved_term:
            case Variable(name):
                variable_type = match.types.get(name)
                if variable_type is not None and (variable_type in _VALUE_TYPES) != (type_name in _VALUE_TYPES):
                    return None
                if variable_type is None or (variable_type != type_name and self.ontology.is_subtype(type_name, variable_type)):
                    return _Match(match.bound, {**match.types, name: type_name})
                return match if variable_type == type_name or self.ontology.is_subtype(variable_type, type_name) else None
            case Name(name) if type_name not in _VALUE_TYPES:
                if self.map is None:
                    return match
                object = self.map.objects.get(name)
                return match if object is not None and self.ontology.is_subtype(object.type, type_name) else None
            case Name():
                return match if type_name == "text" else None  # a value of an enumeration
            case _:
                fitting = _VALUE_TYPES.get(type_name)
                return match if fitting is not None and isinstance(resolved_term, fitting) else None


def _about_attribute(comparison: Comparison) -> Comparison | None:
    """The comparison with an attribute on its left; None when it has none."""
    if isinstance(comparison.left, Attribute):
        return comparison
    if isinstance(comparison.right, Attribute):
        return Comparison(comparison.right, _MIRRORED[comparison.operator], comparison.left)
    return None


def _orders(atom: Relation, relation: RelationType | None) -> list[tuple[Term, ...]]:
    """The arguments in each equivalent order: both for a symmetric relation."""
    is_symmetric = relation is not None and relation.symmetric and len(atom.arguments) == 2
    return [atom.arguments, atom.arguments[::-1]] if is_symmetric else [atom.arguments]
