"""Conversion between units with pint. Importing pint takes 0.8 s, so it is imported only for units that maps rarely use."""

from __future__ import annotations

import math
import tokenize
from functools import lru_cache
from typing import Any

COMMON = frozenset({"m", "rad", "kg", "l", "s", "m/s", "percent", "EUR"})
"""The units of most attributes; they are known without pint."""

USUAL_FACTORS = {("deg", "rad"): math.pi / 180, ("cm", "m"): 0.01, ("mm", "m"): 0.001, ("km/h", "m/s"): 1 / 3.6}
"""The most frequent conversions, with the factors of pint."""


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("EUR = [money] = € = euro")  # prices; exchange rates are not supported
    return registry


def _not_units() -> tuple[type[Exception], ...]:
    """The exceptions of pint for unknown units, other dimensions, and texts that are not units."""
    from pint.errors import PintError

    return (PintError, AssertionError, AttributeError, KeyError, ValueError, TypeError, ArithmeticError, SyntaxError, tokenize.TokenError)


@lru_cache(maxsize=8192)
def convert_unit(value: float, unit: str, target_unit: str) -> float | None:
    """The value in another unit; None when the units are not convertible. A unit that pint does not know is convertible
    only to itself."""
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
