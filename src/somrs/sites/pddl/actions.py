"""Converts PDDL actions to service types.

A PDDL action may delete and add the same fact, for example when it drives from a place to the same place. An effect in Entish states what
holds afterwards, so each such case becomes a separate service type, or is excluded if it has no effect. So does each combination of the
conditions of conditional effects.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from somrs.entish import Attribute, Comparison, Formula, Name, Not, Or, Relation, Term, Variable
from somrs.entish.formula import conjunction, conjuncts, disjunction, substitute, substitute_term, variables
from somrs.ontology.map import Map
from somrs.ontology.services import PROVIDER, Parameter, ServiceType
from somrs.sites.pddl.effects import EffectReader, Effects, Setting
from somrs.sites.pddl.formulas import FormulaReader, SymbolTable
from somrs.sites.pddl.kinds import Sorts
from somrs.sites.pddl.names import Names
from somrs.sites.pddl.resolution import MOST_CHOICES, TooManyChoices, Variant, resolve
from somrs.sites.pddl.syntax import Action, Typed
from somrs.sites.pddl.text import Mistakes

MOST_CONDITIONS = 6
"""The maximum number of conditional effects of an action, each of which doubles the number of service types for it. Of more, facts that no
action changes have to decide (`resolution.py`)."""

Equalities = Mapping[str, Term]
"""Variables with the terms that they are equal to."""


Arguments = tuple[Name | Variable, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """A service type with its PDDL action: the action's name, and the term for each of its arguments."""

    service: ServiceType
    action: str
    arguments: tuple[Term, ...]
    agents: Sorts | None
    """The PDDL types that offer it; None when the domain names no agents."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Case:
    """An action, or the case of it in which some variables are equal."""

    precondition: tuple[Formula, ...]
    adds: tuple[Relation, ...]
    deletes: tuple[Relation, ...]
    values: tuple[Setting, ...]
    sorts: Mapping[str, Sorts]
    equalities: Equalities
    apart: tuple[Equalities, ...] = ()
    """The equalities that the precondition excludes."""
    conditions: tuple[Formula, ...] = ()
    """The conditions of conditional effects that hold or fail in this case."""
    number: int = 0
    """The number of this combination of conditions; 0 if the action has no conditional effects."""


class Actions:
    """Makes service types from the actions of one domain."""

    def __init__(self, words: SymbolTable, map: Map, counted: bool) -> None:
        """`counted`: the plan minimises a function, and the cost of an action is what it adds to the function."""
        self.symbols, self.map, self.counted = words, map, counted
        self.services = Names()

    def make_offers(self) -> Iterator[Offer]:
        read: dict[str, tuple[list[Variant], dict[str, tuple[Variable, Sorts]]]] = {}
        for name, action in self.symbols.domain.actions.items():
            mistakes = self.symbols.domain.mistakes
            scope = self._scope(action, mistakes)
            reader = FormulaReader(self.symbols, mistakes, action.word.written, scope)
            precondition = reader.condition(action.precondition) if action.precondition is not None else None
            effects = EffectReader(reader).effects(action.effect) if action.effect is not None else Effects()
            read[name] = self._variants(action, precondition, effects, scope), scope
        for name, (variants, scope) in read.items():
            for variant in variants:
                yield from self._offers(self.symbols.domain.actions[name], variant, scope)

    def _scope(self, action: Action, mistakes: Mistakes) -> dict[str, tuple[Variable, Sorts]]:
        names = Names([PROVIDER])
        scope: dict[str, tuple[Variable, Sorts]] = {}
        for thing in (*([action.agent] if action.agent else []), *action.parameters):
            if not thing.word.text.startswith("?"):
                mistakes.note(thing.word, action.word.written, "syntax", f"{thing.word} is not a variable; parameters begin with ?")
            if thing.name in scope:
                mistakes.note(
                    thing.word, action.word.written, "duplicate", f"{thing.word} is declared twice; give one of the two another name"
                )
            sorts = self.symbols.kinds.sorts(thing)
            if thing is action.agent:
                scope[thing.name] = Variable(PROVIDER, self.symbols.kinds.kind(sorts, thing).type), sorts
            else:
                scope[thing.name] = Variable(names.add(thing.name, thing.written)), sorts
        return scope

    def _offers(self, action: Action, variant: Variant, scope: Mapping[str, tuple[Variable, Sorts]]) -> Iterator[Offer]:
        declared = {scope[thing.name][0].name: thing for thing in (*([action.agent] if action.agent else []), *action.parameters)}
        for number, (conditions, case_effects) in enumerate(variant.effects.cases(), 1):
            parts = (part for formula in conditions for part in conjuncts(formula))
            whole = _Case(
                precondition=tuple(dict.fromkeys((*variant.precondition, *parts))),
                adds=tuple(dict.fromkeys(case_effects.adds)),
                deletes=tuple(dict.fromkeys(case_effects.deletes)),
                values=tuple(case_effects.values.values()),
                sorts={variable.name: sorts for variable, sorts in scope.values()},
                equalities=variant.choice,
                conditions=conditions,
                number=number if conditions else 0,
            )
            cost = case_effects.cost.term if case_effects.cost is not None else None
            for case in () if self._impossible(whole) else self._cases(whole):
                if case.adds or case.deletes or case.values:
                    yield self._offer(action, case, cost, scope, declared)

    def _variants(
        self, action: Action, precondition: Formula | None, effects: Effects, scope: Mapping[str, tuple[Variable, Sorts]]
    ) -> list[Variant]:
        """The action as it is; with too many conditional effects, its variants in which facts decide about the conditions."""
        as_is = Variant(choice={}, precondition=conjuncts(precondition) if precondition is not None else (), effects=effects)
        if effects.count_conditions() <= MOST_CONDITIONS:
            return [as_is]
        try:
            sorts = {variable.name: sorts for variable, sorts in scope.values()}
            variants = [*resolve(precondition, effects, sorts, self.symbols, self.map)]
        except TooManyChoices:
            return self._refuse(action, f"its conditional effects depend on more than {MOST_CHOICES} choices of objects")
        most = max((variant.effects.count_conditions() for variant in variants), default=0)
        if most > MOST_CONDITIONS:
            reason = f"{most} conditional effects are too many, because each combination becomes a service type"
            return self._refuse(action, f"{reason}; at most {MOST_CONDITIONS} are supported")
        return variants

    def _refuse(self, action: Action, reason: str) -> list[Variant]:
        message = f"{reason}; make one action for each case"
        self.symbols.domain.mistakes.unsupported(action.effect or action.word, action.word.written, message)
        return []

    def _offer(
        self, action: Action, case: _Case, cost: Term | None, scope: Mapping[str, tuple[Variable, Sorts]], declared: Mapping[str, Typed]
    ) -> Offer:
        written = action.word.written
        joined = [f"{name}-is-{term.name}" for name, term in case.equalities.items() if isinstance(term, Name | Variable)]
        name = self.services.fresh("-".join([written, *([f"case{case.number}"] if case.number else []), *joined]))
        picked: list[Formula] = []
        inputs: list[Parameter] = []
        provider = Variable(PROVIDER)
        for variable, _ in scope.values():
            if variable.name in case.equalities:
                continue
            kind = self.symbols.kinds.kind(case.sorts[variable.name], declared[variable.name])
            if kind.relation is not None:
                picked.append(Relation(kind.relation, (variable,)))
            if variable.name != PROVIDER:
                inputs.append(Parameter(name=variable.name, type=kind.type))
            else:
                provider = Variable(PROVIDER, kind.type)
        if action.agent is not None:
            picked += self._of_provider(case, picked, action.agent)
        typed = {PROVIDER: provider}
        preconditions = [substitute(formula, typed) for formula in (*case.precondition, *picked)]
        effects = [substitute(formula, typed) for formula in _effect(case)]
        term = substitute_term(substitute_term(cost, case.equalities), {PROVIDER: Variable(PROVIDER)}) if cost is not None else None
        differences = [
            f"?{name} is {substitute_term(equal_term, {PROVIDER: Variable(PROVIDER)})}" for name, equal_term in case.equalities.items()
        ]
        differences += [str(condition) for condition in case.conditions]
        service = ServiceType(
            name=name,
            inputs=tuple(inputs),
            precondition=str(conjunction(*preconditions)) if preconditions else None,
            effect=str(conjunction(*effects)),
            cost=(str(term) if term is not None else "0") if self.counted else None,
            doc=f"The action {written} of PDDL where {' and '.join(differences)}" if differences else "",
        )
        arguments = tuple(substitute_term(variable, case.equalities) for variable, _ in scope.values())
        agents = (self.symbols.kinds.sorts(action.agent) & case.sorts[PROVIDER]) if action.agent is not None else None
        return Offer(service=service, action=written, arguments=arguments, agents=agents)

    def _of_provider(self, case: _Case, picked: list[Formula], agent: Typed) -> Iterator[Formula]:
        """The condition that the provider is an agent of the right type, if no other condition implies it."""
        provider = Variable(PROVIDER)
        if (equal_term := case.equalities.get(PROVIDER)) is not None:
            yield Comparison(provider, "=", equal_term)
        elif not any(PROVIDER in variables(part) for part in (*case.precondition, *_effect(case), *picked)):
            yield Relation(self.symbols.kinds.relation(case.sorts[PROVIDER], agent), (provider,))

    # Cases with equal variables

    def _cases(self, case: _Case) -> Iterator[_Case]:
        case = replace(case, deletes=tuple(atom for atom in case.deletes if atom not in case.adds))
        for first, second in _rivals(case):
            equalities = self._unify(first, second, case.sorts)
            if equalities is None or any(ruled.items() <= equalities.items() for ruled in case.apart):
                continue
            alike = self._alike(case, equalities)
            if self._impossible(alike):
                continue
            differs = disjunction(*(Comparison(self._variable(name, case), "!=", term) for name, term in equalities.items()))
            yield from self._cases(replace(case, precondition=(*case.precondition, differs), apart=(*case.apart, equalities)))
            if _sensible(alike) and not _idle(alike):
                yield from self._cases(alike)
            return
        yield case

    def _variable(self, name: str, case: _Case) -> Term:
        """The variable as it occurs in the effect of the case; the provider includes its type."""
        for formula in _effect(case):
            if name in variables(formula):
                return variables(formula)[name]
        raise AssertionError(name)

    def _unify(self, first: Arguments, second: Arguments, sorts: Mapping[str, Sorts]) -> Equalities | None:
        """The equalities that make the arguments equal (unification); None if they cannot be equal."""
        bindings: dict[str, Name | Variable] = {}

        def stands_for(term: Name | Variable) -> Name | Variable:
            while isinstance(term, Variable) and term.name in bindings:
                term = bindings[term.name]
            return term

        order = [PROVIDER, *sorts]
        possible = dict(sorts)
        for first_term, second_term in zip(first, second, strict=True):
            first_term, second_term = stands_for(first_term), stands_for(second_term)
            if first_term == second_term:
                continue
            representative, replaced = (
                (first_term, second_term)
                if isinstance(first_term, Name)
                or (isinstance(second_term, Variable) and order.index(first_term.name) < order.index(second_term.name))
                else (second_term, first_term)
            )
            if isinstance(replaced, Name) or not (
                common_sorts := self._sorts(representative, possible) & possible[replaced.name] & self.symbols.kinds.inhabited
            ):
                return None
            if isinstance(representative, Variable):
                possible[representative.name] = common_sorts
            bindings[replaced.name] = representative
        return {name: stands_for(term) for name, term in bindings.items()}

    def _sorts(self, term: Name | Variable, sorts: Mapping[str, Sorts]) -> Sorts:
        if isinstance(term, Variable):
            return sorts[term.name]
        return frozenset({self.symbols.types[self.symbols.objects.pddl(term.name)]})

    def _alike(self, case: _Case, equalities: Equalities) -> _Case:
        """The case in which these equalities hold."""
        sorts = dict(case.sorts)
        for name, term in equalities.items():
            if isinstance(term, Variable):
                sorts[term.name] = sorts[term.name] & sorts[name]
        adds = _relations(case.adds, equalities)
        return _Case(
            precondition=tuple(dict.fromkeys(substitute(formula, equalities) for formula in case.precondition)),
            adds=adds,
            deletes=tuple(atom for atom in _relations(case.deletes, equalities) if atom not in adds),
            values=_settings(case.values, equalities),
            sorts=sorts,
            equalities={**{name: substitute_term(term, equalities) for name, term in case.equalities.items()}, **equalities},
            conditions=tuple(substitute(formula, equalities) for formula in case.conditions),
            number=case.number,
        )

    def _impossible(self, case: _Case) -> bool:
        """Whether the precondition is unsatisfiable, judged from itself and from the facts that no action changes."""
        return any(self._is_unsatisfiable(formula, case.precondition) for formula in case.precondition)

    def _is_unsatisfiable(self, formula: Formula, precondition: tuple[Formula, ...]) -> bool:
        match formula:
            case Relation(name, arguments) if name not in self.symbols.changing and name not in self.symbols.kinds.picked:
                return not any(_fits(arguments, fact.arguments) for fact in self.map.facts(name))
            case Not(Relation() as atom):
                return atom in precondition
            case Comparison(left_term, "!=", right_term):
                return left_term == right_term
            case Comparison(Name() as left_term, "=", Name() as right_term):
                return left_term != right_term
            case Or(parts):
                return all(self._is_unsatisfiable(part, precondition) for part in parts)
        return False


def _rivals(case: _Case) -> Iterator[tuple[Arguments, Arguments]]:
    """Pairs of arguments that must differ: of a deleted and an added fact, and of two attributes that are set."""
    for deleted_fact in case.deletes:
        yield from (
            (deleted_fact.arguments, added_fact.arguments) for added_fact in case.adds if added_fact.relation == deleted_fact.relation
        )
    for first, second in combinations(case.values, 2):
        if first.target.path == second.target.path and first.target != second.target:
            yield (first.target.owner,), (second.target.owner,)


def _effect(case: _Case) -> list[Formula]:
    return [*case.adds, *(value.formula for value in case.values), *map(Not, case.deletes)]


def _settings(values: tuple[Setting, ...], equalities: Equalities) -> tuple[Setting, ...]:
    """The new values of the attributes; two increases of the same attribute are added."""
    settings_by_target: dict[Term, list[Setting]] = {}
    for value in values:
        target = substitute_term(value.target, equalities)
        assert isinstance(target, Attribute)
        setting = Setting(target, value.amount.substituted(equalities), value.adds)
        target_settings = settings_by_target.setdefault(target, [])
        if target_settings and (combined := target_settings[-1].combine(setting)) is not None:
            target_settings[-1] = combined
        else:
            target_settings.append(setting)
    return tuple(setting for settings in settings_by_target.values() for setting in settings if setting.amount.parts or not setting.adds)


def _sensible(case: _Case) -> bool:
    """Whether every attribute gets at most one value."""
    return len({value.target for value in case.values}) == len(case.values)


def _relations(atoms: tuple[Relation, ...], equalities: Equalities) -> tuple[Relation, ...]:
    substituted = (substitute(atom, equalities) for atom in atoms)
    return tuple(dict.fromkeys(atom for atom in substituted if isinstance(atom, Relation)))


def _fits(pattern: tuple[Name | Variable, ...], arguments: tuple[str, ...]) -> bool:
    bound: dict[str, str] = {}
    return all(
        term.name == name if isinstance(term, Name) else bound.setdefault(term.name, name) == name
        for term, name in zip(pattern, arguments, strict=True)
    )


def _idle(case: _Case) -> bool:
    """Whether the action changes nothing in this case."""
    return not case.values and not case.deletes and set(case.adds) <= set(case.precondition)
