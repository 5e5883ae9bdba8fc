"""Convert msgspec Structs to XML and back, according to the Structs' annotations.

A field is an element with a name in UpperCamelCase. None, and a value equal to the field's default, is left out. A tuple is a repeated
element. A mapping holds `Entry` elements with a `name`. A union holds one element, named after the Struct. `xsd.py` writes the schemas.
"""

from __future__ import annotations

import math
import operator
import re
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
Write = Callable[[list[str], str, str, Any], None]
"""Writes a value as an element to a document: with this name and these attributes."""

WriteFields = Callable[[list[str], Any], None]
"""Writes the fields of a Struct as elements to a document."""

Read = Callable[[Element], Any]
_SENDER = "env:Sender"

MOST_WHOLE = 10**18 - 1
"""The largest whole number: every stack can read this many digits."""


class Field(NamedTuple):
    """A field of a Struct: its names in Python and in XML, the type of one element, and its default."""

    name: str
    tag: str
    type: Any
    is_repeated: bool
    """Whether the field is a tuple, which is written as a repeated element."""
    default: Any
    required: bool


def camel(name: str) -> str:
    """Return a name in UpperCamelCase: `TermsId` for `terms_id`."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))


@cache
def fields(kind: type[Struct]) -> tuple[Field, ...]:
    """Return the fields of a Struct, in order."""
    hints = typing.get_type_hints(kind)
    field_list = []
    for info in structs.fields(kind):
        declared_default = info.default_factory() if info.default_factory is not NODEFAULT else info.default
        hint = strip_none(hints[info.name])
        is_repeated = typing.get_origin(hint) is tuple
        # None is written by leaving the element out, so a field that may be None is not required, even if it has no default.
        default = None if declared_default is NODEFAULT and type(None) in union_of(hints[info.name]) else declared_default
        element = strip_none(typing.get_args(hint)[0]) if is_repeated else hint
        field_list.append(
            Field(info.name, camel(info.encode_name), element, is_repeated, default, default is NODEFAULT and not is_repeated)
        )
    return tuple(field_list)


def union_of(hint: Any) -> tuple[Any, ...]:
    """Return the members of a union; of any other type, the type itself."""
    return typing.get_args(hint) if typing.get_origin(hint) in (Union, types.UnionType) else (hint,)


def strip_none(hint: Any) -> Any:
    members = [member for member in union_of(hint) if member is not type(None)]
    return reduce(operator.or_, members)


def is_value(hint: Any) -> bool:
    """Whether the type is a number, text or truth value, distinguished by an attribute `kind`."""
    return set(union_of(hint)) == set(union_of(Value))


def text_of(value: float | str | bool) -> str:
    """Return a simple value in the notation of XML Schema."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float | int):
        if math.isinf(value):
            return "INF" if value > 0 else "-INF"
        return "NaN" if math.isnan(value) else repr(value)
    return value


# Writing. The writer of a type is created once. It writes text: building a tree and serialising it with lxml takes four times as long.

PREFIX = "m:"
"""The prefix of the protocol's namespace, to which all elements of a body belong."""

_SPECIAL = re.compile("[^\\t\\n\\x20-\\ud7ff\\ue000-\\ufffd\\U00010000-\\U0010ffff]|[&<>]")
"""Characters that are escaped, or not allowed in XML. A carriage return is escaped because parsers turn it into a line feed."""

_ESCAPES = {"&": "&amp;", "<": "&lt;", ">": "&gt;", "\r": "&#13;"}
_ATTRIBUTE_ESCAPES = {'"': "&quot;", "\n": "&#10;", "\t": "&#9;"}


def escaped(text: str) -> str:
    """Return the text, escaped for use between two tags. Raises ValueError for characters that XML cannot carry."""
    # XML can carry every printable character; this check first makes the function three times as fast.
    if text.isprintable() and "&" not in text and "<" not in text and ">" not in text:
        return text
    return _SPECIAL.sub(_escape, text)


def escaped_attribute(text: str) -> str:
    """Return the text, escaped for use between quotes. Raises ValueError for characters that XML cannot carry."""
    text = escaped(text)
    for special, written in _ATTRIBUTE_ESCAPES.items():
        text = text.replace(special, written)
    return text


def _escape(match: re.Match[str]) -> str:
    try:
        return _ESCAPES[match[0]]
    except KeyError:
        raise ValueError(f"XML cannot carry {match[0]!r}") from None


def _write_text(document: list[str], name: str, attributes: str, text: str) -> None:
    try:
        document.append(f"<{name}{attributes}>{escaped(text)}</{name}>")
    except ValueError:
        raise WireError(_SENDER, f"{_local(name)}: this text has a character that XML cannot carry: {text[:60]!r}") from None


def _write_simple(document: list[str], name: str, attributes: str, value: float | bool) -> None:
    document.append(f"<{name}{attributes}>{text_of(value)}</{name}>")


def _write_whole(document: list[str], name: str, attributes: str, value: int) -> None:
    if abs(value) > MOST_WHOLE:
        raise WireError(_SENDER, f"{_local(name)}: whole numbers have up to 18 digits, and this is {value!r:.40}")
    document.append(f"<{name}{attributes}>{int(value)!r}</{name}>")


def _write_value(document: list[str], name: str, attributes: str, value: float | str | bool) -> None:
    kind = "truth" if isinstance(value, bool) else "text" if isinstance(value, str) else "number"
    _write_text(document, name, f'{attributes} kind="{kind}"', text_of(value))


def _local(name: str) -> str:
    return name.removeprefix(PREFIX)


_WRITE_SIMPLE: dict[Any, Write] = {str: _write_text, float: _write_simple, int: _write_whole, bool: _write_simple}


@cache
def writer(hint: Any) -> Write:
    """Return the function that writes a value of the type. The function raises WireError for values that XML cannot carry."""
    if is_value(hint):
        return _write_value
    members = union_of(hint)
    if len(members) > 1:
        return _union_writer({member: (f"{PREFIX}{member.__name__}", writer(member)) for member in members})
    if typing.get_origin(hint) is dict:
        return _entries_writer(writer(strip_none(typing.get_args(hint)[1])))
    if isinstance(hint, type) and issubclass(hint, Struct):
        return _struct_writer(fields_writer(hint))
    if isinstance(hint, type) and issubclass(hint, Enum):
        return lambda document, name, attributes, value: _write_text(document, name, attributes, str(value))
    return _WRITE_SIMPLE[hint]


def _union_writer(members: dict[type[Struct], tuple[str, Write]]) -> Write:
    def write(document: list[str], name: str, attributes: str, value: Struct) -> None:
        document.append(f"<{name}{attributes}>")
        member, inner = members[type(value)]
        inner(document, member, "", value)
        document.append(f"</{name}>")

    return write


def _entries_writer(inner: Write) -> Write:
    entry = f"{PREFIX}Entry"

    def write(document: list[str], name: str, attributes: str, value: dict[str, Any]) -> None:
        document.append(f"<{name}{attributes}>")
        for key, item in value.items():
            try:
                named = f' name="{escaped_attribute(key)}"'
            except ValueError:
                raise WireError(_SENDER, f"a name has a character that XML cannot carry: {key[:60]!r}") from None
            inner(document, entry, named, item)
        document.append(f"</{name}>")

    return write


def _struct_writer(inner: WriteFields) -> Write:
    def write(document: list[str], name: str, attributes: str, value: Struct) -> None:
        document.append(f"<{name}{attributes}>")
        inner(document, value)
        document.append(f"</{name}>")

    return write


@cache
def fields_writer(kind: type[Struct]) -> WriteFields:
    """Return the function that writes the fields of a Struct."""
    plan = [(field, f"{PREFIX}{field.tag}", writer(field.type)) for field in fields(kind)]

    def write(document: list[str], value: Struct) -> None:
        for (attribute, _, _, is_repeated, default, required), name, inner in plan:
            field_value = getattr(value, attribute)
            if field_value is None or (not required and field_value == default and type(field_value) is type(default)):
                continue
            if is_repeated:
                for item in field_value:
                    inner(document, name, "", item)
            else:
                inner(document, name, "", field_value)

    return write


# Reading. The reader of a type is created once.


def _wrong(element: Element, problem: str) -> WireError:
    return WireError(_SENDER, f"{etree.QName(element).localname}: {problem}")


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
    """Return the function that reads a value of the type. The function raises WireError."""
    if is_value(hint):
        return _value
    members = union_of(hint)
    if len(members) > 1:
        return _union_reader({f"{{{namespace}}}{member.__name__}": reader(member, namespace) for member in members})
    if typing.get_origin(hint) is dict:
        return _entries_reader(reader(strip_none(typing.get_args(hint)[1]), namespace), f"{{{namespace}}}Entry")
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
        entries: dict[str, Any] = {}
        for entry in _elements(element):
            name = entry.get("name")
            if entry.tag != tag or name is None:
                raise _wrong(element, "only Entry elements with a name were expected in it")
            if name in entries:
                raise _wrong(element, f"two entries are named {name[:40]!r}")
            entries[name] = inner(entry)
        return entries

    return read


def _elements(element: Element) -> list[Element]:
    if element.text and element.text.strip():
        raise _wrong(element, "elements were expected, and there is text in it")
    return list(element)


@cache
def struct_reader(kind: type[Struct], namespace: str, skip: frozenset[str] = frozenset()) -> Read:
    """Return the function that reads a Struct from the elements of its fields, in any order. It ignores the elements in `skip`."""
    slots = {f"{{{namespace}}}{field.tag}": (field, reader(field.type, namespace)) for field in fields(kind)}
    all_fields = fields(kind)

    def read(element: Element) -> Any:
        values: dict[str, Any] = {}
        for child in _elements(element):
            if (slot := slots.get(child.tag)) is None:
                if child.tag in skip:
                    continue
                raise _wrong(element, f"{etree.QName(child).localname} in {etree.QName(child).namespace} is unknown in it")
            field, inner = slot
            if field.is_repeated:
                values.setdefault(field.name, []).append(inner(child))
            elif field.name in values:
                raise _wrong(element, f"{field.tag} is there twice")
            else:
                values[field.name] = inner(child)
        for name, tag, _, is_repeated, default, required in all_fields:
            if is_repeated:
                values[name] = tuple(values.get(name, ()))
            elif name not in values:
                if required:
                    raise _wrong(element, f"{tag} is missing in it")
                values[name] = default
        return kind(**values)

    return read
