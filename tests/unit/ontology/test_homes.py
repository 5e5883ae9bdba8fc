"""Names of objects that have their home on another map."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.check import check
from somrs.ontology.homes import full_name
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactAdded, Object, ObjectAdded
from somrs.ontology.qualified_names import translated
from tests.support.lab import lab

ONTOLOGY, LAB = lab()

NAMES = st.sampled_from(("Jar9", "Barn:Jar9", "Yard:Jar9", "Mill:Jar9"))
MAPS = st.sampled_from(("Barn", "Yard", "Mill"))


def with_neighbours() -> Map:
    jars = [Object(name=name, type="Jar") for name in ("Barn:Jar1", "Barn:Tin", "Mill:Pot", "Barn:Pot")]
    return LAB.changed([*(ObjectAdded(jar) for jar in jars), FactAdded(Fact("isOn", ("Barn:Tin", "Table1")))])


def test_a_name_on_one_map_gives_the_name_on_another() -> None:
    assert translated("Jar9", "Barn", "Yard") == "Barn:Jar9"
    assert translated("Yard:Truck", "Barn", "Yard") == "Truck"
    assert translated("Mill:Cart", "Barn", "Yard") == "Mill:Cart"


@given(name=NAMES, here=MAPS, there=MAPS)
def test_a_name_comes_back_from_another_map_as_it_was(name: str, here: str, there: str) -> None:
    canonical = translated(name, here, here)
    assert translated(translated(canonical, here, there), there, here) == canonical


def test_a_map_has_the_name_that_its_file_gives() -> None:
    assert with_neighbours().name == "Lab"
    assert {*with_neighbours().homes} == {"Barn", "Mill"}


@pytest.mark.parametrize(
    ("written", "meant"),
    [("Jar1", "Jar1"), ("Barn:Jar1", "Barn:Jar1"), ("Tin", "Barn:Tin"), ("Lab:Jar1", "Jar1"), ("Pot", "Pot"), ("Lamp", "Lamp")],
)
def test_a_name_that_is_unique_needs_no_qualification(written: str, meant: str) -> None:
    assert full_name(written, with_neighbours()) == meant


def test_a_formula_spans_maps() -> None:
    formula = check("Tin isOn Lab:Table1 AND Barn:Jar1 isOn Table2", ONTOLOGY, with_neighbours())
    assert formula == parse("Barn:Tin isOn Table1 AND Barn:Jar1 isOn Table2")


def test_an_ambiguous_name_is_refused_with_all_that_it_may_be() -> None:
    with pytest.raises(FormulaError, match="Pot is the name of several objects") as error:
        check("Pot isOn Table1", ONTOLOGY, with_neighbours())
    assert "Barn:Pot" in error.value.hint
    assert "Mill:Pot" in error.value.hint
