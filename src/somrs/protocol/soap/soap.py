"""Encode messages as SOAP 1.2 envelopes with WS-Addressing 1.0 headers, and decode them from untrusted bytes.

Values for which WS-Addressing has a header are in the SOAP header. The transaction, the participant and the version of the protocol are the
first elements of a body of the Failure Recovery Protocol, where stacks generated from the WSDL can set them. A refusal is a SOAP Fault with
the answer in its Detail, as stacks expect of a fault that a WSDL declares.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from lxml import etree
from msgspec import Struct

from somrs.errors import WireError
from somrs.protocol.messages import frp, knowledge, submission
from somrs.protocol.messages.bodies import REQUESTS, ClientBody, DirectoryBody, FrpBody, KnowledgeBody, OrderBody, TrafficBody
from somrs.protocol.messages.envelope import ANONYMOUS, VERSION, Header, Message, message_id, normalised_id
from somrs.protocol.soap.document import MOST_BYTES, SENDER, parse
from somrs.protocol.soap.xml import PREFIX, Element, escaped, escaped_attribute, fields_writer, struct_reader, union_of

ENV = "http://www.w3.org/2003/05/soap-envelope"
WSA = "http://www.w3.org/2005/08/addressing"
FRP = "urn:so-mrs:frp:1.0"
DIRECTORY = "urn:so-mrs:directory:1.0"
KNOWLEDGE = "urn:so-mrs:knowledge:1.0"
CLIENTS = "urn:so-mrs:clients:1.0"
ORDERS = "urn:so-mrs:orders:1.0"
TRAFFIC = "urn:so-mrs:traffic:1.0"
XML = "http://www.w3.org/XML/1998/namespace"

MOST_REASON = 4000
"""The maximal length of a Fault's reason, in characters."""

MOST_MISSED, MOST_NAME = 20, 500
"""The maximal number of header blocks that a Fault names as not understood, and the maximal length of such a name."""

MEDIA_TYPE = "application/soap+xml"
RECEIVER = "env:Receiver"
INVALID_HEADER = "wsa:InvalidAddressingHeader"
CARDINALITY = "wsa:InvalidCardinality"
NO_ADDRESS = "wsa:MissingAddressInEPR"
HEADER_REQUIRED = "wsa:MessageAddressingHeaderRequired"
ACTION_NOT_SUPPORTED = "wsa:ActionNotSupported"
ACTION_MISMATCH = "wsa:ActionMismatch"
UNAVAILABLE = "wsa:EndpointUnavailable"
"""The recipient cannot process the message now (WS-Addressing 1.0 SOAP Binding, 6.4.5): it is safe to send the same message again."""

NAMESPACES: dict[str, tuple[type[Struct], ...]] = {
    FRP: tuple(kind for kind in union_of(FrpBody) if kind is not frp.Fault),
    DIRECTORY: union_of(DirectoryBody),
    KNOWLEDGE: union_of(KnowledgeBody),
    CLIENTS: union_of(ClientBody),
    ORDERS: union_of(OrderBody),
    TRAFFIC: union_of(TrafficBody),
}
"""The bodies of each protocol, by its namespace. A Fault is SOAP's own."""

SESSION = ("Transaction", "Participant", "Version")
"""The elements before the fields of a body of the Failure Recovery Protocol."""

REFUSALS = frozenset(kind for answers in REQUESTS.values() for kind in answers[1:])
"""The answers that refuse a request."""

_FAULT_ACTION = f"{WSA}/fault"
_NOT_XML = re.compile("[^\\t\\n\\r\\x20-\\ud7ff\\ue000-\\ufffd\\U00010000-\\U0010ffff]")
_OWN_ROLES = (None, "", f"{ENV}/role/next", f"{ENV}/role/ultimateReceiver")
_PREFIXES = {"env": ENV, "wsa": WSA, "frp": FRP}
_SOAP_CODES = ("Sender", "Receiver", "VersionMismatch", "MustUnderstand", "DataEncodingUnknown")
# WS-Addressing 1.0 SOAP Binding, 6.4.1: the subcodes of InvalidAddressingHeader.
_BENEATH_INVALID_HEADER = (CARDINALITY, ACTION_MISMATCH, NO_ADDRESS, "wsa:InvalidAddress", "wsa:InvalidEPR", "wsa:DuplicateMessageID")
_ADDRESSING = ("To", "From", "ReplyTo", "FaultTo", "Action", "MessageID", "RelatesTo")
_ADDRESSING_TAGS = {f"{{{WSA}}}{name}": name for name in _ADDRESSING}
_SESSION_TAGS = {f"{{{FRP}}}{name}": name for name in SESSION}
_SESSION = frozenset(_SESSION_TAGS)
_ENVELOPE = f"{{{ENV}}}Envelope"
_ROLE, _MUST_UNDERSTAND = f"{{{ENV}}}role", f"{{{ENV}}}mustUnderstand"


class _BodyType(NamedTuple):
    """The namespace and the class of a body."""

    namespace: str
    kind: type[Struct]


_BY_TAG = {f"{{{namespace}}}{kind.__name__}": _BodyType(namespace, kind) for namespace, kinds in NAMESPACES.items() for kind in kinds}
_NAMESPACE_OF = {kind: namespace for namespace, kinds in NAMESPACES.items() for kind in kinds}


def namespace_of(kind: type[Struct]) -> str:
    """Return the namespace of a body other than a Fault."""
    return _NAMESPACE_OF[kind]


def action(kind: type[Struct]) -> str:
    """Return the WS-Addressing action of a type of message."""
    return _FAULT_ACTION if kind is frp.Fault else f"{_NAMESPACE_OF[kind]}:{kind.__name__}"


# Writing


def encode(message: Message) -> bytes:
    """Return the message as a SOAP envelope. Raises WireError when it is too large or has a character that XML cannot carry."""
    header, body = message.header, message.body
    kind = type(body)
    namespace = _NAMESPACE_OF.get(kind)
    document = [_start(namespace)]
    _address(document, header, action(kind))
    document.append(_BODY_START)
    if isinstance(body, frp.Fault):
        session: list[str] = []
        if header.transaction is not None:
            _write_session(session, "frp:", header)
        _write_fault(document, body, session)
    else:
        content: list[str] = []
        name = f"{PREFIX}{kind.__name__}"
        content.append(f"<{name}>")
        if namespace == FRP:
            _write_session(content, PREFIX, header)
        fields_writer(kind)(content, body)
        content.append(f"</{name}>")
        if kind in REFUSALS:
            _write_fault(document, frp.Fault(code=SENDER, text=_reason(body)), content)
        else:
            document += content
    return _bytes(document)


_BODY_START = "</env:Header><env:Body>"
_BODY_END = "</env:Body></env:Envelope>"


def _start(namespace: str | None = None) -> str:
    ours = f' xmlns:m="{namespace}"' if namespace else ""
    return f"<?xml version='1.0' encoding='utf-8'?>\n<env:Envelope xmlns:env=\"{ENV}\" xmlns:wsa=\"{WSA}\"{ours}><env:Header>"


def _bytes(document: list[str]) -> bytes:
    document.append(_BODY_END)
    written = "".join(document).encode()
    if len(written) > MOST_BYTES:
        raise WireError(SENDER, f"the message has {len(written)} bytes; the limit is {MOST_BYTES}")
    return written


def _element(name: str, text: str) -> str:
    try:
        return f"<{name}>{escaped(text)}</{name}>"
    except ValueError:
        raise WireError(SENDER, f"{name.partition(':')[2]} has a character that XML cannot carry") from None


def _address(document: list[str], header: Header, action: str) -> None:
    document.append(_element("wsa:To", header.recipient))
    if header.sender != ANONYMOUS:
        document.append(f"<wsa:From>{_element('wsa:Address', header.sender)}</wsa:From>")
    if header.reply_to != ANONYMOUS:
        document.append(f"<wsa:ReplyTo>{_element('wsa:Address', header.reply_to)}</wsa:ReplyTo>")
    document += (_element("wsa:Action", action), _element("wsa:MessageID", header.message_id))
    if header.relates_to is not None:
        document.append(_element("wsa:RelatesTo", header.relates_to))


def _write_session(document: list[str], prefix: str, header: Header) -> None:
    for name, value in zip(SESSION, (header.transaction, header.participant, header.version), strict=True):
        if value is not None:
            document.append(_element(f"{prefix}{name}", value))


def _reason(body: Struct) -> str:
    """Return the text of a refusal, for stacks that show the Reason only."""
    match body:
        case knowledge.Rejected(problems=problems):
            return "\n".join(problems)
        case submission.TaskRejected(problem=problem):
            return problem
        case _:
            return type(body).__name__


def _write_fault(document: list[str], fault: frp.Fault, detail: list[str]) -> None:
    """Write a Fault (SOAP 1.2 part 1, 5.4).

    A code of another namespace becomes a subcode of env:Sender, of env:Receiver, or of the code above it in WS-Addressing.
    """
    prefix, name = _code(fault.code)
    codes = [f"env:{name}"] if prefix == "env" else [RECEIVER if name == "EndpointUnavailable" else SENDER, f"{prefix}:{name}"]
    if codes[-1] in _BENEATH_INVALID_HEADER:
        codes.insert(1, INVALID_HEADER)
    document.append(f'<env:Fault xmlns:frp="{FRP}"><env:Code>')
    document.append("<env:Subcode>".join(f"<env:Value>{code}</env:Value>" for code in codes))
    document.append("</env:Subcode>" * (len(codes) - 1))
    # A reason may quote wrong bytes; characters that XML cannot carry are replaced.
    text = escaped(_NOT_XML.sub("?", fault.text)[:MOST_REASON])
    document.append(f'</env:Code><env:Reason><env:Text xml:lang="en">{text}</env:Text></env:Reason>')
    if detail:
        document += ("<env:Detail>", *detail, "</env:Detail>")
    document.append("</env:Fault>")


def _code(code: str) -> tuple[str, str]:
    """Return the prefix and the name of a fault code. A name without a prefix belongs to SOAP, or else to WS-Addressing."""
    prefix, separator, name = code.rpartition(":")
    if not separator:
        prefix = "env" if name in _SOAP_CODES else "wsa"
    if prefix in _PREFIXES and name.isidentifier() and (prefix != "env" or name in _SOAP_CODES):
        return prefix, name
    return "env", "Sender"


def fault(error: WireError, relates_to: str | None = None) -> bytes:
    """Return the SOAP Fault that reports the error to the sender, with the headers of SOAP 1.2 part 1, 5.4.7 and 5.4.8."""
    document = [_start(), _element("wsa:Action", _FAULT_ACTION)]
    if relates_to is not None:
        document.append(_element("wsa:RelatesTo", relates_to))
    if error.code == "env:VersionMismatch":
        document.append('<env:Upgrade><env:SupportedEnvelope qname="env:Envelope"/></env:Upgrade>')
    for tag in error.headers:
        block = etree.QName(tag)
        prefix = "xml" if block.namespace == XML else "h"  # XML's own namespace has no other prefix
        names = f' xmlns:h="{escaped_attribute(block.namespace)}"' if block.namespace and prefix == "h" else ""
        name = f"{prefix}:{block.localname}" if block.namespace else block.localname
        document.append(f'<env:NotUnderstood{names} qname="{name}"/>')
    document.append(_BODY_START)
    _write_fault(document, frp.Fault(code=error.code, text=error.text), [])
    return _bytes(document)


# Reading


def decode(document: bytes) -> Message:
    """Return the message in a SOAP envelope. Raises WireError, and nothing else, for any invalid bytes."""
    root = parse(document)
    header, body = _parts(root)
    headers = _headers(header)
    content = list(body)
    if len(content) != 1:
        raise WireError(SENDER, f"the Body has {len(content)} elements, and one was expected")
    element = content[0]
    if element.tag == f"{{{ENV}}}Fault":
        return _read_fault(element, headers)
    body_type = _body_type(element, headers)
    session = _session(element) if body_type.namespace == FRP else {}
    if session.get("Version", VERSION) != VERSION:
        raise WireError("frp:UnknownVersion", f"version {session['Version'][:20]} of the protocol is unknown; supported: {VERSION}")
    if body_type.namespace == FRP and not (session.get("Transaction") and session.get("Participant")):
        raise WireError(SENDER, f"{body_type.kind.__name__}: Transaction and Participant must be present, and not empty")
    value = struct_reader(body_type.kind, body_type.namespace, _SESSION if body_type.namespace == FRP else frozenset())(element)
    return Message(header=_header(headers, session), body=value)


def _body_type(element: Element, headers: dict[str, str]) -> _BodyType:
    """Return the type of the body, after checking that the headers match it."""
    body_type = _BY_TAG.get(str(element.tag))
    if body_type is None:
        namespace = etree.QName(element).namespace or ""
        if namespace.startswith("urn:so-mrs:frp:") and namespace != FRP:
            raise WireError("frp:UnknownVersion", f"{_short(namespace)} is an unknown version of the protocol; supported: {FRP}")
        raise WireError(ACTION_NOT_SUPPORTED, f"{_short(element.tag)} is not a known message")
    if "Action" not in headers:
        raise WireError(HEADER_REQUIRED, "the header wsa:Action is missing")
    if headers["Action"] != action(body_type.kind):
        raise WireError(
            ACTION_MISMATCH,
            f"the Action is {_short(headers['Action'])}, and the Body a {body_type.kind.__name__}: {action(body_type.kind)}",
        )
    if "MessageID" not in headers:
        raise WireError(HEADER_REQUIRED, "the header wsa:MessageID is missing")
    return body_type


def _short(text: object) -> str:
    return str(text)[:120]


def _parts(root: Element) -> tuple[Element | None, Element]:
    if root.tag != _ENVELOPE:
        name = etree.QName(root)
        if name.localname == "Envelope":
            raise WireError("env:VersionMismatch", f"only SOAP 1.2 is supported, and this is an envelope of {_short(name.namespace)}")
        raise WireError(SENDER, f"a SOAP Envelope was expected, and this is {_short(root.tag)}")
    children = list(root)
    header = children[0] if children and children[0].tag == f"{{{ENV}}}Header" else None
    rest = children[1:] if header is not None else children
    if len(rest) != 1 or rest[0].tag != f"{{{ENV}}}Body":
        raise WireError(SENDER, "an Envelope holds one Body, behind at most one Header")
    return header, rest[0]


def _headers(header: Element | None) -> dict[str, str]:
    """Return the WS-Addressing headers by name; of an endpoint reference, its address."""
    headers: dict[str, str] = {}
    missed: list[str] = []
    for block in header if header is not None else ():
        if block.get(_ROLE) not in _OWN_ROLES:
            continue
        name = _ADDRESSING_TAGS.get(block.tag)
        if name is None:
            if block.get(_MUST_UNDERSTAND, "false").strip() in ("true", "1"):
                missed.append(str(block.tag))
            continue
        if name in ("To", "Action", "MessageID"):
            value = _uri(block)
        elif name in ("From", "ReplyTo", "FaultTo"):
            value = _address_of(block)
        elif block.get("RelationshipType", f"{WSA}/reply") == f"{WSA}/reply":
            value = _uri(block)
        else:
            continue
        if name in headers:
            raise WireError(CARDINALITY, f"the header wsa:{name} is there more than once")
        if not value:
            raise WireError(INVALID_HEADER, f"the header wsa:{name} is empty")
        headers[name] = value
    if missed:
        named = tuple(tag for tag in missed if len(tag) <= MOST_NAME)[:MOST_MISSED]
        raise WireError("env:MustUnderstand", f"the header {_short(missed[0])} is not understood here", named)
    return headers


def _address_of(reference: Element) -> str:
    """Return the address in an endpoint reference. Raises WireError unless there is exactly one."""
    addresses = [child for child in reference if child.tag == f"{{{WSA}}}Address"]
    if len(addresses) > 1 or (not addresses and len(reference)):
        code = CARDINALITY if addresses else NO_ADDRESS
        raise WireError(code, f"the header wsa:{etree.QName(reference).localname} has {len(addresses)} addresses, and one was expected")
    return _uri(addresses[0]) if addresses else ""


def _uri(element: Element) -> str:
    if len(element):
        raise WireError(INVALID_HEADER, f"elements are in wsa:{etree.QName(element).localname}, where a URI was expected")
    return (element.text or "").strip()


def _session(body: Element) -> dict[str, str]:
    session: dict[str, str] = {}
    for child in body:
        if (name := _SESSION_TAGS.get(child.tag)) is not None:
            if name in session:
                raise WireError(SENDER, f"{name} is there twice")
            session[name] = (child.text or "").strip()
    return session


def _header(headers: dict[str, str], session: dict[str, str]) -> Header:
    return Header(
        sender=headers.get("From", ANONYMOUS),
        recipient=headers.get("To", ANONYMOUS),
        message_id=normalised_id(headers.get("MessageID") or message_id("fault", headers.get("RelatesTo"))),
        relates_to=normalised_id(headers["RelatesTo"]) if "RelatesTo" in headers else None,
        reply_to=headers.get("ReplyTo", ANONYMOUS),
        transaction=normalised_id(session["Transaction"]) if session.get("Transaction") else None,
        participant=session.get("Participant") or None,
    )


def _read_fault(element: Element, headers: dict[str, str]) -> Message:
    value = element.find(f"{{{ENV}}}Code/{{{ENV}}}Value")
    subcodes = [_known_code(code) for code in element.iterfind(f"{{{ENV}}}Code//{{{ENV}}}Subcode/{{{ENV}}}Value")]
    text = element.findtext(f"{{{ENV}}}Reason/{{{ENV}}}Text")
    detail = element.find(f"{{{ENV}}}Detail")
    for child in detail if detail is not None else ():
        body_type = _BY_TAG.get(str(child.tag))
        if body_type is not None and body_type.kind in REFUSALS:
            return Message(header=_header(headers, {}), body=struct_reader(body_type.kind, body_type.namespace)(child))
    session = _session(detail) if detail is not None else {}
    # The innermost known subcode says most; subcodes below it may belong to another protocol.
    code = next((subcode for subcode in reversed(subcodes) if subcode), None) or _known_code(value) or SENDER
    return Message(header=_header(headers, session), body=frp.Fault(code=code, text=text if text is not None else "no reason was given"))


def _known_code(element: Element | None) -> str | None:
    """Return a fault code with this module's prefix for its namespace; None for an unknown namespace."""
    if element is None:
        return None
    prefix, _, name = (element.text or "").strip().rpartition(":")
    namespace = element.nsmap.get(prefix or None)
    own_prefix = next((known_prefix for known_prefix, uri in _PREFIXES.items() if uri == namespace), None)
    return f"{own_prefix}:{name}" if own_prefix is not None else None
