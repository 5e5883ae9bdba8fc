"""Names that formulas can use, and texts that messages can carry."""

from __future__ import annotations

import re
from collections.abc import Iterator

import msgspec

from somrs.entish.formula import Comparison, Name
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.qualified_names import home_of

NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 excludes (clause 2.2)."""


def is_name(text: str) -> bool:
    """Whether formulas can use the text as a name, which is not qualified with that of another map."""
    try:
        return not home_of(text) and parse(f"{text} = {text}") == Comparison(Name(text), "=", Name(text))
    except FormulaError:
        return False


def text_problem(text: str) -> str:
    """Why no message can carry the text; empty when messages can."""
    match = NOT_XML.search(text)
    return f"the character U+{ord(match[0]):04X} cannot be sent in a message; leave it out" if match else ""


def texts(value: object, path: str = "") -> Iterator[tuple[str, str]]:
    """All texts in a Struct, each as its path and the text."""
    match value:
        case str():
            yield path, value
        case dict():
            for key, inner in value.items():
                yield from texts(key, path)
                yield from texts(inner, f"{path}.{key}" if path else key)
        case tuple() | list():
            for index, inner in enumerate(value):
                yield from texts(inner, f"{path}.{index}")
        case msgspec.Struct():
            for name in value.__struct_fields__:
                yield from texts(getattr(value, name), f"{path}.{name}" if path else name)
