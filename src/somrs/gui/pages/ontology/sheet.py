"""What there is to read of one definition."""

from __future__ import annotations

from urllib.parse import quote

from nicegui import ui

from somrs.gui.pages.ontology.pieces import Go, Word, cell, chapter, note, row, table, way, ways
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
from somrs.gui.pages.ontology.seen import Had, Seen
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import PART_OF, AttributeType, Definition, FunctionType, ObjectType, RelationType

MOST_OBJECTS = 60
"""So many objects are named; the map shows them all."""

PLACES = ("first", "second", "third", "fourth", "fifth")


def show(definition: Definition, seen: Seen, go: Go) -> None:
    """The sheet of a definition, into the current element."""
    match definition:
        case ObjectType():
            _type(definition, seen, go)
        case AttributeType():
            _attribute(definition, seen, go)
        case RelationType():
            _relation(definition, seen, go)
        case FunctionType():
            _function(definition, seen, go)
        case ServiceType():
            _service(definition, seen, go)


# Types


def _type(type: ObjectType, seen: Seen, go: Go) -> None:
    _attributes(type, seen, go)
    _parts(type, seen, go)
    _rules(type, seen, go)
    _relations(type, seen, go)
    _services(type, seen, go)
    if driver := seen.ontology.driver(type.name):
        with chapter("Driver"):
            Word("code", driver, "somrs-formula")
            if driver != type.driver:
                origin = next(one for one in seen.ontology.ancestors(type.name) if seen.ontology.types[one].driver)
                _origin(origin, type.name, go)
    below = [one.name for one in seen.ontology.types.values() if one.parent == type.name]
    if below:
        with chapter("Types directly below", len(below)):
            ways(go, TYPES, sorted(below))
    _objects(type, seen)


def _origin(origin: str, own: str, go: Go) -> None:
    """From which type something comes."""
    if origin == own:
        Word("span", "own", "somrs-onto-own")
    else:
        with ui.element("span").classes("somrs-onto-from"):
            Word("span", "from ")
            way(go, TYPES, origin)


def _attributes(type: ObjectType, seen: Seen, go: Go) -> None:
    had = seen.attributes_of(type.name)
    with chapter("Attributes", len([one for one in had if "." not in one.path])):
        if not had:
            note("Objects of this type have no attributes.")
            return
        with table("Attribute", "Values", "Default", "Comes from"):
            for one in had:
                _attribute_row(one, type.name, go)


def _attribute_row(had: Had, own: str, go: Go) -> None:
    depth = had.path.count(".")
    with row("somrs-onto-inner" if depth else ""):
        with cell() as made:
            made.style(f"padding-left: {8 + 16 * depth}px")
            way(go, ATTRIBUTES, had.attribute.name, had.path.rpartition(".")[2])
            if had.must and not depth:
                Word("span", "must", "somrs-onto-must").tooltip("Every object of this type has one")
        Word("td", kind_text(had.attribute))
        with cell():
            if had.default is not None:
                Word("span", value_text(had.default, had.attribute))
                if had.default_from and had.default_from != own:
                    Word("span", f" from {had.default_from}", "somrs-soft")
        with cell():
            if not depth:
                _origin(had.origin, own, go)


def _parts(type: ObjectType, seen: Seen, go: Go) -> None:
    parts = seen.parts_of(type.name)
    if not parts:
        return
    with chapter("Parts", len(parts)), table("Type", "How many", "Comes from"):
        for origin, part in parts:
            with row():
                with cell():
                    way(go, TYPES, part.type)
                Word("td", part_text(part))
                with cell():
                    _origin(origin, type.name, go)


def _rules(type: ObjectType, seen: Seen, go: Go) -> None:
    rules = seen.rules_of(type.name)
    if not rules:
        return
    known = seen.ontology.attributes_of(type.name)
    with chapter("Rules", len(rules)), table("Rule", "Comes from"):
        for origin, rule in rules:
            attribute = known.get(rule.attribute or "")
            with row():
                with cell():
                    if rule.doc:
                        ui.label(rule.doc)
                    text = constraint_text(rule, attribute.unit if attribute else None)
                    Word("code" if rule.formula else "div", text, "somrs-formula somrs-soft" if rule.formula else "somrs-onto-limit")
                with cell():
                    _origin(origin, type.name, go)


def _relations(type: ObjectType, seen: Seen, go: Go) -> None:
    relations = seen.relations_of(type.name)
    if not relations:
        return
    with chapter("Relations it can stand in", len(relations)), table("Relation", "Joins", "It is the"):
        for relation, places in relations:
            with row():
                with cell():
                    way(go, RELATIONS, relation.name)
                with cell():
                    ways(go, TYPES, list(relation.joins))
                Word("td", "any of them" if len(places) == len(relation.joins) else " or ".join(PLACES[place] for place in places))


def _services(type: ObjectType, seen: Seen, go: Go) -> None:
    services = seen.services_of(type.name)
    if not services:
        return
    with chapter("Service types that speak of it", len(services)), table("Service type", "As", "Effect"):
        for service, roles in services:
            with row():
                with cell():
                    way(go, SERVICES, service.name)
                Word("td", ", ".join(roles))
                with cell():
                    Word("code", service.effect, "somrs-formula")


def _objects(type: ObjectType, seen: Seen) -> None:
    objects = seen.of_type(type.name)
    with chapter("Objects on the map", len(objects)):
        if not objects:
            note("There is no object of this type, nor of a type below it.")
            return
        with ui.element("span").classes("somrs-onto-ways"):
            for name, exact in objects[:MOST_OBJECTS]:
                with ui.link(target=f"/map?object={quote(name)}").classes("somrs-onto-way"):
                    Word("span", name)
                    if exact != type.name:
                        Word("span", f" {exact}", "somrs-soft")
        if len(objects) > MOST_OBJECTS:
            note(f"and {len(objects) - MOST_OBJECTS} more")


# The others


def _facts(*said: tuple[str, str]) -> None:
    """What there is to say of something, in pairs."""
    with ui.element("dl").classes("somrs-onto-facts"):
        for name, value in said:
            if value:
                Word("dt", name)
                Word("dd", value)


def _attribute(attribute: AttributeType, seen: Seen, go: Go) -> None:
    tolerance = f"{number(attribute.tolerance)} {attribute.unit or ''}".strip() if attribute.tolerance else ""
    with chapter("Values"):
        _facts(("They are", kind_text(attribute)), ("Equal within", tolerance))
        if attribute.attributes:
            ways(go, ATTRIBUTES, list(attribute.attributes))
    owners = [one for one in seen.ontology.types.values() if attribute.name in (*one.attributes, *one.required)]
    with chapter("Types that have it", len(owners)):
        if not owners:
            note("No type has it yet: add it to one.")
        for owner in owners:
            with ui.element("div"):
                way(go, TYPES, owner.name)
                Word("span", " must have it" if attribute.name in owner.required else " may have it", "somrs-soft")
    _users(attribute, seen, go, without={one.name for one in owners})


def _relation(relation: RelationType, seen: Seen, go: Go) -> None:
    with chapter("Joins", len(relation.joins)):
        ways(go, TYPES, list(relation.joins))
        written = f"A {relation.name} B" if len(relation.joins) == 2 else f"{relation.name}({', '.join('ABCDEF'[: len(relation.joins)])})"
        _facts(
            ("Written", written),
            ("Either way round", "yes: A to B is B to A" if relation.symmetric else ""),
            ("At a time", f"an object stands in {relation.name} to one other only" if relation.functional else ""),
            ("Excludes", _excluded(relation, seen)),
            ("Built in", "maps nest parts in their wholes by it" if relation.name == PART_OF else ""),
        )
    _users(relation, seen, go)


def _excluded(relation: RelationType, seen: Seen) -> str:
    if relation.excludes is None:
        return ""
    others = [one.name for one in seen.ontology.relations.values() if one.excludes == relation.excludes and one is not relation]
    return f"{', '.join(others) or 'nothing yet'} (group {relation.excludes}): an object stands in one of them at a time"


def _function(function: FunctionType, seen: Seen, go: Go) -> None:
    with chapter("Of", len(function.parameters)):
        ways(go, TYPES, list(function.parameters))
    with chapter("Value"):
        unit = f"in {function.unit}" if function.unit else ""
        if function.attribute:
            _facts(("It reads", function.attribute), ("Unit", function.unit or ""))
        elif not function.values:
            note(f"SO-MRS works it out {unit}".strip() + ".")
    if function.values:
        with chapter("Table", len(function.values)), table("Of", f"Value {unit}".strip()):
            for key, value in function.values.items():
                with row():
                    Word("td", key)
                    Word("td", number(value))
    _users(function, seen, go)


def _service(service: ServiceType, seen: Seen, go: Go) -> None:
    with chapter("What it does"):
        _facts(("Kind", service.kind.value))
        for label, text in (("Before it", service.precondition or ""), ("After it", service.effect), ("Costs", service.cost or "")):
            if text:
                ui.label(label).classes("somrs-soft")
                Word("code", text, "somrs-formula somrs-onto-formula")
    _parameters("Inputs", service.inputs, go)
    _parameters("Outputs", service.outputs, go)
    if service.handlers:
        with chapter("Handlers", len(service.handlers)), table("On", "When", "Bring about"):
            for handler in service.handlers:
                with row():
                    Word("td", handler.on.value)
                    with cell():
                        Word("code", handler.when or "always", "somrs-formula")
                    with cell():
                        Word("code", handler.effect, "somrs-formula")
    below = [one.name for one in seen.ontology.services.values() if one.parent == service.name]
    if below:
        with chapter("Service types directly below", len(below)):
            ways(go, SERVICES, sorted(below))


def _parameters(title: str, parameters: tuple[Parameter, ...], go: Go) -> None:
    if not parameters:
        return
    with chapter(title, len(parameters)), table("Variable", "Type"):
        for one in parameters:
            with row():
                with cell():
                    Word("code", f"?{one.name}", "somrs-formula")
                with cell():
                    if one.type in ("number", "text", "truth"):
                        Word("span", one.type)
                    else:
                        way(go, TYPES, one.type)


def _users(definition: Definition, seen: Seen, go: Go, without: set[str] | None = None) -> None:
    """Who else speaks of it."""
    section = section_of(definition)
    users = [(one, name) for one, name in seen.users(section, definition.name) if not (one is TYPES and name in (without or ()))]
    if not users:
        return
    with chapter("Spoken of by", len(users)):
        for key in (TYPES.key, SERVICES.key, ATTRIBUTES.key, RELATIONS.key, FUNCTIONS.key):
            if names := [name for one, name in users if one.key == key]:
                ui.label(SECTION[key].label).classes("somrs-soft")
                ways(go, SECTION[key], names)
