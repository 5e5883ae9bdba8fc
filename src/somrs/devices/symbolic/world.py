"""The truth of a site as facts. A service is done only if its precondition holds here, whatever the map in the Repository says."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from somrs.entish import Attribute, Comparison, Formula, Name, Not, Number, Relation, Term, Truth, Variable
from somrs.entish.formula import conjunction, conjuncts, literals, substitute, variables, with_types
from somrs.entish.parse import parse, parse_term
from somrs.errors import FormulaError
from somrs.ontology.effects import changes
from somrs.ontology.files.loading import upper
from somrs.ontology.objects import Change, Fact, FactAdded, Map
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.truth import bindings, formula_holds
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.ontology.values import measure
from somrs.service_manager.sdk.values import term

Inputs = Mapping[str, str]
"""A service's inputs, as an order has them: Entish terms by name."""

Happens = Callable[[Sequence[Change]], Iterable[Change]]
"""Which of the changes that a service makes come about, when it fails on the way."""


class _Refused(Exception):
    """The service cannot be done as the world is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Deed:
    """A service that was done, whole or in part, and what it changed."""

    service: str
    inputs: dict[str, str]
    provider: str
    changes: tuple[Change, ...]
    whole: bool = True


class SymbolicWorld:
    """One world. `deeds` is what was done in it, `rejected` what could not be, each with the reason, both in order."""

    def __init__(self, ontology: Ontology, map: Map) -> None:
        self.ontology, self.map = ontology, map
        self.deeds: list[Deed] = []
        self.rejected: list[str] = []
        effects = [parse(service.effect) for service in ontology.services.values()]
        self._changing = {part.relation for effect in effects for part in _atoms(effect) if isinstance(part, Relation)}
        sides = [side for effect in effects for part in _atoms(effect) if isinstance(part, Comparison) for side in (part.left, part.right)]
        self._set = {side.path for side in sides if isinstance(side, Attribute)}
        self._once: dict[Fact, None] = dict.fromkeys(fact for fact in map.facts() if fact.relation in self._changing)

    def perform(self, service: str, inputs: Inputs, provider: str) -> str | None:
        """Do it: the effect holds then. Otherwise nothing happens; why it cannot be done is returned."""
        try:
            self._do(service, inputs, provider, self._changes(service, inputs, provider), whole=True)
        except (_Refused, FormulaError) as reason:
            self.rejected.append(f"{_shown(service, inputs, provider)}: {reason}")
            return str(reason)
        return None

    def partly(self, service: str, inputs: Inputs, provider: str, happens: Happens = lambda changes: changes[::2]) -> str:
        """Begin it, and fail on the way: some of its changes come about, every other one if nothing else is said, and of a single
        one none. Returns what holds then of what its effect speaks of."""
        try:
            whole = self._changes(service, inputs, provider)
        except (_Refused, FormulaError):
            whole = []
        made = tuple(happens(whole)) if len(whole) > 1 else ()
        if made:
            self._do(service, inputs, provider, made, whole=False)
        return self.said(self.ontology.services[service].effect, provider, inputs)

    def refusal(self, service: str, inputs: Inputs, provider: str) -> str | None:
        """Why it cannot be done now, if it cannot."""
        try:
            self._changes(service, inputs, provider)
        except (_Refused, FormulaError) as reason:
            return str(reason)
        return None

    def said(self, formula: str, provider: str, inputs: Inputs = {}) -> str:  # noqa: B006  # a mapping that nobody changes
        """What holds now of what the formula speaks of: each of its facts as it is, each of its attributes with its value."""
        bound = {PROVIDER: Name(provider), **{name: term(text) for name, text in inputs.items()}}
        atoms = dict.fromkeys(atom for atom in _atoms(substitute(parse(formula), bound)) if not variables(atom))
        found = [self._as_it_is(atom) for atom in atoms]
        known = [part for part in found if part is not None]
        return str(conjunction(*known)) if known else f"{provider}.Working = TRUE"

    def found(self, service: str, inputs: Inputs, provider: str) -> str:
        """What whoever could not do it has found out: what holds of what the service needs and brings about, and how it is itself."""
        known = self.ontology.services.get(service)
        spoken = [text for text in (known.precondition, known.effect) if text is not None] if known is not None else []
        own = [str(fact) for fact in self.map.facts_about(provider) if fact.relation in self._changing]
        return (
            self.said(" AND ".join(f"({text})" for text in [*spoken, *own]), provider, inputs) if spoken else f"{provider}.Working = TRUE"
        )

    def seen(self, object: str) -> str:
        """What somebody who looks at the object reports: the facts about it, and that what held once does not hold any more."""
        about = [fact for fact in self._once if object in fact.arguments]
        facts = [self._as_it_is(Relation(fact.relation, tuple(map(Name, fact.arguments)))) for fact in about]
        known = Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(False))
        return str(conjunction(*(fact for fact in facts if fact is not None), known))

    def cost(self, service: str, inputs: Inputs, provider: str) -> float:
        """What doing it costs, by its service type; 1 where that says nothing."""
        cost = self.ontology.services[service].cost
        if cost is None:
            return 1.0
        bound: dict[str, Term] = {PROVIDER: Name(provider), **{name: term(text) for name, text in inputs.items()}}
        measured = measure(parse_term(cost), self.map, self.ontology, bound)
        return measured.constant.value if measured is not None and isinstance(measured.constant, Number) else 1.0

    def offers(self, device: str) -> tuple[ServiceType, ...]:
        """What the device can do: of the services that the site brings, those whose formulas speak of a provider of its type, or of
        none. What every site has, such as TransferObject, is for devices with a body."""
        kind, common = self.map.objects[device].type, upper().services
        return tuple(service for name, service in self.ontology.services.items() if name not in common and self._offers(kind, service))

    def _offers(self, kind: str, service: ServiceType) -> bool:
        wanted = _provider(service)
        return wanted is None or wanted.type is None or self.ontology.is_subtype(kind, wanted.type)

    def _do(self, service: str, inputs: Inputs, provider: str, made: Sequence[Change], *, whole: bool) -> None:
        self.map = self.map.changed(made)
        self._once.update((change.fact, None) for change in made if isinstance(change, FactAdded))
        self.deeds.append(Deed(service=service, inputs=dict(inputs), provider=provider, changes=tuple(made), whole=whole))

    def _changes(self, name: str, inputs: Inputs, provider: str) -> list[Change]:
        """What it would change. Raises _Refused or FormulaError."""
        service = self.ontology.services.get(name)
        if service is None:
            raise _Refused(f"there is no service type {name} in this world")
        bound = self._bound(service, inputs, provider)
        kinds = {parameter.name: parameter.type for parameter in service.inputs}
        if service.precondition is not None:
            precondition = with_types(parse(service.precondition), kinds)
            row = next(
                bindings(precondition, self.map, self.ontology, {k: v for k, v in bound.items() if k in variables(precondition)}), None
            )
            if row is None:
                raise _Refused(self._lacking(substitute(precondition, bound)))
            bound = {**row, **bound}
        return changes(substitute(parse(service.effect), bound), self.map, self.ontology)

    def _bound(self, service: ServiceType, inputs: Inputs, provider: str) -> dict[str, Term]:
        given = {name: term(text) for name, text in inputs.items()}
        for parameter in service.inputs:
            value = given.get(parameter.name)
            if value is None:
                raise _Refused(f"{service.name} was not told its {parameter.name}")
            if parameter.type in self.ontology.types:
                self._require(value.name if isinstance(value, Name) else str(value), parameter.type)
        wanted = _provider(service)
        self._require(provider, wanted.type if wanted is not None and wanted.type is not None else "Device")
        return {**given, PROVIDER: Name(provider)}

    def _require(self, name: str, kind: str) -> None:
        object = self.map.objects.get(name)
        if object is None:
            raise _Refused(f"there is no {name} in this world")
        if not self.ontology.is_subtype(object.type, kind):
            raise _Refused(f"{name} is a {object.type}, and a {kind} is needed")

    def _lacking(self, precondition: Formula) -> str:
        parts = [part for part in conjuncts(precondition) if not formula_holds(part, self.map, self.ontology)]
        return f"{' and '.join(map(str, parts or [precondition]))} {'does' if len(parts) < 2 else 'do'} not hold"

    def _as_it_is(self, atom: Relation | Comparison) -> Formula | None:
        """What is so of what the atom speaks of; None when nothing can be said, or need be, because nothing changes it."""
        if isinstance(atom, Relation):
            if atom.relation not in self._changing:
                return None
            return atom if formula_holds(atom, self.map, self.ontology) else Not(atom)
        target = atom.left if isinstance(atom.left, Attribute) else atom.right
        if not isinstance(target, Attribute) or target.path not in self._set:
            return None
        measured = measure(target, self.map, self.ontology)
        return Comparison(target, "=", measured.constant) if measured is not None else None


def _atoms(formula: Formula) -> list[Relation | Comparison]:
    return [literal.atom if isinstance(literal, Not) else literal for literal in literals(formula)]


def _provider(service: ServiceType) -> Variable | None:
    """`?Provider` as the service's formulas have it, with its type if they say one."""
    spoken = [variables(parse(text)).get(PROVIDER) for text in (service.precondition, service.effect) if text is not None]
    found = [variable for variable in spoken if variable is not None]
    return next((variable for variable in found if variable.type is not None), found[0] if found else None)


def _shown(service: str, inputs: Inputs, provider: str) -> str:
    return f"{service}({', '.join(f'{name}: {text}' for name, text in inputs.items())}) by {provider}"
