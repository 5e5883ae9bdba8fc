"""How ontologies and maps are written: the whole text, with the short forms and without what goes without saying."""

from __future__ import annotations

import pytest
import yaml

from somrs.ontology.files.dump import dump_map, dump_ontology
from somrs.ontology.files.loading import upper
from somrs.ontology.files.nodes import Source
from somrs.ontology.files.site import dump_site
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.services import Handler, Occasion, Parameter, ServiceKind, ServiceType
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
    Value,
)

EMPTY_ONTOLOGY = Ontology()


def part(name: str, whole: str) -> Fact:
    return Fact(PART_OF, (name, whole))


@pytest.mark.parametrize(
    ("values", "written"),
    [
        ({}, " {type: Box}"),
        ({"PositionX": 1.0, "PositionY": 2.5}, "\n    type: Box\n    at: [1, 2.5]"),
        ({"PositionZ": 3.0, "PositionY": 2.0, "PositionX": 1.0}, "\n    type: Box\n    at: [1, 2, 3]"),
        ({"PositionX": 1.0, "PositionZ": 3.0}, " {type: Box, PositionX: 1, PositionZ: 3}"),
        ({"PositionX": 1.0, "PositionY": 2.0, "PositionZ": "high"}, "\n    type: Box\n    at: [1, 2]\n    PositionZ: high"),
        ({"PositionX": 1.0, "PositionY": True}, " {type: Box, PositionX: 1, PositionY: true}"),
        (
            {"PositionX": 0.0, "PositionY": 0.0, "RotationZ": -0.5, "Note": "3"},
            "\n    type: Box\n    at: [0, 0]\n    turned: -0.5\n    Note: '3'",
        ),
        ({"RotationZ": "round"}, " {type: Box, RotationZ: round}"),
        ({"RotationZ": False}, " {type: Box, RotationZ: false}"),
        (
            {"Load": 1e15, "Power": 999999999999999.0, "Open": True},
            " {type: Box, Load: 1000000000000000.0, Power: 999999999999999, Open: true}",
        ),
    ],
)
def test_how_the_values_of_an_object_are_written(values: dict[str, Value], written: str) -> None:
    assert dump_map(Map([Object(name="A", type="Box", values=values)]), EMPTY_ONTOLOGY) == f"map: A\nobjects:\n  A:{written}\n"


@pytest.mark.parametrize(
    ("values", "read"),
    [
        ({"Shape.Height": 1.0, "Shape.Form": "Box", "Note": "x"}, {"Shape": {"Height": 1, "Form": "Box"}, "Note": "x"}),
        ({"A.B.C": 1.0, "A.B.D": 2.0, "A.E": 3.0}, {"A": {"B": {"C": 1, "D": 2}, "E": 3}}),
        ({"Shape": 1.0, "Shape.Height": 2.0}, {"Shape": 1, "Shape.Height": 2}),
        ({"A.B": 1.0, "A.B.C.D": 2.0, "A.E": 3.0}, {"A": {"B": 1, "E": 3}, "A.B.C.D": 2}),
        ({"A.B.C": 2.0, "A.B": 1.0}, {"A": {"B": {"C": 2}}, "A.B": 1}),
    ],
)
def test_paths_are_written_as_trees(values: dict[str, Value], read: dict[str, object]) -> None:
    written = dump_map(Map([Object(name="A", type="Box", values=values)]), EMPTY_ONTOLOGY)
    assert yaml.safe_load(written)["objects"]["A"] == {"type": "Box", **read}


def test_parts_are_written_below_their_wholes_and_facts_each_on_a_line() -> None:
    map = Map(
        [Object(name=name, type="Box") for name in ("C", "A", "B", "D")],
        [part("B", "A"), Fact("isOn", ("D", "A")), part("C", "B"), part("C", "A"), part("D", "Gone"), Fact("between", ("A", "B", "C"))],
    )
    expected = """\
map: Home
objects:
  A:
    type: Box
    parts:
      B:
        type: Box
        parts:
          C: {type: Box}
  D: {type: Box}
facts:
- C isPartOf A
- D isPartOf Gone
- D isOn A
- between(A, B, C)
"""
    assert dump_map(map, EMPTY_ONTOLOGY, "Home") == expected
    assert dump_map(map, EMPTY_ONTOLOGY).startswith("map: A\n")
    assert dump_map(Map(), EMPTY_ONTOLOGY) == "map: map\nobjects: {}\n"


def test_parts_of_themselves_are_written_too() -> None:
    map = Map([Object(name=name, type="Box") for name in ("A", "B", "C")], [part("B", "C"), part("C", "B")])
    written = yaml.safe_load(dump_map(map, EMPTY_ONTOLOGY))
    assert written["objects"] == {name: {"type": "Box"} for name in ("A", "B", "C")}
    assert sorted(written["facts"]) == ["B isPartOf C", "C isPartOf B"]


FULL: list[Definition] = [
    AttributeType(name="Load", kind=Kind.NUMBER, unit="kg", tolerance=0.5, minimum=0, maximum=0, doc="What it bears"),
    AttributeType(name="Note", kind=Kind.TEXT),
    AttributeType(name="Color", kind=Kind.ENUMERATION, values=("Red", "Off")),
    AttributeType(name="Shape", kind=Kind.COMPLEX, attributes=("Load", "Note")),
    RelationType(name="near", joins=("Box", "Box"), symmetric=True, functional=True, excludes="place", doc="Beside"),
    RelationType(name="likes", joins=("Box", "Object")),
    FunctionType(name="load", parameters=("Box",), attribute="Load", unit="g", doc="How much"),
    FunctionType(name="far", parameters=("Box", "Box"), values={"A B": 2.0}),
    ObjectType(
        name="Box",
        parent="Object",
        attributes=("Load", "Color"),
        required=("Shape",),
        parts=(Part(type="Lid", minimum=0), Part(type="Leg", minimum=3, maximum=4)),
        constraints=(
            Constraint(attribute="Load", minimum=0, maximum=5.5),
            Constraint(attribute="Color", values=("Red",)),
            Constraint(formula="?Self.Load > 1", doc="Heavy"),
        ),
        defaults={"Load": 2.0, "Shape.Load": 3.0},
        driver="a:B",
        doc="A box",
    ),
    ObjectType(name="Lid", parent="Object"),
    ServiceType(
        name="Open",
        parent="Do",
        inputs=(Parameter(name="x", type="Box"),),
        outputs=(Parameter(name="y", type="number"),),
        kind=ServiceKind.COGNITIVE,
        precondition="?x.Load < 3",
        invariant="?x.Load < 4",
        effect="?x.Load = ?y",
        cost="2",
        handlers=(
            Handler(on=Occasion.FAILURE, effect="?x likes A", when="?x.Load > 2"),
            Handler(on=Occasion.COMPENSATION, effect="?x likes B"),
        ),
        doc="Opens it",
    ),
    ServiceType(name="Do", effect="A likes B"),
]
TEXT = """\
ontology: Boxes
attributes:
  Load: {kind: number, unit: kg, tolerance: 0.5, minimum: 0, maximum: 0, doc: What it bears}
  Note: {kind: text}
  Color:
    kind: enumeration
    values: [Red, Off]
  Shape:
    kind: complex
    attributes: [Load, Note]
relations:
  near:
    joins: [Box, Box]
    symmetric: true
    functional: true
    excludes: place
    doc: Beside
  likes:
    joins: [Box, Object]
functions:
  load:
    parameters: [Box]
    attribute: Load
    unit: g
    doc: How much
  far:
    parameters: [Box, Box]
    values: {A B: 2}
types:
  Box:
    parent: Object
    attributes: [Load, Color]
    required: [Shape]
    driver: a:B
    doc: A box
    parts:
    - {type: Lid, minimum: 0}
    - {type: Leg, minimum: 3, maximum: 4}
    constraints:
    - {attribute: Load, minimum: 0, maximum: 5.5}
    - attribute: Color
      values: [Red]
    - {formula: '?Self.Load > 1', doc: Heavy}
    defaults:
      Load: 2
      Shape: {Load: 3}
  Lid: {parent: Object}
services:
"""


def test_all_of_an_ontology_is_written() -> None:
    written = dump_ontology(Ontology(FULL), name="Boxes")
    read = Source("boxes.yaml", written).data
    assert list(read) == ["ontology", "attributes", "relations", "functions", "types", "services"]
    assert read["services"] == {
        "Open": {
            "kind": "cognitive",
            "inputs": {"x": "Box"},
            "outputs": {"y": "number"},
            "parent": "Do",
            "precondition": "?x.Load < 3",
            "while": "?x.Load < 4",
            "effect": "?x.Load = ?y",
            "cost": "2",
            "handlers": [
                {"on": "failure", "when": "?x.Load > 2", "effect": "?x likes A"},
                {"on": "compensation", "effect": "?x likes B"},
            ],
            "doc": "Opens it",
        },
        "Do": {"effect": "A likes B"},
    }
    assert [*read["services"]["Open"]][-2:] == ["handlers", "doc"]
    assert written[: written.index("  Open:")] == TEXT


def test_what_another_ontology_has_already_is_not_written() -> None:
    base = Ontology(
        [ObjectType(name="Object", parent=None), ObjectType(name="Jar", parent="Object"), ObjectType(name="Can", parent="Object")]
    )
    own_ontology = Ontology([base.types["Object"], ObjectType(name="Jar", parent="Can"), ObjectType(name="Cup", parent="Object")])
    assert dump_ontology(base) == "types:\n  Object: {}\n  Jar: {parent: Object}\n  Can: {parent: Object}\n"
    assert dump_ontology(base, base, "own") == "{ontology: own}\n"
    header = "ontology: own\nwithout: [types Jar, types Can]\ntypes:\n"
    assert dump_ontology(own_ontology, base, "own") == f"{header}  Jar: {{parent: Can}}\n  Cup: {{parent: Object}}\n"
    assert (
        dump_ontology(own_ontology, base, "own", whole=True)
        == f"{header}  Object: {{}}\n  Jar: {{parent: Can}}\n  Cup: {{parent: Object}}\n"
    )


def test_a_site_has_its_definitions_before_its_map() -> None:
    map = Map([Object(name="Home", type="Building")])
    map_text = "map: Home\nobjects:\n  Home: {type: Building}\n"
    assert dump_site(upper(), map) == map_text
    assert dump_site(upper(), map, "Ours") == map_text.replace("map: Home", "map: Ours")
    own_ontology = upper().extended([ObjectType(name="Vase", parent="Jar")])
    assert dump_site(own_ontology, map) == f"ontology: Home\ntypes:\n  Vase: {{parent: Jar}}\n{map_text}"
    assert dump_site(own_ontology, map, "Ours").startswith("ontology: Ours\n")
    assert dump_site(own_ontology, Map()).startswith("ontology: site\n")


def test_a_map_is_called_by_its_own_name_or_by_that_of_its_abstract_root() -> None:
    objects = [Object(name="Can1", type="Can"), Object(name="Home", type="Building")]
    assert dump_site(upper(), Map(objects)).startswith("map: Home\n")
    assert dump_site(upper(), Map(objects, (), "Site")).startswith("map: Site\n")
