"""Converts what a thing says to values of attributes, and values to what it is told."""

from __future__ import annotations

import math

from msgspec import Struct

from somrs.ontology.types import AttributeType, Kind, Value
from somrs.ontology.units import convert_unit

Raw = str | float | bool
"""A value in a message: a number, a truth value or a text of JSON, the text of a payload, or a number or a bit of registers."""

TRUE_WORDS = frozenset(("true", "on", "yes", "1", "open", "opened", "online"))
FALSE_WORDS = frozenset(("false", "off", "no", "0", "closed", "close", "offline"))


class Conversion(Struct, frozen=True, kw_only=True):
    """How the values of one attribute, or of one input of a service, are written in messages.

    `values`: the value for a text of the message; then nothing else is understood. Otherwise, a number is `raw * scale + offset`, in
    `unit` (None: that of the attribute). `decimals`: to which the number in the message is rounded (None: not at all). `step`: the number
    in the message is a multiple of it (None: any). `minimum`, `maximum`: of the number, in the unit of the attribute; what is read beyond
    them is not believed, and nothing beyond them is written. `true_from`, `false_to`: of a truth value that is said as a number, from
    which number on it is TRUE, and up to which it is FALSE (None: it is said as a word).
    """

    attribute: AttributeType
    values: dict[str, Value] = {}
    scale: float = 1.0
    offset: float = 0.0
    unit: str | None = None
    decimals: int | None = None
    step: float | None = None
    minimum: float = -math.inf
    maximum: float = math.inf
    true_from: float | None = None
    false_to: float | None = None

    def read(self, raw: object) -> Value | None:
        """The value of the attribute, a number in its unit. None: it stays as it was, between `false_to` and `true_from`.

        Raises ValueError, which says what was expected.
        """
        text = raw_text(raw)
        if self.values:
            if text in self.values:
                return self.values[text]
            raise ValueError(f"{text!r} is none of {', '.join(self.values)}")
        match self.attribute.kind:
            case Kind.NUMBER:
                return self._number(text)
            case Kind.TRUTH if self.true_from is not None and self.false_to is not None:
                number = self._number(text)
                return True if number >= self.true_from else False if number <= self.false_to else None
            case Kind.TRUTH:
                return _truth(text)
            case Kind.ENUMERATION:
                words = {value.lower(): value for value in self.attribute.values}
                if text.lower() in words:
                    return words[text.lower()]
                raise ValueError(f"{text!r} is none of {', '.join(self.attribute.values)}")
        return text

    def write(self, value: Value) -> Raw:
        """What the message says for a value: the inverse of `read`. Raises ValueError."""
        if self.values:
            for raw, known_value in self.values.items():
                if known_value == value and isinstance(known_value, bool) == isinstance(value, bool):
                    return raw
            raise ValueError(f"there is nothing to write for {value}; values: has {', '.join(str(v) for v in self.values.values())}")
        if isinstance(value, bool) or not isinstance(value, float | int):
            return value
        number = self._unscaled(self._within_range(float(value)))
        rounded = round(number / self.step) * self.step if self.step is not None else number
        rounded = round(rounded, self.decimals) if self.decimals is not None else rounded
        if rounded == number:
            return number
        rounded = _short(rounded)
        nearest = self._scaled(rounded)
        if abs(nearest - float(value)) > self.attribute.tolerance > 0:
            raise ValueError(
                f"{value:g}{self._unit} cannot be had, because only steps can be written; the nearest is {nearest:g}{self._unit}"
            )
        return rounded

    def _scaled(self, raw: float) -> float:
        """The number that is meant by the one in a message."""
        if (self.scale, self.offset) != (1.0, 0.0):
            raw = _short(raw * self.scale + self.offset)
        if self.unit is None or self.attribute.unit is None or self.unit == self.attribute.unit:
            return raw
        converted = convert_unit(raw, self.unit, self.attribute.unit)
        assert converted is not None, "the units are checked when the mapping is read"
        return _short(converted)

    def _unscaled(self, number: float) -> float:
        """The number in a message by which one is meant."""
        if self.unit is not None and self.attribute.unit is not None and self.unit != self.attribute.unit:
            converted = convert_unit(number, self.attribute.unit, self.unit)
            assert converted is not None, "the units are checked when the mapping is read"
            number = _short(converted)
        return _short((number - self.offset) / self.scale) if (self.scale, self.offset) != (1.0, 0.0) else number

    def _number(self, text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            raise ValueError(f"{text!r} is not a number") from None
        if not math.isfinite(number):
            raise ValueError(f"{text} is not a finite number")
        return self._within_range(self._scaled(number))

    def _within_range(self, number: float) -> float:
        if self.minimum <= number <= self.maximum:
            return number
        raise ValueError(f"{number:g}{self._unit} is beyond range: {self.minimum:g} to {self.maximum:g}{self._unit}")

    @property
    def _unit(self) -> str:
        return f" {self.attribute.unit}" if self.attribute.unit is not None else ""


def _short(number: float) -> float:
    """The number without the digits that only come from calculating: 20 for 20.000000000000057."""
    return float(f"{number:.12g}")


def raw_text(raw: object) -> str:
    """The text of a value in a message: `true`, `21`, `21.5`. Raises ValueError for a group of values."""
    match raw:
        case str():
            return raw.strip()
        case bool():
            return "true" if raw else "false"
        case int() | float():
            return str(int(raw)) if float(raw).is_integer() else repr(float(raw))
    raise ValueError(f"{type(raw).__name__} is no single value; name one by json:")


def _truth(text: str) -> bool:
    word = text.lower()
    if word in TRUE_WORDS:
        return True
    if word in FALSE_WORDS:
        return False
    raise ValueError(f"{text!r} is neither true nor false; say which by values:")
