"""What is said of objects and facts that break the rules of a small ontology, word by word."""

from __future__ import annotations

import pytest

from somrs.ontology.conformance import Violation, touched_objects, value_problem, violations, violations_of
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import ABSTRACT, PART_OF, AttributeType, Constraint, Kind, ObjectType, Ontology, Part, RelationType, Value

ONTOLOGY = Ontology(
    [
        AttributeType(name="PositionX", kind=Kind.NUMBER, unit="m"),
        AttributeType(name="PositionY", kind=Kind.NUMBER, unit="m"),
        AttributeType(name="Load", kind=Kind.NUMBER, unit="kg", minimum=0, maximum=10),
        AttributeType(name="Power", kind=Kind.NUMBER),
        AttributeType(name="Color", kind=Kind.ENUMERATION, values=("Red", "Green", "Blue")),
        AttributeType(name="Note", kind=Kind.TEXT),
        AttributeType(name="Open", kind=Kind.TRUTH),
        AttributeType(name="Shape", kind=Kind.COMPLEX, attributes=("Form", "Height")),
        AttributeType(name="Form", kind=Kind.TEXT),
        AttributeType(name="Height", kind=Kind.NUMBER),
        AttributeType(name="Unused", kind=Kind.TEXT),
        RelationType(name=PART_OF, joins=("Object", "Object"), functional=True),
        RelationType(name="isOn", joins=("Object", "Object"), functional=True, excludes="place"),
        RelationType(name="isIn", joins=("Object", "Object"), excludes="place"),
        RelationType(name="likes", joins=("Box", "Object")),
        RelationType(name="between", joins=("Object", "Object", "Object")),
        ObjectType(name="Object", parent=None, attributes=("Note",)),
        ObjectType(name=ABSTRACT, parent="Object"),
        ObjectType(name="Site", parent=ABSTRACT),
        ObjectType(name="Hall", parent=ABSTRACT, parts=(Part(type="Box", minimum=1, maximum=2),)),
        ObjectType(name="Yard", parent=ABSTRACT, parts=(Part(type="Box", minimum=2, maximum=2),)),
        ObjectType(name="Lot", parent=ABSTRACT, parts=(Part(type="Box", minimum=2),)),
        ObjectType(name="Thing", parent="Object", attributes=("PositionX", "PositionY", "Load", "Power", "Color", "Open", "Shape")),
        ObjectType(name="Box", parent="Thing"),
        ObjectType(name="Fixed", parent="Thing", required=("PositionX", "Open")),
        ObjectType(name="Crate", parent="Fixed", required=("Load", "Open"), defaults={"Load": 3.0}),
        ObjectType(name="Tower", parent="Thing", required=("Shape",)),
        ObjectType(name="Stool", parent="Thing", required=("Shape",), defaults={"Shape.Height": 1.0}),
        ObjectType(
            name="Tank",
            parent="Thing",
            constraints=(
                Constraint(attribute="Load", minimum=2, maximum=4),
                Constraint(attribute="Color", values=("Red", "Blue")),
                Constraint(formula="?Self.Power > 1 OR NOT ?Self.Open = TRUE", doc="An open tank needs power"),
            ),
        ),
        ObjectType(name="Barrel", parent="Tank", defaults={"Load": 5.0}, constraints=(Constraint(formula="?Self.Shape.Height < 3"),)),
        ObjectType(name="Keg", parent="Barrel", defaults={"Load": 4.0}),
        ObjectType(name="Mate", parent="Thing", constraints=(Constraint(formula="?Box: Box isOn ?Self"),)),
        ObjectType(name="Lid", parent="Thing", constraints=(Constraint(formula="?Self.Load < 3 AND ?Self isOn Model"),)),
        ObjectType(name="Twin", parent="Thing", constraints=(Constraint(formula="?Self.Load = Model.Load"),)),
    ]
)


def object_at(name: str, type: str, **values: Value) -> Object:
    return Object(name=name, type=type, values={"PositionX": 0.0, "PositionY": 0.0, **{k.replace("__", "."): v for k, v in values.items()}})


def site(*objects: Object, facts: tuple[Fact, ...] = ()) -> Map:
    return Map([Object(name="Site1", type="Site"), *objects], facts)


def part(name: str, whole: str = "Site1") -> Fact:
    return Fact(PART_OF, (name, whole))


KNOWN_ATTRIBUTES = "it has Color, Load, Note, Open, PositionX, PositionY, Power, Shape"
NOWHERE = "is nowhere: it is part of nothing, has no position, and no fact such as isOn says where it is"


def broken(subject: str, rule: str, message: str, path: str = "") -> Violation:
    return Violation(subject=subject, rule=rule, message=message, path=path, section="objects")


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("Load", 0, ""),
        ("Load", 10.0, ""),
        ("Load", 10.5, "Load is at most 10, not 10.5"),
        ("Load", -0.5, "Load is at least 0, not -0.5"),
        ("Load", True, "Load is a number in kg, not True"),
        ("Power", "much", "Power is a number, not 'much'"),
        ("Power", -5, ""),
        ("Power", float("inf"), "Power must be a finite number"),
        ("Power", float("nan"), "Power must be a finite number"),
        ("Color", "Green", ""),
        ("Color", "Gren", "Color is one of Red, Green, Blue, not 'Gren'; did you mean Green?"),
        ("Color", "Xyz", "Color is one of Red, Green, Blue, not 'Xyz'"),
        ("Color", True, "Color is one of Red, Green, Blue, not True"),
        ("Note", "", ""),
        ("Note", 3.0, "Note is a text, not 3.0; write it in quotes"),
        ("Open", False, ""),
        ("Open", 1.0, "Open is true or false, not 1.0"),
        ("Shape", "flat", "Shape is made of Form, Height; write them below it, not a value"),
    ],
)
def test_what_is_said_of_a_value(name: str, value: Value, problem: str) -> None:
    assert value_problem(ONTOLOGY.attributes[name], value) == problem
    expected = [broken("A", "value", problem, name)] if problem else []
    assert violations(site(object_at("A", "Box", **{name: value})), ONTOLOGY) == expected


@pytest.mark.parametrize(
    ("object", "expected"),
    [
        (
            object_at("A", "Box", Unused="x"),
            [broken("A", "unknown-attribute", f"a Box has no attribute Unused; {KNOWN_ATTRIBUTES}", "Unused")],
        ),
        (
            object_at("A", "Box", Shape__Hight=1.0),
            [broken("A", "unknown-attribute", f"a Box has no attribute Shape.Hight; {KNOWN_ATTRIBUTES}", "Shape.Hight")],
        ),
        (object_at("A", "Box", Lod=1.0), [broken("A", "unknown-attribute", "no attribute is called Lod; did you mean Load?", "Lod")]),
        (
            object_at("A", "Box", Qwertz=1.0),
            [
                broken(
                    "A",
                    "unknown-attribute",
                    "no attribute is called Qwertz; define it, or use one of the attributes there are",
                    "Qwertz",
                )
            ],
        ),
        (object_at("A", "Bxo"), [broken("A", "unknown-type", "no type is called Bxo; did you mean Box?", "type")]),
        (object_at("A", "Fixed"), [broken("A", "required", "a Fixed must have Open; write Open: and its value")]),
        (object_at("A", "Crate"), [broken("A", "required", "a Crate must have Open; write Open: and its value")]),
        (object_at("A", "Crate", Open=True), []),
        (object_at("A", "Tower"), [broken("A", "required", "a Tower must have Shape; write Shape: and its value")]),
        (object_at("A", "Tower", Shape__Form="x"), []),
        (object_at("A", "Stool"), []),
        (
            object_at("A", "Tower", Shaper="x"),
            [
                broken("A", "unknown-attribute", "no attribute is called Shaper; did you mean Shape or Shape.Form?", "Shaper"),
                broken("A", "required", "a Tower must have Shape; write Shape: and its value"),
            ],
        ),
        (object_at("A", "Tank"), []),
        (object_at("A", "Tank", Load=2.0, Color="Blue"), []),
        (object_at("A", "Tank", Load=4.0), []),
        (object_at("A", "Tank", Load=1.0), [broken("A", "constraint", "for a Tank, Load is at least 2, not 1", "Load")]),
        (object_at("A", "Tank", Load=5.0), [broken("A", "constraint", "for a Tank, Load is at most 4, not 5", "Load")]),
        (object_at("A", "Tank", Load=20.0), [broken("A", "value", "Load is at most 10, not 20", "Load")]),
        (
            object_at("A", "Tank", Load=20.0, Color="Green", Open=True),  # of the formula nothing is said while a value is wrong
            [
                broken("A", "value", "Load is at most 10, not 20", "Load"),
                broken("A", "constraint", "for a Tank, Color is one of Red, Blue, not Green", "Color"),
            ],
        ),
        (object_at("A", "Tank", Open=True), [broken("A", "constraint", "An open tank needs power; this one does not")]),
        (object_at("A", "Tank", Open=True, Power=1.0), [broken("A", "constraint", "An open tank needs power; this one does not")]),
        (object_at("A", "Tank", Open=True, Power=2.0), []),
        (
            object_at("A", "Barrel", Shape__Height=1.0),  # the default of its own type
            [broken("A", "constraint", "for a Tank, Load is at most 4, not 5", "Load")],
        ),
        (object_at("A", "Keg", Shape__Height=1.0), []),
        (
            object_at("A", "Keg", Shape__Height=3.0),
            [broken("A", "constraint", "every Barrel obeys ?Self.Shape.Height < 3; this one does not")],
        ),
        (object_at("A", "Mate"), [broken("A", "constraint", "every Mate obeys ?Box: Box isOn ?Self; this one does not")]),
        (object_at("A", "Twin", Load=2.0), [broken("A", "constraint", "every Twin obeys ?Self.Load = Model.Load; this one does not")]),
        (object_at("A", "Twin", Load=1.0), []),
        (
            object_at("A", "Lid", Load=1.0),
            [broken("A", "constraint", "every Lid obeys ?Self.Load < 3 AND ?Self isOn Model; this one does not")],
        ),
        (Object(name="A", type="Box"), [broken("A", "place", NOWHERE)]),
        (Object(name="A", type="Box", values={"PositionX": 1.0}), [broken("A", "place", NOWHERE)]),
        (Object(name="A", type="Box", values={"PositionY": 1.0}), [broken("A", "place", NOWHERE)]),
        (Object(name="A", type="Fixed", values={"PositionX": 1.0, "Open": True}), []),  # PositionY is not asked for
        (
            Object(name="A", type="Site"),
            [broken("A", "root", "Site1 is the map's root already; make A a part of it, or of one of its parts")],
        ),
    ],
    ids=str,
)
def test_what_is_said_of_an_object(object: Object, expected: list[Violation]) -> None:
    map = site(object_at("Model", "Box", Load=1.0), object)
    assert violations(map, ONTOLOGY) == expected
    assert violations_of(map, ONTOLOGY, ["A"]) == expected
    assert violations_of(map, ONTOLOGY, ["Model"]) == []


@pytest.mark.parametrize(
    ("fact", "expected"),
    [
        (Fact("isOn", ("A", "Site1")), []),
        (Fact("isIn", ("A", "Site1")), []),
        (part("A"), []),
        (Fact("likes", ("A", "Site1")), [broken("A", "place", NOWHERE)]),
        (
            Fact("hates", ("A", "Site1")),
            [
                broken("A", "place", NOWHERE),
                broken(
                    "A hates Site1", "unknown-relation", "no relation is called hates; define it, or use one of the relations there are"
                ),
            ],
        ),
    ],
    ids=str,
)
def test_a_relation_that_excludes_others_says_where_a_thing_is(fact: Fact, expected: list[Violation]) -> None:
    assert violations(site(Object(name="A", type="Box"), facts=(fact,)), ONTOLOGY) == expected


@pytest.mark.parametrize(
    ("facts", "expected"),
    [
        ([Fact("isOn", ("A", "B")), Fact("likes", ("A", "B")), Fact("likes", ("A", "T"))], []),
        ([Fact("isIn", ("A", "B")), Fact("isIn", ("A", "T"))], []),  # more than one, as it is not functional
        (
            [Fact("isOn", ("A", "B")), Fact("isOn", ("A", "T"))],
            [broken("A isOn T", "functional", "cannot hold together with A isOn B; keep one of the two")],
        ),
        (
            [Fact("isOn", ("A", "B")), Fact("isIn", ("A", "B"))],
            [broken("A isIn B", "exclusive", "cannot hold together with A isOn B; keep one of the two")],
        ),
        ([Fact("isOn", ("A", "Tt"))], [broken("A isOn Tt", "unknown-object", "no object is called Tt; did you mean T?")]),
        (
            [Fact("likes", ("T", "A"))],
            [broken("T likes A", "relation-types", "likes needs a Box where T stands, which is a Thing")],
        ),
        (
            [Fact("between", ("A", "B"))],
            [broken("A between B", "relation-types", "between joins 3 objects (Object, Object, Object), not 2")],
        ),
        ([Fact("isOn", ())], [broken("isOn()", "relation-types", "isOn joins 2 objects (Object, Object), not 0")]),
        (
            [Fact("betwen", ("A", "B", "T"))],
            [broken("betwen(A, B, T)", "unknown-relation", "no relation is called betwen; did you mean between?")],
        ),
        (  # what is unknown does not hide what comes after it
            [Fact("betwen", ("A", "B")), Fact("isOn", ("A", "B")), Fact("isOn", ("A", "T"))],
            [
                broken("A betwen B", "unknown-relation", "no relation is called betwen; did you mean between?"),
                broken("A isOn T", "functional", "cannot hold together with A isOn B; keep one of the two"),
            ],
        ),
    ],
    ids=str,
)
def test_what_is_said_of_facts(facts: list[Fact], expected: list[Violation]) -> None:
    map = site(object_at("A", "Box"), object_at("B", "Box"), object_at("T", "Thing"), facts=tuple(facts))
    assert violations(map, ONTOLOGY) == expected
    assert violations_of(map, ONTOLOGY, ["Site1"]) == []


def test_parts_of_parts_count() -> None:
    boxes = [object_at(name, "Box") for name in "ABC"]
    halls = [Object(name=name, type="Hall") for name in ("H0", "H1", "H2", "H3")]
    part_facts = [part("A", "H1"), part("B", "H2"), part("C", "B")]
    rest = [Object(name="Y1", type="Yard"), Object(name="L1", type="Lot")]
    map = site(*halls, *boxes, *rest, facts=(*(part(map_object.name) for map_object in (*halls, *rest)), *part_facts))
    assert violations(map, ONTOLOGY) == [
        broken("H0", "parts", "a Hall has 1 to 2 of type Box among its parts; this one has 0", "parts"),
        broken("H3", "parts", "a Hall has 1 to 2 of type Box among its parts; this one has 0", "parts"),
        broken("Y1", "parts", "a Yard has exactly 2 of type Box among its parts; this one has 0", "parts"),
        broken("L1", "parts", "a Lot has at least 2 of type Box among its parts; this one has 0", "parts"),
    ]
    fuller = map.changed([FactRemoved(part("A", "H1")), FactAdded(part("A", "C"))])
    expected = [broken("H2", "parts", "a Hall has 1 to 2 of type Box among its parts; this one has 3", "parts")]
    assert violations_of(fuller, ONTOLOGY, ["C"]) == expected, "what it is part of is looked at too"
    assert violations_of(fuller, ONTOLOGY, ["B"]) == expected
    assert violations_of(fuller, ONTOLOGY, ["H3", "H0"]) == [
        broken("H0", "parts", "a Hall has 1 to 2 of type Box among its parts; this one has 0", "parts"),
        broken("H3", "parts", "a Hall has 1 to 2 of type Box among its parts; this one has 0", "parts"),
    ]


def test_a_cycle_is_told_once() -> None:
    map = site(object_at("A", "Box"), object_at("B", "Box"), object_at("C", "Box"), facts=(part("C", "B"), part("A", "C"), part("B", "A")))
    expected = [broken("A", "cycle", "is a part of itself: A isPartOf C isPartOf B isPartOf A")]
    assert violations(map, ONTOLOGY) == expected
    assert violations_of(map, ONTOLOGY, ["C"]) == expected


@pytest.mark.parametrize(
    ("map", "expected"),
    [
        (Map(), [broken("map", "root", "the map has no object; one must hold all others")]),
        (
            Map([object_at("A", "Box")]),
            [
                broken(
                    "map",
                    "root",
                    "the map has no AbstractObject (a building, a site, a room) that is part of nothing; one must hold all others",
                )
            ],
        ),
        (Map([object_at("A", "Bxo")]), [broken("A", "unknown-type", "no type is called Bxo; did you mean Box?", "type")]),
        (site(), []),
    ],
    ids=["nothing", "no root", "it may be the unknown one", "one root"],
)
def test_a_map_has_a_root(map: Map, expected: list[Violation]) -> None:
    assert violations(map, ONTOLOGY) == expected


@pytest.mark.parametrize(
    ("change", "names"),
    [
        (ObjectAdded(object_at("N", "Box")), {"N"}),
        (ValueSet("A", "Load", 1.0), {"A"}),
        (FactAdded(Fact("isOn", ("A", "B"))), {"A", "B"}),
        (FactRemoved(Fact("isOn", ("A", "B"))), {"A", "B"}),
        (ObjectRemoved("B"), {"A", "B", "T"}),
        (ObjectRemoved("T"), {"B", "T"}),
    ],
    ids=["added", "set", "fact added", "fact removed", "removed", "removed from below others"],
)
def test_what_a_change_touches(change: Change, names: set[str]) -> None:
    map = site(
        object_at("A", "Box"), object_at("B", "Box"), object_at("T", "Thing"), facts=(Fact("isOn", ("A", "B")), Fact("isOn", ("B", "T")))
    )
    assert touched_objects(map, [change]) == names
    assert touched_objects(map, [ValueSet("Site1", "Note", "x"), change]) == {*names, "Site1"}


def test_values_that_are_as_they_were_are_not_looked_at_again() -> None:
    map = site(
        object_at("A", "Box", Load=11.0),
        object_at("B", "Tank", Load=1.0),
        object_at("C", "Mate"),
        object_at("D", "Box"),
        facts=(Fact("isOn", ("D", "C")),),
    )
    names = ["A", "B", "C"]
    assert [v.subject for v in violations_of(map, ONTOLOGY, names)] == ["A", "B"]
    assert violations_of(map, ONTOLOGY, names, map) == []
    moved = map.changed([FactRemoved(Fact("isOn", ("D", "C"))), ValueSet("A", "Power", 1.0)])
    assert violations_of(moved, ONTOLOGY, names, map) == [
        broken("A", "value", "Load is at most 10, not 11", "Load"),
        broken("C", "constraint", "every Mate obeys ?Box: Box isOn ?Self; this one does not"),
    ]


def test_a_violation_is_told_with_its_subject_and_rule() -> None:
    assert str(Violation(subject="A", rule="value", message="is wrong", path="Load")) == "A: is wrong [value]"
