"""Ontologies and maps as OWL 2 with SHACL: what is written is read back, also when an editor changed it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import ModelError, Problem, UsageError
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.objects import Fact, Object
from somrs.ontology.owl import Format, OwlImport, export, read
from somrs.ontology.types import AttributeType, Constraint, Definition, Kind, ObjectType, Ontology, RelationType
from tests.support.examples import examples
from tests.support.paths import ROOT
from tests.unit.ontology.files.test_loading import HOUSE, definitions, maps, the_map

pytest.importorskip("rdflib", reason="rdflib is not installed")

FOLDER = Path(__file__).parent
PREFIXES = """\
@prefix : <http://example.org/vases#> .
@prefix type: <urn:so-mrs:type:> .
@prefix attribute: <urn:so-mrs:attribute:> .
@prefix relation: <urn:so-mrs:relation:> .
@prefix object: <urn:so-mrs:object:> .
@prefix somrs: <urn:so-mrs:owl:> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix sh: <http://www.w3.org/ns/shacl#> .
"""


def turtle(text: str, base: Ontology | None = None) -> OwlImport:
    return read(PREFIXES + text, "vases.ttl", base or upper())


def noted(owl_import: OwlImport) -> list[tuple[str, str]]:
    return [(note.subject, note.message) for note in owl_import.notes]


# What is written is read back


@pytest.mark.parametrize("format", Format)
@pytest.mark.parametrize("site", ["scenario-1", "scenario-2"])
def test_whole_sites_are_read_back(site: str, format: Format) -> None:
    loaded = load_text((ROOT / "src" / "somrs" / "demo" / "data" / f"{site}.yaml").read_text("utf-8"))
    owl_import = read(export(loaded.ontology, loaded.map, format).decode(), "site", Ontology())
    assert [*owl_import.ontology] == [*loaded.ontology]
    assert owl_import.map == loaded.map
    assert (owl_import.renamings, owl_import.notes) == ((), ())


@given(definitions(), st.sampled_from(Format))
@examples(8)
def test_ontology_is_read_back_as_written(new: list[Definition], format: Format) -> None:
    ontology = upper().extended(new)
    try:
        text = export(ontology, None, format).decode()
    except UsageError:
        assert format is Format.XML, "Turtle holds everything"
        return
    owl_import = read(text, "file", upper())
    assert [*owl_import.ontology] == [*ontology]
    assert not owl_import.notes


@given(maps(), st.sampled_from(Format))
@examples(8)
def test_map_is_read_back_as_written(map: Map, format: Format) -> None:
    try:
        text = export(upper(), map, format).decode()
    except UsageError:
        assert format is Format.XML
        return
    assert read(text, "file", upper()).map == map


def test_relations_of_any_arity_are_read_back() -> None:
    ontology = upper().extended(
        [
            RelationType(name="isNew", joins=("Object",)),
            RelationType(name="between", joins=("Object", "Support", "Support"), functional=True, excludes="place", doc="In the middle"),
        ]
    )
    map = Map(
        [Object(name=name, type="Table") for name in "ABC"],
        [Fact("isNew", ("A",)), Fact("between", ("A", "B", "C")), Fact("isAdjacentTo", ("A", "B"))],
    )
    owl_import = read(export(ontology, map).decode(), "file", upper())
    assert [*owl_import.ontology] == [*ontology]
    assert owl_import.map == map


def test_rules_of_the_same_attribute_keep_each_its_meaning_and_place() -> None:
    rules = (
        Constraint(attribute="Weight", maximum=2.0, doc="Two hands lift it"),
        Constraint(attribute="Weight", minimum=0.1, doc="The wind does not"),
        Constraint(attribute="Weight", maximum=3.0, doc="The shelf holds it"),
    )
    ontology = upper().extended([ObjectType(name="Vase", parent="Graspable", constraints=rules)])
    assert read(export(ontology).decode(), "file", upper()).ontology.types["Vase"].constraints == rules


# What others made of it


EDITED = """\
attributes:
  Content: {kind: enumeration, values: [Tea, Coffee, Nothing]}
types:
  Teapot:
    parent: Graspable
    attributes: [Content]
    required: [Weight]
    parts: [{type: FurnitureLeg, minimum: 1, maximum: 3}]
    defaults: {Shape: {Form: Cylinder, Radius: 8 cm, Height: 18 cm}, Content: Tea}
    constraints:
      - {attribute: Weight, minimum: 0.1, maximum: 2, doc: Light}
      - {attribute: Shape.Form, values: [Polygon, Box, Cylinder]}
      - {formula: "NOT ?Self.Content = Nothing OR ?Self.Weight < 300 g", doc: Empty ones are light}
relations:
  between: {joins: [Object, Support, Support]}
"""


def edited(name: str) -> OwlImport:
    """`teapots` with a map, as the OWL API that Protégé is made with wrote it anew after these edits: a new class Vase below Jar, a new
    property Temperature of it, an individual Vase7, and another label for Cup; and Vase and Cup were made disjoint."""
    return read((FOLDER / name).read_text("utf-8"), name, before_editing())


def before_editing() -> Ontology:
    """The ontology that the editor had: `teapots` on the upper ontology of version 0.3.0."""
    base = load_text((ROOT / "tests/data/upper-0.3.0.yaml").read_text("utf-8"), base=Ontology()).ontology
    return load_text(EDITED, base=base).ontology


@pytest.mark.parametrize("name", ["edited.ttl", "edited.rdf"])
def test_an_editor_may_write_it_anew_and_change_it(name: str) -> None:
    original, owl_import = before_editing(), edited(name)
    assert owl_import.renamings == (Renaming(section=Section.TYPES, name="Cup", to="Mug"),)
    temperature = AttributeType(name="Temperature", kind=Kind.NUMBER)
    vase = ObjectType(name="Vase", parent="Jar", attributes=("Temperature",))
    original_definitions = {(type(definition), definition.name): definition for definition in original}
    assert {(type(definition), definition.name): definition for definition in owl_import.ontology} == {
        **original_definitions,
        (AttributeType, "Temperature"): temperature,
        (ObjectType, "Vase"): vase,
    }
    assert [*owl_import.ontology.types][-1] == "Vase", "what is new comes last"
    assert owl_import.map.objects["Vase7"] == Object(name="Vase7", type="Vase", values={"Temperature": 21.5})
    assert owl_import.map.has_fact("isOn", ("Vase7", "Table1"))
    assert len(owl_import.map.objects) == len(the_map(load_text(HOUSE)).objects) + 1
    assert [note.subject for note in owl_import.notes] == ["Vase"]
    assert "owl:disjointWith Cup" in owl_import.notes[0].message


def test_new_words_of_other_namespaces_are_called_by_label_or_iri() -> None:
    owl_import = turtle("""
:Vase a owl:Class ; rdfs:subClassOf type:Jar ; rdfs:comment "For flowers" ;
  rdfs:subClassOf [ a owl:Restriction ; owl:onProperty :Depth2 ; owl:cardinality 1 ] ,
    [ a owl:Restriction ; owl:onProperty attribute:Weight ; owl:allValuesFrom [ a rdfs:Datatype ; owl:onDatatype xsd:decimal ;
      owl:withRestrictions ( [ xsd:maxInclusive 2 ] ) ] ] ,
    [ a owl:Restriction ; owl:onProperty [ owl:inverseOf relation:isPartOf ] ; owl:someValuesFrom type:Floor ] .
:x17 a owl:Class ; rdfs:label "Urn" ; rdfs:subClassOf :Vase .
:Depth2 a owl:DatatypeProperty ; rdfs:range xsd:float .
:Broken a owl:DatatypeProperty ; rdfs:range xsd:boolean ; rdfs:domain [ a owl:Class ; owl:unionOf ( :Vase type:Cup ) ] .
:standsBeside a owl:ObjectProperty , owl:SymmetricProperty ; rdfs:domain :Vase ; rdfs:range :Vase .
:Urn1 a :x17 , type:Jar ; :Depth2 3 ; :Broken false ; :standsBeside object:Jar002 ; attribute:Color "Red" .
""")
    assert owl_import.ontology.types["Vase"] == ObjectType(
        name="Vase",
        parent="Jar",
        attributes=("Broken",),
        required=("Depth2",),
        parts=(owl_import.ontology.types["Vase"].parts[0],),
        constraints=(Constraint(attribute="Weight", maximum=2.0),),
        doc="For flowers",
    )
    assert (owl_import.ontology.types["Vase"].parts[0].type, owl_import.ontology.types["Vase"].parts[0].minimum) == ("Floor", 1)
    assert owl_import.ontology.types["Urn"].parent == "Vase"
    assert owl_import.ontology.relations["standsBeside"] == RelationType(name="standsBeside", joins=("Vase", "Vase"), symmetric=True)
    assert owl_import.map.objects["Urn1"] == Object(name="Urn1", type="Urn", values={"Depth2": 3.0, "Broken": False, "Color": "Red"})
    assert [*owl_import.map.facts()] == [Fact("standsBeside", ("Urn1", "Jar002"))]
    assert owl_import.notes == ()


def test_what_is_only_mentioned_is_not_changed() -> None:
    """A file of somebody who needed the class above to be declared."""
    owl_import = turtle(":Vase a owl:Class ; rdfs:subClassOf type:Jar . type:Jar a owl:Class . relation:isOn a owl:ObjectProperty .")
    assert [definition.name for definition in owl_import.ontology] == ["Vase"]


def test_shapes_of_others_become_rules_of_types() -> None:
    owl_import = turtle("""
:JarShape a sh:NodeShape ; sh:targetClass type:Jar ;
  sh:property [ sh:path attribute:Weight ; sh:maxInclusive 2 ; sh:minCount 1 ; sh:message "Light" ] ,
    [ sh:path ( attribute:Shape attribute:Form ) ; sh:in ( "Cylinder" "Polygon" ) ] ,
    [ sh:path attribute:Label ; sh:pattern "^J" ] .
""")
    jar = owl_import.ontology.types["Jar"]
    assert jar.constraints == (
        Constraint(attribute="Shape.Form", values=("Cylinder", "Polygon")),
        Constraint(attribute="Weight", maximum=2.0, doc="Light"),
    )
    assert jar.required == ("Weight",)
    assert jar.defaults == upper().types["Jar"].defaults
    assert any("sh:pattern" in message and "sh:minInclusive" in message for _, message in noted(owl_import))


NOTED = [
    (":Vase a owl:Class .", "Vase", "Object is used as its parent"),
    (":Vase a owl:Class ; rdfs:subClassOf type:Jar ; owl:equivalentClass type:Cup .", "Vase", "as a formula with somrs:constraint"),
    (":Vase a owl:Class ; rdfs:subClassOf type:Jar , [ owl:unionOf ( type:Cup type:Can ) ] .", "Vase", "a class expression"),
    (":in a owl:ObjectProperty , owl:TransitiveProperty ; rdfs:domain type:Jar ; rdfs:range type:Jar .", "in", "not transitive"),
    (":in a owl:ObjectProperty ; rdfs:domain type:Jar .", "in", "range must be one class, and it has none; Object is used"),
    (":in a owl:ObjectProperty ; rdfs:domain type:Jar ; rdfs:range type:Jar ; owl:inverseOf :out .", "in", "in one direction only"),
    (":Born a owl:DatatypeProperty ; rdfs:range xsd:dateTime .", "Born", "it is treated as a text"),
    (":Born a owl:DatatypeProperty .", "Born", "it has no range"),
    (":Vase a owl:Class ; rdfs:subClassOf type:Jar ; rdfs:label \"Glas\"@de .", "Vase", "rdfs:label Glas"),
    ("type:Jar a owl:Class ; rdfs:label \"Glass jar\" ; rdfs:subClassOf type:Graspable .", "Jar", "'Glass jar' is no name"),
    ("object:Jar002 a type:Jar ; rdfs:label \"Jar2\" .", "Jar002", "give it another name on the map itself"),
    (":in a owl:ObjectProperty ; rdfs:domain type:Jar ; rdfs:range :P , type:Cup . :P a owl:Class ; rdfs:subClassOf type:Jar ; "
     "owl:disjointWith type:Cup .", "P", "owl:disjointWith Cup"),
    ("type:Jar a owl:Class . :d a owl:Class ; rdfs:subClassOf type:Jar ; owl:disjointWith type:Cup .", "d", "owl:disjointWith Cup"),
    (":Thing1 a owl:NamedIndividual .", "Thing1", "give it one of the types"),
    ("<http://example.org/vases> a owl:Ontology ; owl:imports <http://example.org/pots> .", "vases", "merge them into this one"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "subject", "words"), NOTED, ids=[words for _, _, words in NOTED])
def test_what_there_are_no_words_for_is_named_with_what_to_do(text: str, subject: str, words: str) -> None:
    owl_import = turtle(text)
    assert any(note_subject == subject and words in message for note_subject, message in noted(owl_import)), noted(owl_import)
    assert {note.line for note in owl_import.notes} == {PREFIXES.count("\n") + 1}


def wrong(text: str) -> list[Problem]:
    with pytest.raises(ModelError) as caught:
        turtle(text)
    return caught.value.problems


WRONG = [
    (":Vase a owl:Class ; rdfs:subClassOf type:Jar , type:Room .", "parent", "keep one of them"),
    ("object:Jar2 a type:Jar ; attribute:Color \"Red\" , \"Blue\" .", "value", "Color twice"),
    (":J1 a owl:NamedIndividual ; relation:isOn object:T1 . object:T1 a type:Table .", "type", "is of no type"),
    (":7 a owl:Class ; rdfs:subClassOf type:Jar .", "name", "give it a label"),
    (":a rdfs:label \"B\" ; rdfs:subClassOf type:Jar ; a owl:Class . :B a owl:Class ; rdfs:subClassOf type:Jar .", "duplicate", "name"),
    (":Vase a owl:Class ; rdfs:subClassOf type:Jar ; somrs:default \"Weight is 3\" .", "value", "write such as Weight = 0.3"),
    (":Whistle a owl:Class ; rdfs:subClassOf somrs:Service .", "effect", "somrs:effect"),
    (":Whistle a owl:Class ; rdfs:subClassOf somrs:Service ; somrs:effect \"?x isOn ?y\" ; somrs:inputs \"x\" .", "value", "such as"),
    (":between a owl:Class ; rdfs:subClassOf somrs:Fact .", "relation", "argument1 only TYPE"),
    (":Vase1 a type:Jar , type:Room .", "type", "an object has one type"),
    (":Vase a owl:Class ; ; ] .", "syntax", "this is not Turtle"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "rule", "words"), WRONG, ids=[words for _, _, words in WRONG])
def test_what_is_wrong_is_named_with_its_line(text: str, rule: str, words: str) -> None:
    found_problems = wrong("\n" + text)
    assert [problem.rule for problem in found_problems] == [rule]
    assert words in found_problems[0].message
    assert found_problems[0].line == PREFIXES.count("\n") + 2


@pytest.mark.parametrize(
    "text", ["<?xml version='1.0'?><!DOCTYPE x [<!ENTITY a 'b'>]><x>&a;</x>", "<?xml version='1.0'?><rdf:RDF", "{}", "\x00", "a b c ."]
)
def test_what_is_no_such_file_is_told(text: str) -> None:
    with pytest.raises(ModelError):
        read(text, "file", upper())


def sections(definitions: Iterable[Definition]) -> set[str]:
    return {type(definition).__name__ for definition in definitions}


def test_all_kinds_of_definitions_are_in_what_is_compared() -> None:
    assert sections(upper()) == {"AttributeType", "RelationType", "FunctionType", "ObjectType", "ServiceType"}
