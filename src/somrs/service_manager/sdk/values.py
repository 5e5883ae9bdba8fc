"""Convert between Entish terms and Python values, and read the amounts of money and time that authors write."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache

from somrs.entish.formula import Comparison, Formula, Name, Number, Term, Text, Truth, substitute
from somrs.entish.parse import KEYWORDS, parse
from somrs.errors import DeviceError
from somrs.ontology.services import PROVIDER
from somrs.ontology.types import Value

_AMOUNT = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*([^\W\d]*)\s*")
_NAME = re.compile(r"[^\W\d]\w*(-\w+)*")
_SECONDS = {"": 1.0, "ms": 0.001, "s": 1.0, "min": 60.0, "h": 3600.0}


@lru_cache(maxsize=4096)
def term(text: str) -> Term:
    """Return the term in the text. Raises FormulaError."""
    compared = parse(f"It = {text}")
    return compared.right if isinstance(compared, Comparison) else Name(text)


def python_value(text: str) -> Value:
    """Return the Python value of an Entish term: a number, text or truth value; an object by its name; any other term as text."""
    match term(text):
        case Number(value, None):
            return value
        case Text(value) | Truth(value):
            return value
        case other_term:
            return str(other_term)


def number_of(value: Value) -> float:
    """Return the number of a quantity from the map, such as a length in metres, which comes with or without the attribute's unit."""
    quantity = term(str(value))
    assert isinstance(quantity, Number), "a quantity is a number"
    return quantity.value


def as_term(value: Value) -> Term:
    """Return the Entish term for a Python value. A text that has the form of a name becomes a name."""
    if isinstance(value, bool):
        return Truth(value)
    if isinstance(value, float | int):
        return Number(float(value))
    return Name(value) if _NAME.fullmatch(value) and value not in KEYWORDS else Text(value)


def fill_in(formula: str, provider: str, inputs: Mapping[str, str], outputs: Mapping[str, Value] | None = None) -> Formula:
    """Return the formula with its inputs, its outputs and `?Provider` substituted."""
    if outputs:
        return substitute(_fill_in(formula, provider, tuple(inputs.items())), {name: as_term(value) for name, value in outputs.items()})
    return _fill_in(formula, provider, tuple(inputs.items()))


@lru_cache(maxsize=1024)
def _fill_in(formula: str, provider: str, inputs: tuple[tuple[str, str], ...]) -> Formula:
    """Cached: a quote, the terms and the work each need the formulas of the same order."""
    return substitute(parse(formula), {name: term(text) for name, text in inputs} | {PROVIDER: Name(provider)})


def money(amount: float | str) -> tuple[float, str]:
    """Return the amount and the currency: 4 and EUR for `4 EUR`. A number alone is in EUR."""
    number, unit = _read(amount, "a price", "4 EUR")
    return number, unit or "EUR"


def seconds(amount: float | str) -> float:
    """Return the duration in seconds: of `30 s`, `2 min` or `1 h`. A number alone is in seconds."""
    number, unit = _read(amount, "a duration", "30 s, 2 min or 1 h")
    if unit not in _SECONDS:
        raise DeviceError(f"{amount!r} is not a duration: write it as {', '.join(u for u in _SECONDS if u)}")
    return number * _SECONDS[unit]


def _read(amount: float | str, quantity: str, example: str) -> tuple[float, str]:
    if isinstance(amount, float | int) and not isinstance(amount, bool):
        return float(amount), ""
    match = _AMOUNT.fullmatch(amount) if isinstance(amount, str) else None
    if match is None:
        raise DeviceError(f"{amount!r} is not {quantity}: write a number, or for example {example}")
    return float(match[1]), match[2]
