"""Numbers from one unit to another, through pint, which takes 0.8 s of a start: it is imported only for what maps do not usually say."""

from __future__ import annotations

import math
import tokenize
from functools import lru_cache
from typing import Any

COMMON = frozenset({"m", "rad", "kg", "s", "m/s", "percent", "EUR"})
"""In which most attributes are."""

USUAL_FACTORS = {("deg", "rad"): math.pi / 180, ("cm", "m"): 0.01, ("mm", "m"): 0.001, ("km/h", "m/s"): 1 / 3.6}
"""What maps usually say, as pint would have it."""


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("EUR = [money] = € = euro")  # prices; exchange rates are no business of units
    return registry


def _not_units() -> tuple[type[Exception], ...]:
    """What pint raises on unknown units, other dimensions, and texts that are no unit at all."""
    from pint.errors import PintError

    return (PintError, AssertionError, AttributeError, KeyError, ValueError, TypeError, ArithmeticError, SyntaxError, tokenize.TokenError)


@lru_cache(maxsize=8192)
def convert_unit(value: float, unit: str, target_unit: str) -> float | None:
    """The value in another unit; None when the one cannot be expressed in the other. A unit that pint does not know
    can be expressed in itself only."""
    if unit == target_unit:
        return value
    if (unit, target_unit) in USUAL_FACTORS:
        return value * USUAL_FACTORS[unit, target_unit]
    try:
        return float(_registry().convert(value, unit, target_unit))
    except _not_units():
        return None


@lru_cache(maxsize=256)
def is_known_unit(unit: str) -> bool:
    """Whether pint knows the unit."""
    if unit in COMMON or any(unit == usual for usual, _ in USUAL_FACTORS):
        return True
    try:
        _registry().parse_units(unit)
    except _not_units():
        return False
    return True


def is_convertible(unit: str, target_unit: str) -> bool:
    return convert_unit(1.0, unit, target_unit) is not None
