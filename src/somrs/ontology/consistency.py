"""Checks an ontology by itself: known names, no cycles, known units, formulas that fit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from somrs.entish import Comparison, Not, Number
from somrs.entish.formula import conjuncts, literals, variables
from somrs.entish.normal_form import has_quantifiers
from somrs.entish.parse import nearest, parse, parse_term, read
from somrs.errors import FormulaError
from somrs.ontology.check import check
from somrs.ontology.complex_values import inner_paths
from somrs.ontology.conformance import Violation, value_problem
from somrs.ontology.effects import vague_problem
from somrs.ontology.schema import RESERVED
from somrs.ontology.service_kinds import kind_problems
from somrs.ontology.services import PROVIDER, PROVIDER_TYPE, ServiceKind, ServiceType
from somrs.ontology.type_rules import SELF_VARIABLE
from somrs.ontology.types import (
    ABSTRACT,
    PHYSICAL,
    ROOT,
    AttributeType,
    Constraint,
    Definition,
    FunctionType,
    Kind,
    ObjectType,
    Ontology,
    RelationType,
)
from somrs.ontology.units import COMMON as COMMON_UNITS
from somrs.ontology.units import is_known_unit as unit_known

UNSPECIFIED_ATTRIBUTE = AttributeType(name="", kind=Kind.TEXT)
"""An attribute with default fields, to find out which fields are set: a limit of 0 is set."""

VALUES = ("number", "text", "truth")
"""The types of inputs and outputs of services besides object types."""


def ontology_violations(ontology: Ontology, definitions: Iterable[Definition] | None = None) -> list[Violation]:
    """All violations in the ontology, or only those in the given definitions of it, definition by definition."""
    all_violations: list[Violation] = []
    for definition in ontology if definitions is None else definitions:
        section, violations = _definition_violations(definition, ontology)
        all_violations.extend(replace(violation, section=section) for violation in violations)
    return all_violations


def _definition_violations(definition: Definition, ontology: Ontology) -> tuple[str, Iterator[Violation]]:
    match definition:
        case AttributeType():
            return "attributes", _attribute(definition, ontology)
        case RelationType():
            return "relations", _relation(definition, ontology)
        case FunctionType():
            return "functions", _function(definition, ontology)
        case ObjectType():
            return "types", _type(definition, ontology)
        case ServiceType():
            return "services", _service(definition, ontology)


def _relation(relation: RelationType, ontology: Ontology) -> Iterator[Violation]:
    yield from _types_known(relation.name, "joins", relation.joins, ontology)
    if relation.symmetric and (len(relation.joins) != 2 or len(set(relation.joins)) > 1):
        message = f"a symmetric relation joins two objects of the same type, not {', '.join(relation.joins)}"
        yield Violation(subject=relation.name, rule="relation", message=message, path="joins")


def _attribute(attribute: AttributeType, ontology: Ontology) -> Iterator[Violation]:
    if attribute.name in RESERVED:
        message = f"objects have a key {attribute.name} of their own; give the attribute another name"
        yield Violation(subject=attribute.name, rule="reserved", message=message)
    number, required_key = attribute.kind is Kind.NUMBER, {Kind.ENUMERATION: "values", Kind.COMPLEX: "attributes"}.get(attribute.kind)
    for key in ("unit", "minimum", "maximum", "tolerance"):
        if not number and getattr(attribute, key) != getattr(UNSPECIFIED_ATTRIBUTE, key):
            message = f"only a number has a {key}; leave it out, or write kind: number"
            yield Violation(subject=attribute.name, rule="kind", message=message, path=key)
    for key, kind in (("values", "an enumeration"), ("attributes", "a complex attribute")):
        if key == required_key and not getattr(attribute, key):
            yield Violation(subject=attribute.name, rule="kind", message=f"{kind} needs {key}; list them", path="kind")
        elif key != required_key and getattr(attribute, key):
            yield Violation(
                subject=attribute.name, rule="kind", message=f"only {kind} has {key}; this one's kind is {attribute.kind}", path=key
            )
    if attribute.unit is not None:
        yield from _unit(attribute.name, attribute.unit)
    if attribute.constraints and attribute.kind is not Kind.COMPLEX:
        message = "only a complex attribute has constraints; give minimum, maximum or values"
        yield Violation(subject=attribute.name, rule="kind", message=message, path="constraints")
    for index, constraint in enumerate(attribute.constraints):
        yield from _inner_constraint(attribute, constraint, f"constraints.{index}", ontology)
    for index, inner in enumerate(attribute.attributes):
        if inner not in ontology.attributes:
            yield _unknown(attribute.name, "attribute", inner, ontology.attributes, f"attributes.{index}")
        elif attribute.name in (inner, *_nested_attributes(ontology, inner)):
            message = f"is made of itself, through {inner}; leave it out there"
            yield Violation(subject=attribute.name, rule="cycle", message=message, path=f"attributes.{index}")


def _inner_constraint(attribute: AttributeType, constraint: Constraint, path: str, ontology: Ontology) -> Iterator[Violation]:
    inner = dict(inner_paths(attribute, ontology))
    if constraint.formula is not None or constraint.attribute is None:
        message = "a constraint of a complex attribute limits one of its attributes; state a formula as a constraint of a type"
        yield Violation(subject=attribute.name, rule="constraint", message=message, path=path)
    elif constraint.attribute not in inner:
        yield _unknown(attribute.name, "attribute in it", constraint.attribute, inner, f"{path}.attribute")
    else:
        yield from _limits(attribute.name, constraint, path, inner[constraint.attribute], ontology)


def _nested_attributes(ontology: Ontology, name: str) -> set[str]:
    """All attributes within a complex attribute, at any depth."""
    inner_names: set[str] = set()
    waiting = [name]
    while waiting:
        attribute = ontology.attributes.get(waiting.pop())
        for inner in attribute.attributes if attribute is not None else ():
            if inner not in inner_names:
                inner_names.add(inner)
                waiting.append(inner)
    return inner_names


def _unit(subject: str, unit: str) -> Iterator[Violation]:
    if not unit_known(unit):
        hint = nearest(unit, COMMON_UNITS) or "write one such as m, cm, kg, rad, deg, s, m/s, percent, EUR"
        message = f"pint knows no unit {unit}; {hint}"
        yield Violation(subject=subject, rule="unit", message=message, path="unit")


def _function(function: FunctionType, ontology: Ontology) -> Iterator[Violation]:
    yield from _types_known(function.name, "parameters", function.parameters, ontology)
    if function.unit is not None:
        yield from _unit(function.name, function.unit)
    if function.attribute is not None and function.attribute.split(".")[0] not in ontology.attributes:
        yield _unknown(function.name, "attribute", function.attribute, ontology.attributes, "attribute")
    elif function.attribute is not None and len(function.parameters) != 1:
        message = "a function that reads an attribute has one parameter, the object whose attribute it is"
        yield Violation(subject=function.name, rule="function", message=message, path="parameters")
    if function.attribute is not None and function.values:
        message = "a function either reads an attribute or is a table of values; leave one of them out"
        yield Violation(subject=function.name, rule="function", message=message, path="values")
    for key in function.values:
        if len(key.split()) != len(function.parameters):
            message = f"{key!r} should name {len(function.parameters)} objects, with a space between two"
            yield Violation(subject=function.name, rule="function", message=message, path=f"values.{key}")


def _type(type: ObjectType, ontology: Ontology) -> Iterator[Violation]:
    yield from _parent(type.name, type.parent, "type", ontology.types)
    if type.parent is None and type.name != ROOT:
        yield Violation(subject=type.name, rule="parent", message=f"has no parent; write parent: {ROOT}, or a type below it")
    for key, names in (("attributes", type.attributes), ("required", type.required)):
        for index, name in enumerate(names):
            if name not in ontology.attributes:
                yield _unknown(type.name, "attribute", name, ontology.attributes, f"{key}.{index}")
    for index, part in enumerate(type.parts):
        if part.type not in ontology.types:
            yield _unknown(type.name, "type", part.type, ontology.types, f"parts.{index}.type")
        if part.maximum is not None and part.maximum < part.minimum:
            message = f"at least {part.minimum} and at most {part.maximum} of {part.type} is impossible; correct the limits"
            yield Violation(subject=type.name, rule="parts", message=message, path=f"parts.{index}")
        if ontology.is_closed(type.name) and ontology.is_subtype(type.name, PHYSICAL) and ontology.is_subtype(part.type, ABSTRACT):
            message = f"a {PHYSICAL} is not composed of abstract objects such as a {part.type}; name a type below {PHYSICAL}"
            yield Violation(subject=type.name, rule="parts", message=message, path=f"parts.{index}.type")
    attributes = ontology.attributes_of(type.name)
    for path, value in type.defaults.items():
        problem = value_problem(attributes[path], value) if path in attributes else ""
        if path not in attributes:
            yield _unknown(type.name, "attribute of this type", path, attributes, f"defaults.{path}")
        elif problem:
            yield Violation(subject=type.name, rule="value", message=problem, path=f"defaults.{path}")
    for index, constraint in enumerate(type.constraints):
        yield from _constraint(type, constraint, f"constraints.{index}", attributes, ontology)


def _constraint(
    type: ObjectType, constraint: Constraint, path: str, attributes: Mapping[str, AttributeType], ontology: Ontology
) -> Iterator[Violation]:
    if (constraint.attribute is None) == (constraint.formula is None):
        message = "a constraint has either an attribute with limits, or a formula"
        yield Violation(subject=type.name, rule="constraint", message=message, path=path)
    elif constraint.formula is not None:
        if (constraint.minimum, constraint.maximum, constraint.values) != (None, None, ()):
            message = "a formula has no minimum, maximum or values beside it; state them as a constraint of their own"
            yield Violation(subject=type.name, rule="constraint", message=message, path=path)
        yield from _formula(type.name, constraint.formula, ontology, {SELF_VARIABLE: type.name}, f"{path}.formula")
    elif constraint.attribute is None or constraint.attribute not in attributes:
        yield _unknown(type.name, "attribute of this type", str(constraint.attribute), attributes, f"{path}.attribute")
    else:
        yield from _limits(type.name, constraint, path, attributes[constraint.attribute], ontology)


def _limits(subject: str, constraint: Constraint, path: str, attribute: AttributeType, ontology: Ontology) -> Iterator[Violation]:
    """Violations for limits that say nothing, that no value can meet, or that do not fit the attribute."""
    minimum, maximum = constraint.minimum, constraint.maximum
    if minimum is None and maximum is None and not constraint.values:
        message = f"says nothing about {constraint.attribute}; give minimum, maximum or values"
        yield Violation(subject=subject, rule="constraint", message=message, path=path)
    elif attribute.kind is not Kind.NUMBER and (minimum, maximum) != (None, None):
        message = f"{constraint.attribute} is no number, so it has no minimum or maximum; give values"
        yield Violation(subject=subject, rule="constraint", message=message, path=path)
    elif minimum is not None and maximum is not None and minimum > maximum:
        message = f"no {constraint.attribute} is at least {minimum:g} and at most {maximum:g}; correct the limits"
        yield Violation(subject=subject, rule="constraint", message=message, path=path)
    elif attribute.kind is Kind.COMPLEX:
        yield from _kinds_of_value(subject, constraint, path, attribute, ontology)
    else:
        for value in constraint.values:
            if problem := value_problem(attribute, value):
                yield Violation(subject=subject, rule="constraint", message=problem, path=f"{path}.values")


def _kinds_of_value(subject: str, constraint: Constraint, path: str, attribute: AttributeType, ontology: Ontology) -> Iterator[Violation]:
    """Violations for names that are no complex attributes, or that have attributes which this one has not."""
    complex_attributes = {name: other for name, other in ontology.attributes.items() if other.kind is Kind.COMPLEX}
    for name in map(str, constraint.values):
        if (kind := complex_attributes.get(name)) is None:
            yield _unknown(subject, "complex attribute", name, complex_attributes, f"{path}.values")
        elif foreign := sorted(set(kind.attributes) - set(attribute.attributes)):
            message = f"{attribute.name} cannot be a {name}, because it has no {', '.join(foreign)}; leave that out of {name}"
            yield Violation(subject=subject, rule="constraint", message=message, path=f"{path}.values")


def _service(service: ServiceType, ontology: Ontology) -> Iterator[Violation]:
    yield from _parent(service.name, service.parent, "service", ontology.services)
    typed: dict[str, str] = {PROVIDER: PROVIDER_TYPE if PROVIDER_TYPE in ontology.types else ROOT}
    for side in ("inputs", "outputs"):
        for parameter in getattr(service, side):
            if parameter.type not in ontology.types and parameter.type not in VALUES:
                yield _unknown(service.name, "type", parameter.type, [*ontology.types, *VALUES], f"{side}.{parameter.name}")
            if parameter.name in typed:
                message = f"?{parameter.name} is declared twice; give one of the two another name"
                yield Violation(subject=service.name, rule="duplicate", message=message, path=f"{side}.{parameter.name}")
            typed[parameter.name] = parameter.type
    are_types_known = all(type in ontology.types or type in VALUES for type in typed.values())
    for key, text in (("precondition", service.precondition), ("effect", service.effect), ("invariant", service.invariant)):
        if text is not None and are_types_known:
            yield from _formula(service.name, text, ontology, typed, key)
    yield from _invariant(service)
    yield from _vague_effect(service)
    if service.kind is not ServiceKind.COGNITIVE:
        yield from _quantified_effect(service)
    for problem in kind_problems(service):
        yield Violation(subject=service.name, rule="kind", message=problem, path="effect")
    if service.cost is not None and are_types_known:
        yield from _cost(service, service.cost, ontology, typed)
    for index, handler in enumerate(service.handlers):
        for key, text in (("when", handler.when), ("effect", handler.effect)):
            if text is not None and are_types_known:
                yield from _formula(service.name, text, ontology, typed, f"handlers.{index}.{key}")


def _invariant(service: ServiceType) -> Iterator[Violation]:
    """The variables of an invariant are bound when the service starts, so that it is clear what has to stay true."""
    try:
        used = variables(parse(service.invariant)) if service.invariant is not None else {}
    except FormulaError:
        return  # `_formula` reports it
    for name in used:
        if name not in {PROVIDER, *(parameter.name for parameter in service.inputs)}:
            message = f"?{name} is no input; what has to hold while the service runs is a formula over the inputs and ?{PROVIDER}"
            yield Violation(subject=service.name, rule="formula", message=message, path="invariant")


def _vague_effect(service: ServiceType) -> Iterator[Violation]:
    try:
        effect = read(service.effect)
    except FormulaError:
        return  # `_formula` reports it
    for part in conjuncts(effect.formula):
        if not has_quantifiers(part) and (vague := vague_problem(part)) is not None:
            first = next(literals(part))
            error = effect.error(first.atom if isinstance(first, Not) else first, None, *vague)
            yield Violation(subject=service.name, rule="formula", message=str(error), path="effect")


def _quantified_effect(service: ServiceType) -> Iterator[Violation]:
    try:
        quantified = has_quantifiers(parse(service.effect))
    except FormulaError:
        return  # `_formula` reports it
    if quantified:
        problem = "an effect says what becomes true of its inputs, not of all or some objects of a type"
        place = min((place for word in ("FORALL", "EXISTS") if (place := service.effect.find(word)) >= 0), default=0)
        error = FormulaError(service.effect, place, problem, "make the object an input of the service")
        yield Violation(subject=service.name, rule="formula", message=str(error), path="effect")


def _formula(subject: str, text: str, ontology: Ontology, typed: dict[str, str], path: str) -> Iterator[Violation]:
    try:
        check(text, ontology, None, typed)
    except FormulaError as error:
        yield Violation(subject=subject, rule="formula", message=str(error), path=path)


def _cost(service: ServiceType, text: str, ontology: Ontology, typed: dict[str, str]) -> Iterator[Violation]:
    """Check a cost term, as one side of a comparison with a number."""
    try:
        term = parse_term(text)
        check(Comparison(term, ">=", Number(0)), ontology, None, typed)
    except FormulaError as error:
        yield Violation(subject=service.name, rule="formula", message=str(error), path="cost")
        return
    for name in variables(term):
        if name not in typed:
            message = f"?{name} is no input; a cost is a term over the inputs and ?{PROVIDER}"
            yield Violation(subject=service.name, rule="formula", message=message, path="cost")


def _parent(
    subject: str, parent: str | None, kind: str, definitions: dict[str, ObjectType] | dict[str, ServiceType]
) -> Iterator[Violation]:
    if parent is None:
        return
    if parent not in definitions:
        yield _unknown(subject, kind, parent, definitions, "parent")
        return
    chain = [subject]
    while parent is not None and parent in definitions:
        chain.append(parent)
        if parent == subject:
            message = f"is its own ancestor ({' below '.join(chain)}); give one of them another parent"
            yield Violation(subject=subject, rule="cycle", message=message, path="parent")
            return
        if parent in chain[:-1]:
            return  # the cycle is among the ancestors, and is reported for them
        parent = definitions[parent].parent


def _types_known(subject: str, key: str, types: Iterable[str], ontology: Ontology) -> Iterator[Violation]:
    for index, name in enumerate(types):
        if name not in ontology.types:
            yield _unknown(subject, "type", name, ontology.types, f"{key}.{index}")


def _unknown(subject: str, kind: str, name: str, known_names: Iterable[str], path: str) -> Violation:
    hint = nearest(name, known_names) or "define it, or use one that is there"
    return Violation(subject=subject, rule="unknown-name", message=f"no {kind} is called {name}; {hint}", path=path)
