"""Where one is in a formula that is being written, and what is known there."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec import structs

from somrs.ontology.cursor import Cursor, Slot, Spot, locate_cursor
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, FunctionType, Kind, ObjectType, Ontology, RelationType

ONTOLOGY = Ontology(
    [
        AttributeType(name="Weight", kind=Kind.NUMBER, unit="kg", doc="how heavy it is"),
        AttributeType(name="Count", kind=Kind.NUMBER),
        AttributeType(name="Color", kind=Kind.ENUMERATION, values=("Red", "Blue")),
        AttributeType(name="Label", kind=Kind.TEXT),
        AttributeType(name="Open", kind=Kind.TRUTH),
        AttributeType(name="Height", kind=Kind.NUMBER, unit="m"),
        AttributeType(name="Shape", kind=Kind.COMPLEX, attributes=("Height", "Count")),
        RelationType(name="isOn", joins=("Thing", "Table")),
        RelationType(name="isAt", joins=("Robot", "Object"), doc="where it stands"),
        RelationType(name="between", joins=("Thing", "Table", "Robot")),
        RelationType(name="isNew", joins=("Jar",)),
        FunctionType(name="weight", parameters=("Thing",), attribute="Weight"),
        FunctionType(name="distance", parameters=("Thing", "Robot"), unit="m"),
        ObjectType(name="Object", parent=None, attributes=("Label",)),
        ObjectType(name="Thing", parent="Object", attributes=("Weight", "Open")),
        ObjectType(name="Jar", parent="Thing", attributes=("Color", "Shape"), defaults={"Color": "Red"}),
        ObjectType(name="Table", parent="Object", doc="to put things on"),
        ObjectType(name="Robot", parent="Object"),
        ServiceType(
            name="Bring", effect="?What isOn ?Where", inputs=(Parameter(name="What", type="Jar"), Parameter(name="Where", type="Table"))
        ),
    ]
)
MAP = Map(
    [
        Object(name="Table1", type="Table", values={"Label": "desk"}),
        Object(name="Jar1", type="Jar", values={"Weight": 0.5, "Label": "sugar"}),
        Object(name="Jar2", type="Jar"),
        Object(name="Robot1", type="Robot"),
    ],
    [Fact("isAt", ("Robot1", "Table1"))],
)


def cursor(place: Spot, **fields: Any) -> Cursor:
    return Cursor(spot=place, start=0, end=0, **fields)


def number(name: str, unit: str | None) -> AttributeType:
    return AttributeType(name=name, kind=Kind.NUMBER, unit=unit)


def cursor_at(marked: str, **variables: str) -> Cursor:
    """Where the `|` is in the text."""
    return locate_cursor(marked.replace("|", "", 1), marked.index("|"), ONTOLOGY, MAP, variables)


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ("|", cursor(Spot.ATOM)),
        ("Ja|r1 isOn Table1", cursor(Spot.ATOM)),
        ("Jar1|", cursor(Spot.ATOM)),
        ("Jar1 |", cursor(Spot.RELATION, owner="Jar", comparable=True)),
        ("Jar1 isOn |", cursor(Spot.OBJECT, slot=Slot(relation="isOn", place=1, type="Table"))),
        ("Jar1 isOn T|able1", cursor(Spot.OBJECT, slot=Slot(relation="isOn", place=1, type="Table"))),
        ("Jar1 isOn Table1 |", cursor(Spot.CONTINUATION, complete=True)),
        ("Robot1 isAt |", cursor(Spot.OBJECT, slot=Slot(relation="isAt", place=1))),
        ("Jar1.|", cursor(Spot.ATTRIBUTE, owner="Jar", object="Jar1")),
        ("Jar1.Shape.|", cursor(Spot.ATTRIBUTE, owner="Jar", object="Jar1", path="Shape")),
        ("Jar1.Shape.He|", cursor(Spot.ATTRIBUTE, owner="Jar", object="Jar1", path="Shape")),
        ("Jar1.Shape.Height.|", cursor(Spot.ATTRIBUTE, owner="Jar", object="Jar1", path="Shape.Height")),
        ("?x: Jar.Shape.|", cursor(Spot.ATTRIBUTE, owner="Jar", path="Shape", variables={"x": "Jar"})),
        ("?x: Jar.|", cursor(Spot.ATTRIBUTE, owner="Jar", variables={"x": "Jar"})),
        ("?x: Jar isOn ?y AND ?y.|", cursor(Spot.ATTRIBUTE, owner="Table", variables={"x": "Jar", "y": "Table"})),
        ("?x: |", cursor(Spot.TYPE, variables={"x": None})),
        ("?x:Jar |", cursor(Spot.RELATION, owner="Jar", variables={"x": "Jar"}, comparable=True)),
        ("?x: Foo |", cursor(Spot.CONTINUATION, variables={"x": None}, comparable=True)),
        ("isOn(?x: |", cursor(Spot.TYPE, slot=Slot(relation="isOn", type="Thing"), variables={"x": None}, enclosure="(")),
        ("distance(Jar1, ?y: |", cursor(Spot.TYPE, slot=Slot(relation="", place=1, type="Robot"), variables={"y": None}, enclosure="(")),
        ("Jar1.Weight |", cursor(Spot.CONTINUATION, attribute=ONTOLOGY.attributes["Weight"], comparable=True)),
        ("Jar1.Weight = |", cursor(Spot.VALUE, compared="Weight", attribute=ONTOLOGY.attributes["Weight"])),
        ("Jar1.Weight = J|", cursor(Spot.VALUE, compared="Weight", attribute=ONTOLOGY.attributes["Weight"])),
        ("Jar1.Weight < 5 |", cursor(Spot.UNIT, compared="Weight", attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("Jar1.Weight < 5 k|g", cursor(Spot.UNIT, compared="Weight", attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("Jar1.Weight < 5|", cursor(Spot.UNIT, compared="Weight", attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("Jar1.Weight < 5kg|", cursor(Spot.UNIT, compared="Weight", attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("Jar1.Weight < 5 kg |", cursor(Spot.CONTINUATION, attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("Jar1.Weight < 5 kg + |", cursor(Spot.TERM, compared="Weight", attribute=ONTOLOGY.attributes["Weight"])),
        ("Jar1.Weight < 5 kg + 3 |", cursor(Spot.UNIT, compared="Weight", attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("Jar1.Weight * |", cursor(Spot.TERM)),
        ("Jar1.Weight * J|", cursor(Spot.TERM)),
        ("Jar1.Shape.Height = |", cursor(Spot.VALUE, compared="Shape.Height", attribute=ONTOLOGY.attributes["Height"])),
        ("Jar1.Color = |", cursor(Spot.VALUE, compared="Color", attribute=ONTOLOGY.attributes["Color"])),
        ("Jar1.Color = R|ed", cursor(Spot.VALUE, compared="Color", attribute=ONTOLOGY.attributes["Color"])),
        ("Jar1.Color = Red |", cursor(Spot.CONTINUATION, attribute=ONTOLOGY.attributes["Color"], complete=True)),
        ('Jar1.Label = "su|gar"', cursor(Spot.VALUE, compared="Label", attribute=ONTOLOGY.attributes["Label"], enclosure='"')),
        ('Jar1.Label = "sugar" |', cursor(Spot.CONTINUATION, attribute=ONTOLOGY.attributes["Label"], complete=True)),
        ('Jar1 isOn "su|', cursor(Spot.NOWHERE, slot=Slot(relation="isOn", place=1, type="Table"))),
        ('"su|', cursor(Spot.NOWHERE)),
        ('Jar1.Label = "a\n|', cursor(Spot.NOWHERE)),
        ("5 |", cursor(Spot.UNIT, comparable=True)),
        ("5 kg |", cursor(Spot.CONTINUATION, attribute=number("number", "kg"), comparable=True)),
        ("5 kg = |", cursor(Spot.VALUE, attribute=number("number", "kg"))),
        ("5 = |", cursor(Spot.VALUE, attribute=number("number", None))),
        ("weight(Jar1) |", cursor(Spot.CONTINUATION, attribute=ONTOLOGY.attributes["Weight"], comparable=True, complete=True)),
        ("weight(Jar1) = |", cursor(Spot.VALUE, attribute=ONTOLOGY.attributes["Weight"])),
        ("weight(Jar1) < 5 |", cursor(Spot.UNIT, attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("distance(Jar1, Robot1) = |", cursor(Spot.VALUE, attribute=number("distance", "m"))),
        ("distance(Jar1, Robot1) < 3 |", cursor(Spot.UNIT, attribute=number("distance", "m"), complete=True)),
        ("weight(|", cursor(Spot.OBJECT, slot=Slot(relation="", type="Thing"), enclosure="(")),
        ("distance(Jar1, |", cursor(Spot.OBJECT, slot=Slot(relation="", place=1, type="Robot"), enclosure="(")),
        ("distance(Jar1, Robot1, |", cursor(Spot.OBJECT, slot=Slot(relation="", place=2), enclosure="(")),
        ("between(|", cursor(Spot.OBJECT, slot=Slot(relation="between", type="Thing"), enclosure="(")),
        ("between(Jar1, |", cursor(Spot.OBJECT, slot=Slot(relation="between", place=1, type="Table"), enclosure="(")),
        ("between(Jar1, Table1, R|", cursor(Spot.OBJECT, slot=Slot(relation="between", place=2, type="Robot"), enclosure="(")),
        ("between(Jar1, Table1, Robot1, |", cursor(Spot.OBJECT, slot=Slot(relation="between", place=3), enclosure="(")),
        ("between(Jar1, Table1, distance(Jar1, |", cursor(Spot.OBJECT, slot=Slot(relation="", place=1, type="Robot"), enclosure="(")),
        ("between(distance(Jar1, Robot1), |", cursor(Spot.OBJECT, slot=Slot(relation="between", place=1, type="Table"), enclosure="(")),
        ("foo(|", cursor(Spot.OBJECT, slot=Slot(relation=""), enclosure="(")),
        ("foo(Jar1, |", cursor(Spot.OBJECT, slot=Slot(relation="", place=1), enclosure="(")),
        ("isNew(Jar1.|", cursor(Spot.ATTRIBUTE, owner="Jar", object="Jar1", enclosure="(")),
        ("Jar1 between |", cursor(Spot.OBJECT, slot=Slot(relation="between", place=1))),
        ("Jar1 foo |", cursor(Spot.OBJECT)),
        ("Jar1 foo Table1 |", cursor(Spot.CONTINUATION, complete=True)),
        ("Foo |", cursor(Spot.RELATION, comparable=True)),
        ("?x |", cursor(Spot.RELATION, variables={"x": None}, comparable=True)),
        ("?x isOn Table1 AND ?x |", cursor(Spot.RELATION, owner="Thing", variables={"x": "Thing"}, comparable=True)),
        ("?x isAt ?y AND ?x |", cursor(Spot.RELATION, owner="Robot", variables={"x": "Robot", "y": None}, comparable=True)),
        ("?x isAt ?y AND ?y |", cursor(Spot.RELATION, variables={"x": "Robot", "y": None}, comparable=True)),
        ("FORALL |", cursor(Spot.VARIABLE, quantified=True)),
        ("EXISTS ?x|", cursor(Spot.VARIABLE, quantified=True)),
        ("NOT FORALL ?x: J|", cursor(Spot.TYPE, variables={"x": None}, quantified=True)),
        ("FORALL ?x: Jar |", cursor(Spot.CONTINUATION, variables={"x": "Jar"}, quantified=True)),
        ("FORALL ?x: Jar (|", cursor(Spot.ATOM, variables={"x": "Jar"})),
        ("FORALL ?x: Jar (?x |", cursor(Spot.RELATION, owner="Jar", variables={"x": "Jar"}, comparable=True)),
        ("FORALL ?x: Jar (?x isOn Table1) |", cursor(Spot.CONTINUATION, variables={"x": "Jar"}, complete=True)),
        ("NOT |", cursor(Spot.ATOM, negated=True)),
        ("NOT (|", cursor(Spot.ATOM, negated=True)),
        ("NOT Jar1 |", cursor(Spot.RELATION, owner="Jar", comparable=True, negated=True)),
        ("NOT J|", cursor(Spot.ATOM, negated=True)),
        ("Jar1 isOn Table1 AND |", cursor(Spot.ATOM)),
        ("Jar1 isOn Table1 AND J|", cursor(Spot.ATOM)),
        ("Jar1 isOn Table1 OR NOT J|", cursor(Spot.ATOM, negated=True)),
        ("(Jar1 isOn Table1) |", cursor(Spot.CONTINUATION, complete=True)),
        ("(Jar1 isOn Table1 AND |", cursor(Spot.ATOM)),
        ("((Jar1 isOn Table1) AND |", cursor(Spot.ATOM)),
        ("(Jar1 isOn Table1) AND Jar1 isOn |", cursor(Spot.OBJECT, slot=Slot(relation="isOn", place=1, type="Table"))),
        ("(weight(Jar1) = |", cursor(Spot.VALUE, attribute=ONTOLOGY.attributes["Weight"])),
        ("(weight(Jar1) = 3 |", cursor(Spot.UNIT, attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("? |", cursor(Spot.NOWHERE)),
        ("?|", cursor(Spot.VARIABLE)),
        ("Jar1 isOn ?|", cursor(Spot.OBJECT, slot=Slot(relation="isOn", place=1, type="Table"))),
        ("Jar1.Weight = ?|", cursor(Spot.VARIABLE, compared="Weight", attribute=ONTOLOGY.attributes["Weight"])),
        ("Jar1.Weight + ?|", cursor(Spot.VARIABLE)),
        ("Jar1.?|", cursor(Spot.ATTRIBUTE, owner="Jar", object="Jar1")),
        ("Jar1 isOn ?x|", cursor(Spot.OBJECT, slot=Slot(relation="isOn", place=1, type="Table"))),
        ("?x isOn Table1 AND ?|x isOn Table1", cursor(Spot.VARIABLE, variables={"x": "Thing"})),
        ("?x: number = Jar1.Weight AND ?x |", cursor(Spot.CONTINUATION, variables={"x": "number"}, comparable=True)),
        ("?x = |", cursor(Spot.VALUE, slot=Slot(relation=""), variables={"x": None})),
        ("?x: Jar = |", cursor(Spot.VALUE, slot=Slot(relation="", type="Jar"), variables={"x": "Jar"})),
        ("Jar1 = |", cursor(Spot.VALUE, slot=Slot(relation="", type="Jar"))),
        ("Jar1 = Jar2 |", cursor(Spot.CONTINUATION, complete=True)),
        ("# a |", cursor(Spot.NOWHERE)),
        ("# a \n|", cursor(Spot.ATOM)),
        ("Jar1 # a \n|", cursor(Spot.RELATION, owner="Jar", comparable=True)),
        ("Jar1 AND |", cursor(Spot.ATOM)),
        ("Jar1.Weight = TRUE |", cursor(Spot.CONTINUATION, attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("Jar1.Open = |", cursor(Spot.VALUE, compared="Open", attribute=ONTOLOGY.attributes["Open"])),
        ("Jar1 isOn Table1 Jar1 |", cursor(Spot.NOWHERE)),
        ("weight(Jar1).|", cursor(Spot.NOWHERE)),
        ("?x: Jar.Weight = |", cursor(Spot.VALUE, compared="Weight", attribute=ONTOLOGY.attributes["Weight"], variables={"x": "Jar"})),
        (
            "?x: Jar.Shape.Height < 5 |",
            cursor(Spot.UNIT, compared="Shape.Height", attribute=ONTOLOGY.attributes["Height"], variables={"x": "Jar"}, complete=True),
        ),
        ("5 kg + Jar1.Weight = |", cursor(Spot.VALUE, attribute=number("number", "kg"))),
        ("weight(Jar1) + 3 kg = |", cursor(Spot.VALUE, attribute=ONTOLOGY.attributes["Weight"])),
        ("3 + weight(Jar1) = |", cursor(Spot.VALUE, attribute=number("number", None))),
        ("distance(Jar1, Robot1) + weight(Jar1) = |", cursor(Spot.VALUE, attribute=number("distance", "m"))),
        ("foo(Jar1) = |", cursor(Spot.VALUE, slot=Slot(relation=""))),
        ("between(?x, Table1, Robot1) AND ?x |", cursor(Spot.RELATION, variables={"x": None}, comparable=True)),
        ("isOn ?x AND ?x |", cursor(Spot.RELATION, variables={"x": None}, comparable=True)),
        ("?x isOn |", cursor(Spot.OBJECT, slot=Slot(relation="isOn", place=1, type="Table"), variables={"x": None})),
        ("Jar1 isOn ?x AND ?x isOn Table1 AND ?x |", cursor(Spot.RELATION, owner="Table", variables={"x": "Table"}, comparable=True)),
        ("Jar1 isOn # a|", cursor(Spot.NOWHERE)),
        ("Jar1 # |a", cursor(Spot.NOWHERE)),
        ("NOT(Jar1 |", cursor(Spot.RELATION, owner="Jar", comparable=True, negated=True)),
        ("DoNOT |", cursor(Spot.RELATION, comparable=True)),
        ("NOT Jar1 isOn Table1 AND J|", cursor(Spot.ATOM)),
        ("NOT (Jar1 isOn Table1) |", cursor(Spot.CONTINUATION, complete=True)),
        ("(Jar1 isOn Table1 AND weight(Jar1) = |", cursor(Spot.VALUE, attribute=ONTOLOGY.attributes["Weight"])),
        ("Jar1 isOn Table1 AND (weight(|", cursor(Spot.OBJECT, slot=Slot(relation="", type="Thing"), enclosure="(")),
        ("(weight(Jar1) = 3) AND |", cursor(Spot.ATOM)),
        ("((Jar1 isOn Table1)) |", cursor(Spot.CONTINUATION, complete=True)),
        ("?y isOn Table1 AND |", cursor(Spot.ATOM, variables={"y": "Thing"})),
        ("| isOn ?y", cursor(Spot.ATOM, variables={"y": None})),
        ("?y: text = Jar1.Label AND ?y = |", cursor(Spot.VALUE, slot=Slot(relation=""), variables={"y": "text"})),
        ("?y: Foo isOn Table1 AND |", cursor(Spot.ATOM, variables={"y": None})),
        ("Jar1.Weight < -2.5e3 |", cursor(Spot.UNIT, compared="Weight", attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        (
            "Jar1.Weight < ?x AND Jar1.Height |",
            cursor(Spot.CONTINUATION, attribute=ONTOLOGY.attributes["Height"], variables={"x": None}, comparable=True),
        ),
        ("Jar1.Weight < 5 %|", cursor(Spot.UNIT, compared="Weight", attribute=ONTOLOGY.attributes["Weight"], complete=True)),
        ("?1 |", cursor(Spot.NOWHERE)),
        ("Jar1. Weight |", cursor(Spot.CONTINUATION, attribute=ONTOLOGY.attributes["Weight"], comparable=True)),
        ("?x: Jar = Jar1 |", cursor(Spot.CONTINUATION, variables={"x": "Jar"}, complete=True)),
        ("between(Jar1.Weight, |", cursor(Spot.OBJECT, slot=Slot(relation="between", place=1, type="Table"), enclosure="(")),
        ("Jar1.Weight = 3 AND weight(Jar1) < |", cursor(Spot.VALUE, attribute=ONTOLOGY.attributes["Weight"])),
        ("Unknown.Label = |", cursor(Spot.VALUE, compared="Label", attribute=ONTOLOGY.attributes["Label"])),
    ],
)
def test_where_one_is(marked: str, expected: Cursor) -> None:
    assert structs.replace(cursor_at(marked), start=0, end=0, typed="") == expected


@pytest.mark.parametrize(
    ("marked", "start", "end", "typed"),
    [
        ("|", 0, 0, ""),
        ("|Jar1", 0, 0, ""),
        ("Ja|r1 isOn", 0, 4, "Ja"),
        ("Jar1|", 0, 4, "Jar1"),
        ("Jar1 |isOn", 5, 5, ""),
        ("Jar1 is|On-top Table1", 5, 13, "is"),
        ("Jar1.We|ight", 5, 11, "We"),
        ("Jar1 isOn ?|x", 10, 12, "?"),
        ("Jar1 isOn ?x-|y", 10, 14, "?x-"),
        ("Jar1.Weight < 5|", 15, 15, ""),
        ("Jar1.Weight < 5|5", 15, 15, ""),
        ("Jar1.Weight < 5k|g", 15, 17, "k"),
        ("Jar1.Weight < 5 |kg", 16, 16, ""),
        ("Jar1.Weight < -5.5e+3 k|g", 22, 24, "k"),
        ("Jar1.Weight < 5 %|", 16, 17, "%"),
        ("Jar15 k|g", 6, 8, "k"),
        ('Jar1.Label = "su|gar"', 13, 16, '"su'),
        ('Jar1.Label = "su AND Ja|r1', 13, 23, '"su AND Ja'),
        ('Jar1.Label = "su" AND Ja|r1', 22, 26, "Ja"),
        ("Jar1 # is|", 9, 9, ""),
    ],
)
def test_what_is_being_written(marked: str, start: int, end: int, typed: str) -> None:
    found_cursor = cursor_at(marked)
    assert (found_cursor.start, found_cursor.end, found_cursor.typed) == (start, end, typed)


@pytest.mark.parametrize(
    ("marked", "given_variables", "expected_variables"),
    [
        ("?x |", {"x": "Robot"}, {"x": "Robot"}),
        ("?x: Jar isOn Table1 AND ?x |", {"x": "Robot"}, {"x": "Jar"}),
        ("?x isOn Table1 AND ?x |", {"x": "Robot"}, {"x": "Robot"}),
        ("|", {"x": "Robot"}, {"x": "Robot"}),
        ("?y |", {"x": "Robot"}, {"y": None, "x": "Robot"}),
        ("?x: truth = Jar1.Open |", {}, {"x": "truth"}),
        ("Jar1 isOn ?y AND ?y |", {}, {"y": "Table"}),
        ("?x isOn Table1 AND ?x isAt Table1 AND ?x |", {}, {"x": "Thing"}),
        ("Jar1 isOn ? |", {}, {}),
        ("Jar1.Weight = ?w|", {}, {}),
        ("Jar1.Weight = ?w AND Jar2.Weight = ?w|", {}, {"w": None}),
        ("?x :Jar isOn Table1 AND ?|", {}, {"x": "Jar"}),
        ("NOT | AND ?x isOn ?y", {}, {"x": "Thing", "y": "Table"}),
    ],
)
def test_which_variables_are_known(marked: str, given_variables: dict[str, str], expected_variables: dict[str, str | None]) -> None:
    assert cursor_at(marked, **given_variables).variables == expected_variables
