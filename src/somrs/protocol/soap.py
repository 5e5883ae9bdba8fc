"""Messages as SOAP 1.2 envelopes with WS-Addressing 1.0 headers, and back; hardened against whatever comes.

What WS-Addressing has a place for is in the SOAP header. The transaction, the participant and the version of the protocol are
the first elements of a body of the Failure Recovery Protocol, where stacks that were generated from the WSDL can set them.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from lxml import etree
from msgspec import Struct

from somrs.errors import WireError
from somrs.protocol import frp
from somrs.protocol.bodies import ClientBody, DirectoryBody, FrpBody, KnowledgeBody
from somrs.protocol.envelope import ANONYMOUS, VERSION, Header, Message, message_id, normalised_id
from somrs.protocol.xml import Element, read_fields, union_of, write_fields

ENV = "http://www.w3.org/2003/05/soap-envelope"
WSA = "http://www.w3.org/2005/08/addressing"
FRP = "urn:so-mrs:frp:1.0"
DIRECTORY = "urn:so-mrs:directory:1.0"
KNOWLEDGE = "urn:so-mrs:knowledge:1.0"
CLIENTS = "urn:so-mrs:clients:1.0"
XML_LANG = "{http://www.w3.org/XML/1998/namespace}lang"

MOST_BYTES = 256 * 1024
"""The largest document that is read or written."""

MOST_DEPTH = 32
"""The deepest nesting that is read; our own documents need ten."""

MEDIA_TYPE = "application/soap+xml"
SENDER, RECEIVER = "env:Sender", "env:Receiver"
INVALID_HEADER = "wsa:InvalidAddressingHeader"
CARDINALITY = "wsa:InvalidCardinality"
HEADER_REQUIRED = "wsa:MessageAddressingHeaderRequired"
ACTION_NOT_SUPPORTED = "wsa:ActionNotSupported"
ACTION_MISMATCH = "wsa:ActionMismatch"

NAMESPACES: dict[str, tuple[type[Struct], ...]] = {
    FRP: tuple(kind for kind in union_of(FrpBody) if kind is not frp.Fault),
    DIRECTORY: union_of(DirectoryBody),
    KNOWLEDGE: union_of(KnowledgeBody),
    CLIENTS: union_of(ClientBody),
}
"""The namespace of each protocol, with its bodies. A Fault is SOAP's own."""

SESSION = ("Transaction", "Participant", "Version")
"""The elements before the fields of a body of the Failure Recovery Protocol."""

FAULT_ACTION = f"{WSA}/fault"
_PREFIXES = {"env": ENV, "wsa": WSA, "frp": FRP}
_SESSION_TAGS = frozenset(f"{{{FRP}}}{name}" for name in SESSION)


class Place(NamedTuple):
    """Where a body is at home: its namespace and its class."""

    namespace: str
    kind: type[Struct]


_BY_TAG = {f"{{{namespace}}}{kind.__name__}": Place(namespace, kind) for namespace, kinds in NAMESPACES.items() for kind in kinds}
_NAMESPACE_OF = {kind: namespace for namespace, kinds in NAMESPACES.items() for kind in kinds}


def action(kind: type[Struct]) -> str:
    """The WS-Addressing action of a type of message."""
    return FAULT_ACTION if kind is frp.Fault else f"{_NAMESPACE_OF[kind]}:{kind.__name__}"


# Writing


def encode(message: Message) -> bytes:
    """The message as a SOAP envelope. Raises WireError for what cannot be carried."""
    header = message.header
    if isinstance(message.body, frp.Fault):
        envelope, soap_header, soap_body = _envelope()
        _address(soap_header, header, FAULT_ACTION)
        _write_fault(soap_body, message.body, header)
        return _bytes(envelope)
    kind = type(message.body)
    namespace = _NAMESPACE_OF[kind]
    envelope, soap_header, soap_body = _envelope(namespace)
    _address(soap_header, header, action(kind))
    body = etree.SubElement(soap_body, f"{{{namespace}}}{kind.__name__}")
    if namespace == FRP:
        for name, value in zip(SESSION, (header.transaction, header.participant, header.version), strict=True):
            if value is not None:
                _text(body, f"{{{FRP}}}{name}", value)
    write_fields(body, message.body, namespace)
    return _bytes(envelope)


def _envelope(namespace: str | None = None) -> tuple[Element, Element, Element]:
    names = {"env": ENV, "wsa": WSA, **({"m": namespace} if namespace else {})}
    envelope = etree.Element(f"{{{ENV}}}Envelope", nsmap=names)
    return envelope, etree.SubElement(envelope, f"{{{ENV}}}Header"), etree.SubElement(envelope, f"{{{ENV}}}Body")


def _bytes(envelope: Element) -> bytes:
    document: bytes = etree.tostring(envelope, encoding="utf-8", xml_declaration=True)
    if len(document) > MOST_BYTES:
        raise WireError(SENDER, f"the message has {len(document)} bytes, and {MOST_BYTES} are the most")
    return document


def _text(parent: Element, tag: str, text: str) -> None:
    try:
        etree.SubElement(parent, tag).text = text
    except ValueError:
        raise WireError(SENDER, f"{etree.QName(tag).localname} has a character that XML cannot carry") from None


def _address(parent: Element, header: Header, action: str) -> None:
    _text(parent, f"{{{WSA}}}To", header.recipient)
    if header.sender != ANONYMOUS:
        _text(etree.SubElement(parent, f"{{{WSA}}}From"), f"{{{WSA}}}Address", header.sender)
    if header.reply_to != ANONYMOUS:
        _text(etree.SubElement(parent, f"{{{WSA}}}ReplyTo"), f"{{{WSA}}}Address", header.reply_to)
    _text(parent, f"{{{WSA}}}Action", action)
    _text(parent, f"{{{WSA}}}MessageID", header.message_id)
    if header.relates_to is not None:
        _text(parent, f"{{{WSA}}}RelatesTo", header.relates_to)


def _write_fault(parent: Element, fault: frp.Fault, header: Header | None) -> None:
    """SOAP 1.2 part 1, 5.4. A code of another namespace is a subcode of env:Sender."""
    prefix, name = _code(fault.code)
    element = etree.SubElement(parent, f"{{{ENV}}}Fault", nsmap={"frp": FRP})
    code = etree.SubElement(element, f"{{{ENV}}}Code")
    _text(code, f"{{{ENV}}}Value", f"env:{name}" if prefix == "env" else SENDER)
    if prefix != "env":
        _text(etree.SubElement(code, f"{{{ENV}}}Subcode"), f"{{{ENV}}}Value", f"{prefix}:{name}")
    reason = etree.SubElement(element, f"{{{ENV}}}Reason")
    # A reason may quote the bytes that were wrong; what XML cannot carry of them is replaced.
    said = "".join(
        c if c in "\t\n" or (c >= " " and not 0xD800 <= ord(c) <= 0xDFFF and ord(c) not in (0xFFFE, 0xFFFF)) else "?" for c in fault.text
    )
    _text(reason, f"{{{ENV}}}Text", said[:4000])
    reason[0].set(XML_LANG, "en")
    if header is not None and header.transaction is not None:
        detail = etree.SubElement(element, f"{{{ENV}}}Detail")
        for name, value in zip(SESSION, (header.transaction, header.participant, header.version), strict=True):
            if value is not None:
                _text(detail, f"{{{FRP}}}{name}", value)


def _code(code: str) -> tuple[str, str]:
    prefix, separator, name = code.rpartition(":")
    if separator and prefix in _PREFIXES and name.isidentifier():
        return prefix, name
    return "env", "Sender"


def fault(error: WireError, relates_to: str | None = None) -> bytes:
    """The SOAP Fault that tells a sender what was wrong with its message."""
    envelope, soap_header, soap_body = _envelope()
    _text(soap_header, f"{{{WSA}}}Action", FAULT_ACTION)
    if relates_to is not None:
        _text(soap_header, f"{{{WSA}}}RelatesTo", relates_to)
    if error.code == "env:VersionMismatch":
        upgrade = etree.SubElement(etree.SubElement(soap_header, f"{{{ENV}}}Upgrade"), f"{{{ENV}}}SupportedEnvelope")
        upgrade.set("qname", "env:Envelope")
    _write_fault(soap_body, frp.Fault(code=error.code, text=error.text), None)
    return _bytes(envelope)


# Reading


@lru_cache(maxsize=1)
def _parser_options() -> dict[str, Any]:
    return {
        "resolve_entities": False,
        "load_dtd": False,
        "no_network": True,
        "dtd_validation": False,
        "attribute_defaults": False,
        "huge_tree": False,
        "remove_comments": True,
        "remove_pis": True,
        "collect_ids": False,
    }


def parse(document: bytes) -> Element:
    """The root element of a document that obeys the limits. Raises WireError."""
    if len(document) > MOST_BYTES:
        raise WireError(SENDER, f"the document has {len(document)} bytes, and {MOST_BYTES} are the most")
    try:
        root = etree.fromstring(document, etree.XMLParser(**_parser_options()))
    except (etree.XMLSyntaxError, ValueError, LookupError) as error:
        raise WireError(SENDER, f"this is no XML: {str(error)[:200]}") from None
    tree = root.getroottree()
    if tree.docinfo.internalDTD is not None or tree.docinfo.doctype:
        raise WireError(SENDER, "a document type declaration is not taken; send the document without one")
    _check_depth(root)
    return root


def _check_depth(root: Element) -> None:
    level, depth = [root], 0
    while level:
        depth += 1
        if depth > MOST_DEPTH:
            raise WireError(SENDER, f"the document is nested more than {MOST_DEPTH} deep")
        level = [child for element in level for child in element]


def decode(document: bytes) -> Message:
    """The message in a SOAP envelope. Raises WireError, and nothing else, whatever the bytes are."""
    root = parse(document)
    header, body = _parts(root)
    found = _headers(header)
    content = list(body)
    if len(content) != 1:
        raise WireError(SENDER, f"the Body has {len(content)} elements, and one was expected")
    element = content[0]
    if element.tag == f"{{{ENV}}}Fault":
        return _read_fault(element, found)
    place = _BY_TAG.get(str(element.tag))
    if place is None:
        raise WireError(ACTION_NOT_SUPPORTED, f"{_short(element.tag)} is no message that is known here")
    if "Action" not in found:
        raise WireError(HEADER_REQUIRED, "the header wsa:Action is missing")
    if found["Action"] != action(place.kind):
        raise WireError(
            ACTION_MISMATCH, f"the Action is {_short(found['Action'])}, and the Body a {place.kind.__name__}: {action(place.kind)}"
        )
    if "MessageID" not in found:
        raise WireError(HEADER_REQUIRED, "the header wsa:MessageID is missing")
    session = _session(element) if place.namespace == FRP else {}
    if session.get("Version", VERSION) != VERSION:
        raise WireError("frp:UnknownVersion", f"version {session['Version'][:20]} of the protocol is unknown; {VERSION} is spoken here")
    value = read_fields(element, place.kind, place.namespace, _SESSION_TAGS if place.namespace == FRP else frozenset())
    return Message(header=_header(found, session), body=value)


def _short(text: object) -> str:
    return str(text)[:120]


def _parts(root: Element) -> tuple[Element | None, Element]:
    name = etree.QName(root)
    if name.localname == "Envelope" and name.namespace != ENV:
        raise WireError("env:VersionMismatch", f"SOAP 1.2 is spoken here, and this is an envelope of {_short(name.namespace)}")
    if root.tag != f"{{{ENV}}}Envelope":
        raise WireError(SENDER, f"a SOAP Envelope was expected, and this is {_short(root.tag)}")
    children = list(root)
    header = children[0] if children and children[0].tag == f"{{{ENV}}}Header" else None
    rest = children[1:] if header is not None else children
    if len(rest) != 1 or rest[0].tag != f"{{{ENV}}}Body":
        raise WireError(SENDER, "an Envelope holds one Body, behind at most one Header")
    return header, rest[0]


def _headers(header: Element | None) -> dict[str, str]:
    """The WS-Addressing headers by name; addresses of endpoint references as such."""
    found: dict[str, str] = {}
    for block in header if header is not None else ():
        name = etree.QName(block)
        if name.namespace != WSA:
            if block.get(f"{{{ENV}}}mustUnderstand", "false").strip() in ("true", "1"):
                raise WireError("env:MustUnderstand", f"the header {_short(block.tag)} is not understood here")
            continue
        if name.localname in ("To", "Action", "MessageID"):
            value = (block.text or "").strip()
        elif name.localname in ("From", "ReplyTo", "FaultTo"):
            value = (block.findtext(f"{{{WSA}}}Address") or "").strip()
        elif name.localname == "RelatesTo":
            if block.get("RelationshipType", f"{WSA}/reply") != f"{WSA}/reply":
                continue
            value = (block.text or "").strip()
        else:
            continue
        if name.localname in found:
            raise WireError(CARDINALITY, f"the header wsa:{name.localname} is there more than once")
        if not value:
            raise WireError(INVALID_HEADER, f"the header wsa:{name.localname} is empty")
        found[name.localname] = value
    return found


def _session(body: Element) -> dict[str, str]:
    found: dict[str, str] = {}
    for child in body:
        if child.tag in _SESSION_TAGS:
            name = etree.QName(child).localname
            if name in found:
                raise WireError(SENDER, f"{name} is there twice")
            found[name] = (child.text or "").strip()
    return found


def _header(found: dict[str, str], session: dict[str, str]) -> Header:
    return Header(
        sender=found.get("From", ANONYMOUS),
        recipient=found.get("To", ANONYMOUS),
        message_id=normalised_id(found.get("MessageID") or message_id("fault", found.get("RelatesTo"))),
        relates_to=normalised_id(found["RelatesTo"]) if "RelatesTo" in found else None,
        reply_to=found.get("ReplyTo", ANONYMOUS),
        transaction=normalised_id(session["Transaction"]) if session.get("Transaction") else None,
        participant=session.get("Participant") or None,
    )


def _read_fault(element: Element, found: dict[str, str]) -> Message:
    value = element.findtext(f"{{{ENV}}}Code/{{{ENV}}}Value") or SENDER
    sub = element.findtext(f"{{{ENV}}}Code/{{{ENV}}}Subcode/{{{ENV}}}Value")
    text = element.findtext(f"{{{ENV}}}Reason/{{{ENV}}}Text") or "no reason was given"
    detail = element.find(f"{{{ENV}}}Detail")
    session = _session(detail) if detail is not None else {}
    prefix, name = (sub or value).strip().rpartition(":")[::2]
    known = prefix if sub else "env"
    return Message(header=_header(found, session), body=frp.Fault(code=f"{known}:{name}", text=text))
