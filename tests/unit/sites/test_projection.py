"""Geographic coordinates become metres, on the map and in a building file."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import ModelError
from somrs.sites.openrmf import import_text
from somrs.sites.projection import Projection, from_web_mercator

CAMPUS = """\
name: campus
coordinate_system: wgs84
parameters: {generate_crs: [1, "EPSG:3414"]}
levels:
  L1:
    vertices:
      - [103.77, 1.30, 0, gate]
      - [103.78, 1.30, 0, hall]
      - [103.78, 1.31, 0, ""]
    lanes:
      - [0, 1, {graph_idx: [2, 0]}]
      - [1, 2, {graph_idx: [2, 0]}]
"""


@pytest.mark.parametrize(
    ("reference", "point", "metres"),
    [
        ((103.85, 1.29), (103.86, 1.283), (1112.9177, -774.0217)),
        ((13.4, 52.5), (13.7, 52.29), (20469.9791, -23325.3212)),
        ((-70.0, -33.0), (-69.99, -33.007), (934.4583, -776.3761)),
        ((25.0, 69.9), (25.3, 69.69), (11625.9127, -23398.9341)),
        ((179.999, -17.0), (-179.701, -17.21), (31910.0789, -23265.5018)),
    ],
)
def test_projection_agrees_with_proj(reference: tuple[float, float], point: tuple[float, float], metres: tuple[float, float]) -> None:
    """The values were computed with PROJ 9.5.1: +proj=tmerc +k=1 +ellps=WGS84, about the reference point."""
    assert Projection(*reference)(*point) == pytest.approx(metres, abs=1e-4)


def on_earth(longitude: float, latitude: float) -> tuple[float, float, float]:
    """Cartesian coordinates of a point on the ellipsoid, m: the plain definition."""
    a, f = 6378137.0, 1 / 298.257223563
    eccentricity = f * (2 - f)
    phi, lam = math.radians(latitude), math.radians(longitude)
    normal = a / math.sqrt(1 - eccentricity * math.sin(phi) ** 2)
    return normal * math.cos(phi) * math.cos(lam), normal * math.cos(phi) * math.sin(lam), normal * (1 - eccentricity) * math.sin(phi)


offsets = st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))


@given(st.floats(-180, 180), st.floats(-80, 80), offsets, offsets)
def test_distances_are_those_on_the_ground(longitude: float, latitude: float, start: tuple[float, float], end: tuple[float, float]) -> None:
    points = [(math.remainder(longitude + east, 360), latitude + north) for east, north in (start, end)]
    projection = Projection(longitude, latitude)
    length = math.dist(*(projection(*point) for point in points))
    assert length == pytest.approx(math.dist(*(on_earth(*point) for point in points)), rel=1e-5, abs=1e-3)


def test_campus_in_degrees_has_its_real_extent() -> None:
    site = import_text(CAMPUS)
    gate, hall = (site.map.objects[name].values for name in ("gate", "hall"))
    assert float(hall["PositionX"]) - float(gate["PositionX"]) == pytest.approx(1112.91, abs=0.02), "0.01 degrees near the equator"
    assert site.map.objects["campus"].values == {"Longitude": 103.775, "Latitude": 1.305}
    assert float(gate["PositionX"]) == pytest.approx(-556.5, abs=0.1), "the origin is in the middle"


def test_web_mercator_is_north_up() -> None:
    assert from_web_mercator(128, -128) == pytest.approx((0, 0))
    longitude, latitude = from_web_mercator(201.7961, -127.0719)
    assert (longitude, latitude) == pytest.approx((103.7758, 1.3050), abs=1e-3)
    text = CAMPUS.replace("wgs84", "web_mercator")
    for degrees, tiles in (("103.77, 1.30", "201.79, -127.08"), ("103.78, 1.30", "201.80, -127.08"), ("103.78, 1.31", "201.80, -127.07")):
        text = text.replace(degrees, tiles)
    places = [import_text(text).map.objects[name].values for name in ("gate", "Waypoint001")]
    assert float(places[1]["PositionY"]) - float(places[0]["PositionY"]) == pytest.approx(1563, rel=0.02)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[103.78, 1.31", "[203.78, 1.31", "is no longitude and latitude"),
        ("[103.78, 1.31", "[103.78, 97", "is no longitude and latitude"),
        ("[103.78, 1.31", "[13.78, 1.31", "longitude 13.78, latitude 1.31 is .* km from the building's middle"),
        ("[103.78, 1.31", "[.nan, 1.31", "nan is no number"),
    ],
)
def test_coordinates_that_are_no_degrees_are_told(old: str, new: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        import_text(CAMPUS.replace(old, new))
