"""Ontology and map files: what can be written, what is said of mistakes, and that what is written is read back."""

from __future__ import annotations

import functools
import json
import math
import re
from importlib import resources
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from somrs.entish.parse import parse
from somrs.errors import ModelError, Problem
from somrs.ontology.conformance import violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files.dump import dump_map, dump_ontology
from somrs.ontology.files.loaded import LoadedModel
from somrs.ontology.files.loading import load, load_definitions, load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.schema import json_schema, published_schema
from somrs.ontology.services import Handler, Occasion, Parameter, ServiceKind, ServiceType
from somrs.ontology.types import PART_OF, AttributeType, Constraint, FunctionType, Kind, ObjectType, Ontology, Part, RelationType, Value
from tests.support.examples import examples
from tests.support.paths import ROOT

DEMO = Path(str(resources.files("somrs.demo").joinpath("data/scenario-1.yaml")))
DOCS = ROOT / "docs" / "how-to" / "describe-a-building.md"

HOUSE = """\
map: House
objects:
  House:
    type: Building
    parts:
      Ground:
        type: Storey
        parts:
          Slab: {type: Floor, at: [0, 0, -10 cm], Shape: {Form: Box, Width: 10, Depth: 800 cm, Height: 0.1}}
  Table1: {type: Table, at: [1, 2, 0], turned: 90 deg, Shape: {Form: Box, Width: 1.2, Depth: 0.8, Height: 0.75}}
  Jar1: {type: Jar, at: [1, 2, 0.75], Weight: 300 g}
facts:
  - Jar1 isOn Table1
"""


def problems(text: str, base: Ontology | None = None) -> list[Problem]:
    with pytest.raises(ModelError) as caught:
        load_text(text, "house.yaml", base)
    return caught.value.problems


def the_map(loaded: LoadedModel) -> Map:
    assert loaded.map is not None
    return loaded.map


def test_upper_ontology_is_consistent() -> None:
    assert ontology_violations(upper()) == []
    assert upper().is_subtype("PioneerP3DX", "MobileRobot")
    assert upper().default("Jar", "Shape.Radius") == 0.04
    assert upper().driver("DeliveryRobot") == "somrs.devices.simulator.drivers.manipulator:Manipulator"


def test_map_is_read_with_units_positions_and_parts() -> None:
    map = the_map(load_text(HOUSE))
    assert map.objects["Slab"].values["PositionZ"] == -0.1
    assert map.objects["Slab"].values["Shape.Depth"] == 8.0
    assert map.objects["Table1"].values["RotationZ"] == pytest.approx(math.pi / 2)
    assert map.objects["Jar1"].values["Weight"] == pytest.approx(0.3)
    assert map.whole("Slab") == "Ground"
    assert map.has_fact("isOn", ("Jar1", "Table1"))
    assert map.roots()[0] == "House"


def test_demo_site_tells_scenario_1() -> None:
    loaded = load([DEMO])
    map = the_map(loaded)
    assert violations(map, loaded.ontology) == []
    assert map.has_fact("isOn", ("Jar002", "Cupboard001"))
    jar, cupboard = map.objects["Jar002"].values, map.objects["Cupboard001"].values
    assert jar["PositionZ"] == cupboard["Shape.Height"]
    front = float(cupboard["PositionX"]) + float(cupboard["Shape.Width"]) / 2
    assert 0 < front - float(jar["PositionX"]) <= 0.2, "within reach of a robot in front of the cupboard"
    assert map.objects["Robot1"].values["Price"] == 10
    assert float(map.objects["Robot2"].values["Speed"]) > float(map.objects["Robot1"].values["Speed"])


def test_yaml_words_are_names_and_exponents_are_numbers() -> None:
    map = the_map(load_text(HOUSE.replace("Jar1", "Off")))
    assert "Off" in map.objects
    assert the_map(load_text(HOUSE.replace("300 g", "3e-1"))).objects["Jar1"].values["Weight"] == 0.3


# Each mistake: what is replaced in HOUSE by what; then the line, the rule and words of the message.
MISTAKES: list[tuple[str, str, int, str, str]] = [
    ("type: Jar,", "type: Jarr,", 11, "unknown-type", "did you mean Jar"),
    ("Weight: 300 g", "Wieght: 300 g", 11, "unknown-attribute", "did you mean Weight"),
    ("Weight: 300 g", "Elevation: 3", 11, "unknown-attribute", "a Jar has no attribute Elevation"),
    ("Weight: 300 g", "Weight: 300 mm", 11, "unit", "a number in kg"),
    ("Weight: 300 g", "Weight: much", 11, "value", "a number in kg"),
    ("Weight: 300 g", "Weight: 8 kg", 11, "constraint", "at most 5"),
    ("Weight: 300 g", "Weight: -1", 11, "value", "at least 0"),
    ("Weight: 300 g", "Color: Rde", 11, "value", "did you mean Red"),
    ("Weight: 300 g", "Label: 12", 11, "value", "in quotes"),
    ("Weight: 300 g", "Shape: 12", 11, "value", "is made of Form"),
    ("Weight: 300 g", "Weight: [1]", 11, "value", "a list"),
    ("Weight: 300 g", "Weight: 1, Weight: 2", 11, "duplicate", "already written in line 11"),
    ("at: [1, 2, 0.75]", "at: [1, 2, 0.75], PositionX: 1", 11, "duplicate", "given twice"),
    ("at: [1, 2, 0.75], Weight", "at: [1], Weight", 11, "structure", "at least 2 items"),
    ("at: [1, 2, 0.75]", "at: [1, 2]", 11, "required", "must have PositionZ"),
    ("at: [1, 2, 0.75]", "at: [1, two, 0.75]", 11, "value", "not 'two'"),
    ("{type: Jar, ", "{", 11, "structure", "type is missing"),
    ("Width: 1.2, ", "", 10, "constraint", "a Width, a Depth and a Height"),
    ("facts:", "  Jar 2: {type: Jar, at: [1, 2, 0]}\nfacts:", 12, "name", "is not a name"),
    ("facts:", "  Slab: {type: Jar, at: [1, 2, 0]}\nfacts:", 12, "duplicate", "house.yaml:9"),
    ("isOn Table1", "isOn Table2", 13, "unknown-object", "did you mean Table1"),
    ("isOn Table1", "isOnn Table1", 13, "unknown-relation", "did you mean isOn"),
    ("isOn Table1", "isHeldBy Table1", 13, "relation-types", "needs a Device"),
    ("isOn Table1", "isOn Table1\n  - Jar1 isOn Slab", 14, "functional", "Jar1 isOn Table1"),
    ("isOn Table1", "isOn Table1\n  - Jar1 isIn Slab", 14, "exclusive", "Jar1 isOn Table1"),
    ("isOn Table1", "isOn Table1\n  - Jar1 isOn Table1", 14, "duplicate", "stated already"),
    ("isOn Table1", "isOn", 13, "formula", "ends too early"),
    ("isOn Table1", "isOn ?x", 13, "formula", "between named objects"),
    ("Jar1 isOn Table1", "connects(Table1)", 13, "relation-types", "joins 3 objects"),
    ("facts:", "fakts:", 12, "structure", "did you mean facts"),
    ("    type: Building", "   type: Building", 5, "syntax", "not YAML"),
    ("facts:", "  Hut: {type: Room}\nfacts:", 12, "root", "House is the map's root already"),
    ("facts:", "  Robot: {type: PioneerP3DX, PositionX: 1}\nfacts:", 12, "required", "must have PositionY"),
    ("facts:", "  Leg: {type: FurnitureLeg, Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}}\nfacts:", 12, "place", "is nowhere"),
    ("          Slab: {type: Floor", "          Slab: {type: Wall", 8, "parts", "at least 1 of type Floor"),
    ("map: House", "types: {Vase: {parent: Jarr}}", 1, "unknown-name", "did you mean Jar"),
    ("map: House", "functions: {far: {parameters: [Object, Object], values: {Jar1: 3}}}", 1, "function", "should name 2 objects"),
    (
        "map: House",
        "functions: {far: {parameters: [Object], attribute: Weight, values: {Jar1: 3}}}",
        1,
        "function",
        "leave one of them out",
    ),
    ("map: House", 'services: {Go: {effect: "?Provider isAt ?To", cost: "range(?It)"}}', 1, "formula", "?It is no input"),
    ("map: House", 'services: {Go: {effect: "?Provider isAt ?To", cost: "range("}}', 1, "formula", "this is no term"),
    ("map: House", 'services: {Go: {effect: "?Provider isAt ?To", cost: "?Provider"}}', 1, "formula", "compares numbers"),
    ("map: House", "types: {Vase: {parent: Vase}}", 1, "cycle", "its own ancestor"),
    ("map: House", "types: {Vase: {parrent: Jar}}", 1, "structure", "did you mean parent"),
    ("map: House", "types: {Vase: {}}", 1, "parent", "parent: Object"),
    ("map: House", "types: {Jar: {parent: Object}}", 1, "duplicate", "in the ontology already"),
    ("map: House", "types: {Vase: {parent: Jar, defaults: {Weight: a lot}}}", 1, "value", "a number in kg"),
    ("map: House", "types: {Vase: {parent: Jar, constraints: [{attribute: Weight}]}}", 1, "constraint", "minimum, maximum or values"),
    (
        "map: House",
        "types: {Vase: {parent: Jar, constraints: [{attribute: Weight, values: [a, [1]]}]}}",
        1,
        "structure",
        "an item of values should be",
    ),
    ("map: House", "services: {Go: {effect: x, cost: [1]}}", 1, "structure", "cost should be"),
    ("map: House", "services: {Go: {effect: x, cost: {much: 1}}}", 1, "structure", "cost should be"),
    ("map: House", 'types: {Vase: {parent: Jar, constraints: [{formula: "?Self.Wait > 1"}]}}', 1, "formula", "Wait"),
    ("map: House", "attributes: {Heat: {kind: number, unit: wibble}}", 1, "unit", "pint knows no unit wibble"),
    ("map: House", "attributes: {Heat: {kind: numbr}}", 1, "structure", "'number'"),
    ("map: House", "attributes: {Heat: {kind: enumeration}}", 1, "kind", "needs values"),
    ("map: House", "attributes: {parts: {kind: text}}", 1, "reserved", "another name"),
    ("map: House", "relations: {likes: {joins: [Objct, Object]}}", 1, "unknown-name", "did you mean Object"),
    ("map: House", "functions: {heat: {parameters: [Object], attribute: Wieght}}", 1, "unknown-name", "did you mean Weight"),
    ("map: House", "relations: {near: {joins: [Jar, Table], symmetric: true}}", 1, "relation", "of the same type"),
    ("map: House", "relations: {near: {joins: [Jar, Jar, Jar], symmetric: true}}", 1, "relation", "joins two objects"),
    ("map: House", "attributes: {Heat: {kind: text, unit: K}}", 1, "kind", "only a number has a unit"),
    ("map: House", "attributes: {Heat: {kind: number, values: [Hot]}}", 1, "kind", "only an enumeration has values"),
    ("map: House", "attributes: {Heat: {kind: complex, attributes: [Wieght]}}", 1, "unknown-name", "did you mean Weight"),
    ("map: House", "attributes: {Heat: {kind: complex, attributes: [Weight, Heat]}}", 1, "cycle", "through Heat"),
    ("map: House", "functions: {heat: {parameters: [Object, Object], attribute: Weight}}", 1, "function", "has one parameter"),
    ("map: House", "types: {Vase: {parent: Jar, parts: [{type: FurnitureLag}]}}", 1, "unknown-name", "did you mean FurnitureLeg"),
    ("map: House", "types: {Vase: {parent: Jar, parts: [{type: FurnitureLeg, minimum: 3, maximum: 2}]}}", 1, "parts", "correct the limits"),
    (
        "map: House",
        'types: {Vase: {parent: Jar, constraints: [{attribute: Weight, minimum: 1, formula: "?Self.Weight > 1"}]}}',
        1,
        "constraint",
        "either an attribute",
    ),
    ("map: House", 'services: {Weigh: {effect: "?x isOn Table1", inputs: {x: Jar}, outputs: {x: Jar}}}', 1, "duplicate", "twice"),
    ("map: House", 'services: {Move: {effect: "?x isOn ?y AND", inputs: {x: Jar}}}', 1, "formula", "ends too early"),
    ("map: House", 'services: {Move: {effect: "?x isOn ?y", inputs: {x: Jarr}}}', 1, "unknown-name", "did you mean Jar"),
]


@pytest.mark.parametrize(("old", "new", "line", "rule", "words"), MISTAKES, ids=lambda value: str(value)[:40])
def test_mistake_is_named_with_its_line(old: str, new: str, line: int, rule: str, words: str) -> None:
    assert old in HOUSE
    found_problems = problems(HOUSE.replace(old, new, 1))
    assert [(problem.line, problem.rule) for problem in found_problems] == [(line, rule)], (
        "one problem, and nothing that only follows from it"
    )
    assert words in found_problems[0].message
    assert str(found_problems[0]).startswith(f"house.yaml:{line}: ")


@pytest.mark.parametrize("name", ["AND", "OR", "NOT", "FORALL", "EXISTS", "TRUE", "FALSE", "1a", "a b", "a.b", "-a"])
def test_what_is_no_name_is_told(name: str) -> None:
    message = "is not a name; a name is a letter and then letters, digits, _ or -, and not AND, OR, NOT, FORALL, EXISTS, TRUE or FALSE"
    found_problems = problems(f'types:\n  "{name}": {{parent: Jar}}\n')
    assert [(p.line, p.subject, p.rule, p.message) for p in found_problems] == [(2, name, "name", message)]


def test_what_only_follows_from_a_mistake_is_not_told() -> None:
    found_problems = problems("types:\n  AND: {parent: Jar}\n  Vase: {parent: AND}\n  Urn: {parent: Vasse}\n")
    assert [(p.line, p.subject, p.rule) for p in found_problems] == [(2, "AND", "name"), (4, "Urn", "unknown-name")]


def test_attributes_that_are_made_of_each_other() -> None:
    outer = "attributes: {Heat: {kind: complex, attributes: [Glow]}, Glow: {kind: complex, attributes: [Fire]}"
    assert "Fire" in load_text(f"{outer}, Fire: {{kind: complex, attributes: [Weight]}}}}\n").ontology.attributes
    found_problems = problems(f"{outer}, Fire: {{kind: complex, attributes: [Weight, Heat]}}}}\n")
    assert [(p.subject, p.rule) for p in found_problems] == [("Heat", "cycle"), ("Glow", "cycle"), ("Fire", "cycle")]


def test_what_a_part_may_be_there_for_as_often_as_it_must() -> None:
    types = "types: {Vase: {parent: Jar, parts: [{type: FurnitureLeg, minimum: 2, maximum: 2}]}}"
    assert load_text(HOUSE.replace("map: House", f"{types}\nmap: House", 1)).ontology.types["Vase"].parts[0].maximum == 2


def test_map_without_an_abstract_object_has_no_root() -> None:
    assert [(p.line, p.rule) for p in problems("map: House\nobjects:\n  Jar1: {type: Jar, at: [0, 0, 0]}\n")] == [(2, "root")]
    assert [p.rule for p in problems("map: House\n")] == ["root"]


def test_all_mistakes_are_told_at_once() -> None:
    text = HOUSE
    for old, new in (
        ("Jar,", "Jarr,"),
        ("Table1}", "Table1"),
        ("turned: 90 deg", "turned: 90 kg"),
        ("Form: Box, Width: 10", "Form: Bx, Width: 10"),
    ):
        text = text.replace(old, new, 1)
    assert [(problem.line, problem.rule) for problem in problems(text)] == [(9, "value"), (10, "unit"), (11, "unknown-type")]


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("", "structure"),
        ("- a\n- b\n", "structure"),
        ("map: [", "syntax"),
        ("map: \t\n\tx: 1", "syntax"),
        ("a: &x {b: 1}\nc: *x", "alias"),
        ("map: " + "[" * 5000 + "]" * 5000, "syntax"),
        ("objects: {? [a] : 1}", "syntax"),
        ("map: \x00", "syntax"),
    ],
)
def test_text_that_is_no_such_file(text: str, rule: str) -> None:
    assert rule in {problem.rule for problem in problems(text)}


def test_what_is_wrong_with_the_whole_file_is_said_of_the_file() -> None:
    assert [(p.subject, p.line, p.rule) for p in problems("- a\n- b\n")] == [("file", 1, "structure")]


@given(st.data())
@examples(40)
def test_no_text_makes_loading_fail_otherwise(data: st.DataObject) -> None:
    """A file with something overwritten is read, or its problems are told; nothing else happens."""
    start = data.draw(st.integers(0, len(HOUSE) - 1))
    end = data.draw(st.integers(start, min(start + 12, len(HOUSE))))
    junk = data.draw(st.text(alphabet=":{}[]-,'\"\n |>&*!?%@#ab1.e~", max_size=8))
    found_problems: list[Problem] = []
    try:
        load_text(HOUSE[:start] + junk + HOUSE[end:])
    except ModelError as error:
        found_problems = error.problems
    assert all(problem.message for problem in found_problems)


def test_files_use_others_relative_to_themselves(tmp_path: Path) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "vases.yaml").write_text("ontology: vases\ntypes:\n  Vase: {parent: Jar, defaults: {Weight: 400 g}}\n")
    (tmp_path / "house.yaml").write_text("uses: [lib/vases.yaml]\n" + HOUSE.replace("type: Jar", "type: Vase"))
    (tmp_path / "robots.yaml").write_text("uses: [house.yaml]\nobjects:\n  Robot1: {type: PioneerP3DX, at: [3, 3]}\n")
    loaded = load([tmp_path / "robots.yaml", tmp_path / "house.yaml"])
    assert loaded.ontology.default("Vase", "Weight") == pytest.approx(0.4)
    assert {"Robot1", "Jar1", "House"} <= the_map(loaded).objects.keys()


def test_files_that_are_missing_or_say_a_thing_twice(tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text("uses:\n  - two.yaml\n  - three.yaml\ntypes: {Vase: {parent: Jar}}\n")
    (tmp_path / "two.yaml").write_text("types:\n  Vase: {parent: Can}\n")
    with pytest.raises(ModelError) as caught:
        load([tmp_path / "one.yaml"])
    found_problems = {(Path(p.file).name, p.line, p.rule) for p in caught.value.problems}
    assert found_problems == {("one.yaml", 3, "file"), ("one.yaml", 4, "duplicate")}


def test_what_is_said_of_files_and_of_those_that_they_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("lib").mkdir()
    Path("one.yaml").write_text("uses:\n  - lib/two.yaml\n  - lib/three.yaml\n  - 5\n  - lib/four.yaml\ntypes: {Vase: {parent: Jarr}}\n")
    Path("lib/two.yaml").write_text("uses: [../one.yaml, five.yaml]\ntypes:\n  Pot: {parent: Can}\n  Pit: {parent: Urnn}\n")
    Path("lib/four.yaml").write_bytes(b"types:\n  \xff")
    Path("lib/five.yaml").write_bytes("\ufefftypes: {Urn: {parent: Pot}}\n".encode())
    with pytest.raises(ModelError) as caught:
        load(["one.yaml", "lib/../one.yaml", "gone.yaml", "lib"])
    assert [(p.file, p.line, p.subject, p.rule, p.message) for p in caught.value.problems] == [
        ("gone.yaml", None, "file", "file", "gone.yaml cannot be read: No such file or directory; correct the path or the file"),
        ("lib", None, "file", "file", "lib cannot be read: Is a directory; correct the path or the file"),
        ("lib/two.yaml", 4, "Pit", "unknown-name", "no type is called Urnn; did you mean Urn?"),
        ("one.yaml", 3, "file", "file", "lib/three.yaml cannot be read: No such file or directory; correct the path or the file"),
        ("one.yaml", 4, "uses", "structure", "an item of uses should be a text, not 5; write it in quotes"),
        ("one.yaml", 5, "file", "file", "lib/four.yaml cannot be read: it is not UTF-8 text; correct the path or the file"),
        ("one.yaml", 6, "Vase", "unknown-name", "no type is called Jarr; did you mean Jar?"),
    ]


WRONG_VALUES = """\
map: X
objects:
  A:
    type: Building
    parts:
      B:
        type: Storey
        Elevation:
        parts:
          F:
            type: Floor
            at: [0,
              x,
              1 kg]
            turned: 5 x
            Shape:
              Form: Box
              Width: much
              Depth: -1
              Height: [1]
facts:
  - F isOn B
  - 5
  - F isOn B
  - A = B
  - NOT A isOn B
  - likes(A)
  - "F  isIn\\tA "
types:
  V:
    parent: Jar
    defaults:
      Weight: 1 m
      Shape: {Width: 3 kg,
        Form: Rund}
      Nope: 3
      Label: [1]
without:
  - typos Jar
  - types Jarr
  - types Qqq
"""
NO_FACT = "is not a fact; a fact is one relation between named objects: Jar002 isOn Cupboard001"


def test_what_is_said_of_values_and_facts_and_on_which_line() -> None:
    assert [(p.line, p.subject, p.rule, p.message) for p in problems(WRONG_VALUES)] == [
        (8, "B", "value", "Elevation is empty; write a number, a text, or true or false"),
        (13, "F", "value", "PositionY is a number in m, not 'x'"),
        (14, "F", "unit", "PositionZ is a number in m, and '1 kg' cannot be expressed in it"),
        (15, "F", "unit", "RotationZ is a number in rad, and '5 x' cannot be expressed in it"),
        (18, "F", "value", "Shape.Width is a number in m, not 'much'"),
        (19, "F", "value", "Depth is at least 0, not -1"),
        (20, "F", "value", "Shape.Height is a list; write a number, a text, or true or false"),
        (23, "facts", "structure", "an item of facts should be a text, not 5; write it in quotes"),
        (24, "F isOn B", "duplicate", "is stated already; remove this one"),
        (25, "facts", "formula", f"'A = B' {NO_FACT}"),
        (26, "facts", "formula", f"'NOT A isOn B' {NO_FACT}"),
        (27, "likes(A)", "unknown-relation", "no relation is called likes; define it, or use one of the relations there are"),
        (28, "F isIn A", "exclusive", "cannot hold together with F isOn B; keep one of the two"),
        (33, "V", "unit", "Weight is a number in kg, and '1 m' cannot be expressed in it"),
        (34, "V", "unit", "Shape.Width is a number in m, and '3 kg' cannot be expressed in it"),
        (35, "V", "value", "Form is one of Box, Cylinder, Polygon, not 'Rund'"),
        (36, "V", "unknown-name", "no attribute of this type is called Nope; define it, or use one that is there"),
        (37, "V", "value", "Label is a list; write a number, a text, or true or false"),
        (39, "without", "structure", "'typos Jar' names no definition; write a section and a name, such as types Jar"),
        (40, "Jarr", "unknown-name", "is not among the types of the base ontology; did you mean Jar?"),
        (41, "Qqq", "unknown-name", "is not among the types of the base ontology; leave it out here"),
    ]


def test_what_is_said_of_objects_that_are_none_and_of_short_forms() -> None:
    text = """\
map: X
objects:
  A:
    type: Building
    turned: 1
    at: [0,
      0]
    Shape:
      Form: Box
  B: 5
  C: {type: Jar, at: [0, 0, 0], parts: {D: 7}}
"""
    assert [(p.line, p.subject, p.rule, p.message) for p in problems(text)] == [
        (3, "A", "parts", "a Building has at least 1 of type Storey among its parts; this one has 0"),
        (5, "A", "unknown-attribute", "a Building has no attribute RotationZ; it has Label, Latitude, Longitude, Mode, Supporting"),
        (6, "A", "unknown-attribute", "a Building has no attribute PositionX; it has Label, Latitude, Longitude, Mode, Supporting"),
        (6, "A", "unknown-attribute", "a Building has no attribute PositionY; it has Label, Latitude, Longitude, Mode, Supporting"),
        (9, "A", "unknown-attribute", "a Building has no attribute Shape.Form; it has Label, Latitude, Longitude, Mode, Supporting"),
        (10, "B", "structure", "B should be keys with values (B: {...}), not 5"),
        (11, "D", "structure", "D should be keys with values (D: {...}), not 7"),
    ]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-1", 0.1),
        (".5 kg", 0.5),
        ("' +2.  kg '", 2.0),
        ("-0 g", 0.0),
        ("'250g'", 0.25),
        ("1E3 g", 1.0),
    ],
)
def test_how_numbers_may_be_written(text: str, value: float) -> None:
    assert the_map(load_text(HOUSE.replace("300 g", text))).objects["Jar1"].values["Weight"] == pytest.approx(value)


def test_definitions_build_on_the_base_ontology() -> None:
    base = load_text("types: {Vase: {parent: Jar}}").ontology
    assert load_text("types: {Vase: {parent: Jar}, Urn: {parent: Vase}}", base=base).ontology.is_subtype("Urn", "Jar")
    assert load_text("types: {Vase: {parent: Jar}}").map is None


def test_published_schema_is_the_models() -> None:
    assert published_schema() == json.loads(json.dumps(json_schema())), "write ontology/data/somrs.schema.json anew from json_schema()"


def test_what_the_upper_ontology_has_can_be_left_out_or_defined_anew() -> None:
    text = "without: [types Cup, types Can, services TransferObject]\ntypes:\n  Can: {parent: Graspable, doc: Ours}\n"
    with pytest.raises(ModelError) as caught:
        load_text(text, "own.yaml")
    assert [(problem.line, problem.subject, problem.rule) for problem in caught.value.problems] == [(1, "TransferObject", "relied")]
    ontology = load_text(text.replace(", services TransferObject", "")).ontology
    assert "Cup" not in ontology.types
    assert ontology.types["Can"].doc == "Ours"
    written = dump_ontology(ontology, upper(), "own")
    assert yaml.safe_load(written)["without"] == ["types Can", "types Cup"]
    assert list(yaml.safe_load(written)["types"]) == ["Can"]
    for whole in (written, dump_ontology(ontology, upper(), "own", whole=True)):
        assert {(type(definition), definition.name): definition for definition in load_text(whole).ontology} == {
            (type(definition), definition.name): definition for definition in ontology
        }


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("types Cupp", "did you mean Cup"),
        ("cups", "names no definition"),
        ("types", "names no definition"),
        ("5", "should be a text"),
        ("types Graspable", "neither removed nor renamed"),
        ("attributes Texture", "no attribute is called Texture"),
    ],
)
def test_what_cannot_be_left_out_is_said_with_its_line(entry: str, words: str) -> None:
    found_problems = problems(f"ontology: own\nwithout:\n  - {entry}\n")
    assert any(words in problem.message for problem in found_problems), found_problems
    assert (3 in [problem.line for problem in found_problems]) is (entry != "attributes Texture")


def test_definitions_of_a_text_take_the_place_of_others() -> None:
    text = "map: X\nobjects:\n  A: {type: Nothing}\ntypes:\n  Jar: {parent: Graspable}\n  Vat: {parent: Support}\nwithout: [types Cup]\n"
    ontology = load_definitions(text, "own.yaml", upper())
    assert ontology.types["Jar"].defaults == {}
    assert ontology.types["Vat"].parent == "Support"
    assert "Cup" not in ontology.types
    assert len([*ontology]) == len([*upper()])
    with pytest.raises(ModelError, match=r"own.yaml:2: Jar: no type is called Grasp"):
        load_definitions("types:\n  Jar: {parent: Grasp}\n", "own.yaml", upper())


def test_examples_in_the_documentation_load() -> None:
    blocks = re.findall(r"```yaml\n(.*?)```", DOCS.read_text("utf-8"), re.DOTALL)
    assert len(blocks) >= 2
    ontology = upper()
    for block in blocks:
        ontology = load_text(block, "docs/how-to/describe-a-building.md", ontology).ontology


def test_messages_in_the_documentation_are_those_that_are_told() -> None:
    text = DOCS.read_text("utf-8")
    map = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)[0]
    for old, new in (("type: Table", "type: Tabel"), ("Weight: 300 g", "Weight: 300 mm"), ("isOn Bench1", "isOn Bnch1")):
        assert old in map
        map = map.replace(old, new)
    with pytest.raises(ModelError) as caught:
        load_text(map, "workshop.yaml")
    assert f"```\n{caught.value}\n```" in text


# What is written is read back

names = st.sampled_from(["null", "true", "Off", "e5", "y", "é", "A-1", "No", "on", "x_"]) | st.builds(
    str.__add__, st.sampled_from("Aaé_"), st.text("ab1_", max_size=5)
)
numbers = st.floats(allow_nan=False, allow_infinity=False)
lengths = st.floats(min_value=0, max_value=1e6)
texts = st.text(alphabet=st.characters(exclude_categories=["Cs"]), max_size=30)
positions: st.SearchStrategy[dict[str, Value]] = st.fixed_dictionaries({"PositionX": numbers, "PositionY": numbers, "PositionZ": numbers})
extras: st.SearchStrategy[dict[str, Value]] = st.fixed_dictionaries(
    {},
    optional={
        "RotationZ": numbers,
        "RotationX": numbers,
        "Color": st.sampled_from(upper().attributes["Color"].values),
        "Label": texts,
        "Texture": texts | st.sampled_from(["12", "true", "3 kg", "~", "a: b", "- x", "#"]),
        "Weight": st.floats(0, 5),
    },
)
shapes: st.SearchStrategy[dict[str, Value]] = st.one_of(
    st.fixed_dictionaries({"Shape.Form": st.just("Box"), "Shape.Width": lengths, "Shape.Depth": lengths, "Shape.Height": lengths}),
    st.fixed_dictionaries({"Shape.Form": st.just("Cylinder"), "Shape.Radius": lengths, "Shape.Height": lengths}),
)


@st.composite
def maps(draw: st.DrawFn) -> Map:
    """A building of some storeys with floors, furniture in some of them, and things on some furniture."""
    fresh = iter(draw(st.lists(names, min_size=14, max_size=14, unique=True)))
    root = next(fresh)
    objects, facts = [Object(name=root, type="Building")], []
    supports: list[str] = []
    for _ in range(draw(st.integers(1, 2))):
        storey, floor = next(fresh), next(fresh)
        objects += [Object(name=storey, type="Storey"), Object(name=floor, type="Floor", values={**draw(positions), **draw(shapes)})]
        facts += [Fact(PART_OF, (storey, root)), Fact(PART_OF, (floor, storey))]
        for _ in range(draw(st.integers(0, 2))):
            name = next(fresh)
            objects.append(Object(name=name, type="Table", values={**draw(positions), **draw(shapes), **draw(extras)}))
            supports.append(name)
            facts += [Fact(PART_OF, (name, storey))] if draw(st.booleans()) else []
    for support in supports:
        name = next(fresh)
        objects.append(Object(name=name, type="Can", values={**draw(positions), **draw(extras)}))
        facts.append(Fact("isOn", (name, support)))
    return Map(objects, facts)


@given(maps())
@examples(40)
def test_map_is_read_back_as_written(map: Map) -> None:
    assert load_text(dump_map(map, upper())).map == map


docs = st.text(alphabet=st.characters(exclude_categories=["Cs"]), max_size=20)


@functools.cache
def conditions(variable: str) -> st.SearchStrategy[str]:
    """Formulas about `?variable`, an object of the type, with NOT before anything and quantifiers within quantifiers.

    They contain %(type)s, %(number)s and %(relation)s for names, so that the strategies are the same for all names: Hypothesis takes longer
    to make them than to draw from them.
    """

    def about(subject: str, depth: int) -> st.SearchStrategy[str]:
        above = st.integers(0, 9).map(lambda limit: f"?{subject}.%(number)s > {limit}")
        related = st.sampled_from([f"?{subject} %(relation)s ?{subject}", f"?{subject} %(relation)s ?Anything"])
        atoms = above | related | above.map("NOT {}".format)
        if depth == 0:
            return atoms
        inner = about(f"{subject}{depth}", depth - 1)
        quantified = st.tuples(st.sampled_from(["FORALL", "EXISTS", "NOT FORALL", "NOT EXISTS"]), inner, about(subject, depth - 1)).map(
            lambda parts: f"{parts[0]} ?{subject}{depth}: %(type)s ({parts[1]} OR {parts[2]})"
        )
        joined = st.tuples(about(subject, depth - 1), st.sampled_from(["AND", "OR"]), quantified).map(" ".join)
        return atoms | quantified | joined | joined.map("NOT ({})".format)

    return about(variable, 2)


number_conditions = st.none() | st.just("?x.%(number)s > ?n")
handler_lists = st.lists(
    st.builds(Handler, on=st.sampled_from(Occasion), when=st.none() | conditions("x"), effect=conditions("x")), max_size=2
)


@st.composite
def definitions(draw: st.DrawFn) -> list[AttributeType | RelationType | FunctionType | ObjectType | ServiceType]:
    number_name, enumeration_name, complex_name, type_name, relation_name, symmetric_name, function_name, service_name, table_name = (
        f"New{name}" for name in draw(st.lists(names, min_size=9, max_size=9, unique=True))
    )
    low = draw(st.none() | st.just(0.0) | st.floats(-1e9, 1e9))
    chosen_names = {"type": type_name, "number": number_name, "relation": relation_name}

    def formula(template: str) -> str:
        return str(parse(template % chosen_names))

    return [
        AttributeType(
            name=number_name, kind=Kind.NUMBER, unit=draw(st.sampled_from([None, "m", "km/h", "percent"])), minimum=low, doc=draw(docs)
        ),
        AttributeType(
            name=enumeration_name, kind=Kind.ENUMERATION, values=tuple(draw(st.lists(names, min_size=1, max_size=3, unique=True)))
        ),
        AttributeType(
            name=complex_name,
            kind=Kind.COMPLEX,
            attributes=(number_name, enumeration_name),
            constraints=draw(st.sampled_from([(), (Constraint(attribute=number_name, minimum=1.5, doc="Rule"),)])),
        ),
        ObjectType(
            name=type_name,
            parent=draw(st.sampled_from(["Object", "Table", "Room"])),
            attributes=(number_name,),
            required=(complex_name,),
            parts=(Part(type="Table", minimum=draw(st.integers(0, 3)), maximum=draw(st.none() | st.integers(3, 5))),),
            constraints=(
                Constraint(attribute=number_name, maximum=draw(numbers)),
                Constraint(attribute=complex_name, values=(complex_name,), doc=draw(docs)),
                Constraint(formula=f"?Self.{number_name} < 3", doc=draw(docs)),
                Constraint(formula=formula(draw(conditions("Self"))), doc=draw(docs)),
            ),
            closed=draw(st.booleans()),
            defaults={number_name: max(low or 0.0, draw(st.floats(0, 10)))},
            doc=draw(docs),
        ),
        RelationType(name=relation_name, joins=(type_name, "Object"), functional=draw(st.booleans()), excludes=draw(st.none() | names)),
        RelationType(name=symmetric_name, joins=(type_name, type_name), symmetric=True),
        FunctionType(name=function_name, parameters=(type_name,), attribute=number_name),
        FunctionType(
            name=table_name,
            parameters=(type_name, type_name),
            values={f"{number_name} {enumeration_name}": draw(numbers), f"{enumeration_name} {number_name}": 0.0},
        ),
        ServiceType(
            name=service_name,
            inputs=(Parameter(name="x", type=type_name), Parameter(name="n", type="number")),
            outputs=(Parameter(name="y", type="Object"),),
            kind=draw(st.sampled_from(ServiceKind)),
            precondition=formula(template) if (template := draw(number_conditions | conditions("x"))) is not None else None,
            invariant=draw(st.none() | st.just(f"?x.{number_name} > ?n AND ?x.{number_name} < 9")),
            effect=f"?x {relation_name} ?y",
            handlers=tuple(
                Handler(on=handler.on, when=formula(handler.when) if handler.when is not None else None, effect=formula(handler.effect))
                for handler in draw(handler_lists)
            ),
            cost=draw(st.sampled_from([None, "3", f"{table_name}(?x, ?x)", f"?x.{number_name}"])),
        ),
    ]


@given(definitions())
@examples(40)
def test_ontology_is_read_back_as_written(new: list[AttributeType | RelationType | FunctionType | ObjectType | ServiceType]) -> None:
    ontology = upper().extended(new)
    assert [*load_text(dump_ontology(ontology, base=upper())).ontology] == [*ontology]


def test_whole_upper_ontology_is_read_back() -> None:
    assert [*load_text(dump_ontology(upper()), base=Ontology()).ontology] == [*upper()]


def test_a_site_may_define_the_service_types_of_the_shipped_devices_anew() -> None:
    text = """
services:
  OpenDoor:
    inputs: {Which: Door}
    precondition: "?Which.Open = FALSE"
    effect: "?Which.Open = TRUE"
"""
    assert load_text(text).ontology.services["OpenDoor"].inputs == (Parameter(name="Which", type="Door"),)
    assert load_text("attributes: {}").ontology.services["OpenDoor"].inputs == (Parameter(name="Door", type="Door"),)
