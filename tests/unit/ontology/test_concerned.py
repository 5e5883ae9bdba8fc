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
from somrs.ontology.concerned import violations_after
from somrs.ontology.conformance import SELF, violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.naming import Named, Section, named, revised
from somrs.ontology.objects import Fact, FactAdded, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.truth import holds
from somrs.ontology.types import AttributeType, Constraint, Definition, Ontology, Part, RelationType
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


def edited(data: st.DataObject) -> tuple[list[Named], list[Definition]]:
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
    every = {Section.TYPES: TYPES, Section.ATTRIBUTES: ["Weight", "Content", "Label"], Section.RELATIONS: ["belongsTo", "isOn"]}
    section = data.draw(st.sampled_from([*every]))
    return [Named(section=section, name=data.draw(st.sampled_from(every[section])))], []


def without_broken_formulas(ontology: Ontology) -> bool:
    return not any(one.section == "types" and one.path.startswith("constraints") for one in ontology_violations(ontology))


@given(st.data())
@examples(75)
def test_looking_at_what_a_change_concerns_finds_what_looking_at_all_finds(data: st.DataObject) -> None:
    before = ONTOLOGY
    if data.draw(st.booleans()):  # rules that another change may break
        name, rule = data.draw(st.sampled_from(TYPES[:6])), data.draw(st.sampled_from(RULES))
        before = before.extended([structs.replace(before.types[name], constraints=(rule,))])
        assume(without_broken_formulas(before) and not violations(MAP, before))
    removed, definitions = edited(data)
    after = revised(before, removed, definitions)
    assume(without_broken_formulas(after))
    found = violations_after(MAP, before, after, [*removed, *map(named, definitions)])
    assert set(map(str, found)) == set(map(str, violations(MAP, after)))


def test_a_rule_about_another_type_is_looked_at_when_that_moves() -> None:
    full = structs.replace(ONTOLOGY.types["Bench"], name="FullBench", parent="Bench", constraints=(RULES[2],))
    before = ONTOLOGY.extended([full])
    bench = structs.replace(MAP.objects["Bench1"], type="FullBench")
    facts = [FactAdded(fact) for fact in MAP.facts_about("Bench1") if "Tin1" not in fact.arguments]
    map = MAP.changed([ObjectRemoved("Bench1"), ObjectAdded(bench), *facts])
    assert violations(map, before) == []
    after = before.extended([structs.replace(ONTOLOGY.types["Tin"], name="SmallTin")])
    found = violations_after(map, before, after, [Named(section=Section.TYPES, name="SmallTin")])
    assert [(violation.subject, violation.rule) for violation in found] == [("Bench1", "constraint")]


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
    naive = {name for name in ("Tin1", "Tin2") if not holds(_of(rule, name), map, ontology)}
    assert broken == naive


def _of(rule: str, name: str) -> Formula:
    return substitute(parse(rule), {SELF: Name(name)})
