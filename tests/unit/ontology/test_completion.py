"""What can come next in a formula that is being written: all of it, in its order, and what is said of it."""

from __future__ import annotations

import pytest

from somrs.entish.formula import Number
from somrs.ontology.completion import Completions, complete, describe_object, fitting_objects, format_value, service_effects, units_of
from somrs.ontology.cursor import Slot
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology
from tests.unit.ontology.test_cursor import MAP, ONTOLOGY


def completing(marked: str) -> Completions:
    """What can come at the `|` in the text."""
    return complete(marked.replace("|", "", 1), marked.index("|"), ONTOLOGY, MAP)


UNITS = [
    (unit, "unit", "a unit", " ") for unit in ("mm", "cm", "m", "km", "g", "kg", "s", "min", "h", "m/s", "km/h", "rad", "deg", "%", "EUR")
]
JOINED = [("AND", "keyword", "both hold", " "), ("OR", "keyword", "one of them holds", " ")]
JARS = [("Jar1", "object", "Jar, sugar", " "), ("Jar2", "object", "Jar", " ")]
FUNCTIONS = [("weight", "function", "(Thing)", "("), ("distance", "function", "(Thing, Robot) in m", "(")]


def variable_offers(*types: str, suffix: str = " ") -> list[tuple[str, str, str, str]]:
    """Variables with their types."""
    return [(f"?{name}: {name}", "variable", f"any {name}", suffix) for name in types]


@pytest.mark.parametrize(
    ("marked", "offered"),
    [
        (
            "|",
            [
                *JARS,
                *FUNCTIONS,
                ("Table1", "object", "Table, desk", " "),
                ("Robot1", "object", "Robot", " "),
                ("between", "relation", "(Thing, Table, Robot)", "("),
                ("isNew", "relation", "(Jar)", "("),
                ("NOT", "keyword", "does not hold", " "),
                ("FORALL", "keyword", "holds for every object of a type", " "),
                ("EXISTS", "keyword", "holds for an object of a type", " "),
            ],
        ),
        ("NOT (EX|", [("EXISTS", "keyword", "holds for an object of a type", " ")]),
        ("FORALL ?ja|", [("?Jar: Jar", "variable", "any Jar", " (")]),
        ("FORALL ?x: Ro|", [("Robot", "type", "a kind of Object", " (")]),
        ("FORALL ?x: Jar |", [("(", "operator", "the formula", "")]),
        ("FORALL ?x: Jar (?x|", []),  # nothing else than what is there
        ("Robot1 isA|", [("isAt", "relation", "where it stands", " ")]),
        ("distance(Jar1, ?y: o|", [("Object", "type", "", ""), ("Robot", "type", "a kind of Object", "")]),
        ("ta|", [("Table1", "object", "Table, desk", " "), ("distance", "function", "(Thing, Robot) in m", "(")]),
        ("ar|", [*JARS]),
        (
            "NOT b|",
            [
                ("between", "relation", "(Thing, Table, Robot)", "("),
                ("Table1", "object", "Table, desk", " "),
                ("Robot1", "object", "Robot", " "),
            ],
        ),
        ("Jar1 |", [("isOn", "relation", "joins it with: Table", " "), ("=", "operator", "is", " "), ("!=", "operator", "is not", " ")]),
        (
            "Foo |",
            [
                ("isOn", "relation", "joins it with: Table", " "),
                ("isAt", "relation", "where it stands", " "),
                ("=", "operator", "is", " "),
                ("!=", "operator", "is not", " "),
            ],
        ),
        (
            "Jar1.|",
            [
                ("Color", "attribute", "is Red", " "),
                ("Shape", "attribute", "Shape: Height, Count", "."),
                ("Weight", "attribute", "is 0.5 kg", " "),
                ("Open", "attribute", "truth", " "),
                ("Label", "attribute", 'is "sugar"', " "),
                ("Shape.Height", "attribute", "m", " "),
                ("Shape.Count", "attribute", "number", " "),
            ],
        ),
        ("Jar1.Shape.|", [("Height", "attribute", "m", " "), ("Count", "attribute", "number", " ")]),
        (
            "?x: Thing.|",
            [
                ("Weight", "attribute", "kg, how heavy it is", " "),
                ("Open", "attribute", "truth", " "),
                ("Label", "attribute", "text", " "),
                ("Color", "attribute", "enumeration", " "),
                ("Shape", "attribute", "Shape: Height, Count", "."),
                ("Shape.Height", "attribute", "m", " "),
                ("Shape.Count", "attribute", "number", " "),
            ],
        ),
        ("Jar1.Color = |", [("Red", "value", "Color", " "), ("Blue", "value", "Color", " ")]),
        (
            "Jar1.Color = b|",
            [("Blue", "value", "Color", " "), ("Table1", "object", "Table, desk", " "), ("Robot1", "object", "Robot", " ")],
        ),
        ("Jar1.Open = |", [("TRUE", "value", "", " "), ("FALSE", "value", "", " ")]),
        ("Table1.Label = |", [('"desk"', "value", "a text", " "), ('"sugar"', "value", "a text", " ")]),
        ('Table1.Label = "d|', [('"desk"', "value", "a text", " ")]),
        ("Jar1.Weight = |", [*FUNCTIONS]),
        (
            "Jar1.Weight < 5 |",
            [
                ("kg", "unit", "its own unit", " "),
                ("g", "unit", "a unit", " "),
                *JOINED,
            ],
        ),
        (
            "Jar1.Shape.Count = 5 |",
            [
                *UNITS,
                *JOINED,
            ],
        ),
        (
            "5 |",
            [
                *UNITS,
            ],
        ),
        (
            "?x: |",
            [
                ("Jar", "type", "a kind of Thing", " "),
                ("Table", "type", "to put things on", " "),
                ("Robot", "type", "a kind of Object", " "),
                ("Object", "type", "", " "),
                ("Thing", "type", "a kind of Object", " "),
                ("number", "type", "any number", " "),
                ("text", "type", "any text", " "),
                ("truth", "type", "TRUE or FALSE", " "),
            ],
        ),
        ("isOn(?x: J|", [("Jar", "type", "a kind of Thing", ""), ("Object", "type", "", "")]),
        (
            "?x: t|",
            [
                ("Table", "type", "to put things on", " "),
                ("Thing", "type", "a kind of Object", " "),
                ("text", "type", "any text", " "),
                ("truth", "type", "TRUE or FALSE", " "),
                ("Robot", "type", "a kind of Object", " "),
                ("Object", "type", "", " "),
            ],
        ),
        ("Jar1 isOn |", [("Table1", "object", "Table, desk", " "), ("?Table: Table", "variable", "any Table", " ")]),
        (
            "weight(|",
            [
                ("Jar1", "object", "Jar, sugar", ""),
                ("Jar2", "object", "Jar", ""),
                *variable_offers("Jar", "Thing", suffix=""),
            ],
        ),
        ("weight(j|", [("Jar1", "object", "Jar, sugar", ""), ("Jar2", "object", "Jar", "")]),
        (
            "?x isAt Table1 AND ?z isOn Table1 AND weight(?|",
            [("?z", "variable", "Thing", ""), *variable_offers("Jar", "Thing", suffix="")],
        ),
        (
            "?y: number = 3 AND ?t: Table = Table1 AND Jar1 isOn ?|",
            [("?t", "variable", "Table", " "), ("?Table: Table", "variable", "any Table", " ")],
        ),
        ("Jar1 isOn ?t|", [("?Table: Table", "variable", "any Table", " ")]),
        (
            "Jar1.Weight < 3 AND ?y: number = ?|",
            [
                ("?y", "variable", "number", " "),
                *variable_offers("Jar", "Table", "Robot", "Object", "Thing"),
            ],
        ),
        (
            "?Jar: Jar isOn Table1 AND ?|",
            [
                ("?Jar", "variable", "Jar", " "),
                ("?Jar2: Jar", "variable", "any Jar", " "),
                *variable_offers("Table", "Robot", "Object", "Thing"),
            ],
        ),
        (
            "Jar1 = |",
            [
                *FUNCTIONS,
                *JARS,
            ],
        ),
        ("Jar1 isOn Table1 |", [*JOINED]),
        ("Jar1 isOn Table1 o|", [("OR", "keyword", "one of them holds", " ")]),
        (
            "Jar1.Weight |",
            [
                ("=", "operator", "is", " "),
                ("!=", "operator", "is not", " "),
                ("<", "operator", "is less than", " "),
                ("<=", "operator", "is at most", " "),
                (">", "operator", "is more than", " "),
                (">=", "operator", "is at least", " "),
            ],
        ),
        ("Jar1.Color |", [("=", "operator", "is", " "), ("!=", "operator", "is not", " ")]),
        ("(Jar1 isOn Table1) |", [*JOINED]),
        (
            "Jar1.Weight < 3 kg + |",
            [
                *JARS,
                *FUNCTIONS,
                ("Table1", "object", "Table, desk", " "),
                ("Robot1", "object", "Robot", " "),
            ],
        ),
        (
            "Robot1 isAt |",
            [
                ("Table1", "object", "Table, desk", " "),
                *JARS,
                ("Robot1", "object", "Robot", " "),
                *variable_offers("Table", "Jar", "Robot"),
            ],
        ),
        ("Jar1|", []),
        ("# |", []),
        ("dis|", [("distance", "function", "(Thing, Robot) in m", "(")]),
        (
            "?x isAt ?y AND ?y |",
            [
                ("isOn", "relation", "joins it with: Table", " "),
                ("isAt", "relation", "where it stands", " "),
                ("=", "operator", "is", " "),
                ("!=", "operator", "is not", " "),
            ],
        ),
    ],
)
def test_what_is_offered(marked: str, offered: list[tuple[str, str, str, str]]) -> None:
    assert [(item.text, item.kind, item.detail, item.suffix) for item in completing(marked).items] == offered


@pytest.mark.parametrize(("position", "typed"), [(-5, ""), (0, ""), (1, "J"), (99, "Jar")])
def test_a_place_beyond_the_text_is_its_border(position: int, typed: str) -> None:
    completions = complete("Jar", position, ONTOLOGY, MAP)
    assert (completions.start, [item.text for item in completions.items][:2]) == (0, ["Jar1", "Jar2"])
    assert (completions.end > 0) == (typed != "")


def test_no_more_than_sixty_are_offered() -> None:
    map = Map([Object(name=f"Jar{number}", type="Jar") for number in range(70)])
    assert [item.text for item in complete("Jar", 3, ONTOLOGY, map).items] == [f"Jar{number}" for number in range(60)]


def test_what_fits_best_comes_first() -> None:
    map = Map(
        [
            Object(name="Bottles", type="Table"),
            Object(name="subtle", type="Jar"),
            Object(name="Constable", type="Jar"),
            Object(name="Old-table", type="Jar"),
            Object(name="myTable", type="Table"),
            Object(name="Desk", type="Table"),
            Object(name="Cup", type="Jar", values={"Label": "On the TABLE"}),
            Object(name="Tablet", type="Robot"),
            Object(name="Mug", type="Jar"),
        ]
    )
    assert [map_object.name for map_object in fitting_objects(ONTOLOGY, map, Slot(), "table")] == [
        "Tablet",
        "Old-table",
        "myTable",
        "Constable",
        "Cup",
        "Bottles",
        "Desk",
    ]
    assert [map_object.name for map_object in fitting_objects(ONTOLOGY, map, Slot(type="Table"), "Tabl")] == ["myTable", "Bottles", "Desk"]
    assert [map_object.name for map_object in fitting_objects(ONTOLOGY, map, Slot(relation="isAt", type="Object"))] == [*map.objects]


def test_attributes_that_some_of_a_type_have_come_in_the_order_of_their_depth() -> None:
    types = [
        ObjectType(name="Crate", parent="Object"),
        ObjectType(name="Old", parent="Crate", attributes=("Shape",)),
        ObjectType(name="Oldest", parent="Old", attributes=("Age",)),
    ]
    ontology = ONTOLOGY.extended([AttributeType(name="Age", kind=Kind.NUMBER), *types])
    texts = [item.text for item in complete("?x: Crate.", 10, ontology, MAP).items]
    assert texts == ["Label", "Shape", "Age", "Shape.Height", "Shape.Count"]


def test_what_already_stands_there_is_likely_and_its_like() -> None:
    map = Map([*MAP.objects.values(), Object(name="Thing1", type="Thing")], [Fact("isAt", ("Robot1", "Jar1"))])
    assert [map_object.name for map_object in fitting_objects(ONTOLOGY, map, Slot(relation="isAt", place=1))] == [
        "Jar1",
        "Jar2",
        "Thing1",
        "Table1",
        "Robot1",
    ]


def test_what_services_bring_about() -> None:
    inputs = (Parameter(name="Jar", type="Jar"), Parameter(name="Table", type="Table"))
    effects = [
        "?Jar isOn ?Table AND NOT isNew(?Jar)",
        "?Table isOn ?Jar",
        "?Jar.Shape.Height = 3 OR ?Other.Open = TRUE",
        "?Jar isAt",
        "between(?Jar, Table1, ?Other)",
        "Jar1.Weight = 3",
    ]
    services = [ServiceType(name=f"S{number}", effect=effect, inputs=inputs) for number, effect in enumerate(effects)]
    assert service_effects(Ontology(services)) == {
        "isOn": ("Jar", "Table"),
        "isNew": ("Jar",),
        "Shape.Height": ("Jar",),
        "Open": ("Object",),
        "between": ("Jar", "Object", "Object"),
    }


@pytest.mark.parametrize(
    ("unit", "units"),
    [
        ("kg", ("kg", "g")),
        ("g", ("g", "kg")),
        ("percent", ("%", "rad", "deg")),
        ("pieces", ("pieces",)),
        ("EUR", ("EUR",)),
        (None, ()),
    ],
)
def test_units_of_an_attribute(unit: str | None, units: tuple[str, ...]) -> None:
    assert units_of(AttributeType(name="A", kind=Kind.NUMBER, unit=unit)) == units
    assert units_of(None) == ()


def test_how_objects_and_values_are_written() -> None:
    assert [describe_object(MAP.objects[name]) for name in ("Jar1", "Jar2")] == ["Jar, sugar", "Jar"]
    assert format_value(0.5, ONTOLOGY.attributes["Weight"]) == str(Number(0.5, "kg"))
    assert [format_value("Red", attribute) for attribute in (ONTOLOGY.attributes["Color"], None)] == ["Red", '"Red"']
