"""Editing the ontology: renaming, removing and redefining, with everything that speaks of it; what stands in the way; and undoing it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec import structs

from somrs.entish.parse import parse
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import Fact, Object, ObjectAdded, ValueSet
from somrs.ontology.types import AttributeType, Constraint, Kind, ObjectType
from somrs.protocol.messages.knowledge import (
    Consider,
    Considered,
    Define,
    Defined,
    Definitions,
    OntologyPage,
    ReadEvents,
    ReadOntology,
    Rejected,
    Undo,
    Updated,
    UpdateMap,
)
from tests.support.keeper import Keeper, definitions, renaming

WORKSHOP = """
attributes:
  Volume: {kind: number, unit: l}
  Content: {kind: enumeration, values: [Paint, Oil, Nothing]}
  Package: {kind: complex, attributes: [Volume, Content]}
relations:
  belongsTo: {joins: [Tin, Bench], functional: true}
functions:
  content: {parameters: [Tin], attribute: Package.Volume}
  way: {parameters: [Table, Table], values: {Bench1 Bench2: 3}}
types:
  Bench: {parent: Table, parts: [{type: Vice, minimum: 0}]}
  Vice: {parent: Furniture}
  Tin:
    parent: Graspable
    attributes: [Package]
    defaults: {Package: {Volume: 1 l}, Shape: {Form: Cylinder, Radius: 0.08, Height: 0.18}}
    constraints:
      - {attribute: Package.Volume, maximum: 5}
      - formula: "NOT ?Self.Package.Content = Nothing OR ?Self.Weight < 0.3 AND ?Self.Package.Volume >= 0"
  SmallTin: {parent: Tin}
services:
  Refill:
    inputs: {Tin: Tin, At: Bench}
    precondition: "?Tin isOn ?At AND ?Tin belongsTo ?Bench: Bench AND ?Tin.Package.Content = Nothing"
    effect: "?Tin.Package.Content = Paint"
    cost: "2 * content(?Tin) + way(?At, ?At)"
    handlers:
      - {on: failure, effect: "?Tin isOn ?At", when: "?Tin.Package.Volume > 1"}
  RefillQuickly: {parent: Refill, inputs: {Tin: SmallTin}, effect: "?Tin.Package.Content = Paint"}
map: Workshop
objects:
  Workshop:
    type: Building
    parts: {Ground: {type: Storey, parts: {Slab: {type: Floor, at: [0, 0, -0.1], Shape: {Form: Box, Width: 9, Depth: 9, Height: 0.1}}}}}
  Bench1: {type: Bench, at: [1, 1, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.9}}
  Bench2: {type: Bench, at: [3, 1, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.9}}
  Tin1: {type: Tin, at: [1, 1, 0.9], Package: {Volume: 2, Content: Oil}}
  Tin2: {type: SmallTin, at: [1, 1.2, 0.9]}
  Robot1: {type: PioneerP3DX, at: [5, 3, 0]}
facts: [Tin1 isOn Bench1, Tin2 isOn Bench1, Tin1 belongsTo Bench1]
"""


@pytest.fixture
def keeper(tmp_path: Path) -> Iterator[Keeper]:
    loaded = load_text(WORKSHOP, base=upper())
    keeper = Keeper(tmp_path / "repository.sqlite", loaded.ontology, loaded.map)
    yield keeper
    keeper.settle()
    assert keeper.replica.map == keeper.contents.map
    assert definitions(keeper.replica.ontology) == definitions(keeper.contents.ontology)
    contents_before = keeper.contents
    keeper.restart()
    assert ([*keeper.contents.ontology], keeper.contents.defined_at) == ([*contents_before.ontology], contents_before.defined_at)
    assert keeper.replica.map == keeper.contents.map
    keeper.close()


def remove(section: Section, *names: str) -> Define:
    return Define(removed=tuple(DefinitionKey(section=section, name=name) for name in names), author="Anna")


def types(*types: ObjectType, expected: int | None = None, author: str = "Anna") -> Define:
    return Define(definitions=Definitions(types=types), expected_version=expected, author=author)


# Renaming


def test_a_type_is_renamed_wherever_it_is_spoken_of(keeper: Keeper) -> None:
    assert keeper.ask(renaming(Section.TYPES, "Tin", "PaintTin"), Defined) == Defined(version=1)
    ontology, map = keeper.contents.ontology, keeper.contents.map
    assert "Tin" not in ontology.types
    assert ontology.types["SmallTin"].parent == "PaintTin"
    assert ontology.relations["belongsTo"].joins == ("PaintTin", "Bench")
    assert ontology.functions["content"].parameters == ("PaintTin",)
    assert [(p.name, p.type) for p in ontology.services["Refill"].inputs] == [("Tin", "PaintTin"), ("At", "Bench")]
    assert map.objects["Tin1"].type == "PaintTin"
    assert map.objects["Tin2"].type == "SmallTin"
    assert map.has_fact("isOn", ("Tin1", "Bench1"))


def test_types_in_formulas_and_parts_are_renamed(keeper: Keeper) -> None:
    keeper.ask(renaming(Section.TYPES, "Bench", "Workbench"), Defined)
    keeper.ask(renaming(Section.TYPES, "Vice", "Clamp"), Defined)
    ontology = keeper.contents.ontology
    assert "?Bench: Workbench" in (ontology.services["Refill"].precondition or "")
    assert ontology.types["Workbench"].parts[0].type == "Clamp"


def test_an_attribute_is_renamed_wherever_it_is_spoken_of(keeper: Keeper) -> None:
    keeper.ask(renaming(Section.ATTRIBUTES, "Volume", "Litres"), Defined)
    keeper.ask(renaming(Section.ATTRIBUTES, "Package", "Packing"), Defined)
    ontology, tin = keeper.contents.ontology, keeper.contents.ontology.types["Tin"]
    assert ontology.attributes["Packing"].attributes == ("Litres", "Content")
    assert tin.attributes == ("Packing",)
    assert tin.defaults["Packing.Litres"] == 1.0
    assert tin.constraints[0].attribute == "Packing.Litres"
    assert "?Self.Packing.Litres >= 0" in (tin.constraints[1].formula or "")
    assert ontology.functions["content"].attribute == "Packing.Litres"
    assert ontology.services["Refill"].handlers[0].when == "?Tin.Packing.Litres > 1"
    assert ontology.services["Refill"].effect == "?Tin.Packing.Content = Paint"
    assert keeper.contents.map.objects["Tin1"].values["Packing.Litres"] == 2.0
    assert keeper.contents.map.objects["Tin1"].values["Packing.Content"] == "Oil"


def test_a_relation_is_renamed_with_its_facts(keeper: Keeper) -> None:
    keeper.ask(renaming(Section.RELATIONS, "belongsTo", "isLentTo"), Defined)
    assert "?Tin isLentTo ?Bench" in (keeper.contents.ontology.services["Refill"].precondition or "")
    assert [*keeper.contents.map.facts("isLentTo")] == [Fact("isLentTo", ("Tin1", "Bench1"))]
    assert [*keeper.contents.map.facts("belongsTo")] == []


def test_functions_and_services_are_renamed(keeper: Keeper) -> None:
    keeper.ask(renaming(Section.FUNCTIONS, "content", "fill"), Defined)
    keeper.ask(renaming(Section.SERVICES, "Refill", "TopUp"), Defined)
    services = keeper.contents.ontology.services
    assert parse(f"{services['TopUp'].cost} = 0") == parse("2 * fill(?Tin) + way(?At, ?At) = 0")
    assert services["RefillQuickly"].parent == "TopUp"


def test_what_a_formula_says_besides_is_left_as_it_was_written(keeper: Keeper) -> None:
    formula_before = keeper.contents.ontology.types["Tin"].constraints[1].formula
    keeper.ask(renaming(Section.ATTRIBUTES, "Color", "Colour"), Rejected)
    keeper.ask(renaming(Section.RELATIONS, "belongsTo", "isLentTo"), Defined)
    assert keeper.contents.ontology.types["Tin"].constraints[1].formula == formula_before


def test_two_definitions_may_swap_their_names(keeper: Keeper) -> None:
    swap = Define(
        renamed=(
            Renaming(section=Section.TYPES, name="Tin", to="SmallTin"),
            Renaming(section=Section.TYPES, name="SmallTin", to="Tin"),
        )
    )
    keeper.ask(swap, Defined)
    assert keeper.contents.ontology.types["Tin"].parent == "SmallTin"
    assert keeper.contents.map.objects["Tin1"].type == "SmallTin"
    assert keeper.contents.map.objects["Tin2"].type == "Tin"


def test_renaming_and_redefining_come_together(keeper: Keeper) -> None:
    new = structs.replace(keeper.contents.ontology.types["Tin"], name="PaintTin", constraints=(), doc="With paint in it")
    change = Define(renamed=(Renaming(section=Section.TYPES, name="Tin", to="PaintTin"),), definitions=Definitions(types=(new,)))
    keeper.ask(change, Defined)
    assert keeper.contents.ontology.types["PaintTin"] == new
    assert keeper.contents.map.objects["Tin1"].type == "PaintTin"


@pytest.mark.parametrize(
    ("define", "problem"),
    [
        (renaming(Section.TYPES, "Tim", "Can1"), "there is no type Tim; did you mean Tin?"),
        (renaming(Section.TYPES, "Tin", "Jar"), "there is a type Jar already"),
        (renaming(Section.TYPES, "Tin", "A b"), "not a name that formulas can use"),
        (renaming(Section.OBJECTS, "Tin1", "Tin9"), "is renamed by itself"),
        (remove(Section.TYPES, "Tim"), "there is no type Tim"),
        (remove(Section.OBJECTS, "Tin1"), "by an update of the map"),
        (renaming(Section.ATTRIBUTES, "Volume", "at"), "objects have a key at"),
        (types(ObjectType(name="T", parent="Tin", doc="\x00")), "U+0000"),
        (types(ObjectType(name="T", parent="Tin"), ObjectType(name="T", parent="Jar")), "defined 2 times"),
        (renaming(Section.TYPES, "Device", "Machine"), "neither removed nor renamed"),
        (remove(Section.ATTRIBUTES, "PositionX"), "neither removed nor renamed"),
        (remove(Section.RELATIONS, "isPartOf"), "neither removed nor renamed"),
        (Define(definitions=Definitions(attributes=(AttributeType(name="PositionX", kind=Kind.TEXT),))), "kind must stay number"),
        (types(ObjectType(name="MobileRobot", parent="Furniture")), "parent must stay Device"),
    ],
)
def test_what_cannot_be_done_is_said_clearly(keeper: Keeper, define: Define, problem: str) -> None:
    assert any(problem in rule.message for rule in keeper.broken(define)), keeper.broken(define)


# Removing


def test_what_nothing_speaks_of_is_removed(keeper: Keeper) -> None:
    assert keeper.ask(remove(Section.SERVICES, "RefillQuickly"), Defined) == Defined(version=1)
    assert keeper.ask(remove(Section.TYPES, "Bottle", "Cup"), Defined) == Defined(version=2)
    assert "Bottle" not in keeper.contents.ontology.types
    assert keeper.ask(remove(Section.FUNCTIONS, "range"), Defined) == Defined(version=3)


def test_the_consequences_of_removing_are_all_told_where_they_are(keeper: Keeper) -> None:
    broken_rules = keeper.broken(remove(Section.TYPES, "Tin"))
    places = {(rule.section, rule.subject, rule.path) for rule in broken_rules}
    assert ("types", "SmallTin", "parent") in places
    assert ("relations", "belongsTo", "joins.0") in places
    assert ("functions", "content", "parameters.0") in places
    assert ("services", "Refill", "inputs.Tin") in places
    assert ("objects", "Tin1", "type") in places


def test_removing_an_attribute_tells_which_objects_have_it(keeper: Keeper) -> None:
    broken_rules = keeper.broken(remove(Section.ATTRIBUTES, "Content"))
    places = {(rule.section, rule.subject, rule.path) for rule in broken_rules}
    assert ("attributes", "Package", "attributes.1") in places
    assert ("objects", "Tin1", "Package.Content") in places
    assert ("services", "Refill", "effect") in places


def test_something_may_take_the_place_of_what_is_removed_unless_there_is_any_on_the_map(keeper: Keeper) -> None:
    cup = Define(
        removed=(DefinitionKey(section=Section.TYPES, name="Cup"),), renamed=(Renaming(section=Section.TYPES, name="Bottle", to="Cup"),)
    )
    keeper.ask(cup, Defined)
    assert keeper.contents.ontology.types["Cup"].defaults["Shape.Height"] == 0.22
    tin = Define(
        removed=(DefinitionKey(section=Section.TYPES, name="SmallTin"),),
        renamed=(Renaming(section=Section.TYPES, name="Can", to="SmallTin"),),
    )
    assert ("objects", "Tin2") in {(rule.section, rule.subject) for rule in keeper.broken(tin)}


def test_what_was_said_of_something_removed_is_not_said_of_what_takes_its_name(keeper: Keeper) -> None:
    definitions_before = definitions(keeper.contents.ontology)
    bench = keeper.contents.ontology.types["Bench"]
    vice = Define(
        removed=(DefinitionKey(section=Section.TYPES, name="Vice"),), renamed=(Renaming(section=Section.TYPES, name="Tin", to="Vice"),)
    )
    for change in (vice, structs.replace(vice, definitions=Definitions(types=(bench,)))):
        (rule,) = keeper.broken(change)
        assert (rule.section, rule.subject, rule.rule) == (Section.TYPES, "Bench", "replaced")
    with_bench = structs.replace(vice, definitions=Definitions(types=(structs.replace(bench, doc="holds tins by their vice"),)))
    keeper.ask(with_bench, Defined)
    keeper.ask(Undo(version=1), Updated)
    assert definitions(keeper.contents.ontology) == definitions_before


# Redefining


def test_a_narrower_rule_tells_which_objects_break_it(keeper: Keeper) -> None:
    tin = keeper.contents.ontology.types["Tin"]
    narrow = structs.replace(tin, constraints=(Constraint(attribute="Package.Volume", maximum=1.5),))
    (rule,) = keeper.broken(types(narrow))
    assert (rule.subject, rule.section, rule.path, rule.rule) == ("Tin1", "objects", "Package.Volume", "constraint")


def test_moving_a_type_is_defining_it_with_another_parent(keeper: Keeper) -> None:
    bench = keeper.contents.ontology.types["Bench"]
    broken_rules = keeper.broken(types(structs.replace(bench, parent="Shelf")))
    assert [(rule.section, rule.subject, rule.path) for rule in broken_rules] == [("services", "Refill", "cost")]
    keeper.ask(remove(Section.SERVICES, "Refill", "RefillQuickly"), Defined)
    assert keeper.ask(types(structs.replace(bench, parent="Shelf")), Defined) == Defined(version=2)
    broken_rules = keeper.broken(types(structs.replace(bench, parent="Space")))
    assert {"Bench1", "Bench2"} <= {rule.subject for rule in broken_rules if rule.section == "objects"}


def test_a_rule_about_other_types_is_looked_at_when_those_move(keeper: Keeper) -> None:
    rule = Constraint(formula="NOT ?T: Graspable isOn ?Self OR ?Self.PositionX >= 0", doc="What holds things stands right of the middle")
    bench = structs.replace(keeper.contents.ontology.types["Bench"], constraints=(rule,))
    keeper.ask(types(bench), Defined)
    assert keeper.ask(UpdateMap(changes=(ValueSet("Bench2", "PositionX", -1.0),)), object)


def test_two_people_who_edit_the_same_type_hear_of_each_other(keeper: Keeper) -> None:
    tin = keeper.contents.ontology.types["Tin"]
    keeper.ask(types(structs.replace(tin, doc="Anna's"), expected=0, author="Anna"), Defined)
    (rule,) = keeper.broken(types(structs.replace(tin, doc="Ben's"), expected=0, author="Ben"))
    assert (rule.section, rule.subject, rule.rule) == ("types", "Tin", "overtaken")
    assert "Anna changed it in version 1, after version 0 that was expected" in rule.message
    keeper.restart()
    assert "Anna" in keeper.broken(types(structs.replace(tin, doc="Ben's"), expected=0))[0].message
    # Another type is nobody's business, nor is what says the same.
    vice = structs.replace(keeper.contents.ontology.types["Vice"], doc="Ben's")
    assert keeper.ask(types(vice, structs.replace(tin, doc="Anna's"), expected=0), Defined) == Defined(version=2)
    assert keeper.ask(types(structs.replace(tin, doc="Ben's"), expected=2), Defined) == Defined(version=3)


def test_what_was_removed_or_renamed_meanwhile_is_said_to_be(keeper: Keeper) -> None:
    keeper.ask(renaming(Section.TYPES, "SmallTin", "TinyTin"), Defined)
    broken_rules = keeper.broken(types(ObjectType(name="SmallTin", parent="Tin"), expected=0))
    assert "Anna removed or renamed it in version 1" in broken_rules[0].message


def test_a_renaming_minds_what_others_did_to_the_same_thing_only(keeper: Keeper) -> None:
    keeper.ask(types(structs.replace(keeper.contents.ontology.types["Tin"], doc="Anna's")), Defined)
    assert keeper.ask(structs.replace(renaming(Section.ATTRIBUTES, "Volume", "Litres"), expected_version=0), Defined)
    assert keeper.broken(structs.replace(renaming(Section.TYPES, "Tin", "Box1"), expected_version=0))


# Considering


def test_considering_tells_what_would_change_and_changes_nothing(keeper: Keeper) -> None:
    considered = keeper.ask(Consider(change=renaming(Section.TYPES, "Tin", "PaintTin")), Considered)
    assert considered.broken == ()
    assert considered.revision is not None
    assert "Tin" in [type.name for type in considered.revision.before.types]
    assert "PaintTin" in [type.name for type in considered.revision.after.types]
    assert [change.object.name for change in considered.changes if isinstance(change, ObjectAdded)] == ["Tin1"]
    assert (considered.all_broken, considered.all_changes) == (0, 1)
    assert keeper.contents.version == 0
    moved = keeper.ask(Consider(change=UpdateMap(situation="Tin1 isOn Bench2")), Considered)
    assert len(moved.changes) == 2
    assert keeper.contents.map.has_fact("isOn", ("Tin1", "Bench1"))


def test_of_very_many_consequences_the_first_are_told_and_how_many_there_are(keeper: Keeper) -> None:
    values = {"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.9, "Package.Volume": 2.0}
    for start in range(0, 1000, 100):
        additions = (ObjectAdded(Object(name=f"Tin-{n}", type="Tin", values={**values})) for n in range(start, start + 100))
        keeper.ask(UpdateMap(changes=tuple(additions)), Updated)
    considered = keeper.ask(Consider(change=remove(Section.TYPES, "Tin")), Considered)
    assert considered.all_broken > 1000
    assert 20 < len(considered.broken) <= 200
    rejected = keeper.ask(remove(Section.TYPES, "Tin"), Rejected)
    assert len(rejected.broken) == 50
    assert "more problems" in rejected.problems[-1]
    renamed = keeper.ask(Consider(change=renaming(Section.TYPES, "Tin", "T")), Considered)
    assert renamed.all_changes == 1001
    assert 20 < len(renamed.changes) <= 200
    keeper.ask(renaming(Section.TYPES, "Tin", "T"), Defined)
    assert keeper.events(ReadEvents(limit=1))[0].all_changes == 1001


# History and undoing


def test_the_history_of_the_ontology_tells_who_changed_what_from_what(keeper: Keeper) -> None:
    tin = keeper.contents.ontology.types["Tin"]
    keeper.ask(types(structs.replace(tin, doc="Anna's")), Defined)
    keeper.ask(UpdateMap(situation="Tin1 isOn Bench2"), Updated)
    keeper.ask(renaming(Section.TYPES, "SmallTin", "TinyTin"), Defined)
    renamed, redefined = keeper.events(ReadEvents(ontology=True))
    assert (renamed.version, redefined.version, redefined.author) == (3, 1, "Anna")
    assert redefined.revision is not None
    assert redefined.revision.before.types == (tin,)
    assert redefined.revision.after.types[0].doc == "Anna's"
    assert renamed.renamed == (Renaming(section=Section.TYPES, name="SmallTin", to="TinyTin"),)
    assert redefined.at < renamed.at


@pytest.mark.parametrize(
    "define",
    [
        renaming(Section.TYPES, "Tin", "PaintTin"),
        renaming(Section.ATTRIBUTES, "Package", "Packing"),
        renaming(Section.RELATIONS, "belongsTo", "isLentTo"),
        renaming(Section.FUNCTIONS, "way", "distanceOf"),
        remove(Section.SERVICES, "Refill", "RefillQuickly"),
        types(ObjectType(name="Vice", parent="Tin"), ObjectType(name="Drill", parent="Furniture")),
        Define(
            renamed=renaming(Section.TYPES, "Tin", "T").renamed,
            definitions=Definitions(types=(ObjectType(name="Tin", parent="T"),)),
        ),
        Define(
            removed=remove(Section.TYPES, "Vice").removed,
            renamed=renaming(Section.TYPES, "Bench", "B").renamed,
            definitions=Definitions(types=(ObjectType(name="B", parent="Table"),)),
        ),
    ],
)
def test_undoing_brings_back_what_was_and_undoing_that_what_came(keeper: Keeper, define: Define) -> None:
    definitions_before, map = definitions(keeper.contents.ontology), keeper.contents.map
    keeper.ask(define, Defined)
    definitions_after, map_after = definitions(keeper.contents.ontology), keeper.contents.map
    assert definitions_after != definitions_before
    assert keeper.ask(Undo(version=1, author="Ben"), Updated) == Updated(version=2)
    assert (definitions(keeper.contents.ontology), keeper.contents.map) == (definitions_before, map)
    assert keeper.events()[0].undoes == 1
    assert keeper.ask(Undo(version=2), Updated) == Updated(version=3)
    assert (definitions(keeper.contents.ontology), keeper.contents.map) == (definitions_after, map_after)
    assert (definitions(keeper.read_version(0)[0]), keeper.read_version(0)[1]) == (definitions_before, map)
    assert (definitions(keeper.read_version(1)[0]), keeper.read_version(1)[1]) == (definitions_after, map_after)


def test_undoing_a_renaming_takes_along_what_came_since(keeper: Keeper) -> None:
    keeper.ask(renaming(Section.TYPES, "Tin", "PaintTin"), Defined)
    keeper.ask(types(ObjectType(name="HugeTin", parent="PaintTin")), Defined)
    keeper.ask(UpdateMap(changes=(ValueSet("Tin1", "PositionX", 1.3),)), Updated)
    keeper.ask(Undo(version=1), Updated)
    assert keeper.contents.ontology.types["HugeTin"].parent == "Tin"
    assert keeper.contents.map.objects["Tin1"].values["PositionX"] == 1.3


def test_what_was_changed_since_stands_in_the_way_of_undoing(keeper: Keeper) -> None:
    tin = keeper.contents.ontology.types["Tin"]
    keeper.ask(types(structs.replace(tin, doc="Anna's")), Defined)
    keeper.ask(types(structs.replace(tin, doc="Ben's"), author="Ben"), Defined)
    (rule,) = keeper.broken(Undo(version=1))
    assert (rule.section, rule.subject, rule.rule) == ("types", "Tin", "changed-since")
    assert "Ben in version 2" in rule.message
    keeper.ask(Undo(version=2), Updated)
    keeper.ask(Undo(version=1), Updated)
    assert keeper.contents.ontology.types["Tin"] == tin


def test_what_speaks_of_it_since_stands_in_the_way_of_undoing(keeper: Keeper) -> None:
    keeper.ask(types(ObjectType(name="Drill", parent="Furniture")), Defined)
    keeper.ask(types(ObjectType(name="HandDrill", parent="Drill")), Defined)
    broken_rules = keeper.broken(Undo(version=1))
    assert ("types", "HandDrill", "parent") in {(rule.section, rule.subject, rule.path) for rule in broken_rules}


def test_a_version_that_is_not_there_is_not_undone(keeper: Keeper) -> None:
    assert "there is no version 7" in keeper.broken(Undo(version=7))[0].message
    assert "there is no version 0" in keeper.broken(Undo(version=0))[0].message


def test_a_request_to_undo_that_comes_again_is_answered_again(keeper: Keeper) -> None:
    keeper.ask(types(ObjectType(name="Drill", parent="Furniture")), Defined)
    assert keeper.ask(Undo(version=1), Updated, identity="urn:uuid:1") == Updated(version=2)
    assert keeper.ask(Undo(version=1), Updated, identity="urn:uuid:1") == Updated(version=2)
    assert keeper.contents.version == 2


# Reading while it changes


def test_pages_say_when_the_ontology_changed_last(keeper: Keeper) -> None:
    assert keeper.ask(ReadOntology(), OntologyPage).changed_at == 0
    keeper.ask(types(ObjectType(name="Drill", parent="Furniture")), Defined)
    keeper.ask(UpdateMap(situation="Tin1 isOn Bench2"), Updated)
    page = keeper.ask(ReadOntology(), OntologyPage)
    assert (page.changed_at, page.version) == (1, 2)
