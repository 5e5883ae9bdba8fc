"""The form for each kind of definition: its fields and their choices."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from somrs.gui.pages.ontology.drafts import BLANK_RULE, COMPUTED, READ, TABLE
from somrs.gui.pages.ontology.fields import Fields, line
from somrs.gui.pages.ontology.form_parser import attributes_within
from somrs.gui.pages.ontology.ontology_view import OntologyView
from somrs.gui.pages.ontology.sections import ATTRIBUTES, FUNCTIONS, RELATIONS, SERVICES, TYPES
from somrs.gui.pages.ontology.type_form import MakeAttribute, TypeForm, limit_fields
from somrs.ontology.services import PROVIDER, PROVIDER_TYPE, Occasion, ServiceKind
from somrs.ontology.types import ROOT, FunctionType, Kind, Ontology

_NAME_HINT = "A letter, then letters, digits, _ or -"
_VALUE_TYPES = ("number", "text", "truth")

_KINDS: dict[str | None, str] = {
    Kind.NUMBER.value: "a number",
    Kind.TEXT.value: "a text",
    Kind.TRUTH.value: "yes or no",
    Kind.ENUMERATION.value: "one of a list",
    Kind.COMPLEX.value: "group of other attributes",
}
_SOURCES: dict[str | None, str] = {READ: "reads an attribute", TABLE: "is a table", COMPUTED: "is computed by SO-MRS"}


def build_form(fields: Fields, view: OntologyView, make_attribute: MakeAttribute) -> None:
    """Add the form for the draft's kind to the current element."""
    ontology = view.ontology
    builders: dict[str, Callable[[Fields, Ontology], None]] = {
        ATTRIBUTES.key: _attribute,
        RELATIONS.key: _relation,
        FUNCTIONS.key: _function,
        SERVICES.key: _service,
    }
    with line():
        name = fields.text("name", "Name", hint=_NAME_HINT)
        if fields.draft.name is None:
            name.props("autofocus")
        if fields.draft.section_key in (TYPES.key, SERVICES.key):
            _parent(fields, ontology)
    if fields.draft.section is TYPES:
        TypeForm(fields, view, make_attribute)
    else:
        builders[fields.draft.section_key](fields, ontology)
    fields.lines("doc", "Description")


def _parent(fields: Fields, ontology: Ontology) -> None:
    own_name = fields.draft.name
    if fields.draft.section is TYPES:
        if own_name != ROOT:
            subtypes = {type_name for type_name in ontology.types if own_name is not None and ontology.is_subtype(type_name, own_name)}
            fields.choice("parent", "Parent", sorted(ontology.types.keys() - subtypes), hint="Type from which it inherits")
    else:
        none_option: dict[str | None, str] = {None: "none"}
        fields.choice("parent", "Parent", {**none_option, **{name: name for name in sorted(ontology.services) if name != own_name}})


# Attributes


def _attribute(fields: Fields, ontology: Ontology) -> None:
    def rule(path: str) -> None:
        limit_fields(fields, path, attributes_within(fields.draft.form, ontology))
        fields.text(f"{path}.doc", "Message when the rule is broken", width="full")

    def show_kind_fields() -> None:
        body.clear()
        with body:
            match fields.value_at("kind"):
                case Kind.NUMBER.value:
                    with line():
                        fields.text("unit", "Unit", hint="m, cm, kg, s, m/s, percent, EUR ...", width="middle")
                        fields.text("minimum", "At least", width="narrow")
                        fields.text("maximum", "At most", width="narrow")
                        fields.text("tolerance", "Equal within", width="narrow")
                case Kind.ENUMERATION.value:
                    fields.text("values", "Values", hint="Separated by commas", width="full")
                case Kind.COMPLEX.value:
                    other_attributes = sorted(name for name in ontology.attributes if name != fields.draft.name)
                    fields.multiple_choice("attributes", "Made of", other_attributes)
                    fields.rows("constraints", "Rules", "rule", rule, lambda: dict(BLANK_RULE))

    fields.choice("kind", "Its values are", _KINDS, callback=show_kind_fields)
    body = ui.element("div")
    show_kind_fields()


# Relations and functions


def _type_rows(fields: Fields, path: str, title: str, ontology: Ontology) -> None:
    types = sorted(ontology.types)
    fields.rows(path, title, "type", lambda row_path: _type_choice(fields, row_path, types), lambda: "Object")


def _type_choice(fields: Fields, path: str, types: list[str]) -> None:
    fields.choice(path, f"{('First', 'Second', 'Third')[index] if (index := int(path.rpartition('.')[2])) < 3 else 'Next'} type", types)


def _relation(fields: Fields, ontology: Ontology) -> None:
    _type_rows(fields, "joins", "Joins", ontology)
    fields.flag("symmetric", "Symmetric: A to B is B to A")
    fields.flag("functional", "Functional: an object has this relation to one other at a time")
    groups = sorted({relation.excludes for relation in ontology.relations.values() if relation.excludes})
    hint = "An object has one relation of a group at a time" + (f"; there is {', '.join(groups)}" if groups else "")
    fields.text("excludes", "Group of relations that exclude each other", hint=hint, width="full")


def _function(fields: Fields, ontology: Ontology) -> None:
    def show_source_fields() -> None:
        body.clear()
        with body:
            match fields.value_at("source"):
                case "attribute":
                    paths = sorted(
                        {
                            path
                            for type in ontology.types
                            for path, attribute in ontology.attributes_of(type).items()
                            if attribute.kind is Kind.NUMBER
                        }
                    )
                    fields.choice("attribute", "Attribute", paths)
                case "table":
                    hint = "By the names of the objects, separated by spaces."
                    fields.rows("values", "Table", "value", value, lambda: {"key": "", "value": ""}, hint)

    def value(path: str) -> None:
        fields.text(f"{path}.key", "Of")
        fields.text(f"{path}.value", "Value", width="narrow")

    _type_rows(fields, "parameters", "Parameters", ontology)
    with line():
        fields.choice("source", "Its value", _SOURCES, callback=show_source_fields)
        fields.text("unit", "Unit", width="middle")
    body = ui.element("div")
    show_source_fields()


# Service types


def _variable_types(fields: Fields, ontology: Ontology) -> dict[str, str]:
    """The types of the variables in a service's formulas."""
    device = {PROVIDER: PROVIDER_TYPE} if PROVIDER_TYPE in ontology.types else {}
    rows = [*fields.value_at("inputs"), *fields.value_at("outputs")]
    return {**device, **{row["name"].strip().removeprefix("?"): row["type"] for row in rows if row["name"].strip() and row["type"]}}


def _call_text(function: FunctionType) -> str:
    return f"{function.name}({', '.join(f'?{type_name}' for type_name in function.parameters)})"


def _service(fields: Fields, ontology: Ontology) -> None:
    types = [*_VALUE_TYPES, *sorted(ontology.types)]

    def update_variables() -> None:
        for formula in (precondition_field, invariant_field, effect_field):
            formula.field.variables = _variable_types(fields, ontology)

    def parameter(path: str) -> None:
        fields.text(f"{path}.name", "Variable", width="middle", callback=update_variables)
        fields.choice(f"{path}.type", "Type", types, callback=update_variables)

    def handler(path: str) -> None:
        fields.choice(f"{path}.on", "On", {occasion.value: occasion.value for occasion in Occasion}, width="middle")
        fields.formula(f"{path}.when", "When (always, if empty)", _variable_types(fields, ontology))
        fields.formula(f"{path}.effect", "Make true", _variable_types(fields, ontology))

    fields.choice("kind", "Kind", {kind.value: kind.value for kind in ServiceKind})
    blank = {"name": "", "type": None}
    fields.rows("inputs", "Inputs", "input", parameter, lambda: dict(blank))
    fields.rows("outputs", "Outputs", "output", parameter, lambda: dict(blank))
    precondition_field = fields.formula(
        "precondition",
        "Precondition",
        _variable_types(fields, ontology),
        hint="Must hold before the service begins; ?Provider is the device",
    )
    invariant_field = fields.formula(
        "invariant",
        "While it runs",
        _variable_types(fields, ontology),
        hint="Must hold as long as the service runs; if it does not, the service is stopped. Over the inputs and ?Provider",
    )
    effect_field = fields.formula("effect", "Effect", _variable_types(fields, ontology))
    example = next((f", such as {_call_text(function)}" for function in ontology.functions.values() if function.parameters), "")
    fields.text("cost", "Cost", hint=f"A number, or a term over the inputs and ?Provider{example}", width="full")
    fields.rows(
        "handlers", "Handlers", "handler", handler, lambda: {"on": Occasion.FAILURE.value, "when": "", "effect": ""},
        "Formulas to make true when a step of the type fails or is to be undone.",
    )  # fmt: skip
