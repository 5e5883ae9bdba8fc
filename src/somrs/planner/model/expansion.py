"""Quantifiers, expanded over the objects of the map. Parts that no service on offer changes are evaluated on the map, and left out if they
hold.

FORALL becomes a conjunction; before a negated atom it needs no expansion, because a variable that occurs only after NOT stands for any
object. EXISTS becomes a variable of its own. The rest of the planner sees no quantifiers.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

from msgspec import structs

from somrs.entish import And, Attribute, Call, Exists, ForAll, Formula, Name, Not, Or, Relation, Variable
from somrs.entish.formula import (
    Literal,
    conjunction,
    conjuncts,
    disjunction,
    literals,
    substitute,
    terms,
    variables,
)
from somrs.entish.normal_form import affirmed_variables, distribute_for_all, has_quantifiers, negation
from somrs.entish.parse import parse
from somrs.ontology.query_context import object_variables
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.truth import bindings, formula_holds
from somrs.planner.model.problem import Problem
from somrs.planner.model.vocabulary import Inexpressible, Vocabulary


def expand_quantifiers(problem: Problem) -> Problem:
    """The problem without quantifiers in the goal and in the preconditions of services. Raises Inexpressible for the goal's."""
    preconditions = [available.service_type.start_condition for available in problem.services]
    if not has_quantifiers(problem.goal) and not any(text is not None and has_quantifiers(parse(text)) for text in preconditions):
        return problem
    vocabulary = Vocabulary(problem.ontology, [parse(available.service_type.effect) for available in problem.services])
    services = (
        structs.replace(available, service_type=_expand_precondition(available.service_type, problem, vocabulary))
        for available in problem.services
    )
    expanded = _Expansion(problem, vocabulary).expand(problem.goal)
    return structs.replace(problem, goal=expanded.formula or problem.goal, services=tuple(services))


def _expand_precondition(service: ServiceType, problem: Problem, vocabulary: Vocabulary) -> ServiceType:
    """The service type without quantifiers in what has to hold at its start, unless they cannot be expanded."""
    precondition = parse(service.start_condition) if service.start_condition is not None else None
    if precondition is None or not has_quantifiers(precondition):
        return service
    given = {PROVIDER, *(parameter.name for parameter in service.inputs), *variables(parse(service.effect))}
    try:
        expanded = _Expansion(problem, vocabulary, given).expand(precondition)
    except Inexpressible:
        return service  # its operators report it
    return structs.replace(service, precondition=str(expanded.formula) if expanded.formula is not None else None, invariant=None)


@dataclass(frozen=True, slots=True)
class _Expanded:
    """A formula without quantifiers; None if it is true. `is_false`: it cannot become true, for the parts in the formula."""

    formula: Formula | None
    is_false: bool = False

    @property
    def is_true(self) -> bool:
        return self.formula is None


_TRUE = _Expanded(None)


@dataclass(slots=True, eq=False)
class _Expansion:
    """Expands one formula. `given`: the variables that have values from elsewhere."""

    problem: Problem
    vocabulary: Vocabulary
    given: set[str] = field(default_factory=set)
    taken: set[str] = field(default_factory=set)
    """The names of variables that a new variable must not have."""

    def expand(self, formula: Formula) -> _Expanded:
        self.given |= affirmed_variables(formula).keys()
        self.taken |= self.given | {term.name for term in terms(formula) if isinstance(term, Variable)}
        return self._expand(formula)

    def _expand(self, formula: Formula) -> _Expanded:
        match formula:
            case And(parts):
                return self._conjunction([self._expand(part) for part in parts])
            case Or(parts):
                return self._disjunction([self._expand(part) for part in parts])
            case ForAll(variable, body):
                return self._for_all(*self._renamed(variable, body))
            case Exists(variable, body):
                return self._exists(*self._renamed(variable, body))
            case _ if self._is_static(formula) and self._is_closed(formula):
                return _TRUE if formula_holds(formula, self.problem.map, self.problem.ontology) else _Expanded(formula, is_false=True)
        return _Expanded(formula)

    def _conjunction(self, parts: list[_Expanded]) -> _Expanded:
        formulas = [part.formula for part in parts if part.formula is not None]
        return _Expanded(conjunction(*formulas), any(part.is_false for part in parts)) if formulas else _TRUE

    def _disjunction(self, parts: list[_Expanded]) -> _Expanded:
        if any(part.is_true for part in parts):
            return _TRUE
        possible = [part for part in parts if not part.is_false]
        formulas = [part.formula for part in possible or parts if part.formula is not None]
        return _Expanded(disjunction(*formulas), not possible)

    def _renamed(self, variable: Variable, body: Formula) -> tuple[Variable, Formula]:
        """The quantifier's variable under a name that no other variable has, and the body with it."""
        name = variable.name
        if name in self.given:
            name = next(new for n in itertools.count(2) if (new := f"{name}{n}") not in self.taken)
        self.taken.add(name)
        renamed = Variable(name, variable.type)
        return renamed, substitute(body, {variable.name: renamed})

    # FORALL

    def _for_all(self, variable: Variable, body: Formula) -> _Expanded:
        if not self._has_objects(variable):
            return _TRUE
        distributed = distribute_for_all([variable], body)
        if not isinstance(distributed, ForAll):
            return self._expand(distributed)
        if not self._stands_for_object(variable, body):
            raise Inexpressible(ForAll(variable, body), f"?{variable.name} stands for any value")
        disjuncts = body.parts if isinstance(body, Or) else (body,)
        guards = [part for part in disjuncts if self._is_guard(part, variable)]
        rest = [part for part in disjuncts if not self._is_guard(part, variable)]
        names = self._objects(variable, [negation(guard, {*self.given, variable.name}) for guard in guards])
        broken = disjunction(*rest) if rest else body
        return self._conjunction([self._expand(substitute(broken, {variable.name: Name(name)})) for name in names])

    # EXISTS

    def _exists(self, variable: Variable, body: Formula) -> _Expanded:
        if not self._stands_for_object(variable, body):
            return self._opened(variable, body)
        guards = [part for part in conjuncts(body) if self._is_guard(part, variable)]
        rest = [part for part in conjuncts(body) if not self._is_guard(part, variable)]
        if not rest:
            is_true = next(self._objects(variable, guards), None) is not None
            return _TRUE if is_true else _Expanded(self._opened(variable, body).formula, is_false=True)
        if all(isinstance(guard, Literal) for guard in guards):
            return self._opened(variable, body)
        expanded = [self._expand(substitute(conjunction(*rest), {variable.name: Name(name)})) for name in self._objects(variable, guards)]
        return self._disjunction(expanded) if expanded else _Expanded(self._opened(variable, body).formula, is_false=True)

    def _opened(self, variable: Variable, body: Formula) -> _Expanded:
        """The body, with the variable as a variable of the whole formula."""
        self.given.add(variable.name)
        return self._expand(body)

    # What the map says

    def _is_static(self, formula: Formula) -> bool:
        """Whether no service on offer can change what the formula says."""
        return all(self._is_static_literal(literal) for literal in literals(formula))

    def _is_static_literal(self, literal: Literal) -> bool:
        atom = literal.atom if isinstance(literal, Not) else literal
        if isinstance(atom, Relation):
            return atom.relation not in self.vocabulary.relations
        read = {term.path for term in terms(atom) if isinstance(term, Attribute)}
        for call in (term for term in terms(atom) if isinstance(term, Call)):
            function = self.problem.ontology.functions.get(call.function)
            read |= {function.attribute} if function is not None and function.attribute else {"PositionX", "PositionY", "PositionZ"}
        return read.isdisjoint(self.vocabulary.paths)

    def _is_closed(self, formula: Formula) -> bool:
        """Whether the map alone says whether the formula holds."""
        return self.given.isdisjoint(variables(formula)) and not affirmed_variables(formula)

    def _is_guard(self, part: Formula, variable: Variable) -> bool:
        """Whether the map alone says for which objects the part holds."""
        open_variables = affirmed_variables(part).keys() | (self.given & variables(part).keys())
        return variable.name in variables(part) and open_variables <= {variable.name} and self._is_static(part)

    def _stands_for_object(self, variable: Variable, body: Formula) -> bool:
        if variable.type is not None:
            return variable.type not in ("number", "text", "truth")
        return variable.name not in variables(body) or variable.name in object_variables(body, self.problem.ontology)

    def _has_objects(self, variable: Variable) -> bool:
        return variable.type in (None, "number", "text", "truth") or next(self._objects(variable, []), None) is not None

    def _objects(self, variable: Variable, guards: list[Formula]) -> Iterator[str]:
        """The objects of the variable's type for which the guards hold."""
        map, ontology = self.problem.map, self.problem.ontology
        formula = conjunction(*guards) if guards else None
        if formula is not None and variable.name in affirmed_variables(formula):
            rows = bindings(formula, map, ontology)
            yield from dict.fromkeys(term.name for row in rows if isinstance(term := row[variable.name], Name))
            return
        for name, object in map.objects.items():
            if variable.type is None or ontology.is_subtype(object.type, variable.type):
                row = {variable.name: Name(name)}
                if formula is None or next(bindings(formula, map, ontology, row), None) is not None:
                    yield name
