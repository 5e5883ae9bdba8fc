"""The ontology is what the paper says it is: shapes are demanded and enforced, elementary objects have no parts, and what cannot be
enforced is refused (paper, "Environment representation")."""

from __future__ import annotations

import pytest

from somrs.errors import ModelError
from somrs.ontology.conformance import violations
from somrs.ontology.consistency import ontology_violations
from somrs.ontology.files.dump import dump_ontology
from somrs.ontology.files.levels import level_of
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.files.site import dump_site
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.owl import Format, export, read
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import AttributeType, Constraint, Definition, Kind, ObjectType, Part
from somrs.protocol.messages.knowledge import Define, by_kind
from somrs.repository.definition import define_outcome
from tests.support.building import building

LEG = "CuboidFurnitureLeg"
LEGS = building("Hall", 10, 10)


def problems(text: str) -> str:
    """The problems of a file on the latest level; empty if it has none."""
    try:
        load_text(f"upper: 2\n{text}", "site.yaml")
    except ModelError as error:
        return str(error)
    return ""


def leg(shape: str, name: str = "Leg1") -> str:
    return f"\n  {name}: {{type: {LEG}, at: [1, 1, 0], Shape: {shape}}}"


@pytest.mark.parametrize(
    ("shape", "problem"),
    [
        ("{Form: Box, Width: 0.05, Depth: 0.05, Height: 0.7}", ""),
        ("{Form: Cylinder, Radius: 0.05, Height: 0.7}", "a CuboidFurnitureLegShape has no Radius"),
        ("{Form: Box, Width: 0.4, Depth: 0.4, Height: 0.7}", "Width is at most 0.15, not 0.4"),
        ("{Form: Box, Width: 0.05, Depth: 0.05, Height: 3}", "Height is at most 1.2, not 3"),
        ("{Form: Box, Width: 5 cm, Height: 70 cm}", "a CuboidFurnitureLegShape has a Depth, which is not given"),
    ],
)
def test_a_shape_that_a_type_demands_is_enforced(shape: str, problem: str) -> None:
    assert (problem in problems(LEGS + leg(shape))) if problem else (problems(LEGS + leg(shape)) == "")


def test_of_several_shapes_one_must_fit() -> None:
    text = """
attributes:
  RoundShape: {kind: complex, attributes: [Form, Radius, Height], constraints: [{attribute: Form, values: [Cylinder]}]}
types:
  Post: {parent: Furniture, constraints: [{attribute: Shape, values: [CuboidFurnitureLegShape, RoundShape]}]}
"""
    site = text + LEGS + "\n  Post1: {type: Post, at: [1, 1, 0], Shape: "
    assert problems(site + "{Form: Cylinder, Radius: 0.1, Height: 2}}") == ""
    assert problems(site + "{Form: Box, Width: 0.1, Depth: 0.1, Height: 1}}") == ""
    assert "Shape is a RoundShape, and a RoundShape has no Width" in problems(site + "{Form: Box, Width: 1, Depth: 1, Height: 1}}")


def test_the_constraints_of_a_complex_attribute_hold_for_every_object_that_has_it() -> None:
    text = """
attributes:
  Gauge: {kind: number, unit: m}
  Wheel: {kind: complex, attributes: [Gauge], constraints: [{attribute: Gauge, minimum: 0.1, doc: A wheel rolls over sills}]}
types:
  Trolley: {parent: Furniture, attributes: [Wheel]}
"""
    site = text + LEGS + "\n  T1: {type: Trolley, at: [1, 1, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}, Wheel: {Gauge: "
    assert problems(site + "0.2}}") == ""
    assert "Wheel.Gauge is at least 0.1, not 0.05" in problems(site + "0.05}}")


@pytest.mark.parametrize(
    ("constraint", "problem"),
    [
        (Constraint(attribute="Shape", values=("CuboidFurnitureLegShap",)), "no complex attribute is called CuboidFurnitureLegShap"),
        (Constraint(attribute="Shape", values=("Wheel",)), "Shape cannot be a Wheel, because it has no Gauge"),
        (Constraint(attribute="Shape", minimum=1), "no number"),
        (Constraint(attribute="Color", values=("Pink",)), "Color is one of"),
        (Constraint(attribute="Weight", values=("heavy",)), "Weight is a number in kg"),
        (Constraint(attribute="Weight", minimum=3, maximum=2), "no Weight is at least 3 and at most 2"),
        (Constraint(formula="?Self.Weight > 1", maximum=3), "a formula has no minimum, maximum or values beside it"),
    ],
)
def test_a_constraint_that_cannot_be_enforced_is_refused(constraint: Constraint, problem: str) -> None:
    definitions: list[Definition] = [
        AttributeType(name="Gauge", kind=Kind.NUMBER),
        AttributeType(name="Wheel", kind=Kind.COMPLEX, attributes=("Gauge",)),
        ObjectType(name="Box", parent="Graspable", constraints=(constraint,)),
    ]
    assert problem in str(ontology_violations(upper(2).extended(definitions), definitions)[0])


@pytest.mark.parametrize(
    ("attribute", "problem"),
    [
        (
            AttributeType(name="Gauge", kind=Kind.NUMBER, constraints=(Constraint(attribute="Width", minimum=1),)),
            "only a complex attribute",
        ),
        (
            AttributeType(name="Wheel", kind=Kind.COMPLEX, attributes=("Width",), constraints=(Constraint(attribute="Depth", minimum=1),)),
            "no",
        ),
        (
            AttributeType(name="Wheel", kind=Kind.COMPLEX, attributes=("Width",), constraints=(Constraint(formula="?Self.Width > 1"),)),
            "type",
        ),
    ],
)
def test_so_is_one_of_an_attribute(attribute: AttributeType, problem: str) -> None:
    assert problem in str(ontology_violations(upper(2).extended([attribute]), [attribute])[0])


def test_a_changed_shape_is_checked_for_the_objects_that_must_have_it_and_a_renamed_one_is_renamed_in_the_constraint() -> None:
    loaded = load_text("upper: 2\n" + LEGS + leg("{Form: Box, Width: 0.05, Depth: 0.05, Height: 0.7}"), "site.yaml")
    assert loaded.map is not None
    shape = loaded.ontology.attributes["CuboidFurnitureLegShape"]
    narrow = AttributeType(
        name=shape.name, kind=shape.kind, attributes=shape.attributes, constraints=(Constraint(attribute="Width", maximum=0.03),)
    )
    outcome = define_outcome(loaded.map, loaded.ontology, Define(definitions=by_kind([narrow])))
    assert ["Width is at most 0.03" in violation.message for violation in outcome.broken] == [True]
    renaming = Renaming(section=Section.ATTRIBUTES, name=shape.name, to="LegShape")
    renamed = Renamer((renaming,), loaded.ontology).ontology(loaded.ontology)
    assert renamed.types[LEG].constraints[-1] == Constraint(attribute="Shape", values=("LegShape",))
    assert violations(loaded.map, renamed) == []


# Parts


JAR_WITH_LID = LEGS + "\n  Jar1: {type: Jar, at: [1, 1, 0], parts: {Lid1: {type: PhysicalObject, at: [1, 1, 0.1]}}}"


def test_an_elementary_object_has_no_parts() -> None:
    assert "a Jar has no parts: its attributes describe it; declare PhysicalObject among the parts of Jar" in problems(JAR_WITH_LID)
    declared = "types:\n  Lid: {parent: PhysicalObject}\n  LiddedJar: {parent: Jar, parts: [{type: Lid, minimum: 0}]}\n" + JAR_WITH_LID
    lidded = declared.replace("type: Jar,", "type: LiddedJar,")
    assert "a LiddedJar has only parts of the types Lid" in problems(lidded)
    assert problems(lidded.replace("{type: PhysicalObject, at", "{type: Lid, at")) == ""


def test_a_physical_object_is_not_composed_of_abstract_ones() -> None:
    room = ObjectType(name="Ark", parent="Furniture", parts=(Part(type="Room"),))
    assert "not composed of abstract objects" in str(ontology_violations(upper(2).extended([room]), [room])[0])


TABLE = LEGS + "\n  Table1: {type: Table, at: [2, 2, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}"
PARTS = (
    ", parts: {Top1: {type: TableTop, Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.04}}, "
    f"Leg1: {{type: {LEG}, Shape: {{Form: Box, Width: 0.05, Depth: 0.05, Height: 0.66}}}}}}"
)


def test_a_table_has_legs_and_a_top() -> None:
    assert "a Table has at least 1 of type FurnitureLeg among its parts; this one has 0" in problems(TABLE + "}")
    assert problems(TABLE + PARTS + "}") == ""


def test_a_file_that_was_written_before_is_not_asked_for_them() -> None:
    assert load_text(TABLE + "}", "site.yaml").map is not None
    assert load_text(JAR_WITH_LID, "site.yaml").map is not None
    own_volume = "attributes:\n  Volume: {kind: number, unit: m, doc: How loud it is}\n"
    assert load_text(own_volume, "site.yaml").ontology.attributes["Volume"].unit == "m"


def test_what_the_paper_names_is_there() -> None:
    ontology = upper(2)
    attributes = ontology.attributes_of("PhysicalObject").keys()
    assert {"Color", "Weight", "Volume", "PositionX", "RotationX", "Shape", "Texture"} <= attributes
    parts = {name: {part.type: part.minimum for part in ontology.parts_of(name)} for name in ("CuboidRoom", "Building", "Table")}
    assert parts["CuboidRoom"] == {"Wall": 4, "Floor": 1, "Ceiling": 1, "Window": 0, "Door": 0}
    assert parts["Building"] == {"Storey": 1, "Space": 0, "Passage": 0, "Stairs": 0, "Lift": 0}
    assert parts["Table"] == {"FurnitureLeg": 1, "TableTop": 1, "PhysicalObject": 0}
    assert ontology_violations(ontology) == ontology_violations(upper(1)) == []


# Files


@pytest.mark.parametrize("level", [1, 2])
def test_a_file_keeps_its_level(level: int) -> None:
    text = f"upper: {level}\ntypes:\n  Vase: {{parent: Jar}}\n" + TABLE + (PARTS if level == 2 else "") + "}"
    loaded = load_text(text, "site.yaml")
    assert loaded.map is not None
    assert level_of(loaded.ontology) == level
    again = load_text(dump_site(loaded.ontology, loaded.map, "Hall"), "again.yaml")
    assert (again.ontology.types, again.ontology.attributes) == (loaded.ontology.types, loaded.ontology.attributes)
    assert load_text(dump_ontology(loaded.ontology, upper(level), "own"), "again.yaml").ontology.types == loaded.ontology.types
    assert load_text(dump_site(upper(level), loaded.map), "again.yaml").ontology.types == upper(level).types


@pytest.mark.parametrize("format", [*Format])
def test_owl_keeps_all_of_it(format: Format) -> None:
    two = AttributeType(name="BoardShape", kind=Kind.COMPLEX, attributes=("Form", "Width"), doc="Flat")
    board = ObjectType(
        name="Board",
        parent="Furniture",
        closed=True,
        constraints=(Constraint(attribute="Shape", values=("BoardShape", "Shape"), doc="Or"),),
    )
    ontology = upper(2).extended([two, board])
    read_ontology = read(export(ontology, None, format).decode(), "file", upper()).ontology
    for name in ("CuboidFurnitureLegShape", "BoardShape", "Shape"):
        assert read_ontology.attributes[name] == ontology.attributes[name]
    for name in ("Board", LEG, "PhysicalObject", "Table", "CuboidRoom"):
        assert read_ontology.types[name] == ontology.types[name]
