"""What stands in the forms of the ontology's page, and what it comes to."""

from __future__ import annotations

from typing import Any

import pytest

from somrs.gui.pages.ontology.changes import definition_changes, summary
from somrs.gui.pages.ontology.drafts import form_of, merge_forms, start_draft
from somrs.gui.pages.ontology.form_parser import Mistakes, definition_of, form_path
from somrs.gui.pages.ontology.sections import ATTRIBUTES, SERVICES, TYPES, section_of
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.services import Handler, Occasion, Parameter, ServiceType
from somrs.ontology.types import AttributeType, Definition, FunctionType, Kind, ObjectType, Ontology
from somrs.protocol.messages.knowledge import Revision, by_kind

SITE_YAML = """
attributes:
  Volume: {kind: number, unit: l, minimum: 0, maximum: 5, tolerance: 0.01}
functions:
  km: {parameters: [Place, Place], values: {Depot Harbour: 12, Harbour Depot: 12.5}, unit: km}
types:
  Bench: {parent: Table, parts: [{type: Vice, minimum: 0, maximum: 2}], driver: "a:B"}
  Vice: {parent: PhysicalObject, required: [Weight], attributes: [Volume]}
  Tin:
    parent: Graspable
    defaults: {Shape: {Form: Cylinder, Radius: 8 cm}, Color: Red, Unknown: false}
    constraints:
      - {attribute: Volume, maximum: 0, doc: Empty}
      - {attribute: Color, values: [Red, Blue]}
      - formula: "NOT ?Self.Color = Red OR ?Self.Weight < 300 g"
    attributes: [Volume]
"""


def ontology() -> Ontology:
    return load_text(SITE_YAML, base=upper()).ontology


def sample_definitions() -> list[Definition]:
    handler = Handler(on=Occasion.FAILURE, effect="?Object.Unknown = FALSE", when="?Object.Unknown = TRUE")
    paint = ServiceType(
        name="Paint",
        effect="?Object.Color = Red",
        inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="Coats", type="number")),
        outputs=(Parameter(name="Used", type="number"),),
        handlers=(handler,),
        parent="TransferObject",
        cost="3",
        doc="Makes it red",
    )
    return [*ontology(), paint]


@pytest.mark.parametrize("definition", sample_definitions(), ids=lambda definition: f"{section_of(definition).key} {definition.name}")
def test_a_form_that_nobody_touched_says_what_the_definition_says(definition: Definition) -> None:
    draft = start_draft(section_of(definition), definition, 1)
    assert not draft.dirty
    assert definition_of(draft, ontology()) == definition
    assert draft.original == definition


@pytest.mark.parametrize("name", ["CuboidFurnitureLegShape", "PhysicalObject", "CuboidFurnitureLeg"])
def test_so_does_one_with_shapes_and_declared_parts(name: str) -> None:
    latest = upper(2)
    definition = latest.attributes.get(name) or latest.types[name]
    assert definition_of(start_draft(section_of(definition), definition, 1), latest) == definition


def test_quantities_are_written_in_any_unit_that_fits() -> None:
    draft = start_draft(TYPES, None, 1, name="Vase", parent="Graspable")
    draft.form["defaults"] = [{"path": "Shape.Height", "value": "30 cm"}, {"path": "Weight", "value": " 0.5"}]
    definition = definition_of(draft, ontology())
    assert isinstance(definition, ObjectType)
    assert definition.defaults == pytest.approx({"Shape.Height": 0.3, "Weight": 0.5})


@pytest.mark.parametrize(
    ("key", "value", "path", "expected_text"),
    [
        ("name", " ", "name", "give it a name"),
        ("defaults", [{"path": "Weight", "value": "3 m"}], "defaults.0.value", "m cannot be expressed in kg"),
        ("defaults", [{"path": "Weight", "value": "heavy"}], "defaults.0.value", "“heavy” is not a number in kg"),
        ("defaults", [{"path": "Weight", "value": ""}], "defaults.0.value", "give the value"),
        ("defaults", [{"path": "Weight", "value": "1"}] * 2, "defaults.1.path", "Weight is there twice"),
        ("attributes", [{"attribute": None, "must": True}], "attributes.0", "choose an attribute"),
        ("parts", [{"type": "Wall", "minimum": "1.5", "maximum": ""}], "parts.0.minimum", "a count"),
    ],
)
def test_what_cannot_be_read_is_said_where_it_is(key: str, value: Any, path: str, expected_text: str) -> None:
    draft = start_draft(TYPES, None, 1, name="Vase", parent="Graspable")
    draft.form[key] = value
    with pytest.raises(Mistakes) as caught:
        definition_of(draft, ontology())
    assert expected_text in caught.value.messages[path]


def test_what_only_one_of_two_changed_is_brought_together() -> None:
    base = form_of(ontology().types["Jar"])
    mine, theirs = form_of(ontology().types["Jar"]), form_of(ontology().types["Jar"])
    mine["doc"] = "Mine"
    mine["defaults"][1]["value"] = "0.05"
    mine["defaults"][2]["value"] = "0.2"
    theirs["driver"] = "a:B"
    theirs["defaults"][2]["value"] = "0.3"
    del theirs["defaults"][3]
    theirs["defaults"].append({"path": "Color", "value": "Red"})
    result, conflicts = merge_forms(base, mine, theirs)
    assert (result["doc"], result["driver"]) == ("Mine", "a:B")
    assert {row["path"]: row["value"] for row in result["defaults"]} == {
        "Shape.Form": "Cylinder",
        "Shape.Radius": "0.05",
        "Shape.Height": "0.2",
        "Supporting": "false",
        "Color": "Red",
    }
    assert conflicts == ["defaults.Shape.Height"]


def test_the_backends_paths_lead_to_fields() -> None:
    form = form_of(ontology().types["Vice"])  # Weight, which it must have, is the first row, Volume the second
    assert form_path("required.0", form) == "attributes.0"
    assert form_path("attributes.0", form) == "attributes.1"
    assert form_path("defaults.Shape.Radius", form_of(ontology().types["Tin"])) == "defaults.1.value"
    assert form_path("constraints.2.formula", form_of(ontology().types["Tin"])) == "constraints.2.formula"
    assert form_path("inputs.Destination", form_of(ontology().services["TransferObject"])) == "inputs.1.type"


def test_changes_are_told_field_by_field() -> None:
    old, new = ontology().types["Jar"], ObjectType(name="Pot", parent="Cup", defaults={**ontology().types["Jar"].defaults, "Weight": 0.5})
    removed_attribute, added_function = (
        AttributeType(name="Smell", kind=Kind.TEXT),
        FunctionType(name="age", parameters=("Object",), attribute="Weight"),
    )
    revision = Revision(before=by_kind([old, removed_attribute]), after=by_kind([new, added_function]))
    changes = definition_changes(revision, [Renaming(section=Section.TYPES, name="Jar", to="Pot")])
    assert [(change.verb, change.old_name, change.name) for change in changes] == [
        ("renamed", "Jar", "Pot"),
        ("added", "age", "age"),
        ("removed", "Smell", "Smell"),
    ]
    assert [(difference.field, difference.before, difference.after) for difference in changes[0].differences] == [
        ("Parent", "Graspable", "Cup"),
        ("Defaults: Weight", "0.3", "0.5"),
    ]
    assert summary(changes) == "Jar renamed to Pot; age added; Smell removed"


def test_a_blank_form_of_each_kind_asks_for_a_name() -> None:
    for section in (TYPES, ATTRIBUTES, SERVICES):
        with pytest.raises(Mistakes) as caught:
            definition_of(start_draft(section, None, 1), ontology())
        assert "name" in caught.value.messages
