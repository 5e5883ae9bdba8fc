"""Evaluates formulas on a map: whether a formula holds, and for which objects and values. `effects.py` computes changes of a map.

The world is closed: a relation that is not on the map does not hold. A comparison with an attribute that has no value, neither its own nor
a default, is false, also for `!=`. Numbers within the tolerance of the attribute are equal, so exactly one of `<`, `=` and `>` holds
between two numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import partial

from msgspec import Struct

from somrs.entish.formula import (
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Formula,
    Name,
    Not,
    Number,
    Or,
    Relation,
    Term,
    Text,
    Truth,
    Variable,
    alternatives,
    conjunction,
    conjuncts,
    count_alternatives,
    variables,
)
from somrs.errors import FormulaError
from somrs.ontology.map import Map
from somrs.ontology.query_context import QueryContext
from somrs.ontology.types import Ontology
from somrs.ontology.values import MeasuredValue, compare, evaluate, measure, name_of, value_of
from somrs.ontology.work_budget import WorkBudget

__all__ = ["Bindings", "bindings", "evaluate", "formula_holds", "value_of"]

Bindings = dict[str, Term]

LISTED = 64
"""So many facts are listed with the work of one step."""

REMEMBERED_WORK = 16
"""What took so many steps and led to nothing is remembered, because it is likely to be met again."""

ALTERNATIVES = 20_000
"""The maximum number of alternatives of a formula with variables; more are taken for a mistake."""


def bindings(
    formula: Formula,
    map: Map,
    ontology: Ontology,
    initial_bindings: Mapping[str, Term] | None = None,
    budget: WorkBudget | None = None,
) -> Iterator[Bindings]:
    """All bindings of the free variables with which the formula holds, each once. They extend `initial_bindings`.

    A variable that occurs only after NOT is not free: `NOT ?x isOn Table1` means that nothing stands on Table1. `budget`: the
    work that this may take, if not `MOST_WORK`.

    Raises:
        FormulaError: the formula has too many alternatives, or no equation gives a variable for values its value.
        ExcessiveWork: the evaluation takes too much work.
    """
    context = QueryContext(map, ontology, budget if budget is not None else WorkBudget(), formula)
    return _Query(context, formula, initial_bindings or {}).answers()


def formula_holds(formula: Formula, map: Map, ontology: Ontology, budget: WorkBudget | None = None) -> bool:
    """Whether the formula holds for at least one binding of its free variables. Raises FormulaError as `bindings` does."""
    return next(bindings(formula, map, ontology, budget=budget), None) is not None


class _Goal(Struct, frozen=True, eq=False):
    """A part of a conjunction, and the variables that must be bound to test it."""

    condition: Condition
    required_variables: tuple[str, ...]


class _Query:
    """One query of one map: the formula's variables, their domains, and the search for bindings. `witnesses`: the variables of the
    quantifiers whose body is queried; they need an object even if the body does not have them."""

    def __init__(
        self, context: QueryContext, formula: Formula, initial_bindings: Mapping[str, Term], witnesses: Iterable[Variable] = ()
    ) -> None:
        self.context, self.map, self.ontology, self.formula = context, context.map, context.ontology, formula
        analysis = context.analysis(formula)
        context.spend(analysis.size)
        self.types, self.objects = dict(analysis.types), set(analysis.objects)
        own = {variable.name: variable for variable in witnesses}
        for name in own.keys() - self.types.keys():
            self.types[name] = own[name].type
            self.objects.add(name)
        self.initial_bindings: Bindings = dict(initial_bindings)
        self.free = tuple(name for name in self.types if name in analysis.affirmed or name in self.initial_bindings or name in own)
        self.impossible = any(name in self.types and not self.admits(name, term) for name, term in self.initial_bindings.items())

    def answers(self) -> Iterator[Bindings]:
        """The bindings, each once. Parts whose variables are all bound are tested only once, for all alternatives of the others."""
        if self.impossible:
            return
        open_parts = [part for part in conjuncts(self.formula) if self._is_open(part)]
        holds = all(self._is_open(part) or self.is_true(part, self.initial_bindings) for part in conjuncts(self.formula))
        if all(name in self.initial_bindings for name in self.free):
            if holds:
                yield dict(self.initial_bindings)
            return
        if math.prod(map(count_alternatives, open_parts)) > ALTERNATIVES:
            problem = f"more than {ALTERNATIVES} combinations of its alternatives"
            raise FormulaError(str(self.formula), 0, problem, "ask with fewer ORs")
        row_keys: set[tuple[Term, ...]] = set()
        branches: Iterable[tuple[Condition, ...]] = alternatives(conjunction(*open_parts)) if open_parts else [()]
        for branch in branches:
            search = _Branch(self, branch, self.free, self.initial_bindings)
            for row in search.search(search.goals, self.initial_bindings) if holds else ():
                key = tuple(row[name] for name in self.free)
                if key not in row_keys:
                    row_keys.add(key)
                    yield row

    def _is_open(self, part: Formula) -> bool:
        return any(name in self.free and name not in self.initial_bindings for name in variables(part))

    # Domains of variables

    def admits(self, variable: str, term: Term) -> bool:
        """Whether the variable may be bound to the term."""
        type_name = self.types.get(variable)
        if variable in self.objects:
            object = self.map.objects.get(term.name) if isinstance(term, Name) else None
            return object is not None and (type_name is None or self.context.is_subtype(object.type, type_name))
        match type_name:
            case None:
                return True
            case "number":
                return isinstance(term, Number)
            case "text":
                return isinstance(term, Text | Name)
            case "truth":
                return isinstance(term, Truth)
        return False

    def domain(self, variable: str) -> list[str]:
        """The names of the objects in the domain of an object variable."""
        return self.context.objects_of(self.types.get(variable))

    # Tests of bound formulas

    def is_true(self, formula: Formula, bound: Bindings) -> bool:
        """Whether the formula, whose free variables are all bound, holds."""
        match formula:
            case And(parts):
                return all(self.is_true(part, bound) for part in parts)
            case Or(parts):
                return any(self.is_true(part, bound) for part in parts)
            case Not(atom):
                if all(name in bound for name in variables(atom)):
                    return not self.is_true(atom, bound)
                inner = _Branch(self, (atom,), tuple(variables(atom)), bound)
                return next(inner.search(inner.goals, bound), None) is None
            case Relation(relation, arguments):
                self.context.spend()
                return self._is_related(relation, tuple(name_of(argument, bound) or "" for argument in arguments))
            case Comparison(left_term, operator, right_term):
                self.context.spend()
                left_value, right_value = self.measure(left_term, bound), self.measure(right_term, bound)
                return left_value is not None and right_value is not None and compare(left_value, operator, right_value)
            case Exists(variable, body):
                return self._has_witness(variable, body, bound)
            case ForAll(variable, _):
                return not self._has_witness(variable, self.context.counterexample(formula, bound), bound)

    def _has_witness(self, variable: Variable, body: Formula, bound: Bindings) -> bool:
        """Whether the body holds for an object in place of the variable."""
        witnesses = {variable.name: variable}
        # One query for all, because an equation within may give a variable its value. A variable of the same name hides the outer one.
        while isinstance(body, Exists) and body.variable.name not in witnesses:
            witnesses[body.variable.name] = body.variable
            body = body.body
        outer = {name: term for name, term in bound.items() if name not in witnesses and name in variables(body)}
        return next(_Query(self.context, body, outer, witnesses.values()).answers(), None) is not None

    def measure(self, term: Term, bound: Bindings) -> MeasuredValue | None:
        return measure(term, self.map, self.ontology, bound)

    def is_symmetric(self, relation: str, arity: int) -> bool:
        relation_type = self.ontology.relations.get(relation)
        return arity == 2 and relation_type is not None and relation_type.symmetric

    def _is_related(self, relation: str, arguments: tuple[str, ...]) -> bool:
        if self.map.has_fact(relation, arguments):
            return True
        return self.is_symmetric(relation, len(arguments)) and self.map.has_fact(relation, arguments[::-1])


class _Branch:
    """A conjunction. The search always takes the part with the fewest possible bindings next.

    Whether the open parts hold for some bindings only depends on the terms of their own variables. So a search that led to nothing is
    remembered by these, and not repeated for other terms of variables that only the closed parts have.
    """

    def __init__(self, query: _Query, conditions: tuple[Condition, ...], free: tuple[str, ...], initial_bindings: Bindings) -> None:
        self.query, self.free, self.initial_bindings = query, free, initial_bindings
        query.context.spend(len(conditions))
        self.goals = [_Goal(condition, tuple(name for name in variables(condition) if name in free)) for condition in conditions]
        self.definitions: dict[str, _Goal] = {}
        for goal in self.goals:
            for variable, term in _equations(goal.condition):
                if not isinstance(term, Variable) and variable not in variables(term):
                    self.definitions.setdefault(variable, goal)
        self._candidates: dict[str, list[str]] = {}
        self._fruitless: set[tuple[tuple[_Goal, ...], tuple[Term | None, ...]]] = set()
        self._require_definitions(initial_bindings)

    def _require_definitions(self, initial_bindings: Bindings) -> None:
        """Raise FormulaError for a variable that stands for a value and that no equation defines."""
        known_variables = {name for name in self.free if name in initial_bindings or name in self.query.objects}
        grown = True
        while grown:
            new = {variable for goal in self.goals for variable, _ in self._definable(goal, known_variables)}
            grown = not new <= known_variables
            known_variables |= new
        for name in self.free:
            if name not in known_variables:
                text = str(self.query.formula)
                raise FormulaError(
                    text, max(text.find(f"?{name}"), 0), f"nothing gives ?{name} a value", f"add an equation, such as ... = ?{name}"
                )

    def _definable(self, goal: _Goal, known_variables: set[str] | Bindings) -> Iterator[tuple[str, Term]]:
        """The unknown variables that the goal can define, each with the term for its value.

        The first equation in the formula defines the value; terms that are equal within tolerance may differ from it.
        """
        for variable, term in _equations(goal.condition):
            if variable in known_variables or not all(name in known_variables for name in variables(term)):
                continue
            definition = self.definitions.get(variable)
            if variable in self.query.objects or definition is goal or (definition is None and isinstance(term, Variable)):
                yield variable, term

    def search(self, goals: list[_Goal], bound: Bindings) -> Iterator[Bindings]:
        """The bindings that extend `bound`, with which all of the goals hold."""
        context = self.query.context
        context.spend(1 + len(goals))
        open_goals = []
        for goal in goals:
            if any(name not in bound for name in goal.required_variables):
                open_goals.append(goal)
            elif not self.query.is_true(goal.condition, bound):
                return
        if open_goals:
            steps = [(cost, index, step) for index, goal in enumerate(open_goals) for cost, step in self._steps(goal, bound)]
        else:
            steps = [(self._possibilities(name), 0, partial(self._enumerate, name, bound)) for name in self.free if name not in bound]
            if not steps:
                yield dict(bound)
                return
        key = tuple(open_goals), tuple(bound.get(name) for goal in open_goals for name in goal.required_variables)
        if key in self._fruitless:
            return
        _, _, step = min(steps, key=lambda step: step[:2])
        work_before, is_fruitless = context.budget.remaining, True
        for extended_bindings in step():
            for row in self.search(open_goals, extended_bindings):
                is_fruitless = False
                yield row
        if is_fruitless and work_before - context.budget.remaining >= REMEMBERED_WORK:
            self._fruitless.add(key)

    def _steps(self, goal: _Goal, bound: Bindings) -> Iterator[tuple[int, partial[Iterator[Bindings]]]]:
        """The search steps that bind variables of the goal, each with its estimated number of results."""
        query = self.query
        for variable, term in self._definable(goal, bound):
            yield 1, partial(self._define, variable, term, bound)
        match goal.condition:
            case Relation(relation, arguments):
                names = [name_of(argument, bound) for argument in arguments]
                yield self._count(relation, names), partial(self._match, relation, arguments, names, bound)
            case _:
                for name in goal.required_variables:
                    if name not in bound and name in query.objects:
                        yield self._possibilities(name) + 1, partial(self._enumerate, name, bound)

    def _define(self, variable: str, term: Term, bound: Bindings) -> Iterator[Bindings]:
        measured = self.query.measure(term, bound)
        if measured is not None and self.query.admits(variable, measured.constant):
            yield {**bound, variable: measured.constant}

    def _enumerate(self, variable: str, bound: Bindings) -> Iterator[Bindings]:
        if variable not in self._candidates:
            self._candidates[variable] = self._filtered(variable)
        for name in self._candidates[variable]:
            yield {**bound, variable: Name(name)}

    def _filtered(self, variable: str) -> list[str]:
        """The objects in the variable's domain for which the goals that only have this variable hold."""
        own_conditions = [
            goal.condition for goal in self.goals if set(goal.required_variables) - self.initial_bindings.keys() == {variable}
        ]
        domain = self.query.domain(variable)
        return [
            name
            for name in domain
            if all(self.query.is_true(condition, {**self.initial_bindings, variable: Name(name)}) for condition in own_conditions)
        ]

    def _possibilities(self, variable: str) -> int:
        return len(self._candidates[variable] if variable in self._candidates else self.query.domain(variable))

    def _count(self, relation: str, names: list[str | None]) -> int:
        facts_with = self.query.map.facts_with
        if self.query.is_symmetric(relation, len(names)):
            fact_counts = [len(facts_with(relation, 0, name)) + len(facts_with(relation, 1, name)) for name in names if name is not None]
        else:
            fact_counts = [len(facts_with(relation, place, name)) for place, name in enumerate(names) if name is not None]
        return min(fact_counts, default=self.query.map.count(relation))

    def _match(self, relation: str, arguments: tuple[Name | Variable, ...], names: list[str | None], bound: Bindings) -> Iterator[Bindings]:
        for tuple_ in dict.fromkeys(self._tuples(relation, names)):
            self.query.context.spend()
            extended_bindings = dict(bound)
            for argument, name in zip(arguments, tuple_, strict=True):
                if isinstance(argument, Name):
                    fits = argument.name == name
                elif argument.name in extended_bindings:
                    fits = extended_bindings[argument.name] == Name(name)
                else:
                    extended_bindings[argument.name] = Name(name)
                    fits = self.query.admits(argument.name, Name(name))
                if not fits:
                    break
            else:
                yield extended_bindings

    def _tuples(self, relation: str, names: list[str | None]) -> Iterator[tuple[str, ...]]:
        """The argument tuples of the relation that may fit the known names."""
        map = self.query.map
        for backwards in (False, True) if self.query.is_symmetric(relation, len(names)) else (False,):
            stored = names[::-1] if backwards else names
            tuple_groups = [map.facts_with(relation, place, name) for place, name in enumerate(stored) if name is not None]
            argument_tuples = min(tuple_groups, key=len) if tuple_groups else [fact.arguments for fact in map.facts(relation)]
            self.query.context.spend(1 + len(argument_tuples) // LISTED)
            for arguments in argument_tuples:
                if len(arguments) == len(names):
                    yield arguments[::-1] if backwards else arguments


def _equations(condition: Condition) -> Iterator[tuple[str, Term]]:
    """The variable and the term of an equation `?w = term`, in both directions."""
    if isinstance(condition, Comparison) and condition.operator == "=":
        for variable, term in ((condition.left, condition.right), (condition.right, condition.left)):
            if isinstance(variable, Variable):
                yield variable.name, term
