"""The XML Schemas of the bodies, one for each protocol's namespace, made from the annotations that `xml.py` uses.

Other SOAP stacks generate code from the schemas; tests validate the encoder's output against them. The schemas are stricter than the reader
in one point: they fix the order of a body's elements, because XSD 1.0 allows no free order for repeated elements.
"""

from __future__ import annotations

import typing
from collections.abc import Callable
from enum import Enum
from typing import Any

from lxml import etree
from msgspec import Struct

from somrs.protocol.soap.soap import FRP, NAMESPACES, SESSION
from somrs.protocol.soap.xml import Element, Field, fields, is_value, strip_none, union_of

XS = "http://www.w3.org/2001/XMLSchema"
_VALUE = "Value"
_SIMPLE = {str: "xs:string", float: "xs:double", int: "xs:long", bool: "xs:boolean"}


def schema_of(namespace: str) -> bytes:
    """Return the schema of a protocol's namespace."""
    return _Writer(namespace).document()


class _Writer:
    """A schema. Types are added when they are first referenced."""

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace
        self.root = etree.Element(f"{{{XS}}}schema", nsmap={"xs": XS, "m": namespace})
        self.root.set("targetNamespace", namespace)
        self.root.set("elementFormDefault", "qualified")
        self._named: dict[str, Any] = {}

    def document(self) -> bytes:
        for kind in NAMESPACES[self.namespace]:
            _add(self.root, "element", name=kind.__name__, type=self.type_of(kind))
        document: bytes = etree.tostring(self.root, encoding="utf-8", xml_declaration=True, pretty_print=True)
        return document

    def type_of(self, hint: Any) -> str:
        """Return the name of the schema type for an annotation."""
        if hint in _SIMPLE:
            return _SIMPLE[hint]
        if is_value(hint):
            return self._declare_type(_VALUE, hint, self._value)
        if typing.get_origin(hint) is dict:
            inner = strip_none(typing.get_args(hint)[1])
            return self._declare_type(f"Named{self.type_of(inner).rpartition(':')[2].title()}s", hint, self._entries)
        if issubclass(hint, Enum):
            return self._declare_type(hint.__name__, hint, self._enumeration)
        return self._declare_type(hint.__name__, hint, self._struct)

    def _declare_type(self, name: str, hint: Any, write: Callable[[str, Any], None]) -> str:
        if name not in self._named:
            self._named[name] = hint
            write(name, hint)
        assert self._named[name] == hint, f"two types are called {name}"
        return f"m:{name}"

    def _value(self, name: str, hint: Any) -> None:
        """Declare a number, text or truth value, distinguished by `kind`."""
        extension = self._text_with_attributes(name, "xs:string")
        attribute = _add(extension, "attribute", name="kind", default="text")
        simple = _add(_add(attribute, "simpleType"), "restriction", base="xs:string")
        for kind in ("number", "text", "truth"):
            _add(simple, "enumeration", value=kind)

    def _text_with_attributes(self, name: str, base: str) -> Element:
        return _add(_add(_add(self.root, "complexType", name=name), "simpleContent"), "extension", base=base)

    def _entries(self, name: str, hint: Any) -> None:
        inner = self.type_of(strip_none(typing.get_args(hint)[1]))
        entry = f"Named{inner.rpartition(':')[2].title()}"
        sequence = _add(_add(self.root, "complexType", name=name), "sequence")
        _add(sequence, "element", name="Entry", type=f"m:{entry}", minOccurs="0", maxOccurs="unbounded")
        _add(self._text_with_attributes(entry, inner), "attribute", name="name", type="xs:string", use="required")

    def _enumeration(self, name: str, hint: type[Enum]) -> None:
        restriction = _add(_add(self.root, "simpleType", name=name), "restriction", base="xs:token")
        for member in hint:
            _add(restriction, "enumeration", value=str(member.value))

    def _struct(self, name: str, kind: type[Struct]) -> None:
        complex_type = _add(self.root, "complexType", name=name)
        _document(complex_type, kind)
        sequence = _add(complex_type, "sequence")
        if self.namespace == FRP and kind in NAMESPACES[FRP]:
            for element in SESSION:
                optional = {"minOccurs": "0"} if element == "Version" else {}
                _add(sequence, "element", name=element, type="xs:string", **optional)
        for field in fields(kind):
            self._field(sequence, field)

    def _field(self, sequence: Element, field: Field) -> None:
        occurs = {} if field.required else {"minOccurs": "0"}
        if field.is_repeated:
            occurs["maxOccurs"] = "unbounded"
        members = union_of(field.type)
        if len(members) == 1 or is_value(field.type):
            _add(sequence, "element", name=field.tag, type=self.type_of(field.type), **occurs)
            return
        choice = _add(_add(_add(sequence, "element", name=field.tag, **occurs), "complexType"), "choice")
        for member in members:
            _add(choice, "element", name=member.__name__, type=self.type_of(member))


def _add(parent: Element, tag: str, **attributes: str) -> Element:
    return etree.SubElement(parent, f"{{{XS}}}{tag}", attributes)


def _document(element: Element, kind: type[Struct]) -> None:
    text = " ".join((kind.__doc__ or "").split())
    if text:
        _add(_add(element, "annotation"), "documentation").text = text
