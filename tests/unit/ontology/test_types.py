"""What an ontology tells of its types, and how its definitions are found, added and taken away."""

from __future__ import annotations

import pytest

from somrs.ontology.naming import DefinitionKey, Renaming, Section, find_definition, key_of, revise_ontology
from somrs.ontology.services import ServiceType
from somrs.ontology.types import ROOT, AttributeType, Definition, FunctionType, Kind, ObjectType, Ontology, RelationType

LOAD = AttributeType(name="Load", kind=Kind.NUMBER)
FORM = AttributeType(name="Form", kind=Kind.TEXT)
SHAPE = AttributeType(name="Shape", kind=Kind.COMPLEX, attributes=("Form", "Size"))
SIZE = AttributeType(name="Size", kind=Kind.COMPLEX, attributes=("Load", "Missing"))
NEAR_RELATION = RelationType(name="near", joins=("Box", "Box"))
FAR = FunctionType(name="far", parameters=("Box",))
OBJECT = ObjectType(name=ROOT, parent=None)
BOX = ObjectType(name="Box", parent=ROOT, attributes=("Load",), defaults={"Load": 1.0, "Shape.Form": "flat"}, driver="a:A")
CRATE = ObjectType(name="Crate", parent="Box", required=("Shape",), defaults={"Load": 0.0}, attributes=("Missing",))
VAT = ObjectType(name="Vat", parent="Crate", driver="b:B")
ONE_TYPE = ObjectType(name="One", parent="Other")
OTHER_TYPE = ObjectType(name="Other", parent="One")
STRAY = ObjectType(name="Stray", parent="Gone")
OPEN = ServiceType(name="Open", effect="A near B")
ALL_DEFINITIONS: list[Definition] = [
    LOAD,
    FORM,
    SHAPE,
    SIZE,
    NEAR_RELATION,
    FAR,
    OBJECT,
    BOX,
    CRATE,
    VAT,
    ONE_TYPE,
    OTHER_TYPE,
    STRAY,
    OPEN,
]
ONTOLOGY = Ontology(reversed(ALL_DEFINITIONS))


@pytest.mark.parametrize(
    ("name", "ancestors"),
    [
        (ROOT, (ROOT,)),
        ("Vat", ("Vat", "Crate", "Box", ROOT)),
        ("One", ("One", "Other")),
        ("Stray", ("Stray",)),
        ("Gone", ()),
    ],
)
def test_ancestors_begin_with_the_type_itself(name: str, ancestors: tuple[str, ...]) -> None:
    assert ONTOLOGY.ancestors(name) == ancestors
    assert ONTOLOGY.ancestors(name) == ancestors, "asked once more"


def test_every_object_is_one_of_the_root() -> None:
    assert [ONTOLOGY.is_subtype("Gone", ROOT), ONTOLOGY.is_subtype("Vat", "Box"), ONTOLOGY.is_subtype("Box", "Vat")] == [True, True, False]
    assert set(ONTOLOGY.subtypes("Crate")) == {"Crate", "Vat"}
    assert set(ONTOLOGY.subtypes(ROOT)) == set(ONTOLOGY.types)


def test_attributes_are_inherited_and_spread_out() -> None:
    spread = {"Shape": SHAPE, "Shape.Form": FORM, "Shape.Size": SIZE, "Shape.Size.Load": LOAD}
    assert ONTOLOGY.attributes_of("Box") == {"Load": LOAD}
    for _ in range(2):
        assert ONTOLOGY.attributes_of("Vat") == {"Load": LOAD, **spread}
    assert ONTOLOGY.attributes_of("Gone") == {}


def test_attributes_that_are_made_of_themselves_end_somewhere() -> None:
    round_ = AttributeType(name="R", kind=Kind.COMPLEX, attributes=("R",))
    paths = [*Ontology([round_, ObjectType(name="T", parent=None, attributes=("R",))]).attributes_of("T")]
    assert paths == [".".join("R" * count) for count in range(1, 10)]


def test_defaults_and_drivers_are_those_of_the_nearest_ancestor() -> None:
    assert [ONTOLOGY.default(name, "Load") for name in ("Box", "Vat", ROOT)] == [1.0, 0.0, None]
    assert ONTOLOGY.default("Vat", "Shape.Form") == "flat"
    assert [ONTOLOGY.driver(name) for name in ("Box", "Crate", "Vat", ROOT, "Gone")] == ["a:A", "a:A", "b:B", None, None]


def test_definitions_are_found_by_section_and_name() -> None:
    assert {key_of(definition) for definition in ONTOLOGY} == {key_of(definition) for definition in ALL_DEFINITIONS}
    sections = [key_of(definition).section for definition in ONTOLOGY]
    assert list(dict.fromkeys(sections)) == [section for section in Section if section is not Section.OBJECTS]
    assert all(find_definition(ONTOLOGY, key_of(definition)) is definition for definition in ALL_DEFINITIONS)
    assert find_definition(ONTOLOGY, DefinitionKey(section=Section.OBJECTS, name="Box")) is None
    assert find_definition(ONTOLOGY, DefinitionKey(section=Section.RELATIONS, name="Box")) is None


def test_an_ontology_is_revised() -> None:
    new = ObjectType(name="Box", parent=ROOT)
    changed = revise_ontology(ONTOLOGY, [key_of(VAT), key_of(NEAR_RELATION)], [new])
    assert {key_of(definition): definition for definition in changed} == {
        key_of(definition): definition for definition in ALL_DEFINITIONS if definition not in (VAT, NEAR_RELATION, BOX)
    } | {key_of(new): new}
    assert [*revise_ontology(ONTOLOGY, [], [])] == [*ONTOLOGY]
    assert [*ONTOLOGY.extended([new])][-1] == ONTOLOGY.services["Open"]
    assert ONTOLOGY.types["Box"] is BOX, "the old one is as it was"


def test_what_is_named_is_told_in_words() -> None:
    assert str(DefinitionKey(section=Section.SERVICES, name="Open")) == "service type Open"
    assert str(Renaming(section=Section.TYPES, name="Box", to="Case")) == "type Box to Case"
