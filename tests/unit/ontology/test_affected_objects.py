"""A change of the ontology is looked at as thoroughly as if the whole map were; and rules about an object's own values are asked quickly,
and answered as ever."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec import structs

from somrs.entish import Name
from somrs.entish.formula import Formula, substitute
from somrs.entish.parse import parse
from somrs.ontology.affected_objects import violations_after
from somrs.ontology.conformance import violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Section, key_of, revise_ontology
from somrs.ontology.objects import Fact, FactAdded, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.truth import formula_holds
from somrs.ontology.type_rules import SELF_VARIABLE
from somrs.ontology.types import (
    PART_OF,
    AttributeType,
    Constraint,
    Definition,
    FunctionType,
    Kind,
    ObjectType,
    Ontology,
    Part,
    RelationType,
)
from tests.support.examples import examples
from tests.unit.repository.test_redefinition import WORKSHOP

LOADED = load_text(WORKSHOP, base=upper())
assert LOADED.map is not None
MAP, ONTOLOGY = LOADED.map, LOADED.ontology

TYPES = ["Tin", "SmallTin", "Bench", "Graspable", "Table", "Support", "PhysicalObject", "Storey", "Building", "PioneerP3DX", "Place"]
RULES = [
    Constraint(formula="?Self.PositionX < 2"),
    Constraint(formula="?Self.Weight < 0.6 OR ?Self.Package.Volume > 1"),
    Constraint(formula="?Thing: Tin isOn ?Self"),
    Constraint(formula="NOT ?Self isOn ?Bench: Bench"),
    Constraint(formula="content(?Self) > 1"),
    Constraint(attribute="PositionX", maximum=2),
]

EDITS: list[dict[str, Any]] = [
    *({"parent": parent} for parent in ("Graspable", "Support", "Tin", "Room", "Device", "Furniture", "Object", "AbstractObject")),
    *({"constraints": (rule,)} for rule in RULES),
    *({"required": (name,)} for name in ("Weight", "Package")),
    *({key: {} if key == "defaults" else ()} for key in ("attributes", "defaults")),
    *({"parts": (part,)} for part in (Part(type="Tin"), Part(type="Storey", minimum=2))),
    {"doc": "x"},
]


def edited(data: st.DataObject) -> tuple[list[DefinitionKey], list[Definition]]:
    """What is removed, and what is otherwise."""
    kind = data.draw(st.sampled_from(["type", "type", "type", "attribute", "relation", "function", "removed"]))
    if kind == "type":
        type = ONTOLOGY.types[data.draw(st.sampled_from(TYPES))]
        return [], [structs.replace(type, **data.draw(st.sampled_from(EDITS)))]
    if kind == "attribute":
        attribute: AttributeType = ONTOLOGY.attributes[data.draw(st.sampled_from(["PositionX", "Weight", "Volume", "Width"]))]
        return [], [structs.replace(attribute, **data.draw(st.sampled_from([{"maximum": 1.5}, {"tolerance": 2.0}, {"minimum": 0.5}])))]
    if kind == "relation":
        relation: RelationType = ONTOLOGY.relations[data.draw(st.sampled_from(["isOn", "belongsTo", "isPartOf"]))]
        joins = data.draw(st.sampled_from([("Object", "Object"), ("Tin", "Bench"), ("SmallTin", "Bench"), ("Room", "Room")]))
        return [], [structs.replace(relation, joins=joins, excludes=data.draw(st.sampled_from([None, "place"])))]
    if kind == "function":
        return [], [structs.replace(ONTOLOGY.functions["content"], attribute=data.draw(st.sampled_from(["Weight", "PositionX"])))]
    names_by_section = {Section.TYPES: TYPES, Section.ATTRIBUTES: ["Weight", "Content", "Label"], Section.RELATIONS: ["belongsTo", "isOn"]}
    section = data.draw(st.sampled_from([*names_by_section]))
    return [DefinitionKey(section=section, name=data.draw(st.sampled_from(names_by_section[section])))], []


def without_broken_formulas(ontology: Ontology) -> bool:
    return not any(violation.section == "types" and violation.path.startswith("constraints") for violation in ontology_violations(ontology))


@given(st.data())
@examples(75)
def test_looking_at_what_a_change_concerns_finds_what_looking_at_all_finds(data: st.DataObject) -> None:
    ontology_before = ONTOLOGY
    if data.draw(st.booleans()):  # rules that another change may break
        name, rule = data.draw(st.sampled_from(TYPES[:6])), data.draw(st.sampled_from(RULES))
        ontology_before = ontology_before.extended([structs.replace(ontology_before.types[name], constraints=(rule,))])
        assume(without_broken_formulas(ontology_before) and not violations(MAP, ontology_before))
    removed, definitions = edited(data)
    ontology_after = revise_ontology(ontology_before, removed, definitions)
    assume(without_broken_formulas(ontology_after))
    found_violations = violations_after(MAP, ontology_before, ontology_after, [*removed, *map(key_of, definitions)])
    assert set(map(str, found_violations)) == set(map(str, violations(MAP, ontology_after)))


def test_a_rule_about_another_type_is_looked_at_when_that_moves() -> None:
    full = structs.replace(ONTOLOGY.types["Bench"], name="FullBench", parent="Bench", constraints=(RULES[2],))
    ontology_before = ONTOLOGY.extended([full])
    bench = structs.replace(MAP.objects["Bench1"], type="FullBench")
    facts = [FactAdded(fact) for fact in MAP.facts_about("Bench1") if "Tin1" not in fact.arguments]
    map = MAP.changed([ObjectRemoved("Bench1"), ObjectAdded(bench), *facts])
    assert violations(map, ontology_before) == []
    ontology_after = ontology_before.extended([structs.replace(ONTOLOGY.types["Tin"], name="SmallTin")])
    found_violations = violations_after(map, ontology_before, ontology_after, [DefinitionKey(section=Section.TYPES, name="SmallTin")])
    assert [(violation.subject, violation.rule) for violation in found_violations] == [("Bench1", "constraint")]


VALUES = st.sampled_from([None, 0.1, 0.3, 2.0, math.pi])


@pytest.mark.parametrize(
    "rule",
    [
        "NOT ?Self.Shape.Form = Box OR ?Self.Shape.Width >= 0 AND ?Self.Shape.Depth >= 0",
        "?Self.Weight < 0.3 kg OR NOT ?Self.PositionX > 1",
        "?Self.Weight != 300 g",
        "?Self.PositionX = 2.01 AND ?Self.Color = Red",
        '?Self.Label = "x" OR ?Self.Unknown = TRUE',
    ],
)
@given(st.data())
@examples(40)
def test_a_rule_about_an_objects_own_values_is_answered_as_any_formula_is(rule: str, data: st.DataObject) -> None:
    type = structs.replace(ONTOLOGY.types["Tin"], constraints=(Constraint(formula=rule),), required=(), defaults={})
    ontology = ONTOLOGY.extended(
        [type, structs.replace(ONTOLOGY.types["Graspable"], required=()), RelationType(name="r", joins=("Object",))]
    )
    map = MAP.changed([FactAdded(Fact("r", ("Tin1",)))])
    for name in ("Tin1", "Tin2"):
        for path in ("Weight", "PositionX", "Shape.Width", "Shape.Depth"):
            map = map.changed([ValueSet(name, path, data.draw(VALUES))])
        map = map.changed([ValueSet(name, "Shape.Form", data.draw(st.sampled_from([None, "Box"])))])
        map = map.changed([ValueSet(name, "Color", data.draw(st.sampled_from([None, "Red", "Blue"])))])
        map = map.changed([ValueSet(name, "Unknown", data.draw(st.sampled_from([None, True, False])))])
        map = map.changed([ValueSet(name, "Label", data.draw(st.sampled_from([None, "x", "y"])))])
    broken = {violation.subject for violation in violations(map, ontology) if rule in violation.message}
    naive = {name for name in ("Tin1", "Tin2") if not formula_holds(_rule_for(rule, name), map, ontology)}
    assert broken == naive


def _rule_for(rule: str, name: str) -> Formula:
    return substitute(parse(rule), {SELF_VARIABLE: Name(name)})


# Nothing else is looked at: here everything lacks a mark, so that what was looked at is told.

UNMARKED = Ontology(
    [
        *(AttributeType(name=name, kind=Kind.NUMBER) for name in ("Mark", "Weight", "Size", "Depth")),
        AttributeType(name="Shape", kind=Kind.COMPLEX, attributes=("Size",)),
        RelationType(name=PART_OF, joins=("Object", "Object")),
        *(RelationType(name=name, joins=("Object", "Object"), doc="old") for name in ("isOn", "isNear")),
        FunctionType(name="depth", parameters=("Object",), attribute="Depth"),
        ObjectType(name="Object", parent=None),
        ObjectType(name="AbstractObject", parent="Object"),
        ObjectType(name="Site", parent="AbstractObject"),
        ObjectType(name="Thing", parent="Object", required=("Mark",), attributes=("Weight",)),
        ObjectType(name="Box", parent="Thing", attributes=("Shape",)),
        ObjectType(name="Cup", parent="Thing", constraints=(Constraint(attribute="Weight", maximum=2),)),
        ObjectType(name="Lid", parent="Object", required=("Mark",), constraints=(Constraint(formula="NOT ?Self isNear ?Other"),)),
        ObjectType(name="Ring", parent="Object", required=("Mark",), constraints=(Constraint(formula="depth(?Self) < 3"),)),
        ObjectType(name="Pin", parent="Object", required=("Mark",), constraints=(Constraint(formula="?Box: Box isOn ?Self"),)),
        ObjectType(name="Vat", parent="Object"),
    ]
)
UNMARKED_MAP = Map(
    [Object(name=name, type=name.rstrip("1")) for name in ("Site1", "Thing1", "Box1", "Cup1", "Lid1", "Ring1", "Pin1", "Box11")],
    [
        *(Fact(PART_OF, (name, "Site1")) for name in ("Thing1", "Box1", "Cup1", "Lid1", "Ring1", "Pin1", "Box11")),
        Fact("isOn", ("Thing1", "Lid1")),
    ],
)
TYPE = UNMARKED.types


@pytest.mark.parametrize(
    ("new", "removed_names", "checked_subjects"),
    [
        ([AttributeType(name="Weight", kind=Kind.NUMBER, unit="kg")], (), "Box1 Box11 Cup1 Thing1"),
        ([AttributeType(name="Weight", kind=Kind.NUMBER, doc="other")], (), ""),
        ([AttributeType(name="Size", kind=Kind.NUMBER, unit="m")], (), "Box1 Box11"),
        ([AttributeType(name="Depth", kind=Kind.NUMBER, unit="m")], (), ""),
        ([structs.replace(UNMARKED.relations["isOn"], excludes="place")], (), "Lid1 Pin1 Thing1"),
        ([structs.replace(UNMARKED.relations["isOn"], doc="new")], (), ""),
        ([structs.replace(UNMARKED.relations["isNear"], symmetric=True)], (), "Lid1"),
        ([structs.replace(UNMARKED.functions["depth"], unit="m")], (), "Ring1"),
        ([structs.replace(TYPE["Box"], attributes=())], (), "Box1 Box11"),
        ([structs.replace(TYPE["Box"], parent="Cup")], (), "Box1 Box11 Pin1"),
        ([structs.replace(TYPE["Thing"], attributes=())], (), "Box1 Box11 Cup1 Thing1"),
        ([ObjectType(name="New", parent="Box")], (), "Pin1"),
        ([ObjectType(name="New", parent="Box"), structs.replace(TYPE["Vat"], driver="v")], (), "Pin1"),
        ([structs.replace(TYPE["Vat"], driver="v")], (), ""),
        ([], ("Vat",), "Pin1"),
        ([structs.replace(TYPE["Vat"], parent="AbstractObject")], (), "Pin1"),  # there is none on the map
        ([structs.replace(TYPE["Lid"], parent="AbstractObject")], (), "Box1 Box11 Cup1 Lid1 Pin1 Ring1 Thing1"),
        ([structs.replace(TYPE["Site"], parent="Object")], (), "Box1 Box11 Cup1 Lid1 Pin1 Ring1 Site1 Thing1 map"),
    ],
)
def test_only_what_is_concerned_is_looked_at(new: list[Definition], removed_names: tuple[str, ...], checked_subjects: str) -> None:
    removed = [DefinitionKey(section=Section.TYPES, name=name) for name in removed_names]
    ontology_after = revise_ontology(UNMARKED, removed, new)
    found_violations = violations_after(UNMARKED_MAP, UNMARKED, ontology_after, [*removed, *map(key_of, new)])
    assert " ".join(sorted({violation.subject for violation in found_violations})) == checked_subjects
