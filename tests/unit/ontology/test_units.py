"""Units: what maps usually say is known without pint, and is as pint has it."""

from __future__ import annotations

import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.units import COMMON, USUAL_FACTORS, _registry, convert_unit, is_convertible, is_known_unit
from tests.support.paths import SCENARIO_1


@given(value=st.floats(-1e4, 1e4, allow_nan=False))
@pytest.mark.parametrize(("unit", "target_unit"), USUAL_FACTORS)
def test_the_usual_units_are_as_pint_has_them(unit: str, target_unit: str, value: float) -> None:
    assert convert_unit(value, unit, target_unit) == float(_registry().convert(value, unit, target_unit))


@pytest.mark.parametrize("unit", sorted({*COMMON, *(unit for pair in USUAL_FACTORS for unit in pair)}))
def test_pint_knows_what_is_taken_for_known(unit: str) -> None:
    _registry().parse_units(unit)


def test_a_map_in_usual_units_is_read_without_pint() -> None:
    program = "import sys; from somrs.ontology.files.loading import load; load(sys.argv[1:]); assert 'pint' not in sys.modules"
    subprocess.run([sys.executable, "-c", program, str(SCENARIO_1)], check=True)


@pytest.mark.parametrize(
    ("value", "unit", "target_unit", "expected"),
    [
        (2.0, "wibble", "wibble", 2.0),
        (2.0, "wibble", "m", None),
        (2.0, "kg", "m", None),
        (2.0, "m/", "m", None),
        (2.0, "", "m", None),
        (2.0, "km", "m", 2000.0),
        (500.0, "g", "kg", 0.5),
        (3.0, "euro", "EUR", 3.0),
    ],
)
def test_what_can_be_expressed_in_another_unit(value: float, unit: str, target_unit: str, expected: float | None) -> None:
    assert convert_unit(value, unit, target_unit) == expected
    assert is_convertible(unit, target_unit) is (expected is not None)


@pytest.mark.parametrize(("unit", "is_unit"), [("km/h", True), ("EUR", True), ("euro", True), ("wibble", False), ("m/", False)])
def test_which_units_are_known(unit: str, is_unit: bool) -> None:
    assert is_known_unit(unit) is is_unit
