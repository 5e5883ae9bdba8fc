"""Actions: operators with all their variables bound, and their effects as facts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from somrs.entish import Attribute, Name, Number, Term, Text, Truth, Variable
from somrs.entish.formula import Constant, Literal, substitute, substitute_term
from somrs.ontology.services import PROVIDER, ServiceKind
from somrs.ontology.types import AttributeType, Kind
from somrs.ontology.units import convert_unit
from somrs.ontology.values import attribute_at, constant, measure
from somrs.planner.model.operators import Operator
from somrs.planner.model.vocabulary import EXISTS_SUFFIX, Argument, Fact, Pattern
from somrs.planner.model.world import Binding, World, as_term


@dataclass(frozen=True, slots=True, eq=False)
class Action:
    """An operator with all its variables bound."""

    operator: Operator
    binding: Binding
    preconditions: tuple[Fact, ...]
    add_effects: tuple[Fact, ...]
    delete_effects: tuple[Fact, ...]
    numeric_conditions: tuple[Literal, ...] = ()
    numeric_effects: tuple[tuple[Attribute, Term], ...] = ()

    @property
    def provider(self) -> str | None:
        """The device that has to execute the action, if the service type's formulas use `?Provider`."""
        provider = self.binding.get(PROVIDER)
        return provider if isinstance(provider, str) else None


def added_facts(action: Action, world: World) -> Iterator[Fact]:
    """The facts that the action adds, and those that follow: an object that is on another one is on any."""
    for predicate, arguments in action.add_effects:
        yield predicate, arguments
        if predicate in world.ontology.relations:
            yield predicate + EXISTS_SUFFIX, arguments[:1]


def make_action(operator: Operator, binding: Binding, world: World) -> Action | None:
    """The action with the binding; None if an effect is no valid fact (an object in a place relation to itself, an undefined value), if
    the map settles the choice that it makes, or if a service that tells something tells nothing new."""
    add_effects: list[Fact] = []
    for pattern in operator.add_effects:
        effect = _effect(pattern, binding, world)
        if effect is None:
            return None
        add_effects.append(effect)
    if operator.tells and operator.service is not None:
        if operator.service.kind is not ServiceKind.PHYSICAL:
            add_effects = [fact for fact in add_effects if world.is_open(fact)]
        if not add_effects or world.is_fruitless(operator.service, binding):
            return None

    def ground(pattern: Pattern) -> Fact:
        return world.canonical((pattern[0], _arguments(pattern, binding)))

    preconditions = tuple(dict.fromkeys(map(ground, operator.preconditions)))
    if operator.static_ways:
        if any(world.is_settled(fact, operator) for fact in add_effects):
            return None
        preconditions = tuple(fact for fact in preconditions if not world.is_settled(fact, operator))
    substitution = (
        {name: as_term(value) for name, value in binding.items()} if operator.numeric_conditions or operator.numeric_effects else {}
    )
    numeric_conditions = tuple(substitute(literal, substitution) for literal in operator.numeric_conditions)
    numeric_effects = tuple(
        (substitute_term(target, substitution), substitute_term(source, substitution)) for target, source in operator.numeric_effects
    )
    return Action(
        operator,
        binding,
        preconditions,
        tuple(dict.fromkeys(add_effects)),
        tuple(map(ground, operator.delete_effects)),
        numeric_conditions,  # type: ignore[arg-type]
        numeric_effects,  # type: ignore[arg-type]
    )


def _effect(pattern: Pattern, binding: Binding, world: World) -> Fact | None:
    """The fact that the effect adds; None for an invalid fact (an object in a place relation to itself, an undefined value)."""
    predicate, terms = pattern
    if predicate.startswith("."):
        owner = argument_of(terms[0], binding)
        attribute = attribute_at(predicate[1:], world.ontology)
        value = _value(terms[1], attribute, binding, world)
        fits = isinstance(owner, str) and value is not None and world.has_attribute(owner, predicate[1:])
        return (predicate, (owner, value)) if fits and owner is not None and value is not None else None
    arguments = _arguments(pattern, binding)
    if predicate not in world.ontology.relations:
        return predicate, arguments
    for name in arguments:
        if name not in world.map.objects:
            return None
    if len(set(arguments)) < len(arguments) and not _with_itself(predicate, world):
        return None
    return world.canonical((predicate, arguments))


def _with_itself(predicate: str, world: World) -> bool:
    """Whether an object may have the relation to itself: not in functional, symmetric or exclusive relations, such as places."""
    relation = world.ontology.relations.get(predicate)
    return relation is not None and not (relation.functional or relation.symmetric or relation.excludes)


def _value(term: Argument | Term, attribute: AttributeType | None, binding: Binding, world: World) -> Constant | None:
    """The new value of the attribute, in the attribute's unit; None if it is undefined or out of range."""
    if isinstance(term, Constant):
        terms: Mapping[str, Term] = {}  # it reads no variable
    else:
        terms = {name: as_term(value) for name, value in binding.items()}
    measured = measure(term, world.map, world.ontology, terms) if not isinstance(term, str) else None
    if measured is None or attribute is None:
        return None
    match attribute.kind, measured.constant:
        case Kind.NUMBER, Number(value, unit):
            number = value if unit is None or attribute.unit is None else convert_unit(value, unit, attribute.unit)
            is_in_range = number is not None and _at_least(number, attribute.minimum) and _at_least(attribute.maximum, number)
            return constant(number, attribute) if number is not None and is_in_range else None
        case Kind.TRUTH, Truth() as truth:
            return truth
        case Kind.TEXT, Text() as text:
            return text
        case Kind.ENUMERATION, (Name(word) | Text(word)):
            return Name(word) if not attribute.values or word in attribute.values else None
    return None


def _arguments(pattern: Pattern, binding: Binding) -> tuple[Argument, ...]:
    """The arguments of the pattern whose variables are bound."""
    arguments = [argument_of(term, binding) for term in pattern[1]]
    return tuple([argument for argument in arguments if argument is not None])


def argument_of(term: Argument | Term, binding: Binding) -> Argument | None:
    """The argument that a term of a pattern stands for; None while its variable is not bound."""
    if isinstance(term, Variable):
        return binding.get(term.name)
    assert isinstance(term, (str, Constant))
    return term


def _at_least(number: float | None, least: float | None) -> bool:
    return number is None or least is None or number >= least
