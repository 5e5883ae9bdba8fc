"""Which objects of the map the sighted objects of a report are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import somrs.repository.association
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import Ontology
from somrs.repository.assignment import assign
from somrs.repository.association import NEAR, Association, Sighting, Surroundings, associate
from tests.support.building import building
from tests.support.examples import examples

SITE = (
    building("Kitchen", 10, 10)
    + """
  Table1: {type: Table, at: [1, 1, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}}
  Table2: {type: Table, at: [5, 5, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}}
  Red1: {type: Jar, at: [1, 1, 0.7], Color: Red}
  Blue1: {type: Jar, at: [1.2, 1, 0.7], Color: Blue}
  Plain1: {type: Jar, at: [5, 5, 0.7]}
  Cup1: {type: Cup, at: [5.2, 5, 0.7], Color: Red}
  Robot1: {type: PioneerP3DX, at: [3, 3, 0], Color: Red}
  Robot2: {type: PioneerP3DX, at: [8, 8, 0], Color: Blue}
facts:
  - Red1 isOn Table1
  - Blue1 isOn Table1
  - Plain1 isOn Table2
  - Cup1 isOn Table2
"""
)


def kitchen() -> tuple[Map, Ontology]:
    loaded = load_text(SITE, base=upper())
    assert loaded.map is not None
    return loaded.map, loaded.ontology


MAP, ONTOLOGY = kitchen()


def sighting(
    variable: str,
    type: str = "Jar",
    at: tuple[float, float] | None = None,
    place: str | None = None,
    color: str | None = None,
    height: float | None = None,
) -> Sighting:
    x, y = at if at is not None else (None, None)
    described = {"PositionX": x, "PositionY": y, "PositionZ": 0.7 if at is not None else None, "Color": color, "Shape.Height": height}
    values = {path: value for path, value in described.items() if value is not None}
    return Sighting(variable=variable, object=Object(name=f"seen-{variable}", type=type, values=values), place=place)


def association(*sightings: Sighting, map: Map = MAP, **around: object) -> Association:
    return associate(sightings, map, ONTOLOGY, Surroundings(**around))  # type: ignore[arg-type]  # as the fields


@pytest.mark.parametrize(
    ("seen", "name"),
    [
        (sighting("A", at=(1.1, 1.1), color="Red"), "Red1"),
        (sighting("A", at=(1.05, 1.0)), "Red1"),
        (sighting("A", at=(1.19, 1.0), color="Blue"), "Blue1"),
        (sighting("A", "Graspable", at=(5.2, 5.1), color="Red"), "Cup1"),
        (sighting("A", at=(5.0, 5.0), color="Green"), "Plain1"),
        (sighting("A", place="Table2"), "Plain1"),
        (sighting("A", at=(5.0, 5.0), height=0.145), "Plain1"),
        (sighting("A", at=(5.0, 5.0), height=0.3), None),
        (sighting("A", at=(1.1, 1.1), color="Green"), None),
        (sighting("A", "Bottle", at=(1.1, 1.1)), None),
        (sighting("A", at=(1.0, 1.0 + NEAR + 0.3), color="Red"), None),
        (sighting("A", place="Table2", color="Red"), "Plain1"),
        (sighting("A", place="Floor1", color="Blue"), None),
        (sighting("A", "PioneerP3DX", at=(7.0, 1.0), color="Blue"), "Robot2"),
        (sighting("A", color="Blue"), "Blue1"),
    ],
)
def test_a_sighting_is_of_the_nearest_object_with_its_attributes(seen: Sighting, name: str | None) -> None:
    found = association(seen)
    assert (dict(found.names), [*found.new]) == (({"A": name}, []) if name is not None else ({}, ["A"]))


def test_all_sightings_of_a_report_are_associated_together() -> None:
    # The first alone would be Red1, which the second matches better.
    found = association(sighting("A", at=(1.08, 1.0)), sighting("B", at=(1.0, 1.0)))
    assert found.names == {"A": "Blue1", "B": "Red1"}
    twice = association(*(sighting(name, at=(5.0, 5.0)) for name in "AB"))
    assert ([*twice.names.values()], len(twice.new)) == (["Plain1"], 1)


def test_what_is_sought_may_be_anywhere() -> None:
    seen = sighting("A", at=(8.0, 2.0), color="Red")
    assert association(seen).new == ["A"]
    assert association(seen, anywhere={"Red1"}, sought=["Red1"]).names == {"A": "Red1"}
    # An object at this place that a person put on the map is nearer.
    assert association(sighting("A", at=(5.0, 5.0)), anywhere={"Red1"}, sought=["Red1"]).names == {"A": "Plain1"}


def test_what_is_known_from_a_sighting_alone_may_be_what_is_sought() -> None:
    seen = sighting("A", at=(5.1, 5.0), color="Red")
    found = association(seen, anywhere={"Red1"}, sought=["Red1"], provisional={"Plain1"})
    assert (found.names, found.duplicates) == ({"A": "Red1"}, {"Plain1": "Red1"})
    both = association(seen, sighting("B", at=(1.0, 1.0), color="Red"), anywhere={"Red1"}, sought=["Red1"], provisional={"Plain1"})
    assert (both.names, both.duplicates) == ({"A": "Plain1", "B": "Red1"}, {})


def test_what_cannot_be_told_apart_is_not_decided() -> None:
    seen = sighting("A", at=(3.0, 3.0), color="Red")
    assert association(seen, held={"Red1"}).undecided == ["A"], "it may be what a device carries"
    assert association(seen, moved={"Red1"}).undecided == ["A"], "it may have been here then"
    assert association(seen, departed=[Object(name="Red9", type="Jar", values={"Color": "Red"})]).undecided == ["A"]
    assert association(seen, departed=[Object(name="Red9", type="Jar", values={"Color": "Blue"})]).new == ["A"]
    assert association(sighting("A", at=(1.0, 1.0), color="Red"), moved={"Red1"}).names == {"A": "Red1"}


# The assignment, and its slow twin

costs = st.lists(st.dictionaries(st.sampled_from("abcd"), st.sampled_from([0.0, 0.1, 0.25, 0.5, 0.75, 1.0, 1.5]), max_size=4), max_size=4)


def total(choice: Sequence[str | None], rows: Sequence[Mapping[str, float]], unassigned: float) -> float:
    return math.fsum(row[column] if column is not None else unassigned for column, row in zip(choice, rows, strict=True))


def least_total(rows: Sequence[Mapping[str, float]], unassigned: float) -> float:
    """The least total of all assignments, tried one by one."""
    choices = itertools.product(*([None, *row] for row in rows))
    return min(
        total(choice, rows, unassigned) for choice in choices if len({*choice} - {None}) == sum(column is not None for column in choice)
    )


@given(costs, st.sampled_from([0.3, 1.0]))
def test_the_assignment_costs_least(rows: list[dict[str, float]], unassigned: float) -> None:
    assigned = assign(rows, unassigned)
    columns = [column for column in assigned if column is not None]
    assert len(columns) == len({*columns})
    assert total(assigned, rows, unassigned) == pytest.approx(least_total(rows, unassigned))


places = st.tuples(st.integers(0, 20), st.integers(0, 20)).map(lambda cell: (cell[0] / 10, cell[1] / 10))
seen_things = st.lists(st.tuples(places, st.sampled_from(["Red", "Blue", None]), st.sampled_from(["Jar", "Cup", "Graspable"])), max_size=4)


@given(seen_things, st.permutations(range(4)))
def test_the_order_of_sightings_does_not_matter_to_their_total(
    things: list[tuple[tuple[float, float], str | None, str]], order: list[int]
) -> None:
    sightings = [sighting(str(i), type, at=at, color=color) for i, (at, color, type) in enumerate(things)]
    first = association(*sightings)
    second = association(*(sightings[i] for i in order if i < len(sightings)))
    assert len(first.names) == len(second.names)
    assert len({*first.names.values()}) == len(first.names), "each object is seen once"
    for seen in sightings:
        if seen.variable in first.names:
            object = MAP.objects[first.names[seen.variable]]
            assert math.dist(*([float(o.values[path]) for path in ("PositionX", "PositionY")] for o in (seen.object, object))) <= NEAR


# Many objects

NAMES = [f"Thing{number}" for number in range(8)]
coordinates = st.one_of(st.none(), st.sampled_from([-0.9, -0.4, 0.0, 0.3, 0.5, 0.8, 1.0, 1.4, 2.0]))
sets_of_names = st.sets(st.sampled_from(NAMES), max_size=2)
things = st.fixed_dictionaries(
    {
        "type": st.sampled_from(["Jar", "Cup", "PioneerP3DX"]),
        "at": st.tuples(coordinates, coordinates),
        "place": st.sampled_from([None, "Table1", "Table2"]),
    }
)


@given(st.lists(things, max_size=8), things, sets_of_names, sets_of_names, sets_of_names)
@examples(200)
def test_what_is_near_is_found_among_many_as_among_few(
    described: list[dict[str, Any]], seen: dict[str, Any], anywhere: set[str], held: set[str], moved: set[str]
) -> None:
    objects = [Object(name=name, type="Table") for name in ("Table1", "Table2")]
    facts = []
    for name, thing in zip(NAMES, described, strict=False):
        values = {path: value for path, value in zip(("PositionX", "PositionY"), thing["at"], strict=True) if value is not None}
        objects.append(Object(name=name, type=thing["type"], values=values))
        facts += [Fact("isOn", (name, thing["place"]))] if thing["place"] is not None else []
    map = Map(objects, facts)
    x, y = seen["at"]
    sighted = sighting("A", seen["type"], (x, y) if x is not None and y is not None else None, seen["place"])
    around: dict[str, object] = {"anywhere": anywhere & {*map.objects}, "held": held, "moved": moved}
    expected = association(sighted, map=map, **around)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(somrs.repository.association, "MOST_COMPARED", 0)
        assert association(sighted, map=map, **around) == expected
