"""The actual state of a site as facts. A service takes effect only if its precondition holds here, whatever the Repository's map says.

A cognitive service changes nothing, and tells what is so here (`recognition.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from somrs.devices.symbolic.recognition import recognised_situation
from somrs.entish import Attribute, Comparison, Formula, Name, Not, Number, Relation, Term, Truth, Variable
from somrs.entish.formula import conjunction, conjuncts, literals, substitute, variables, with_types
from somrs.entish.parse import parse, parse_term
from somrs.errors import FormulaError
from somrs.ontology.effects import changes
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded
from somrs.ontology.services import PROVIDER, PROVIDER_TYPE, ServiceKind, ServiceType
from somrs.ontology.truth import bindings, formula_holds
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.ontology.values import measure
from somrs.service_manager.sdk.values import term

Inputs = Mapping[str, str]
"""The inputs of a service, as in an order: Entish terms by name."""

FIELD_OF_VIEW = "FieldOfView"
"""The attribute of devices with a camera."""

ChangeSelection = Callable[[Sequence[Change]], Iterable[Change]]
"""Selects the changes of a service that occur when it fails on the way."""


class _Refused(Exception):
    """The service cannot be performed in the current state of the world."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Action:
    """A service that was performed, wholly or in part, and its changes."""

    service: str
    inputs: dict[str, str]
    provider: str
    changes: tuple[Change, ...]
    whole: bool = True


class SymbolicWorld:
    """One world. `actions` are the services performed; `rejected` are those that could not be, with reasons. Both are in order of time."""

    def __init__(self, ontology: Ontology, map: Map) -> None:
        self.ontology, self.map = ontology, map
        self.actions: list[Action] = []
        self.rejected: list[str] = []
        effects = [parse(service.effect) for service in ontology.services.values()]
        self._changing = {part.relation for effect in effects for part in _atoms(effect) if isinstance(part, Relation)}
        sides = [side for effect in effects for part in _atoms(effect) if isinstance(part, Comparison) for side in (part.left, part.right)]
        self._set = {side.path for side in sides if isinstance(side, Attribute)}
        self._past_facts: dict[Fact, None] = dict.fromkeys(fact for fact in map.facts() if fact.relation in self._changing)

    def perform(self, service: str, inputs: Inputs, provider: str) -> str | None:
        """Apply the effect of a service. If that is impossible, change nothing, and return the reason."""
        try:
            self._apply(service, inputs, provider, self._changes(service, inputs, provider), whole=True)
        except (_Refused, FormulaError) as reason:
            self.rejected.append(f"{_format_call(service, inputs, provider)}: {reason}")
            return str(reason)
        return None

    def partly(self, service: str, inputs: Inputs, provider: str, select_changes: ChangeSelection = lambda changes: changes[::2]) -> str:
        """Perform a service that fails on the way: apply the selected changes, by default every second one. A single change is not applied.

        Returns the current state of what its effect mentions.
        """
        try:
            whole = self._changes(service, inputs, provider)
        except (_Refused, FormulaError):
            whole = []
        partial_changes = tuple(select_changes(whole)) if len(whole) > 1 else ()
        if partial_changes:
            self._apply(service, inputs, provider, partial_changes, whole=False)
        return self.describe(self.ontology.services[service].effect, provider, inputs)

    def result(self, service: str, inputs: Inputs, provider: str) -> str:
        """The situation that a device reports when it has completed a service: what its effect mentions, or what it has recognised."""
        service_type = self.ontology.services[service]
        if not self._observes(service):
            return self.describe(service_type.effect, provider, inputs)
        effect = substitute(parse(service_type.effect), self._terms(inputs, provider))
        kinds = {parameter.name: parameter.type for parameter in service_type.outputs}
        if variables(effect):
            situation = recognised_situation(with_types(effect, kinds), self.map, self.ontology)
            return situation or f"{provider}.Working = TRUE"
        asked = [str(owner) for owner in map(_asked, _atoms(effect)) if owner is not None]
        return " AND ".join(map(self.describe_object, asked)) or self.describe(service_type.effect, provider, inputs)

    def _observes(self, service: str) -> bool:
        return service in self.ontology.services and self.ontology.services[service].kind is ServiceKind.COGNITIVE

    def refusal(self, service: str, inputs: Inputs, provider: str) -> str | None:
        """The reason why a service cannot be performed now, or None."""
        try:
            self._changes(service, inputs, provider)
        except (_Refused, FormulaError) as reason:
            return str(reason)
        return None

    def describe(self, formula: str, provider: str, inputs: Inputs = {}) -> str:  # noqa: B006  # never modified
        """The current state of what a formula mentions: its facts, negated if they do not hold, and its attributes with their values."""
        bound = self._terms(inputs, provider)
        atoms = dict.fromkeys(atom for atom in _atoms(substitute(parse(formula), bound)) if not variables(atom))
        parts = [self._evaluate_atom(atom) for atom in atoms]
        known_parts = [part for part in parts if part is not None]
        return str(conjunction(*known_parts)) if known_parts else f"{provider}.Working = TRUE"

    def describe_failure(self, service: str, inputs: Inputs, provider: str) -> str:
        """The situation that a device reports when a service fails: the state of its precondition and effect, and of the device."""
        service_type = self.ontology.services.get(service)
        formulas = (service_type.start_condition, service_type.effect) if service_type is not None else ()
        spoken = [text for text in formulas if text is not None]
        own_facts = [str(fact) for fact in self.map.facts_about(provider) if fact.relation in self._changing]
        return (
            self.describe(" AND ".join(f"({text})" for text in [*spoken, *own_facts]), provider, inputs)
            if spoken
            else f"{provider}.Working = TRUE"
        )

    def describe_object(self, object: str) -> str:
        """The situation that an observer of the object reports: its facts, and the negation of earlier facts that no longer hold."""
        past_facts = [fact for fact in self._past_facts if object in fact.arguments]
        facts = [self._evaluate_atom(Relation(fact.relation, tuple(map(Name, fact.arguments)))) for fact in past_facts]
        known_atom = Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(False))
        return str(conjunction(*(fact for fact in facts if fact is not None), known_atom))

    def cost(self, service: str, inputs: Inputs, provider: str) -> float:
        """The cost of a service according to its service type; 1 if that specifies none."""
        cost = self.ontology.services[service].cost
        if cost is None:
            return 1.0
        bound = self._terms(inputs, provider)
        measured = measure(parse_term(cost), self.map, self.ontology, bound)
        return measured.constant.value if measured is not None and isinstance(measured.constant, Number) else 1.0

    def offers(self, device: str) -> tuple[ServiceType, ...]:
        """The service types that the device can provide: those of the site whose formulas name a provider of its type, or no provider.

        Service types of the upper ontology, such as TransferObject, are for physical devices; a device with a camera offers those that
        find out where objects are.
        """
        kind, common = self.map.objects[device].type, upper().services
        sees = FIELD_OF_VIEW in self.ontology.attributes_of(kind)
        return tuple(
            service
            for name, service in self.ontology.services.items()
            if self._offers(kind, service) and (name not in common or (sees and self._finds(service)))
        )

    def _finds(self, service: ServiceType) -> bool:
        """Whether a service finds out where objects are, which a camera can see."""
        atoms = _atoms(parse(service.effect))
        return self._observes(service.name) and all(isinstance(atom, Relation) or _asked(atom) is not None for atom in atoms)

    def _terms(self, inputs: Inputs, provider: str) -> dict[str, Term]:
        return {PROVIDER: Name(provider), **{name: term(text) for name, text in inputs.items()}}

    def _offers(self, kind: str, service: ServiceType) -> bool:
        provider_variable = _provider(service)
        return provider_variable is None or provider_variable.type is None or self.ontology.is_subtype(kind, provider_variable.type)

    def _apply(self, service: str, inputs: Inputs, provider: str, applied_changes: Sequence[Change], *, whole: bool) -> None:
        self.map = self.map.changed(applied_changes)
        self._past_facts.update((change.fact, None) for change in applied_changes if isinstance(change, FactAdded))
        self.actions.append(Action(service=service, inputs=dict(inputs), provider=provider, changes=tuple(applied_changes), whole=whole))

    def _changes(self, name: str, inputs: Inputs, provider: str) -> list[Change]:
        """The changes that a service would make. Raises _Refused or FormulaError."""
        service = self.ontology.services.get(name)
        if service is None:
            raise _Refused(f"there is no service type {name} in this world")
        bound = self._bound(service, inputs, provider)
        kinds = {parameter.name: parameter.type for parameter in service.inputs}
        if service.start_condition is not None:
            precondition = with_types(parse(service.start_condition), kinds)
            row = next(
                bindings(precondition, self.map, self.ontology, {k: v for k, v in bound.items() if k in variables(precondition)}), None
            )
            if row is None:
                raise _Refused(self._lacking(substitute(precondition, bound)))
            bound = {**row, **bound}
        if self._observes(name):
            return []
        return changes(substitute(parse(service.effect), bound), self.map, self.ontology)

    def _bound(self, service: ServiceType, inputs: Inputs, provider: str) -> dict[str, Term]:
        terms = {name: term(text) for name, text in inputs.items()}
        for parameter in service.inputs:
            value = terms.get(parameter.name)
            if value is None:
                raise _Refused(f"the input {parameter.name} of {service.name} is missing")
            if parameter.type in self.ontology.types:
                self._require(value.name if isinstance(value, Name) else str(value), parameter.type)
        provider_variable = _provider(service)
        self._require(
            provider, provider_variable.type if provider_variable is not None and provider_variable.type is not None else PROVIDER_TYPE
        )
        return {**terms, PROVIDER: Name(provider)}

    def _require(self, name: str, kind: str) -> None:
        object = self.map.objects.get(name)
        if object is None:
            raise _Refused(f"there is no {name} in this world")
        if not self.ontology.is_subtype(object.type, kind):
            raise _Refused(f"{name} is a {object.type}, and a {kind} is needed")

    def _lacking(self, precondition: Formula) -> str:
        parts = [part for part in conjuncts(precondition) if not formula_holds(part, self.map, self.ontology)]
        return f"{' and '.join(map(str, parts or [precondition]))} {'does' if len(parts) < 2 else 'do'} not hold"

    def _evaluate_atom(self, atom: Relation | Comparison) -> Formula | None:
        """The current state of what an atom mentions; None if it is unknown, or if no service changes it."""
        if isinstance(atom, Relation):
            if atom.relation not in self._changing:
                return None
            return atom if formula_holds(atom, self.map, self.ontology) else Not(atom)
        target = atom.left if isinstance(atom.left, Attribute) else atom.right
        if not isinstance(target, Attribute) or target.path not in self._set:
            return None
        measured = measure(target, self.map, self.ontology)
        return Comparison(target, "=", measured.constant) if measured is not None else None


def _asked(atom: Relation | Comparison) -> Name | Variable | None:
    """The object whose place and state an atom asks for: `?Object.Unknown = FALSE`."""
    match atom:
        case Comparison(Attribute(owner, path)) if path == UNKNOWN:
            return owner
        case _:
            return None


def _atoms(formula: Formula) -> list[Relation | Comparison]:
    return [literal.atom if isinstance(literal, Not) else literal for literal in literals(formula)]


def _provider(service: ServiceType) -> Variable | None:
    """The variable `?Provider` of the service's formulas, with its type if they state one."""
    spoken = [variables(parse(text)).get(PROVIDER) for text in (service.start_condition, service.effect) if text is not None]
    provider_variables = [variable for variable in spoken if variable is not None]
    return next(
        (variable for variable in provider_variables if variable.type is not None), provider_variables[0] if provider_variables else None
    )


def _format_call(service: str, inputs: Inputs, provider: str) -> str:
    return f"{service}({', '.join(f'{name}: {text}' for name, text in inputs.items())}) by {provider}"
