"""Between msgspec Structs and XML elements, driven by the Structs' annotations alone.

A field is an element in UpperCamelCase; None, and what equals its default, is left out. A tuple is the element repeated, a mapping
holds `Entry` elements with a `name`, a union holds one element named by the Struct that it is. `xsd.py` writes the same as a schema.
"""

from __future__ import annotations

import math
import operator
import types
import typing
from collections.abc import Callable
from enum import Enum
from functools import cache, reduce
from typing import Any, NamedTuple, Union

from lxml import etree
from msgspec import NODEFAULT, Struct, structs

from somrs.errors import WireError
from somrs.ontology.types import Value

Element = etree._Element
Write = Callable[[Element, Any], None]
Read = Callable[[Element], Any]
SENDER = "env:Sender"

MOST_WHOLE = 10**18 - 1
"""The largest whole number: so many digits every stack can read."""


class Field(NamedTuple):
    """One field of a Struct: its names in Python and in XML, the type of one element of it, and how it is left out."""

    name: str
    tag: str
    type: Any
    many: bool
    """Whether it is a tuple, which is the element repeated."""
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
        hint = without_none(hints[info.name])
        many = typing.get_origin(hint) is tuple
        # None is written by leaving the element out, so a field that may be None is not required, whatever Python says.
        default = None if given is NODEFAULT and type(None) in union_of(hints[info.name]) else given
        element = without_none(typing.get_args(hint)[0]) if many else hint
        found.append(Field(info.name, camel(info.name), element, many, default, default is NODEFAULT and not many))
    return tuple(found)


def union_of(hint: Any) -> tuple[Any, ...]:
    """The members of a union; of anything else, itself."""
    return typing.get_args(hint) if typing.get_origin(hint) in (Union, types.UnionType) else (hint,)


def without_none(hint: Any) -> Any:
    left = [member for member in union_of(hint) if member is not type(None)]
    return reduce(operator.or_, left)


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


# Writing. What fills an element with a value of a type is made once for each type and namespace.


def _write_text(element: Element, text: str) -> None:
    try:
        element.text = text
    except ValueError:
        raise WireError(
            SENDER, f"{etree.QName(element).localname}: this text has a character that XML cannot carry: {text[:60]!r}"
        ) from None


def _write_simple(element: Element, value: float | bool) -> None:
    element.text = text_of(value)


def _write_whole(element: Element, value: int) -> None:
    if abs(value) > MOST_WHOLE:
        raise WireError(SENDER, f"{etree.QName(element).localname}: whole numbers have up to 18 digits, and this is {value!r:.40}")
    element.text = repr(int(value))


def _write_value(element: Element, value: float | str | bool) -> None:
    element.set("kind", "truth" if isinstance(value, bool) else "text" if isinstance(value, str) else "number")
    _write_text(element, text_of(value))


_WRITE_SIMPLE: dict[Any, Write] = {str: _write_text, float: _write_simple, int: _write_whole, bool: _write_simple}


@cache
def writer(hint: Any, namespace: str) -> Write:
    """What fills an element with a value of the type. Raises WireError for what XML cannot carry."""
    if is_value(hint):
        return _write_value
    members = union_of(hint)
    if len(members) > 1:
        return _union_writer({member: (f"{{{namespace}}}{member.__name__}", writer(member, namespace)) for member in members})
    if typing.get_origin(hint) is dict:
        return _entries_writer(writer(without_none(typing.get_args(hint)[1]), namespace), f"{{{namespace}}}Entry")
    if isinstance(hint, type) and issubclass(hint, Struct):
        return _struct_writer(hint, namespace)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return lambda element, value: _write_text(element, str(value))
    return _WRITE_SIMPLE[hint]


def _union_writer(members: dict[type[Struct], tuple[str, Write]]) -> Write:
    def write(element: Element, value: Struct) -> None:
        tag, inner = members[type(value)]
        inner(etree.SubElement(element, tag), value)

    return write


def _entries_writer(inner: Write, tag: str) -> Write:
    def write(element: Element, value: dict[str, Any]) -> None:
        for name, one in value.items():
            entry = etree.SubElement(element, tag)
            try:
                entry.set("name", name)
            except ValueError:
                raise WireError(SENDER, f"a name has a character that XML cannot carry: {name[:60]!r}") from None
            inner(entry, one)

    return write


def _struct_writer(kind: type[Struct], namespace: str) -> Write:
    plan = [(field, f"{{{namespace}}}{field.tag}", writer(field.type, namespace)) for field in fields(kind)]

    def write(element: Element, value: Struct) -> None:
        for (name, _, _, many, default, required), tag, inner in plan:
            one = getattr(value, name)
            if one is None or (not required and one == default and type(one) is type(default)):
                continue
            if many:
                for item in one:
                    inner(etree.SubElement(element, tag), item)
            else:
                inner(etree.SubElement(element, tag), one)

    return write


# Reading, likewise


def _wrong(element: Element, what: str) -> WireError:
    return WireError(SENDER, f"{etree.QName(element).localname}: {what}")


def _text(element: Element) -> str:
    if len(element):
        raise _wrong(element, "text was expected, and there are elements in it")
    return element.text or ""


def _number(element: Element) -> float:
    text = _text(element).strip()
    try:
        if "_" in text or not text.isascii():
            raise ValueError
        return float(text)
    except ValueError:
        raise _wrong(element, f"{text[:40]!r} is no number") from None


def _whole(element: Element) -> int:
    text = _text(element).strip()
    digits = text[1:] if text[:1] in ("+", "-") else text
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 18):
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


_READ_SIMPLE: dict[Any, Read] = {str: _text, float: _number, int: _whole, bool: _truth}


@cache
def reader(hint: Any, namespace: str) -> Read:
    """What makes a value of the type from an element. Raises WireError."""
    if is_value(hint):
        return _value
    members = union_of(hint)
    if len(members) > 1:
        return _union_reader({f"{{{namespace}}}{member.__name__}": reader(member, namespace) for member in members})
    if typing.get_origin(hint) is dict:
        return _entries_reader(reader(without_none(typing.get_args(hint)[1]), namespace), f"{{{namespace}}}Entry")
    if isinstance(hint, type) and issubclass(hint, Struct):
        return struct_reader(hint, namespace)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return _enum_reader(hint)
    return _READ_SIMPLE[hint]


def _enum_reader(kind: type[Enum]) -> Read:
    def read(element: Element) -> Any:
        text = _text(element).strip()
        try:
            return kind(text)
        except ValueError:
            raise _wrong(element, f"{text[:40]!r} is none of {', '.join(str(member.value) for member in kind)}") from None

    return read


def _union_reader(members: dict[str, Read]) -> Read:
    names = ", ".join(etree.QName(tag).localname for tag in members)

    def read(element: Element) -> Any:
        inner = _elements(element)
        if len(inner) != 1 or inner[0].tag not in members:
            raise _wrong(element, f"one of {names} was expected in it")
        return members[inner[0].tag](inner[0])

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


@cache
def struct_reader(kind: type[Struct], namespace: str, skip: frozenset[str] = frozenset()) -> Read:
    """What makes a Struct from the elements of its fields, in any order; those in `skip` are somebody else's."""
    known = {f"{{{namespace}}}{field.tag}": (field, reader(field.type, namespace)) for field in fields(kind)}
    all_fields = fields(kind)

    def read(element: Element) -> Any:
        found: dict[str, Any] = {}
        for child in _elements(element):
            if (slot := known.get(child.tag)) is None:
                if child.tag in skip:
                    continue
                raise _wrong(element, f"{etree.QName(child).localname} in {etree.QName(child).namespace} is unknown in it")
            field, inner = slot
            if field.many:
                found.setdefault(field.name, []).append(inner(child))
            elif field.name in found:
                raise _wrong(element, f"{field.tag} is there twice")
            else:
                found[field.name] = inner(child)
        for name, tag, _, many, default, required in all_fields:
            if many:
                found[name] = tuple(found.get(name, ()))
            elif name not in found:
                if required:
                    raise _wrong(element, f"{tag} is missing in it")
                found[name] = default
        return kind(**found)

    return read
