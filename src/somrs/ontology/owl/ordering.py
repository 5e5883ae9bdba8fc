"""Reads and writes annotations for the order of names and for default values."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TypeVar

from somrs.ontology.types import Value

T = TypeVar("T", bound=Value)


def ordered(items: Sequence[Value]) -> str:
    """A hint for the order of items that OWL has as a set; empty for fewer than two items."""
    return json.dumps(list(items), ensure_ascii=False) if len(items) > 1 else ""


def in_order(items: Iterable[T], hint: str | None) -> tuple[T, ...]:
    """The items, each once, in the order of the hint; items that are not in it come last, by name. A hint may also be names separated by
    spaces, which are easier to write by hand."""
    text = (hint or "").strip()
    try:
        order = json.loads(text) if text.startswith("[") else text.split()
    except ValueError:
        order = []
    place = {_key(item): number for number, item in enumerate(order)}
    return tuple(sorted(dict.fromkeys(items), key=lambda item: (place.get(_key(item), len(place)), str(item))))


def _key(item: object) -> tuple[type, object]:
    """The key of an item, which distinguishes TRUE from 1."""
    return (float, float(item)) if isinstance(item, int | float) and not isinstance(item, bool) else (type(item), str(item))


def read_default(text: str) -> tuple[str, Value]:
    """The path and value of a default in its written form: `Shape.Height = 0.14`. Raises ValueError for other texts."""
    path, sign, value = text.partition("=")
    if not sign:
        raise ValueError("there is no = in it")
    default_value = json.loads(value)
    if isinstance(default_value, bool | str):
        return path.strip(), default_value
    if isinstance(default_value, int | float):
        return path.strip(), float(default_value)
    raise ValueError("it is no number, text or truth")
