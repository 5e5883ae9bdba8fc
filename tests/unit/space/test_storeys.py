"""The heights of storeys: every object of a building is on one of them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.space.storeys import BELOW_FLOOR, elevation_of, span_of

ONTOLOGY = upper()


@given(
    st.lists(st.integers(-40, 200), min_size=1, max_size=6, unique=True).map(lambda tenths: [number / 10 for number in tenths]),
    st.floats(-5, 30),
)
def test_every_height_from_the_lowest_storey_on_is_on_one_storey(elevations: list[float], height: float) -> None:
    storeys = {f"Storey{number}": elevation for number, elevation in enumerate(elevations)}
    map = Map([Object(name=name, type="Storey", values={"Elevation": elevation}) for name, elevation in storeys.items()])
    spans = {name: span_of(name, map, ONTOLOGY) for name in storeys}
    at_height = [name for name, span in spans.items() if span is not None and span[0] <= height < span[1]]
    below = [name for name, elevation in storeys.items() if elevation - BELOW_FLOOR <= height]
    assert at_height == ([max(below, key=storeys.__getitem__)] if below else [])


def test_a_storey_without_an_elevation_is_at_the_height_of_its_type() -> None:
    map = Map([Object(name="Storey1", type="Storey"), Object(name="House", type="Building")])
    assert elevation_of("Storey1", map, ONTOLOGY) == 0.0
    assert span_of("Storey1", map, ONTOLOGY) == (-BELOW_FLOOR, float("inf"))


@pytest.mark.parametrize("name", ["House", "Attic"])
def test_what_is_no_storey_has_no_span(name: str) -> None:
    assert span_of(name, Map([Object(name="House", type="Building")]), ONTOLOGY) is None
