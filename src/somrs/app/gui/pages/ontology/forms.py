"""The form of each kind of definition: which fields there are, and what can be chosen in them."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from somrs.app.gui.pages.ontology.drafts import COMPUTED, FORMULA, LIMITS, READ, TABLE
from somrs.app.gui.pages.ontology.fields import Fields, line
from somrs.app.gui.pages.ontology.reading import attributes_with
from somrs.app.gui.pages.ontology.sections import ATTRIBUTES, FUNCTIONS, RELATIONS, SERVICES, TYPES
from somrs.ontology.conformance import SELF
from somrs.ontology.services import PROVIDER, Occasion, ServiceKind
from somrs.ontology.types import ROOT, AttributeType, Kind, Ontology

NAME_HINT = "A letter, then letters, digits, _ or -"
DEVICE = "Device"
VALUE_TYPES = ("number", "text", "truth")

KINDS: dict[str | None, str] = {
    Kind.NUMBER.value: "a number",
    Kind.TEXT.value: "a text",
    Kind.TRUTH.value: "yes or no",
    Kind.ENUMERATION.value: "one of a list",
    Kind.COMPLEX.value: "made of other attributes",
}
SOURCES: dict[str | None, str] = {READ: "reads an attribute", TABLE: "is a table", COMPUTED: "is worked out by SO-MRS"}
RULES: dict[str | None, str] = {LIMITS: "limits of an attribute", FORMULA: "a formula"}
TRUTHS: dict[str | None, str] = {"true": "yes", "false": "no"}


def build(fields: Fields, ontology: Ontology) -> None:
    """The form of the draft's kind, into the current element."""
    making: dict[str, Callable[[Fields, Ontology], None]] = {
        TYPES.key: _type,
        ATTRIBUTES.key: _attribute,
        RELATIONS.key: _relation,
        FUNCTIONS.key: _function,
        SERVICES.key: _service,
    }
    with line():
        name = fields.text("name", "Name", hint=NAME_HINT)
        if fields.draft.name is None:
            name.props("autofocus")
        if fields.draft.section_key in (TYPES.key, SERVICES.key):
            _parent(fields, ontology)
    making[fields.draft.section_key](fields, ontology)
    fields.lines("doc", "What it means")


def _parent(fields: Fields, ontology: Ontology) -> None:
    own = fields.draft.name
    if fields.draft.section is TYPES:
        if own != ROOT:
            below = {one for one in ontology.types if own is not None and ontology.is_a(one, own)}
            fields.choice("parent", "Parent", sorted(ontology.types.keys() - below), hint="What it inherits from")
    else:
        nothing: dict[str | None, str] = {None: "none"}
        fields.choice("parent", "Parent", {**nothing, **{name: name for name in sorted(ontology.services) if name != own}})


# Types


def _type(fields: Fields, ontology: Ontology) -> None:
    known = sorted(ontology.attributes)

    def attribute(path: str) -> None:
        fields.choice(f"{path}.attribute", "Attribute", known, then=defaults)
        fields.flag(f"{path}.must", "every object must have it")

    def part(path: str) -> None:
        fields.choice(f"{path}.type", "Type", sorted(ontology.types))
        fields.text(f"{path}.minimum", "At least", width="narrow")
        fields.text(f"{path}.maximum", "At most", width="narrow", hint="no limit if empty")

    def default(path: str) -> None:
        had = attributes_with(fields.draft.form, ontology)
        fields.choice(f"{path}.path", "Attribute", _simple(had), then=defaults)
        _value(fields, f"{path}.value", had.get(fields.get(f"{path}.path") or ""))

    def rule(path: str) -> None:
        had = attributes_with(fields.draft.form, ontology)
        fields.choice(f"{path}.sort", "Rule", RULES, width="middle", then=rules)
        if fields.get(f"{path}.sort") == FORMULA:
            hint = "?Self is the object; other typed variables are parts of it"
            fields.formula(f"{path}.formula", "Formula", {SELF: fields.draft.name or fields.get("parent") or ROOT}, hint=hint)
        else:
            fields.choice(f"{path}.attribute", "Attribute", _simple(had), then=rules)
            chosen = had.get(fields.get(f"{path}.attribute") or "")
            if chosen is None or chosen.kind is Kind.NUMBER:
                unit = chosen.unit or "" if chosen else ""
                fields.text(f"{path}.minimum", "At least", width="narrow", suffix=unit)
                fields.text(f"{path}.maximum", "At most", width="narrow", suffix=unit)
            fields.text(f"{path}.values", "One of", width="middle", hint="with commas between")
        fields.text(f"{path}.doc", "In words, for whoever breaks it", width="full")

    fields.rows("attributes", "Attributes of its own", "attribute", attribute, lambda: {"attribute": None, "must": False})
    defaults = fields.rows(
        "defaults",
        "Defaults",
        "default",
        default,
        lambda: {"path": None, "value": ""},
        "Hold for every object that does not say otherwise.",
    )
    fields.rows("parts", "Parts", "part", part, lambda: {"type": None, "minimum": "1", "maximum": ""}, "Sub-objects that every object has.")
    blank = {"sort": LIMITS, "attribute": None, "minimum": "", "maximum": "", "values": "", "formula": "", "doc": ""}
    rules = fields.rows("constraints", "Rules", "rule", rule, lambda: dict(blank))
    fields.text("driver", "Driver", hint="module:Class of the program that serves such a device", width="full")


def _simple(had: dict[str, AttributeType]) -> list[str]:
    """What can have a value: not what is made of others."""
    return sorted(path for path, attribute in had.items() if attribute.kind is not Kind.COMPLEX)


def _value(fields: Fields, path: str, attribute: AttributeType | None) -> None:
    """A value, in the way of its attribute."""
    if attribute is not None and attribute.kind is Kind.TRUTH:
        fields.choice(path, "Value", TRUTHS, width="middle")
    elif attribute is not None and attribute.kind is Kind.ENUMERATION:
        fields.choice(path, "Value", attribute.values, width="middle")
    else:
        fields.text(path, "Value", width="middle", suffix=attribute.unit or "" if attribute else "")


# Attributes


def _attribute(fields: Fields, ontology: Ontology) -> None:
    def more() -> None:
        body.clear()
        with body:
            match fields.get("kind"):
                case Kind.NUMBER.value:
                    with line():
                        fields.text("unit", "Unit", hint="m, cm, kg, s, m/s, percent, EUR ...", width="middle")
                        fields.text("minimum", "At least", width="narrow")
                        fields.text("maximum", "At most", width="narrow")
                        fields.text("tolerance", "Equal within", width="narrow")
                case Kind.ENUMERATION.value:
                    fields.several("values", "Values", hint="Type each and press Enter")
                case Kind.COMPLEX.value:
                    others = sorted(name for name in ontology.attributes if name != fields.draft.name)
                    fields.several("attributes", "Made of", others)

    fields.choice("kind", "Its values are", KINDS, then=more)
    body = ui.element("div")
    more()


# Relations and functions


def _joined(fields: Fields, path: str, title: str, ontology: Ontology) -> None:
    types = sorted(ontology.types)
    fields.rows(path, title, "type", lambda at: _chosen(fields, at, types), lambda: "Object")


def _chosen(fields: Fields, path: str, types: list[str]) -> None:
    fields.choice(path, f"{('First', 'Second', 'Third')[index] if (index := int(path.rpartition('.')[2])) < 3 else 'Next'} type", types)


def _relation(fields: Fields, ontology: Ontology) -> None:
    _joined(fields, "joins", "Joins", ontology)
    fields.flag("symmetric", "Either way round: A to B is B to A")
    fields.flag("functional", "An object stands in it to one other at a time")
    groups = sorted({relation.excludes for relation in ontology.relations.values() if relation.excludes})
    hint = "An object stands in one relation of a group at a time" + (f"; there is {', '.join(groups)}" if groups else "")
    fields.text("excludes", "Group of relations that exclude each other", hint=hint, width="full")


def _function(fields: Fields, ontology: Ontology) -> None:
    def more() -> None:
        body.clear()
        with body:
            match fields.get("source"):
                case "attribute":
                    paths = sorted(
                        {path for type in ontology.types for path, one in ontology.attributes_of(type).items() if one.kind is Kind.NUMBER}
                    )
                    fields.choice("attribute", "Attribute", paths)
                case "table":
                    hint = "By the names of the objects, with a space between two."
                    fields.rows("values", "Table", "value", value, lambda: {"key": "", "value": ""}, hint)

    def value(path: str) -> None:
        fields.text(f"{path}.key", "Of")
        fields.text(f"{path}.value", "Value", width="narrow")

    _joined(fields, "parameters", "Of", ontology)
    with line():
        fields.choice("source", "Its value", SOURCES, then=more)
        fields.text("unit", "Unit", width="middle")
    body = ui.element("div")
    more()


# Service types


def _typed(fields: Fields, ontology: Ontology) -> dict[str, str]:
    """The types of the variables that a service's formulas have."""
    device = {PROVIDER: DEVICE} if DEVICE in ontology.types else {}
    rows = [*fields.get("inputs"), *fields.get("outputs")]
    return {**device, **{row["name"].strip().removeprefix("?"): row["type"] for row in rows if row["name"].strip() and row["type"]}}


def _service(fields: Fields, ontology: Ontology) -> None:
    types = [*VALUE_TYPES, *sorted(ontology.types)]

    def declared() -> None:
        for formula in (before, after):
            formula.field.variables = _typed(fields, ontology)

    def parameter(path: str) -> None:
        fields.text(f"{path}.name", "Variable", width="middle", then=declared)
        fields.choice(f"{path}.type", "Type", types, then=declared)

    def handler(path: str) -> None:
        fields.choice(f"{path}.on", "On", {one.value: one.value for one in Occasion}, width="middle")
        fields.formula(f"{path}.when", "When (always, if empty)", _typed(fields, ontology))
        fields.formula(f"{path}.effect", "Bring about", _typed(fields, ontology))

    fields.choice("kind", "Kind", {kind.value: kind.value for kind in ServiceKind})
    blank = {"name": "", "type": None}
    fields.rows("inputs", "Inputs", "input", parameter, lambda: dict(blank))
    fields.rows("outputs", "Outputs", "output", parameter, lambda: dict(blank))
    before = fields.formula("precondition", "Holds before it", _typed(fields, ontology), hint="What must be so; ?Provider is the device")
    after = fields.formula("effect", "Holds after it", _typed(fields, ontology))
    fields.text("cost", "Costs", hint="A number, or a term over the inputs and ?Provider: km(?From, ?To)", width="full")
    fields.rows(
        "handlers", "Handlers", "handler", handler, lambda: {"on": Occasion.FAILURE.value, "when": "", "effect": ""},
        "What is brought about when a step of the type fails, or is to be undone.",
    )  # fmt: skip
