"""The read-only view of a definition."""

from __future__ import annotations

from urllib.parse import quote

from nicegui import ui

from somrs.gui.pages.ontology.elements import OpenDefinition, TextTag, cell, chapter, definition_link, definition_links, note, row, table
from somrs.gui.pages.ontology.ontology_view import OntologyView, TypeAttribute
from somrs.gui.pages.ontology.sections import (
    ATTRIBUTES,
    FUNCTIONS,
    RELATIONS,
    SECTION,
    SERVICES,
    TYPES,
    constraint_text,
    kind_text,
    number,
    part_text,
    section_of,
    value_text,
)
from somrs.ontology.complex_values import inner_paths
from somrs.ontology.service_kinds import planning_notes
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import PART_OF, AttributeType, Definition, FunctionType, ObjectType, RelationType

MOST_OBJECTS = 60
"""Limit of objects listed; the map shows all."""

_ORDINALS = ("first", "second", "third", "fourth", "fifth")


def show_definition(definition: Definition, view: OntologyView, open_definition: OpenDefinition) -> None:
    """Add the sheet of a definition to the current element."""
    match definition:
        case ObjectType():
            _type(definition, view, open_definition)
        case AttributeType():
            _attribute(definition, view, open_definition)
        case RelationType():
            _relation(definition, view, open_definition)
        case FunctionType():
            _function(definition, view, open_definition)
        case ServiceType():
            _service(definition, view, open_definition)


# Types


def _type(type: ObjectType, view: OntologyView, open_definition: OpenDefinition) -> None:
    _attributes(type, view, open_definition)
    _parts(type, view, open_definition)
    _rules(type, view, open_definition)
    _relations(type, view, open_definition)
    _services(type, view, open_definition)
    if driver := view.ontology.driver(type.name):
        with chapter("Driver"):
            TextTag("code", driver, "somrs-formula")
            if driver != type.driver:
                origin = next(ancestor for ancestor in view.ontology.ancestors(type.name) if view.ontology.types[ancestor].driver)
                _origin(origin, type.name, open_definition)
    subtypes = [subtype.name for subtype in view.ontology.types.values() if subtype.parent == type.name]
    if subtypes:
        with chapter("Types directly below", len(subtypes)):
            definition_links(open_definition, TYPES, sorted(subtypes))
    _objects(type, view)


def _origin(origin: str, type_name: str, open_definition: OpenDefinition) -> None:
    """Add the type from which an item is inherited."""
    if origin == type_name:
        TextTag("span", "own", "somrs-onto-own")
    else:
        with ui.element("span").classes("somrs-onto-from"):
            TextTag("span", "from ")
            definition_link(open_definition, TYPES, origin)


def _attributes(type: ObjectType, view: OntologyView, open_definition: OpenDefinition) -> None:
    type_attributes = view.attributes_of(type.name)
    with chapter("Attributes", len([type_attribute for type_attribute in type_attributes if "." not in type_attribute.path])):
        if not type_attributes:
            note("Objects of this type have no attributes.")
            return
        with table("Attribute", "Values", "Default", "Comes from"):
            for type_attribute in type_attributes:
                _attribute_row(type_attribute, type.name, open_definition)


def _attribute_row(type_attribute: TypeAttribute, type_name: str, open_definition: OpenDefinition) -> None:
    depth = type_attribute.path.count(".")
    with row("somrs-onto-inner" if depth else ""):
        with cell() as name_cell:
            name_cell.style(f"padding-left: {8 + 16 * depth}px")
            definition_link(open_definition, ATTRIBUTES, type_attribute.attribute.name, type_attribute.path.rpartition(".")[2])
            if type_attribute.is_required and not depth:
                TextTag("span", "required", "somrs-onto-must").tooltip("Every object of this type has one")
        TextTag("td", kind_text(type_attribute.attribute))
        with cell():
            if type_attribute.default is not None:
                TextTag("span", value_text(type_attribute.default, type_attribute.attribute))
                if type_attribute.default_from and type_attribute.default_from != type_name:
                    TextTag("span", f" from {type_attribute.default_from}", "somrs-soft")
        with cell():
            if not depth:
                _origin(type_attribute.origin, type_name, open_definition)


def _parts(type: ObjectType, view: OntologyView, open_definition: OpenDefinition) -> None:
    parts = view.parts_of(type.name)
    if not parts:
        if view.ontology.is_closed(type.name):
            with chapter("Parts"):
                note("None: this type is elementary. Its objects are described by their attributes.")
        return
    with chapter("Parts", len(parts)), table("Type", "How many", "Comes from"):
        for origin, part in parts:
            with row():
                with cell():
                    definition_link(open_definition, TYPES, part.type)
                TextTag("td", part_text(part))
                with cell():
                    _origin(origin, type.name, open_definition)


def _rules(type: ObjectType, view: OntologyView, open_definition: OpenDefinition) -> None:
    rules = view.rules_of(type.name)
    if not rules:
        return
    attributes = view.ontology.attributes_of(type.name)
    with chapter("Rules", len(rules)), table("Rule", "Comes from"):
        for origin, rule in rules:
            attribute = attributes.get(rule.attribute or "")
            with row():
                with cell():
                    if rule.doc:
                        ui.label(rule.doc)
                    text = constraint_text(rule, attribute.unit if attribute else None)
                    TextTag("code" if rule.formula else "div", text, "somrs-formula somrs-soft" if rule.formula else "somrs-onto-limit")
                with cell():
                    _origin(origin, type.name, open_definition)


def _relations(type: ObjectType, view: OntologyView, open_definition: OpenDefinition) -> None:
    relations = view.relations_of(type.name)
    if not relations:
        return
    with chapter("Relations it can be in", len(relations)), table("Relation", "Joins", "It is the"):
        for relation, places in relations:
            with row():
                with cell():
                    definition_link(open_definition, RELATIONS, relation.name)
                with cell():
                    definition_links(open_definition, TYPES, list(relation.joins))
                TextTag("td", "any of them" if len(places) == len(relation.joins) else " or ".join(_ORDINALS[place] for place in places))


def _services(type: ObjectType, view: OntologyView, open_definition: OpenDefinition) -> None:
    services = view.services_of(type.name)
    if not services:
        return
    with chapter("Service types that use it", len(services)), table("Service type", "As", "Effect"):
        for service, roles in services:
            with row():
                with cell():
                    definition_link(open_definition, SERVICES, service.name)
                TextTag("td", ", ".join(roles))
                with cell():
                    TextTag("code", service.effect, "somrs-formula")


def _objects(type: ObjectType, view: OntologyView) -> None:
    objects = view.objects_of_type(type.name)
    with chapter("Objects on the map", len(objects)):
        if not objects:
            note("There are no objects of this type or its subtypes.")
            return
        with ui.element("span").classes("somrs-onto-ways"):
            for name, exact in objects[:MOST_OBJECTS]:
                with ui.link(target=f"/map?object={quote(name)}").classes("somrs-onto-way"):
                    TextTag("span", name)
                    if exact != type.name:
                        TextTag("span", f" {exact}", "somrs-soft")
        if len(objects) > MOST_OBJECTS:
            note(f"and {len(objects) - MOST_OBJECTS} more")


# Other definitions


def _facts(*facts: tuple[str, str]) -> None:
    """Add a list of names and values; empty values are left out."""
    with ui.element("dl").classes("somrs-onto-facts"):
        for name, value in facts:
            if value:
                TextTag("dt", name)
                TextTag("dd", value)


def _attribute(attribute: AttributeType, view: OntologyView, open_definition: OpenDefinition) -> None:
    tolerance = f"{number(attribute.tolerance)} {attribute.unit or ''}".strip() if attribute.tolerance else ""
    with chapter("Values"):
        _facts(("Kind", kind_text(attribute)), ("Equal within", tolerance))
        if attribute.attributes:
            definition_links(open_definition, ATTRIBUTES, list(attribute.attributes))
    if attribute.constraints:
        inner = dict(inner_paths(attribute, view.ontology))
        with chapter("Rules", len(attribute.constraints)), table("Rule"):
            for rule in attribute.constraints:
                with row(), cell():
                    if rule.doc:
                        ui.label(rule.doc)
                    limited = inner.get(rule.attribute or "")
                    TextTag("div", constraint_text(rule, limited.unit if limited else None), "somrs-onto-limit")
    owners = [owner for owner in view.ontology.types.values() if attribute.name in (*owner.attributes, *owner.required)]
    with chapter("Types that have it", len(owners)):
        if not owners:
            note("No type has it yet: add it to one.")
        for owner in owners:
            with ui.element("div"):
                definition_link(open_definition, TYPES, owner.name)
                TextTag("span", " (required)" if attribute.name in owner.required else " (optional)", "somrs-soft")
    _users(attribute, view, open_definition, excluded_names={owner.name for owner in owners})


def _relation(relation: RelationType, view: OntologyView, open_definition: OpenDefinition) -> None:
    with chapter("Joins", len(relation.joins)):
        definition_links(open_definition, TYPES, list(relation.joins))
        written = f"A {relation.name} B" if len(relation.joins) == 2 else f"{relation.name}({', '.join('ABCDEF'[: len(relation.joins)])})"
        _facts(
            ("Written", written),
            ("Symmetric", "yes: A to B is B to A" if relation.symmetric else ""),
            ("Functional", f"an object has {relation.name} to one other at a time" if relation.functional else ""),
            ("Excludes", _excluded(relation, view)),
            ("Built in", "map files nest parts in their wholes by this relation" if relation.name == PART_OF else ""),
        )
    _users(relation, view, open_definition)


def _excluded(relation: RelationType, view: OntologyView) -> str:
    if relation.excludes is None:
        return ""
    other_names = [
        other_relation.name
        for other_relation in view.ontology.relations.values()
        if other_relation.excludes == relation.excludes and other_relation is not relation
    ]
    return f"{', '.join(other_names) or 'nothing yet'} (group {relation.excludes}): an object has one of them at a time"


def _function(function: FunctionType, view: OntologyView, open_definition: OpenDefinition) -> None:
    with chapter("Parameters", len(function.parameters)):
        definition_links(open_definition, TYPES, list(function.parameters))
    with chapter("Value"):
        unit = f"in {function.unit}" if function.unit else ""
        if function.attribute:
            _facts(("It reads", function.attribute), ("Unit", function.unit or ""))
        elif not function.values:
            note(f"Computed by SO-MRS {unit}".strip() + ".")
    if function.values:
        with chapter("Table", len(function.values)), table("Of", f"Value {unit}".strip()):
            for key, value in function.values.items():
                with row():
                    TextTag("td", key)
                    TextTag("td", number(value))
    _users(function, view, open_definition)


def _service(service: ServiceType, view: OntologyView, open_definition: OpenDefinition) -> None:
    with chapter("Definition"):
        _facts(("Kind", service.kind.value))
        for label, text in (
            ("Precondition", service.precondition),
            ("While it runs", service.invariant),
            ("Effect", service.effect),
            ("Cost", service.cost),
        ):
            if text:
                ui.label(label).classes("somrs-soft")
                TextTag("code", text, "somrs-formula somrs-onto-formula")
    _parameters("Inputs", service.inputs, open_definition)
    _parameters("Outputs", service.outputs, open_definition)
    for text in planning_notes(service):
        note(f"{text[:1].upper()}{text[1:]}.")
    if service.handlers:
        with chapter("Handlers", len(service.handlers)), table("On", "When", "Make true"):
            for handler in service.handlers:
                with row():
                    TextTag("td", handler.on.value)
                    with cell():
                        TextTag("code", handler.when or "always", "somrs-formula")
                    with cell():
                        TextTag("code", handler.effect, "somrs-formula")
    _providers(service, view)
    subtypes = [subtype.name for subtype in view.ontology.services.values() if subtype.parent == service.name]
    if subtypes:
        with chapter("Service types directly below", len(subtypes)):
            definition_links(open_definition, SERVICES, sorted(subtypes))


def _providers(service: ServiceType, view: OntologyView) -> None:
    """The devices that offer the service, and those whose programs have another definition of it."""
    providers, withheld = sorted(view.providers.get(service.name, ())), sorted(view.withheld.get(service.name, ()))
    with chapter("Offered by", len(providers)):
        if not providers:
            note("No device offers services of this type now.")
        with ui.element("span").classes("somrs-onto-ways"):
            for name in providers[:MOST_OBJECTS]:
                with ui.link(target=f"/map?object={quote(name)}").classes("somrs-onto-way"):
                    TextTag("span", name)
        if len(providers) > MOST_OBJECTS:
            note(f"and {len(providers) - MOST_OBJECTS} more")
    if withheld:
        with chapter("Not on offer", len(withheld)):
            note("The programs of these devices have another definition.")
            with table("Device", "Why"):
                for name, reason in withheld[:MOST_OBJECTS]:
                    with row():
                        TextTag("td", name)
                        TextTag("td", reason)


def _parameters(title: str, parameters: tuple[Parameter, ...], open_definition: OpenDefinition) -> None:
    if not parameters:
        return
    with chapter(title, len(parameters)), table("Variable", "Type"):
        for parameter in parameters:
            with row():
                with cell():
                    TextTag("code", f"?{parameter.name}", "somrs-formula")
                with cell():
                    if parameter.type in ("number", "text", "truth"):
                        TextTag("span", parameter.type)
                    else:
                        definition_link(open_definition, TYPES, parameter.type)


def _users(definition: Definition, view: OntologyView, open_definition: OpenDefinition, excluded_names: set[str] | None = None) -> None:
    """The definitions that refer to it."""
    section = section_of(definition)
    users = [
        (user_section, name)
        for user_section, name in view.users(section, definition.name)
        if not (user_section is TYPES and name in (excluded_names or ()))
    ]
    if not users:
        return
    with chapter("Used by", len(users)):
        for key in (TYPES.key, SERVICES.key, ATTRIBUTES.key, RELATIONS.key, FUNCTIONS.key):
            if names := [name for user_section, name in users if user_section.key == key]:
                ui.label(SECTION[key].label).classes("somrs-soft")
                definition_links(open_definition, SECTION[key], names)
