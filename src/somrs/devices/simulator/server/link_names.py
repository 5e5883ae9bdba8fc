"""Names on the robot link of a world with several maps.

A client speaks in the names of one of them, which its hello states: `Jar1` is `Barn:Jar1` in the world for a device of the barn. What the
world tells it is translated back, also in texts for people: `Barn:Jar1` is `Jar1`, and `Yard:Truck` stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from msgspec import Struct, structs

from somrs.ontology.homes import text_with_names
from somrs.ontology.qualified_names import SEPARATOR, translated
from somrs.ontology.types import Ontology

_OBJECTS = ("robot", "object", "support", "container", "subject")
"""The fields of what a client says that name an object of the map."""

S = TypeVar("S", bound=Struct)


class LinkNames:
    """Translates the lines of a client that speaks in the names of this map."""

    def __init__(self, map: str) -> None:
        self._full: Callable[[str], str] = partial(translated, from_map=map, to_map="")
        self._prefix = re.compile(rb"(?<![\w:])" + re.escape(map + SEPARATOR).encode() + rb"(?=\w)")

    def from_client(self, message: S, ontology: Ontology) -> S:
        """The hello, command or question in the names of the world. Raises FormulaError for a situation that is none."""
        changes: dict[str, Any] = {}
        for field in message.__struct_fields__:
            value = getattr(message, field)
            if value is None:
                continue
            if field in _OBJECTS:
                changes[field] = self._full(value)
            elif field == "stops":
                changes[field] = tuple(self._full(stop) if isinstance(stop, str) else stop for stop in value)
            elif field == "situation":
                changes[field] = text_with_names(value, self._full, ontology)
        return structs.replace(message, **changes)

    def to_client(self, line: bytes) -> bytes:
        """The encoded line in the names of the client's map."""
        return self._prefix.sub(b"", line)
