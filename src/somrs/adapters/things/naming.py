"""Names on the map for things that are announced under names for people."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection

from somrs.entish.parse import KEYWORDS
from somrs.ontology.units import is_known_unit

_UNIT = re.compile(r"[\w°%µ/²³ ]{1,20}")
"""Units that messages may name: without powers, of which a few characters would take for ever to compute."""


def object_name(text: str, taken_names: Collection[str]) -> str:
    """A name on the map for a text, which no other thing has: `LivingRoomLamp` for `living room lamp`."""
    words = re.findall(r"\w+", unicodedata.normalize("NFC", text).replace("_", " "))
    name = "".join(word[:1].upper() + word[1:] for word in words)
    if not re.match(r"[^\W\d]", name) or name in KEYWORDS:
        name = f"Thing{name}"
    candidate, number = name, 2
    while candidate in taken_names:
        candidate, number = f"{name}{'-' if name[-1].isdigit() else ''}{number}", number + 1
    return candidate


def is_unit(text: str) -> bool:
    """Whether a text that somebody else has written is a unit."""
    return _UNIT.fullmatch(text) is not None and is_known_unit(text)


def definition_name(text: str) -> str:
    """The name of an attribute or a type for a text: `FillLevel` for `fillLevel` and `fill-level`."""
    return object_name(text, ())
