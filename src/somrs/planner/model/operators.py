"""Service types as operators: preconditions, add effects and delete effects, all as facts (`vocabulary.py`).

Formulas are compiled here; how operators apply to the objects of a map is in `grounding/`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass

from somrs.entish import Arithmetic, Attribute, Comparison, Formula, Name, Not, Relation, Term, Variable
from somrs.entish.formula import Literal, conjuncts, names, terms, variables, with_types
from somrs.entish.normal_form import has_quantifiers
from somrs.entish.parse import parse
from somrs.ontology.effects import vague_problem
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.types import ROOT
from somrs.ontology.values import attribute_at
from somrs.planner.model.choices import ALTERNATIVES, Alternative, TooManyAlternatives, split
from somrs.planner.model.reading import found_in, outputs_in_effect, tells
from somrs.planner.model.vocabulary import EXISTS_SUFFIX, GOAL, KNOWN, Inexpressible, Pattern, Vocabulary, providers_of, strip_type


@dataclass(frozen=True, slots=True)
class Test:
    """A comparison with attributes that services change. The `hidden` variables stand for their values; each has a tolerance."""

    comparison: Comparison
    hidden: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class NegativePrecondition:
    """No fact may match the pattern (with a test: no fact whose hidden value passes it). Variables that only occur here stand for any
    object."""

    pattern: Pattern
    test: Test | None = None


@dataclass(frozen=True, slots=True)
class StaticWays:
    """The alternatives of a choice about which the map alone decides, each as literals; `names` are the variables of its arguments."""

    names: tuple[str, ...]
    ways: tuple[tuple[Literal, ...], ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Operator:
    """A service type with one alternative of its precondition; or, without a service, one alternative of the goal or of a choice."""

    service: ServiceType | None
    condition: tuple[Formula, ...]
    """The alternative as written."""
    effect: Formula | None
    preconditions: tuple[Pattern, ...]
    negative_preconditions: tuple[NegativePrecondition, ...]
    tests: tuple[Test, ...]
    static_conditions: tuple[Literal, ...]
    add_effects: tuple[Pattern, ...]
    delete_effects: tuple[Pattern, ...]
    numeric_conditions: tuple[Literal, ...]
    """Comparisons of counters."""
    numeric_effects: tuple[tuple[Attribute, Term], ...]
    """The counters that the operator assigns, with their new values."""
    types: Mapping[str, frozenset[str]]
    """For each variable, the types that its value must all have."""
    variables: tuple[str, ...]
    """The variables to bind, with `Provider` if the formulas use it."""
    static_ways: Mapping[str, StaticWays]
    """For each choice that it needs or makes and that may hold on the map whatever services do, by predicate."""
    tells: bool = False
    """Whether the result of the service is known only when it is done; the add effects are then what the plan assumes."""
    found_values: Mapping[str, str]
    """For each variable that stands for a value that the service finds out, the path of the attribute."""

    @property
    def static_literals(self) -> tuple[Literal, ...]:
        """What the operator needs, or may need, of the map that no service changes."""
        ways = (literal for static_ways in self.static_ways.values() for way in static_ways.ways for literal in way)
        return (*self.static_conditions, *ways)

    @property
    def reaches_goal(self) -> bool:
        return GOAL in self.add_effects

    @property
    def is_choice(self) -> bool:
        return self.service is None and not self.reaches_goal


def operators(service: ServiceType, vocabulary: Vocabulary) -> Iterator[Operator]:
    """The operators of a service type; none if its result is known only when it is done, and the reading assumes nothing. Raises
    Inexpressible."""
    inputs = {parameter.name: parameter.type for parameter in service.inputs}
    outputs = {parameter.name: parameter.type for parameter in service.outputs if parameter.name in outputs_in_effect(service)}
    effect = with_types(parse(service.effect), inputs | outputs)
    precondition = with_types(parse(service.start_condition), inputs) if service.start_condition is not None else None
    formula_variables = {**variables(effect), **(variables(precondition) if precondition is not None else {})}
    if PROVIDER in formula_variables:
        inputs[PROVIDER] = providers_of(service.name)
    compiling = _Compiling(vocabulary, service.name)
    for parts in outcomes(service, effect, vocabulary):
        yield from compiling.operators(precondition, _Result(service, effect, parts), inputs)


def outcomes(service: ServiceType, effect: Formula, vocabulary: Vocabulary) -> Iterable[tuple[Formula, ...]]:
    """The alternatives of what the service may bring about or tell, each as parts of an effect."""
    if not tells(service):
        return [conjuncts(effect)]
    return vocabulary.reading.outcomes(service, effect, vocabulary.ontology) if vocabulary.reading is not None else []


def goal_operators(goal: Formula, vocabulary: Vocabulary) -> Iterator[Operator]:
    """One operator for each alternative of the goal, which adds `GOAL`, and the operators of its choices. Raises Inexpressible."""
    yield from _Compiling(vocabulary, "the goal").operators(goal, _Result(added=(GOAL,)), {})


@dataclass(frozen=True, slots=True)
class _Result:
    """What an operator brings about: the `parts` of one outcome of a service, or facts of the planner's own."""

    service: ServiceType | None = None
    effect: Formula | None = None
    parts: tuple[Formula, ...] = ()
    added: tuple[Pattern, ...] = ()


class _Compiling:
    """Compiles the operators of one service type or goal, whose name is `subject`."""

    def __init__(self, vocabulary: Vocabulary, subject: str) -> None:
        self.vocabulary, self.subject = vocabulary, subject
        self._choices: dict[Formula, Pattern] = {}
        self._static_ways: dict[str, StaticWays] = {}

    def operators(self, condition: Formula | None, result: _Result, inputs: Mapping[str, str]) -> Iterator[Operator]:
        """The operators of the condition's alternatives, and those of their choices."""
        given = {*inputs, *(name for part in result.parts for name in variables(part))}
        made = next((predicate for predicate, _ in result.added), "")
        for alternative in self._split(condition, given):
            if made in self._static_ways and alternative.literals in self._static_ways[made].ways:
                continue
            shared = {*given, *(name for literal in alternative.literals for name in variables(literal))}
            new = [choice for choice in alternative.choices if choice not in self._choices]
            choices = [self._choice(choice, shared) for choice in alternative.choices]
            static_ways = {name: self._static_ways[name] for name in (made, *(c[0] for c in choices)) if name in self._static_ways}
            yield _Compiler(self.vocabulary, inputs, result).operator(alternative, choices, static_ways)
            for choice in new:
                arguments = [variable for name, variable in variables(choice).items() if name in shared]
                types = {variable.name: inputs.get(variable.name) or variable.type or ROOT for variable in arguments}
                yield from self.operators(choice, _Result(added=(self._choices[choice],)), types)

    def _split(self, condition: Formula | None, given: Collection[str]) -> list[Alternative]:
        if condition is None:
            return [Alternative(())]
        if has_quantifiers(condition):
            raise Inexpressible(condition, "its quantifiers cannot be expanded over objects")
        try:
            return split(condition, given)
        except TooManyAlternatives:
            raise Inexpressible(condition, f"it has more than {ALTERNATIVES} alternatives") from None

    def _choice(self, choice: Formula, shared: Collection[str]) -> Pattern:
        """The fact that stands for the choice. Its arguments are the variables that occur elsewhere, too."""
        if choice in self._choices:
            return self._choices[choice]
        names = tuple(name for name in variables(choice) if name in shared)
        pattern = f"choice {len(self._choices) + 1} of {self.subject}", tuple(map(Variable, names))
        self._choices[choice] = pattern
        if ways := tuple(alternative.literals for alternative in self._split(choice, names) if self._is_static(alternative, names)):
            self._static_ways[pattern[0]] = StaticWays(names, ways)
        return pattern

    def _is_static(self, alternative: Alternative, names: Collection[str]) -> bool:
        """Whether the map alone says whether the alternative holds for the objects with these names."""
        reading = self.vocabulary.reading
        if alternative.choices or (reading is not None and reading.unknown):
            return False
        bound = {name for literal in alternative.literals if not isinstance(literal, Not) for name in variables(literal)}
        return bound <= set(names) and all(map(self.vocabulary.is_static, alternative.literals))


class _Compiler:
    """Compiles one operator."""

    def __init__(self, vocabulary: Vocabulary, inputs: Mapping[str, str], result: _Result) -> None:
        self.vocabulary, self.inputs, self.result = vocabulary, inputs, result
        self.tells = result.service is not None and tells(result.service)
        self._occurrences: Counter[str] = Counter(inputs.keys())
        self.preconditions: dict[Pattern, None] = {}
        self.negative_preconditions: list[NegativePrecondition] = []
        self.tests: list[Test] = []
        self.static_conditions: list[Literal] = []
        self.add_effects: list[Pattern] = []
        self.delete_effects: list[Pattern] = []
        self.numeric_conditions: list[Literal] = []
        self.numeric_effects: list[tuple[Attribute, Term]] = []
        self.types: dict[str, frozenset[str]] = {}
        self.found_values: dict[str, str] = {}

    def operator(self, alternative: Alternative, choices: Iterable[Pattern], static_ways: Mapping[str, StaticWays]) -> Operator:
        """The operator with one alternative of its condition. It needs the `choices`."""
        for part in (*alternative.literals, *self.result.parts):
            self._occurrences.update(term.name for term in terms(part) if isinstance(term, Variable))
            self._note_types(part)
        for pattern in choices:
            self._occurrences.update(argument.name for argument in pattern[1] if isinstance(argument, Variable))
            self.preconditions[pattern] = None
        for name, type_name in self.inputs.items():
            self._note(name, type_name)
        for literal in alternative.literals:
            self._condition(literal)
        for part in self.result.parts:
            self._effect(part)
        self._knowledge(alternative.literals, self.result.parts)
        self.add_effects.extend(self.result.added)
        return Operator(
            service=self.result.service,
            condition=(*alternative.literals, *alternative.choices),
            effect=self.result.effect,
            preconditions=tuple(self.preconditions),
            negative_preconditions=tuple(self.negative_preconditions),
            tests=tuple(self.tests),
            static_conditions=tuple(self.static_conditions),
            add_effects=tuple(self.add_effects),
            delete_effects=tuple(self.delete_effects),
            numeric_conditions=tuple(self.numeric_conditions),
            numeric_effects=tuple(self.numeric_effects),
            types=self.types,
            variables=tuple(dict.fromkeys([*self.inputs, *self._to_bind()])),
            static_ways=static_ways,
            tells=self.tells,
            found_values=self.found_values,
        )

    def _to_bind(self) -> Iterator[str]:
        """The variables that grounding binds: not those that occur only after NOT, nor those that `EXISTS_SUFFIX` replaced."""
        for _, arguments in (*self.preconditions, *self.add_effects, *self.delete_effects):
            for argument in arguments:
                if not isinstance(argument, str):
                    yield from variables(argument)
        for literal in (*self.static_conditions, *self.numeric_conditions, *(test.comparison for test in self.tests)):
            if not isinstance(literal, Not):
                yield from variables(literal)
        for target, source in self.numeric_effects:
            yield from (*variables(target), *variables(source))

    def _note(self, name: str, type_name: str) -> None:
        self.types[name] = self.types.get(name, frozenset()) | {type_name}

    def _note_types(self, part: Formula) -> None:
        atom = part.atom if isinstance(part, Not) else part
        for variable in variables(part).values():
            if variable.type is not None:
                self._note(variable.name, variable.type)
        if isinstance(atom, Relation) and (relation := self.vocabulary.ontology.relations.get(atom.relation)):
            for argument, joined in zip(atom.arguments, relation.joins, strict=False):
                if isinstance(argument, Variable) and not isinstance(part, Not):
                    self._note(argument.name, joined)

    # Preconditions

    def _condition(self, literal: Literal) -> None:
        match literal:
            case Relation(name) if name in self.vocabulary.relations:
                existential = self._existential_pattern(literal)
                self.preconditions[existential if existential is not None else self._pattern(literal)] = None
            case Not(Relation(name) as atom) if name in self.vocabulary.relations:
                self.negative_preconditions.append(NegativePrecondition(self._pattern(atom)))
            case Comparison() | Not(Comparison()) if any(self.vocabulary.counter(term) is not None for term in terms(literal)):
                self.numeric_conditions.append(literal)
            case Comparison() as comparison:
                self._comparison(comparison)
            case Not(Comparison() as comparison):
                self._negated_comparison(literal, comparison)
            case _:
                self.static_conditions.append(literal)

    def _comparison(self, comparison: Comparison) -> None:
        test, patterns = self._with_hidden(comparison)
        if test is None:
            self.static_conditions.append(comparison)
        else:
            self.tests.append(test)
            self.preconditions.update(dict.fromkeys(patterns))

    def _negated_comparison(self, literal: Not, comparison: Comparison) -> None:
        test, patterns = self._with_hidden(comparison)
        if test is None:
            self.static_conditions.append(literal)
        elif len(patterns) == 1:
            self.negative_preconditions.append(NegativePrecondition(patterns[0], test))
        else:
            raise Inexpressible(literal, "NOT before a comparison of two attributes that services change")

    def _with_hidden(self, comparison: Comparison) -> tuple[Test | None, list[Pattern]]:
        """The comparison with hidden variables in place of changing attributes, and the patterns of the facts that bind them."""
        hidden: dict[str, float] = {}
        patterns: list[Pattern] = []
        left, right = (self._hide(term, hidden, patterns) for term in (comparison.left, comparison.right))
        return (Test(Comparison(left, comparison.operator, right), hidden) if hidden else None), patterns

    def _hide(self, term: Term, hidden: dict[str, float], patterns: list[Pattern]) -> Term:
        """The term with hidden variables in place of changing attributes. Adds their tolerances to `hidden`, and the patterns of the facts
        that bind them to `patterns`."""
        if isinstance(term, Arithmetic):
            return Arithmetic(self._hide(term.left, hidden, patterns), term.operator, self._hide(term.right, hidden, patterns))
        attribute = self.vocabulary.changing(term)
        if attribute is None:
            return term
        variable = Variable(str(attribute))  # no other variable has a dot in its name
        attribute_type = attribute_at(attribute.path, self.vocabulary.ontology)
        hidden[variable.name] = attribute_type.tolerance if attribute_type else 0.0
        patterns.append(("." + attribute.path, (strip_type(attribute.owner), variable)))
        return variable

    def _existential_pattern(self, atom: Relation) -> Pattern | None:
        """`isOn *` in place of `?Object isOn ?Source`, if ?Source occurs nowhere else; else None."""
        relation = self.vocabulary.ontology.relations.get(atom.relation)
        if relation is None or not relation.functional or not self.vocabulary.is_exclusive(atom.relation):
            return None
        for argument, joined in zip(atom.arguments[1:], relation.joins[1:], strict=True):
            if not isinstance(argument, Variable) or self._occurrences[argument.name] != 1:
                return None
            if argument.type is not None and not self.vocabulary.ontology.is_subtype(joined, argument.type):
                return None
        return atom.relation + EXISTS_SUFFIX, (strip_type(atom.arguments[0]),)

    def _pattern(self, atom: Relation) -> Pattern:
        return atom.relation, tuple(map(strip_type, atom.arguments))

    # Knowledge

    def _knowledge(self, precondition: tuple[Literal, ...], parts: tuple[Formula, ...]) -> None:
        """Objects that are unknown in the reading have to be known before the operator uses them, but for those that it finds or makes."""
        reading, ontology = self.vocabulary.reading, self.vocabulary.ontology
        if reading is None or not reading.unknown:
            return
        found = {strip_type(owner) for owner in found_in(parts, ontology)} | reading.fresh if self.tells else set()
        mentioned = {name for part in (*precondition, *parts) for name in names(part)}
        for name in sorted(mentioned & reading.unknown_objects.keys() - found):
            self.preconditions[KNOWN, (name,)] = None
        for name in dict.fromkeys([*self.inputs, *self._to_bind()]):
            types, variable = self.types.get(name, frozenset()), Variable(name)
            if variable in found:  # an output cannot be looked for
                fresh = (object for object, type in reading.unknown if object in reading.fresh and self._fits(type, types))
                self.static_conditions += [Not(Comparison(variable, "=", Name(object))) for object in fresh]
            elif any(self._fits(type, types) for type in reading.unknown_objects.values()):
                self.preconditions[KNOWN, (variable,)] = None
        if self.tells:
            own = [name for name in reading.unknown_objects if name in mentioned and name in reading.fresh]
            for name in own:  # each stands for the output of one use, and the uses are counted in their order
                self.negative_preconditions.append(NegativePrecondition((KNOWN, (name,))))
                if (before := reading.predecessor(name)) is not None:
                    self.preconditions[KNOWN, (before,)] = None
            self.add_effects += [(KNOWN, (argument,)) for argument in dict.fromkeys([*own, *sorted(found - reading.fresh, key=str)])]

    def _fits(self, type: str, types: frozenset[str]) -> bool:
        """Whether an object of the type may be one of all these types. No unknown object is a provider or a value."""
        return all(name in self.vocabulary.ontology.types and self.vocabulary.ontology.is_subtype(type, name) for name in types)

    # Effects

    def _effect(self, part: Formula) -> None:
        if (vague := vague_problem(part)) is not None:
            raise Inexpressible(part, vague[0])
        match part:
            case Relation():
                self.add_effects.append(self._pattern(part))
            case Not(Relation() as atom):
                self.delete_effects.append(self._pattern(atom))
            case Comparison(Attribute(_, path) as target, "=", source) if path in self.vocabulary.counters:
                self.numeric_effects.append((target, source))
            case Comparison(source, "=", Attribute(_, path) as target) if path in self.vocabulary.counters:
                self.numeric_effects.append((target, source))
            case Comparison(Attribute() as target, "=", source) | Comparison(source, "=", Attribute() as target):
                patterns: list[Pattern] = []
                if self.tells and isinstance(source, Variable) and source.name not in self.inputs:
                    self.found_values[source.name] = target.path
                new_value = self._hide(source, {}, patterns)
                self.preconditions.update(dict.fromkeys(patterns))
                self.add_effects.append(("." + target.path, (strip_type(target.owner), new_value)))
