"""Which service types can make a formula true, and with which inputs: unification of their effects with what is wanted."""

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
from somrs.ontology.objects import Map
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.types import Ontology, RelationType
from somrs.ontology.values import Measured, attribute_at, compare

DEVICE = "Device"
"""The type of `?Provider`."""

_WANTED = "wanted "
"""Before the names of the wanted formula's variables, which are not those of the same names in the effect. Entish has
no blanks in names."""

_OPPOSITE = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
_MIRRORED = {"=": "=", "!=": "!=", "<": ">", ">=": "<=", ">": "<", "<=": ">="}
_VALUE_TYPES: Mapping[str, type[Number] | type[Text] | type[Truth]] = {"number": Number, "text": Text, "truth": Truth}


def unifiers(
    offered: Formula, wanted: Literal, ontology: Ontology, types: Mapping[str, str], map: Map | None = None
) -> Iterator[dict[str, Term]]:
    """The ways in which making `offered` true may make `wanted` true: for variables of `offered`, constants or variables
    of `wanted`. `types` are those of the variables of `offered`; with a map, constants must be of them.

    May: where a value is still open on one side, or a thing is put somewhere else only if that is another place.
    """
    unifying = _Unifying(offered, ontology, map, certain=False)
    for match in unifying.ways(unifying.start(types, wanted), unifying.renamed(wanted)):
        yield unifying.result(match)


def can_bring_about(service: ServiceType, wanted: Formula, ontology: Ontology, map: Map | None = None) -> bool:
    """Whether the effect of the service can make some atom of the wanted formula true."""
    effect, types = parse(service.effect), types_of(service, ontology)
    return any(next(unifiers(effect, literal, ontology, types, map), None) is not None for literal in literals(wanted))


def bring_about_all(service: ServiceType, wanted: Formula, ontology: Ontology, map: Map | None = None) -> Iterator[dict[str, Term]]:
    """The bindings of the service's variables with which its effect is sure to make every conjunct of the wanted formula
    true (of an OR: every conjunct of one alternative), each once. Variables that do not matter are left out.

    What already holds is not looked at: take it out of `wanted` before. An output never stands for a constant, since
    its value is known only afterwards.
    """
    effect, types = parse(service.effect), types_of(service, ontology)
    outputs = {output.name for output in service.outputs}
    unifying = _Unifying(effect, ontology, map, certain=True)
    seen: list[dict[str, Term]] = []
    for branch in alternatives(wanted):
        matches = iter([unifying.start(types, wanted)])
        for literal in branch:
            matches = unifying.each(matches, unifying.renamed(literal))
        for match in matches:
            result = unifying.result(match)
            if result not in seen and not any(isinstance(result.get(name), Constant) for name in outputs):
                seen.append(result)
                yield result


def types_of(service: ServiceType, ontology: Ontology) -> dict[str, str]:
    """The types of the variables in a service's formulas, as far as it declares them."""
    provider = {PROVIDER: DEVICE} if DEVICE in ontology.types else {}
    return provider | {parameter.name: parameter.type for parameter in (*service.inputs, *service.outputs)}


class _Match(Struct, frozen=True):
    """What the variables of both sides stand for so far, and the types of those that are open."""

    bound: dict[str, Term]
    types: dict[str, str]

    def resolve(self, term: Term) -> Term:
        while isinstance(term, Variable) and term.name in self.bound:
            term = self.bound[term.name]
        return term


class _Unifying:
    """An effect to be matched; `certain`: only ways that make the wanted true whatever the open variables are."""

    def __init__(self, effect: Formula, ontology: Ontology, map: Map | None, certain: bool) -> None:
        self.effect, self.ontology, self.map, self.certain = conjuncts(effect), ontology, map, certain
        self.variables = {name: variable for part in self.effect for name, variable in variables(part).items()}

    def start(self, types: Mapping[str, str], wanted: Formula) -> _Match:
        declared = {name: variable.type for name, variable in self.variables.items() if variable.type is not None}
        asked = {_WANTED + name: variable.type for name, variable in variables(wanted).items() if variable.type is not None}
        return _Match({}, declared | {name: type_name for name, type_name in types.items() if name in self.variables} | asked)

    def renamed(self, wanted: Literal) -> Literal:
        renamed = substitute(wanted, {name: Variable(_WANTED + name) for name in variables(wanted)})
        assert isinstance(renamed, Relation | Comparison | Not)
        return renamed

    def result(self, match: _Match) -> dict[str, Term]:
        found: dict[str, Term] = {}
        for name in self.variables:
            term = match.resolve(Variable(name))
            if isinstance(term, Variable):
                if not term.name.startswith(_WANTED):
                    continue
                term = Variable(term.name.removeprefix(_WANTED), match.types.get(term.name))
            found[name] = term
        return found

    def each(self, matches: Iterator[_Match], wanted: Literal) -> Iterator[_Match]:
        for match in matches:
            yield from self.ways(match, wanted)

    def ways(self, match: _Match, wanted: Literal) -> Iterator[_Match]:
        """Every way in which one conjunct of the effect makes the wanted literal true."""
        for part in self.effect:
            match part, wanted:
                case (Relation() as made, Relation() as asked) | (Not(Relation() as made), Not(Relation() as asked)):
                    yield from self._same(match, made, asked)
                case Relation(), Not(Relation() as atom):
                    yield from self._displaced(match, part, atom)
                case Comparison(), Not(Comparison(left, operator, right)):
                    yield from self._value(match, part, Comparison(left, _OPPOSITE[operator], right))
                case Comparison(), Comparison():
                    yield from self._value(match, part, wanted)

    def _same(self, match: _Match, offered: Relation, wanted: Relation) -> Iterator[_Match]:
        if offered.relation != wanted.relation or len(offered.arguments) != len(wanted.arguments):
            return
        relation = self.ontology.relations.get(offered.relation)
        for arguments in _orders(wanted, relation):
            found: _Match | None = match
            for place, (one, other) in enumerate(zip(offered.arguments, arguments, strict=True)):
                found = self._join(found, one, other) if found is not None else None
                if found is not None and relation is not None and place < len(relation.joins):
                    found = self._of_type(found, one, relation.joins[place])
            if found is not None:
                yield found

    def _displaced(self, match: _Match, offered: Relation, wanted: Relation) -> Iterator[_Match]:
        """NOT wanted, because its first argument enters a relation that it excludes, or another tuple of its own. Each argument of a
        symmetric relation is its first."""
        one, other = (self.ontology.relations.get(relation) for relation in (offered.relation, wanted.relation))
        if one is None or other is None or not offered.arguments or not wanted.arguments:
            return
        if one.name == other.name and not one.functional:
            return
        if one.name != other.name and (one.excludes is None or one.excludes != other.excludes):
            return
        for mine, theirs in product(_orders(offered, one), _orders(wanted, other)):
            found = self._join(match, mine[0], theirs[0])
            if found is None:
                continue
            rest = [(found.resolve(a), found.resolve(b)) for a, b in zip(mine[1:], theirs[1:], strict=False)]
            differs = any(isinstance(a, Name) and isinstance(b, Name) and a != b for a, b in rest)
            if one.name != other.name or differs or (not self.certain and any(a != b for a, b in rest)):
                yield found

    def _value(self, match: _Match, offered: Comparison, wanted: Comparison) -> Iterator[_Match]:
        given, asked = _about_attribute(offered), _about_attribute(wanted)
        if given is None or asked is None or given.operator != "=":
            return
        target, attribute = given.left, asked.left
        assert isinstance(target, Attribute)
        assert isinstance(attribute, Attribute)
        if target.path != attribute.path:
            return
        found = self._join(match, target.owner, attribute.owner)
        if found is None:
            return
        value, limit = found.resolve(given.right), found.resolve(asked.right)
        if not isinstance(value, Constant | Variable) or not isinstance(limit, Constant | Variable):
            same = substitute_term(value, found.bound) == substitute_term(limit, found.bound)
            if not self.certain or (same and asked.operator == "="):
                yield found
        elif asked.operator == "=":
            joined = self._join(found, value, limit, target.path)
            if joined is not None:
                yield joined
        elif isinstance(value, Constant) and isinstance(limit, Constant):
            if self._compare(value, asked.operator, limit, target.path):
                yield found
        elif not self.certain:
            yield found

    def _compare(self, left: Constant, operator: str, right: Constant, path: str) -> bool:
        """Compares as values of the attribute: in its unit where they name none, and with its tolerance."""
        attribute = attribute_at(path, self.ontology)
        unit, tolerance = (attribute.unit, attribute.tolerance) if attribute else (None, 0.0)
        sides = [Number(side.value, side.unit or unit) if isinstance(side, Number) else side for side in (left, right)]
        within = isinstance(sides[0], Number) and sides[0].unit == unit
        return compare(Measured(sides[0], tolerance if within else 0.0), operator, Measured(sides[1], 0.0 if within else tolerance))

    def _join(self, match: _Match, offered: Term, wanted: Term, path: str = "") -> _Match | None:
        """Makes two terms the same; of two variables, the effect's stands for the wanted one."""
        one, other = match.resolve(offered), match.resolve(wanted)
        if one == other:
            return match
        if isinstance(one, Variable) and (not isinstance(other, Variable) or not one.name.startswith(_WANTED)):
            return self._bind(match, one.name, other)
        if isinstance(other, Variable):
            return self._bind(match, other.name, one)
        if path and isinstance(one, Constant) and isinstance(other, Constant) and self._compare(one, "=", other, path):
            return match
        return None

    def _bind(self, match: _Match, variable: str, term: Term) -> _Match | None:
        bound = _Match({**match.bound, variable: term}, match.types)
        type_name = match.types.get(variable)
        return self._of_type(bound, term, type_name) if type_name is not None else bound

    def _of_type(self, match: _Match, term: Term, type_name: str) -> _Match | None:
        """The match, if the term can be of the type; an open variable is of it from then on."""
        known = match.resolve(term)
        match known:
            case Variable(name):
                own = match.types.get(name)
                if own is not None and (own in _VALUE_TYPES) != (type_name in _VALUE_TYPES):
                    return None
                if own is None or (own != type_name and self.ontology.is_a(type_name, own)):
                    return _Match(match.bound, {**match.types, name: type_name})
                return match if own == type_name or self.ontology.is_a(own, type_name) else None
            case Name(name) if type_name not in _VALUE_TYPES:
                if self.map is None:
                    return match
                object = self.map.objects.get(name)
                return match if object is not None and self.ontology.is_a(object.type, type_name) else None
            case Name():
                return match if type_name == "text" else None  # a value of a list
            case _:
                fitting = _VALUE_TYPES.get(type_name)
                return match if fitting is not None and isinstance(known, fitting) else None


def _about_attribute(comparison: Comparison) -> Comparison | None:
    """The comparison with an attribute on its left; None when it has none."""
    if isinstance(comparison.left, Attribute):
        return comparison
    if isinstance(comparison.right, Attribute):
        return Comparison(comparison.right, _MIRRORED[comparison.operator], comparison.left)
    return None


def _orders(atom: Relation, relation: RelationType | None) -> list[tuple[Term, ...]]:
    """The arguments, in each order in which they say the same."""
    either = relation is not None and relation.symmetric and len(atom.arguments) == 2
    return [atom.arguments, atom.arguments[::-1]] if either else [atom.arguments]
