"""The five kinds of definitions, and their texts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import quote

from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Constraint, Definition, FunctionType, Kind, ObjectType, Ontology, Part, RelationType, Value


@dataclass(frozen=True, slots=True)
class Section:
    """`key`: its name in files and in the ontology; `singular`: the name of one definition; `label`: the title of its tab."""

    key: str
    singular: str
    label: str
    icon: str
    struct: type[Definition]

    def definitions_in(self, ontology: Ontology) -> Mapping[str, Definition]:
        """The definitions of this kind, by name."""
        definitions: Mapping[str, Definition] = getattr(ontology, self.key)
        return definitions

    @property
    def parameter(self) -> str:
        """The parameter name in links: `/ontology?type=Jar`."""
        return self.singular.split()[0]

    def link(self, name: str) -> str:
        return f"/ontology?{self.parameter}={quote(name)}"


TYPES = Section("types", "type", "Types", "category", ObjectType)
ATTRIBUTES = Section("attributes", "attribute", "Attributes", "tune", AttributeType)
RELATIONS = Section("relations", "relation", "Relations", "link", RelationType)
FUNCTIONS = Section("functions", "function", "Functions", "functions", FunctionType)
SERVICES = Section("services", "service type", "Services", "build", ServiceType)

SECTIONS = (TYPES, ATTRIBUTES, RELATIONS, FUNCTIONS, SERVICES)
SECTION = {section.key: section for section in SECTIONS}


def section_of(definition: Definition) -> Section:
    return next(section for section in SECTIONS if isinstance(definition, section.struct))


def number(value: float) -> str:
    """Format a number: 4, not 4.0. The text parses to the same number."""
    short = f"{value:.12g}"
    return short if float(short) == value else repr(value)


def _limits(minimum: float | None, maximum: float | None, unit: str | None = None) -> str:
    """Format a range: `at least 0 kg`, `0 to 100 percent`; empty without limits."""
    unit_suffix = f" {unit}" if unit else ""
    if minimum is not None and maximum is not None:
        return f"{number(minimum)} to {number(maximum)}{unit_suffix}"
    if minimum is not None:
        return f"at least {number(minimum)}{unit_suffix}"
    return f"at most {number(maximum)}{unit_suffix}" if maximum is not None else ""


def value_text(value: Value, attribute: AttributeType | None = None) -> str:
    """A value with its unit."""
    match value:
        case bool():
            return "yes" if value else "no"
        case str():
            return value
        case _:
            return f"{number(value)} {attribute.unit}" if attribute is not None and attribute.unit else number(value)


def kind_text(attribute: AttributeType) -> str:
    """The kind of an attribute's values: `number in kg, at least 0`, `one of Red, Blue`."""
    match attribute.kind:
        case Kind.NUMBER:
            phrases = [f"number in {attribute.unit}" if attribute.unit else "number", _limits(attribute.minimum, attribute.maximum)]
            return ", ".join(part for part in phrases if part)
        case Kind.ENUMERATION:
            return f"one of {', '.join(attribute.values)}"
        case Kind.COMPLEX:
            return f"group of {', '.join(attribute.attributes)}"
        case Kind.TRUTH:
            return "yes or no"
        case Kind.TEXT:
            return "text"


def part_text(part: Part) -> str:
    """How many of the parts there are."""
    if part.maximum is None:
        return f"at least {part.minimum}" if part.minimum else "any number"
    return f"exactly {part.minimum}" if part.minimum == part.maximum else f"{part.minimum} to {part.maximum}"


def constraint_text(constraint: Constraint, unit: str | None = None) -> str:
    """The rule as a text: the limits of an attribute, or the formula."""
    if constraint.formula is not None:
        return constraint.formula
    limit_text = _limits(constraint.minimum, constraint.maximum, unit)
    choice_text = f"one of {', '.join(value_text(value) for value in constraint.values)}" if constraint.values else ""
    return f"{constraint.attribute}: {', '.join(part for part in (limit_text, choice_text) if part)}"
