"""Examples of formulas name only objects of the site."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.gui.examples import Examples, examples, with_variables
from somrs.ontology.check import check
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.truth import formula_holds
from tests.support.paths import SCENARIO_1

ONTOLOGY = load([str(SCENARIO_1)]).ontology
SCENARIO = load([str(SCENARIO_1)]).map or Map()
OFFICE = Map(
    [
        Object(name="Mug7", type="Cup"),
        Object(name="DeskA", type="Table"),
        Object(name="DeskB", type="Table"),
        Object(name="Office", type="CuboidRoom"),
    ],
    [Fact("isOn", ("Mug7", "DeskA")), Fact("isPartOf", ("DeskA", "Office"))],
)


def test_they_are_of_the_site() -> None:
    assert examples(OFFICE, ONTOLOGY) == Examples(goal="Mug7 isOn DeskB", condition="Mug7 isOn DeskA", query="?Thing isOn DeskA")
    assert examples(OFFICE, ONTOLOGY, "Mug7").goal == "Mug7 isOn DeskB"


def test_they_fit_the_ontology_and_the_map() -> None:
    shown = examples(SCENARIO, ONTOLOGY)
    for text in (shown.goal, shown.condition, shown.query):
        check(text, ONTOLOGY, SCENARIO)
    assert not formula_holds(parse(shown.goal), SCENARIO, ONTOLOGY)
    assert formula_holds(parse(shown.condition), SCENARIO, ONTOLOGY)


@pytest.mark.parametrize(
    ("map", "goal"),
    [
        (Map(), "Object relation Place"),
        (Map([Object(name="DeskA", type="Table")]), "Object relation Place"),
        (Map([Object(name="Mug7", type="Cup")]), "Object relation Place"),
        (Map([Object(name="Mug7", type="Cup"), Object(name="DeskA", type="Table")]), "Mug7 isOn DeskA"),
    ],
)
def test_without_suitable_objects_they_show_the_form(map: Map, goal: str) -> None:
    assert examples(map, ONTOLOGY).goal == goal


def test_about_an_object_that_nothing_can_move_they_show_the_form() -> None:
    assert examples(OFFICE, ONTOLOGY, "Office").goal == "Office relation Place"
    assert examples(OFFICE, ONTOLOGY, "Nobody").goal == "Nobody relation Place"


def test_a_variable_takes_the_place_of_the_object() -> None:
    types = {"Provider": "Device", "Object": "Graspable"}
    assert with_variables("Mug7 isOn DeskB", types, OFFICE, ONTOLOGY) == "?Object isOn DeskB"
    assert with_variables("Mug7 isOn DeskB", {"Provider": "Device"}, OFFICE, ONTOLOGY) == "Mug7 isOn DeskB"
