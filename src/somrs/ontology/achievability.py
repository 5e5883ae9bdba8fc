"""Which parts of a goal no service could ever bring about, by the effects and the conditions of services alone: no plan is searched for."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from msgspec import Struct

from somrs.entish.formula import (
    And,
    Attribute,
    Comparison,
    Exists,
    ForAll,
    Formula,
    Literal,
    Name,
    Not,
    Or,
    Relation,
    Term,
    Variable,
    alternatives,
    conjunction,
    count_alternatives,
    names,
    substitute,
    terms,
    variables,
)
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.map import Map
from somrs.ontology.matching import types_of, unifiers
from somrs.ontology.services import PROVIDER, ServiceKind, ServiceType
from somrs.ontology.truth import bindings
from somrs.ontology.types import Ontology
from somrs.ontology.values import attribute_at, constant, value_of
from somrs.ontology.work_budget import WorkBudget

DEPTH = 3
"""The number of services in a row of which each would have to bring about a condition of the next."""
ALTERNATIVES = 100
"""The number of alternatives of a precondition up to which its conditions are examined."""
EXAMPLES = 3
"""The number of objects to name that would do in place of one that does not."""


class Hindrance(Struct, frozen=True):
    """A condition of a service that does not hold and that nothing changes. `need` also says what is so, `remedy` what would help."""

    condition: str
    need: str
    remedy: str = ""


class Unachievable(Struct, frozen=True):
    """A part of a goal that does not hold and that no service brings about, and why. `reason` is empty if no service has such an effect
    on any object; `remedy` is empty if nothing in particular would help."""

    literal: Literal
    reason: str
    remedy: str = ""


@dataclass(frozen=True)
class Achievability:
    """Which facts these services could bring about on a map. `providers`: the devices that offer each service type, by its name; without
    an entry, any object may be the provider.

    What is called achievable need not be so: the conditions of a service are examined one by one, as far as no service changes them.
    """

    services: Collection[ServiceType]
    ontology: Ontology
    map: Map
    providers: Mapping[str, Collection[str]]
    _known: dict[tuple[Literal, int], bool] = field(init=False, repr=False, compare=False, default_factory=dict)
    """Whether a literal could become true, by the number of services in a row."""
    _budget: WorkBudget = field(init=False, repr=False, compare=False, default_factory=WorkBudget)
    """For all questions together: what is too much to find out is taken to be possible."""

    def unachievable_parts(self, goal: Formula) -> Iterator[Unachievable]:
        """The parts without which the goal cannot hold, and that no service brings about; none for an OR with an achievable alternative,
        and none of what holds."""
        if self._holds(goal):
            return
        match goal:
            case And(parts):
                for part in parts:
                    yield from self.unachievable_parts(part)
            case Or(parts):
                of_each = [[*self.unachievable_parts(part)] for part in parts]
                if all(of_each):
                    yield from of_each[0]
            case ForAll(_, body) | Exists(_, body):
                yield from self.unachievable_parts(body)
            case literal:
                if not self.is_achievable(literal):
                    yield self._explained(literal)

    def is_achievable(self, literal: Literal) -> bool:
        """Whether a service could bring the literal about."""
        return any(self.could_use(service, literal) for service in self.services)

    def could_use(self, service: ServiceType, literal: Literal) -> bool:
        """Whether this service could bring the literal about. A service that recognises relations does not bring them about."""
        is_relation = isinstance(literal.atom if isinstance(literal, Not) else literal, Relation)
        return not (is_relation and service.kind is ServiceKind.COGNITIVE) and self._can_bring_about(service, literal, DEPTH)

    def hindrance(self, service: ServiceType, literal: Literal) -> Hindrance | None:
        """Why a service whose effect fits never brings the literal about: its first condition that cannot hold. None if it could, or if
        its effect does not fit."""
        hindrances = [self._hindrance(service, unifier, literal, DEPTH) for unifier in self._unifiers(service, literal)]
        return hindrances[0] if hindrances and None not in hindrances else None

    def _explained(self, literal: Literal) -> Unachievable:
        physical = [service for service in self.services if service.kind is ServiceKind.PHYSICAL]
        order = [*self.ontology.services]
        physical.sort(key=lambda service: order.index(service.name) if service.name in order else len(order))
        hindrances = {service.name: hindrance for service in physical if (hindrance := self.hindrance(service, literal)) is not None}
        if hindrances:
            return Unachievable(literal, hindrance_text(hindrances), next(iter(hindrances.values())).remedy)
        fitting = (reason for service in physical for reason in misfits(service, literal, self.ontology, self.map))
        return Unachievable(literal, next(fitting, ""))

    def _holds(self, formula: Formula) -> bool:
        """Whether the formula holds for some objects; also where a query cannot tell because an input that is a value is open."""
        try:
            return next(bindings(formula, self.map, self.ontology, budget=self._budget), None) is not None
        except FormulaError:
            return True

    def _unifiers(self, service: ServiceType, literal: Literal) -> Iterator[dict[str, Term]]:
        return unifiers(parse(service.effect), literal, self.ontology, types_of(service, self.ontology), self.map)

    def _can_bring_about(self, service: ServiceType, literal: Literal, depth: int) -> bool:
        return any(depth == 0 or self._hindrance(service, unifier, literal, depth) is None for unifier in self._unifiers(service, literal))

    def _can_become_true(self, literal: Literal, depth: int) -> bool:
        """Whether any service, of whatever kind, could make the literal true, or find out that it is."""
        key = literal, depth
        if key not in self._known:
            self._known[key] = any(self._can_bring_about(service, literal, depth) for service in self.services)
        return self._known[key]

    def _hindrance(self, service: ServiceType, unifier: Mapping[str, Term], literal: Literal, depth: int) -> Hindrance | None:
        """A condition of the service, as the unifier has it, that cannot hold in the first alternative of its precondition; None if there
        is an alternative without one."""
        condition = self._condition(service, unifier)
        if condition is None or count_alternatives(condition) > ALTERNATIVES:
            return None
        first: Hindrance | None = None
        for branch in alternatives(condition):
            fixed = [part for part in branch if isinstance(part, Literal) and not self._can_become_true(part, depth - 1)]
            if not fixed or any(self._hold_together(fixed, provider) for provider in self._possible_providers(service, unifier)):
                return None
            first = first or self._describe(service, unifier, fixed, literal)
        return first

    def _condition(self, service: ServiceType, unifier: Mapping[str, Term]) -> Formula | None:
        """What has to hold when the service starts; its inputs are bound as far as the unifier binds them. None: nothing that is known
        before the service has given its outputs."""
        if service.start_condition is None:
            return None
        condition = parse(service.start_condition)
        if any(output.name in variables(condition) for output in service.outputs):
            return None
        inputs = {input.name: Variable(input.name, input.type) for input in service.inputs if input.type in self.ontology.types}
        taken = {term.name for term in unifier.values() if isinstance(term, Variable)}
        others = {name: Variable(f"{name}'", variable.type) for name, variable in variables(condition).items() if name in taken}
        return substitute(condition, others | inputs | dict(unifier))

    def _possible_providers(self, service: ServiceType, unifier: Mapping[str, Term]) -> Iterable[str | None]:
        """The devices with which the conditions are tried; None: whatever object."""
        return (None,) if PROVIDER in unifier else self.providers.get(service.name, (None,))

    def _hold_together(self, parts: Collection[Literal], provider: str | None) -> bool:
        condition = conjunction(*parts)
        return self._holds(condition if provider is None else substitute(condition, {PROVIDER: Name(provider)}))

    # Words

    def _describe(self, service: ServiceType, unifier: Mapping[str, Term], fixed: Collection[Literal], literal: Literal) -> Hindrance:
        single = [part for part in fixed if not self._holds(part)]
        condition = single[0] if single else conjunction(*fixed)
        if not isinstance(condition, Literal):
            return Hindrance(str(condition), str(condition))
        value = present_value(condition, self.ontology, self.map)
        sorts = [variable.type for variable in variables(condition).values() if variable.type is not None]
        value = value or (f"that holds for no {' and '.join(sorts)}" if sorts else "")
        bare = str(_without_types(condition))
        return Hindrance(bare, f"{bare}, and {value}" if value else bare, self._remedy(service, unifier, condition, literal))

    def _remedy(self, service: ServiceType, unifier: Mapping[str, Term], condition: Literal, literal: Literal) -> str:
        """Text for the other objects that meet a condition of one object. Those come first that are in such a fact already."""
        subjects = [name for name in names(condition) if name in self.map.objects]
        role = next((input for input in service.inputs if [unifier.get(input.name)] == [Name(name) for name in subjects]), None)
        if role is None or not isinstance(condition, Comparison) or variables(condition):
            return ""
        other = Variable(role.name, role.type)
        left, right = (_with_owner(side, other) for side in (condition.left, condition.right))
        wanted = Comparison(left, condition.operator, right)
        fitting = {term.name: None for row in bindings(wanted, self.map, self.ontology) if isinstance(term := row.get(role.name), Name)}
        in_use = self._in_such_facts(literal, Name(subjects[0]))
        ordered = sorted(fitting, key=lambda name: name not in in_use)
        rest = f" and {len(ordered) - EXAMPLES} more" if len(ordered) > EXAMPLES else ""
        examples = f"it holds for {', '.join(ordered[:EXAMPLES])}{rest}; " if ordered else ""
        return f"{examples}if it holds for {subjects[0]}, too, correct the map"

    def _in_such_facts(self, literal: Literal, subject: Name) -> set[str]:
        """The objects that are in the place of the subject in facts of the literal's relation."""
        if not isinstance(literal, Relation) or subject not in literal.arguments:
            return set()
        return set(self.map.objects_at(literal.relation, literal.arguments.index(subject)))


def hindrance_text(hindrances: Mapping[str, Hindrance]) -> str:
    """Text for the condition of the first service type, and of those with the same."""
    first = next(iter(hindrances.values()))
    services = [name for name, hindrance in hindrances.items() if hindrance.need == first.need]
    return f"{' and '.join(services)} need{'s' if len(services) == 1 else ''} {first.need}"


def present_value(condition: Literal, ontology: Ontology, map: Map) -> str:
    """Text for the value of the attribute that the condition compares, and for its meaning; empty without a value."""
    attribute = next((term for term in terms(condition) if isinstance(term, Attribute)), None)
    object = map.objects.get(attribute.owner.name) if attribute is not None and isinstance(attribute.owner, Name) else None
    if attribute is None or object is None:
        return ""
    value, definition = value_of(object.name, attribute.path, map, ontology), attribute_at(attribute.path, ontology)
    if value is None:
        return ""
    default = f", by default for a {object.type}" if attribute.path not in object.values else ""
    meaning = f" ({attribute.path}: {definition.doc[0].lower()}{definition.doc[1:]})" if definition is not None and definition.doc else ""
    return f"it is {constant(value, definition)}{default}{meaning}"


def _without_types(literal: Literal) -> Formula:
    return substitute(blank_variables(literal), {name: Variable(name) for name in variables(literal)})


def _with_owner(side: Term, owner: Variable) -> Term:
    return Attribute(owner, side.path) if isinstance(side, Attribute) else side


def blank_variables(literal: Literal) -> Formula:
    """The literal with `?` in place of untyped variables."""
    return substitute(literal, {name: Name("?") for name, variable in variables(literal).items() if variable.type is None})


def misfits(service: ServiceType, literal: Literal, ontology: Ontology, map: Map) -> Iterator[str]:
    """Texts for the inputs whose type does not admit the literal's objects, where the service brings such things about for others."""
    if service.kind is not ServiceKind.PHYSICAL:
        return
    types = {parameter.name: parameter.type for parameter in service.inputs}
    for unifier in unifiers(parse(service.effect), literal, ontology, types):
        objects = {name: map.objects.get(term.name) for name, term in unifier.items() if isinstance(term, Name)}
        for name, object in objects.items():
            if object is not None and name in types and not ontology.is_subtype(object.type, types[name]):
                yield f"{service.name} takes only a {types[name]} as its {name}, and {object.name} is a {object.type}"
