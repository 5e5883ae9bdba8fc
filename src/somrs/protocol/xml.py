"""Between msgspec Structs and XML elements, driven by the Structs' annotations alone.

A field is an element in UpperCamelCase; None, and what equals its default, is left out. A tuple is the element repeated, a mapping
holds `Entry` elements with a `name`, a union holds one element named by the Struct that it is. `xsd.py` writes the same as a schema.
"""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Callable
from enum import Enum
from functools import cache
from typing import Any, NamedTuple, Union

from lxml import etree
from msgspec import NODEFAULT, Struct, structs

from somrs.errors import WireError
from somrs.ontology.types import Value

Element = etree._Element
Write = Callable[[Element, Any], None]
Read = Callable[[Element], Any]
SENDER = "env:Sender"


class Field(NamedTuple):
    """One field of a Struct: its name in Python and in XML, its type without None, and how it is to be left out."""

    name: str
    tag: str
    type: Any
    default: Any
    required: bool


def camel(name: str) -> str:
    """`terms_id` as `TermsId`."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))


@cache
def fields(kind: type[Struct]) -> tuple[Field, ...]:
    """The fields of a Struct, in order."""
    hints = typing.get_type_hints(kind)
    found = []
    for info in structs.fields(kind):
        given = info.default_factory() if info.default_factory is not NODEFAULT else info.default
        # None is written by leaving the element out, so a field that may be None is not required, whatever Python says.
        default = None if given is NODEFAULT and type(None) in union_of(hints[info.name]) else given
        required = default is NODEFAULT
        found.append(Field(info.name, camel(info.name), without_none(hints[info.name]), default, required))
    return tuple(found)


def union_of(hint: Any) -> tuple[Any, ...]:
    """The members of a union; of anything else, itself."""
    return typing.get_args(hint) if typing.get_origin(hint) in (Union, types.UnionType) else (hint,)


def without_none(hint: Any) -> Any:
    left = tuple(member for member in union_of(hint) if member is not type(None))
    return left[0] if len(left) == 1 else Union[left]


def is_value(hint: Any) -> bool:
    """Whether it is a number, a text or a truth, told apart by an attribute `kind`."""
    return set(union_of(hint)) == set(union_of(Value))


def text_of(value: float | str | bool) -> str:
    """A simple value as XML Schema writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float | int):
        if math.isinf(value):
            return "INF" if value > 0 else "-INF"
        return "NaN" if math.isnan(value) else repr(value)
    return value


def _set_text(element: Element, text: str) -> None:
    try:
        element.text = text
    except ValueError:
        raise WireError(
            SENDER, f"{etree.QName(element).localname}: this text has a character that XML cannot carry: {text[:60]!r}"
        ) from None


@cache
def writer(hint: Any, namespace: str) -> Write:
    """What fills an element with a value of the type."""
    if is_value(hint):
        return _write_value
    members = union_of(hint)
    if len(members) > 1:
        return lambda element, value: writer(type(value), namespace)(_child(element, namespace, type(value).__name__), value)
    origin = typing.get_origin(hint)
    if origin is dict:
        inner = writer(without_none(typing.get_args(hint)[1]), namespace)

        def write_entries(element: Element, value: dict[str, Any]) -> None:
            for name, one in value.items():
                entry = _child(element, namespace, "Entry")
                _set_attribute(entry, "name", name)
                inner(entry, one)

        return write_entries
    if isinstance(hint, type) and issubclass(hint, Struct):
        return lambda element, value: write_fields(element, value, namespace)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return lambda element, value: _set_text(element, str(value.value))
    return lambda element, value: _set_text(element, text_of(value))


def _write_value(element: Element, value: Any) -> None:
    kind = "truth" if isinstance(value, bool) else "number" if isinstance(value, float | int) else "text"
    element.set("kind", kind)
    _set_text(element, text_of(value))


def _set_attribute(element: Element, name: str, text: str) -> None:
    try:
        element.set(name, text)
    except ValueError:
        raise WireError(SENDER, f"a name has a character that XML cannot carry: {text[:60]!r}") from None


def _child(element: Element, namespace: str, tag: str) -> Element:
    return etree.SubElement(element, f"{{{namespace}}}{tag}")


def write_fields(element: Element, value: Struct, namespace: str) -> None:
    """Append an element for each field that is not left out."""
    for field in fields(type(value)):
        one = getattr(value, field.name)
        if one is None or (not field.required and one == field.default and type(one) is type(field.default)):
            continue
        if typing.get_origin(field.type) is tuple:
            write = writer(without_none(typing.get_args(field.type)[0]), namespace)
            for item in one:
                write(_child(element, namespace, field.tag), item)
        else:
            writer(field.type, namespace)(_child(element, namespace, field.tag), one)


# Reading


def _wrong(element: Element, what: str) -> WireError:
    return WireError(SENDER, f"{etree.QName(element).localname}: {what}")


def _text(element: Element) -> str:
    if len(element):
        raise _wrong(element, "text was expected, and there are elements in it")
    return element.text or ""


def _number(element: Element) -> float:
    text = _text(element).strip()
    try:
        if "_" in text:
            raise ValueError
        return float(text)
    except ValueError:
        raise _wrong(element, f"{text[:40]!r} is no number") from None


def _whole(element: Element) -> int:
    text = _text(element).strip()
    digits = text[1:] if text[:1] in "+-" else text
    if not (digits.isascii() and digits.isdigit() and len(digits) < 19):
        raise _wrong(element, f"{text[:40]!r} is no whole number")
    return int(text)


def _truth(element: Element) -> bool:
    text = _text(element).strip()
    if text not in ("true", "false", "1", "0"):
        raise _wrong(element, f"{text[:40]!r} is neither true nor false")
    return text in ("true", "1")


def _value(element: Element) -> float | str | bool:
    match element.get("kind", "text"):
        case "number":
            return _number(element)
        case "truth":
            return _truth(element)
        case "text":
            return _text(element)
        case kind:
            raise _wrong(element, f"kind is number, text or truth, and not {kind[:40]!r}")


_SIMPLE: dict[Any, Read] = {str: _text, float: _number, int: _whole, bool: _truth}


@cache
def reader(hint: Any, namespace: str) -> Read:
    """What makes a value of the type from an element. Raises WireError."""
    if is_value(hint):
        return _value
    members = union_of(hint)
    if len(members) > 1:
        return _union_reader({f"{{{namespace}}}{member.__name__}": member for member in members}, namespace)
    if typing.get_origin(hint) is dict:
        return _entries_reader(reader(without_none(typing.get_args(hint)[1]), namespace), f"{{{namespace}}}Entry")
    if isinstance(hint, type) and issubclass(hint, Struct):
        return lambda element: read_fields(element, hint, namespace)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return _enum_reader(hint)
    return _SIMPLE[hint]


def _enum_reader(kind: type[Enum]) -> Read:
    def read(element: Element) -> Any:
        text = _text(element).strip()
        try:
            return kind(text)
        except ValueError:
            raise _wrong(element, f"{text[:40]!r} is none of {', '.join(str(member.value) for member in kind)}") from None

    return read


def _union_reader(members: dict[str, type[Struct]], namespace: str) -> Read:
    def read(element: Element) -> Any:
        inner = _elements(element)
        if len(inner) != 1 or inner[0].tag not in members:
            raise _wrong(element, f"one of {', '.join(member.__name__ for member in members.values())} was expected in it")
        return read_fields(inner[0], members[inner[0].tag], namespace)

    return read


def _entries_reader(inner: Read, tag: str) -> Read:
    def read(element: Element) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for entry in _elements(element):
            name = entry.get("name")
            if entry.tag != tag or name is None:
                raise _wrong(element, "only Entry elements with a name were expected in it")
            if name in found:
                raise _wrong(element, f"two entries are named {name[:40]!r}")
            found[name] = inner(entry)
        return found

    return read


def _elements(element: Element) -> list[Element]:
    if element.text and element.text.strip():
        raise _wrong(element, "elements were expected, and there is text in it")
    return list(element)


def read_fields(element: Element, kind: type[Struct], namespace: str, skip: frozenset[str] = frozenset()) -> Any:
    """A Struct from the elements of its fields, in any order; those in `skip` are somebody else's."""
    known = {f"{{{namespace}}}{field.tag}": field for field in fields(kind)}
    found: dict[str, Any] = {}
    for child in _elements(element):
        if child.tag in skip:
            continue
        field = known.get(child.tag)
        if field is None:
            raise _wrong(element, f"{etree.QName(child).localname} in {etree.QName(child).namespace} is unknown in it")
        if typing.get_origin(field.type) is tuple:
            found.setdefault(field.name, []).append(reader(without_none(typing.get_args(field.type)[0]), namespace)(child))
        elif field.name in found:
            raise _wrong(element, f"{field.tag} is there twice")
        else:
            found[field.name] = reader(field.type, namespace)(child)
    for field in fields(kind):
        if typing.get_origin(field.type) is tuple:
            found[field.name] = tuple(found.get(field.name, ()))
        elif field.required and field.name not in found:
            raise _wrong(element, f"{field.tag} is missing in it")
        elif field.name not in found:
            found[field.name] = field.default
    return kind(**found)
