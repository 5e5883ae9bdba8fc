"""The form of a type."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from nicegui import ui

from somrs.gui.pages.ontology.drafts import BLANK_RULE, FORMULA, LIMITS
from somrs.gui.pages.ontology.fields import Fields
from somrs.gui.pages.ontology.form_parser import attributes_with, type_from_form
from somrs.gui.pages.ontology.ontology_view import OntologyView
from somrs.ontology.type_rules import SELF_VARIABLE
from somrs.ontology.types import AttributeType, Kind

MakeAttribute = Callable[[Callable[[str], None]], None]
"""Lets the user create an attribute; the callback receives its name."""

_RULES: dict[str | None, str] = {LIMITS: "limits of an attribute", FORMULA: "a formula"}
_TRUTHS: dict[str | None, str] = {"true": "yes", "false": "no"}


class TypeForm:
    """The fields after name and parent. Defaults and rules can use the attributes in the form and the inherited ones."""

    def __init__(self, fields: Fields, view: OntologyView, make_attribute: MakeAttribute) -> None:
        self._fields, self._view = fields, view
        self._rebuild_attributes = fields.rows(
            "attributes", "Attributes of its own", "attribute", self._attribute, lambda: {"attribute": None, "must": False},
            make_buttons=lambda: ui.button(
                "Make a new attribute", on_click=lambda: make_attribute(self._add_attribute)
            ).props("flat dense no-caps"),
        )  # fmt: skip
        self._inherited = ui.label().classes("somrs-soft")
        self._rebuild_defaults = fields.rows(
            "defaults", "Defaults", "default", self._default, lambda: {"path": None, "value": ""},
            "Values for objects that do not set the attribute.",
        )  # fmt: skip
        fields.rows(
            "parts",
            "Parts",
            "part",
            self._part,
            lambda: {"type": None, "minimum": "1", "maximum": ""},
            "Parts that every object has.",
        )
        fields.flag("closed", "Objects have no other parts than those listed here and inherited")
        self._rebuild_rules = fields.rows("constraints", "Rules", "rule", self._rule, lambda: dict(BLANK_RULE))
        fields.text("driver", "Driver", hint="module:Class of the program that serves such a device", width="full")
        self._show_inherited()
        fields.add_callback("parent", self._parent_chosen)

    def _available_attributes(self) -> Mapping[str, AttributeType]:
        return attributes_with(self._fields.draft.form, self._view.ontology)

    def _show_inherited(self) -> None:
        parent = self._fields.value_at("parent") or ""
        types = [self._view.ontology.types[ancestor] for ancestor in self._view.ontology.ancestors(parent)]
        names = dict.fromkeys(name for type in types for name in (*type.required, *type.attributes))
        self._inherited.text = f"From {parent}: {', '.join(names)}" if names else ""

    def _parent_chosen(self) -> None:
        self._show_inherited()
        self._attributes_chosen()

    def _attributes_chosen(self) -> None:
        self._rebuild_defaults()
        self._rebuild_rules()

    def _add_attribute(self, name: str) -> None:
        """Add a new attribute to the type."""
        self._fields.value_at("attributes").append({"attribute": name, "must": False})
        self._rebuild_attributes()
        self._attributes_chosen()
        self._fields.store_draft()

    # Rows

    def _attribute(self, path: str) -> None:
        self._fields.choice(f"{path}.attribute", "Attribute", sorted(self._view.ontology.attributes), callback=self._attributes_chosen)
        self._fields.flag(f"{path}.must", "required")

    def _part(self, path: str) -> None:
        self._fields.choice(f"{path}.type", "Type", sorted(self._view.ontology.types))
        self._fields.text(f"{path}.minimum", "At least", width="narrow")
        self._fields.text(f"{path}.maximum", "At most", width="narrow", hint="no limit if empty")

    def _default(self, path: str) -> None:
        attributes = self._available_attributes()
        value: ui.input | ui.select | None = None

        def chosen() -> None:
            nonlocal value
            attribute = attributes.get(self._fields.value_at(f"{path}.path") or "")
            if isinstance(value, ui.input) and not _listed(attribute):
                value.props["suffix"] = _unit(attribute)  # the field stays, since the user may be typing in it
                return
            slot.clear()
            with slot:
                value = self._value(f"{path}.value", attribute)

        self._fields.choice(f"{path}.path", "Attribute", _simple(attributes), callback=chosen)
        slot = ui.element("div").classes("somrs-onto-slot")
        chosen()

    def _value(self, path: str, attribute: AttributeType | None) -> ui.input | ui.select:
        """A field for a value of the attribute."""
        if attribute is None or not _listed(attribute):
            return self._fields.text(path, "Value", width="middle", suffix=_unit(attribute))
        return self._fields.choice(path, "Value", _TRUTHS if attribute.kind is Kind.TRUTH else attribute.values, width="middle")

    def _rule(self, path: str) -> None:
        self._fields.choice(f"{path}.sort", "Rule", _RULES, width="middle", callback=lambda: self._rebuild_rules())
        if self._fields.value_at(f"{path}.sort") == FORMULA:
            hint = "?Self is the object; other typed variables are parts of it"
            object_type = type_from_form(self._fields.draft.form, self._fields.draft.name or "type")
            self._fields.formula(f"{path}.formula", "Formula", {SELF_VARIABLE: object_type.name}, hint=hint, types=[object_type])
        else:
            limit_fields(self._fields, path, self._available_attributes())
        self._fields.text(f"{path}.doc", "Message when the rule is broken", width="full")


def limit_fields(fields: Fields, path: str, attributes: Mapping[str, AttributeType]) -> None:
    """The fields for the limits of one of the attributes."""

    def chosen() -> None:
        attribute = attributes.get(fields.value_at(f"{path}.attribute") or "")
        for field in ends:
            field.props["suffix"] = _unit(attribute)
            field.visible = attribute is None or attribute.kind is Kind.NUMBER
        is_group = attribute is not None and attribute.kind is Kind.COMPLEX
        values.props["hint"] = "groups of attributes, separated by commas" if is_group else "separated by commas"

    fields.choice(f"{path}.attribute", "Attribute", sorted(attributes), callback=chosen)
    ends = [fields.text(f"{path}.{key}", label, width="narrow") for key, label in (("minimum", "At least"), ("maximum", "At most"))]
    values = fields.text(f"{path}.values", "One of", width="middle", hint="separated by commas")
    chosen()


def _listed(attribute: AttributeType | None) -> bool:
    """Whether the values are chosen from a list."""
    return attribute is not None and attribute.kind in (Kind.TRUTH, Kind.ENUMERATION)


def _unit(attribute: AttributeType | None) -> str:
    return attribute.unit or "" if attribute is not None else ""


def _simple(attributes: Mapping[str, AttributeType]) -> list[str]:
    """The attributes that have values themselves, in contrast to groups."""
    return sorted(path for path, attribute in attributes.items() if attribute.kind is not Kind.COMPLEX)
