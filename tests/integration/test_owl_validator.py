"""Another SHACL validator agrees with our own check of what maps have to obey."""

from __future__ import annotations

import pytest
from hypothesis import given

from somrs.ontology.conformance import violations
from somrs.ontology.files.loaded import LoadedModel
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactAdded, Object, ObjectAdded, ValueSet
from somrs.ontology.owl import to_graph
from somrs.ontology.types import Ontology
from tests.support.examples import examples
from tests.unit.ontology.files.test_loading import HOUSE, maps, the_map

pyshacl = pytest.importorskip("pyshacl", reason="pySHACL is not installed")


def judged(map: Map, ontology: Ontology) -> str:
    """What pySHACL has against the map; empty when nothing."""
    conforms, _, text = pyshacl.validate(to_graph(ontology, map, shapes=False), shacl_graph=to_graph(ontology))
    return "" if conforms else text


@pytest.mark.slow
def test_the_shapes_are_shapes() -> None:
    graph = to_graph(upper())
    conforms, _, text = pyshacl.validate(graph, shacl_graph=graph, meta_shacl=True)
    assert conforms, text


@given(maps())
@examples(6)
def test_what_our_check_accepts_the_other_accepts(map: Map) -> None:
    assert violations(map, upper()) == []
    assert judged(map, upper()) == ""


WORDS = """\
types:
  Bench: {parent: Table, required: [Weight], parts: [{type: FurnitureLeg, minimum: 1, maximum: 2}]}
  Stool: {parent: Chair, defaults: {Weight: 3}}
relations:
  between: {joins: [Object, Support, Support], functional: true}
  isStuckTo: {joins: [PhysicalObject, Object], excludes: place}
  isTiedTo: {joins: [PhysicalObject, Object], excludes: bond}
  isBefore: {joins: [PhysicalObject, Object], excludes: side}
  isBehind: {joins: [PhysicalObject, Object], excludes: side}
"""


def house(extra: str = "", *changes: Change) -> LoadedModel:
    loaded = load_text(WORDS + HOUSE + extra)
    return LoadedModel(loaded.ontology, the_map(loaded).changed(changes))


def thing(name: str, type: str, **values: float | str | bool) -> ObjectAdded:
    place: dict[str, float | str | bool] = {"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.0}
    return ObjectAdded(Object(name=name, type=type, values={**place, **values}))


CYLINDER: dict[str, float | str | bool] = {"Shape.Form": "Cylinder", "Shape.Radius": 1.0, "Shape.Height": 1.0}
BOX: dict[str, float | str | bool] = {"Shape.Form": "Box", "Shape.Width": 1.0, "Shape.Depth": 1.0, "Shape.Height": 1.0}
LEG: list[Change] = [thing("Leg", "FurnitureLeg", **BOX), FactAdded(Fact("isPartOf", ("Leg", "Bench1")))]

BROKEN: dict[str, list[Change]] = {
    "a number that is a text": [ValueSet("Jar1", "Weight", "heavy")],
    "a text that is a number": [ValueSet("Jar1", "Label", 3.0)],
    "below the attribute's minimum": [ValueSet("Table1", "Shape.Height", -1.0)],
    "above the type's maximum": [ValueSet("Jar1", "Weight", 8.0)],
    "none of the list": [ValueSet("Jar1", "Color", "Pink")],
    "none of the type's list": [thing("Leg", "CuboidFurnitureLeg", **CYLINDER)],
    "a value where there are parts of it": [ValueSet("Jar1", "Shape", "round")],
    "an attribute that its type has not": [ValueSet("Jar1", "Elevation", 3.0)],
    "a part of a value that it has not": [ValueSet("Table1", "Shape.Weight", 3.0)],
    "nothing where something is required": [ValueSet("Jar1", "PositionZ", None)],
    "a shape where something is required": [thing("Bench1", "Bench", **BOX), *LEG],
    "a part that is missing": [thing("Bench1", "Bench", Weight=3.0, **BOX)],
    "a floor that is none": [ObjectAdded(Object(name="Slab", type="Wall", values=the_map(load_text(HOUSE)).objects["Slab"].values))],
    "a type that there is not": [thing("Vase1", "Vase")],
    "a relation from what it does not join": [FactAdded(Fact("isHeldBy", ("House", "Table1")))],
    "a relation to what it does not join": [FactAdded(Fact("isHeldBy", ("Jar1", "House")))],
    "a relation to nothing": [FactAdded(Fact("isAdjacentTo", ("Jar1", "Nobody")))],
    "on two things at a time": [FactAdded(Fact("isOn", ("Jar1", "Slab")))],
    "on and in": [FactAdded(Fact("isIn", ("Jar1", "Table1")))],
    "stuck and on": [FactAdded(Fact("isStuckTo", ("Jar1", "Table1")))],
    "before and behind": [FactAdded(Fact("isBefore", ("Jar1", "Table1"))), FactAdded(Fact("isBehind", ("Jar1", "Slab")))],
    "between what it does not join": [FactAdded(Fact("between", ("Jar1", "House", "Table1")))],
    "between too few": [FactAdded(Fact("between", ("Jar1", "Table1")))],
    "between twice": [
        thing("Table2", "Table", **BOX),
        FactAdded(Fact("between", ("Jar1", "Table1", "Table2"))),
        FactAdded(Fact("between", ("Jar1", "Table2", "Table1"))),
    ],
    "on three": [FactAdded(Fact("isAdjacentTo", ("Jar1", "Table1", "Slab")))],
    "a part of itself": [FactAdded(Fact("isPartOf", ("House", "Ground")))],
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_what_breaks_a_rule_is_refused_by_both(case: str) -> None:
    loaded = house("", *BROKEN[case])
    assert violations(the_map(loaded), loaded.ontology), "ours"
    assert judged(the_map(loaded), loaded.ontology), "the other"


def test_what_breaks_no_rule_is_accepted_by_both() -> None:
    """Near misses of what is refused."""
    loaded = house(
        "",
        *LEG[:1],
        thing("Bench1", "Bench", Weight=3.0, **BOX),
        *LEG[1:],
        thing("Stool1", "Stool", **BOX),
        thing("Table2", "Table", **BOX),
        ValueSet("Jar1", "Weight", 5.0),
        FactAdded(Fact("between", ("Jar1", "Table1", "Table2"))),
        FactAdded(Fact("isStuckTo", ("Stool1", "Table1"))),
        FactAdded(Fact("isStuckTo", ("Stool1", "Table2"))),
    )
    assert violations(the_map(loaded), loaded.ontology) == []
    assert judged(the_map(loaded), loaded.ontology) == ""
