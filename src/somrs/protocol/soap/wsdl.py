"""The WSDL 1.1 description of each kind of component: SOAP 1.2 over HTTP, document/literal, with WS-Addressing.

A component has one port type with all messages that it accepts. The first answer of a request is its output; the other answers are its
faults. All other messages are one-way operations; a reply to them is a message of its own to the sender's ReplyTo. That messages have
WS-Addressing headers is said by a policy (WS-Addressing 1.0 Metadata, 3.1).

Each kind of component has a target namespace of its own: from several descriptions in one namespace, some generators make one service.
"""

from __future__ import annotations

from lxml import etree
from msgspec import Struct

from somrs.protocol.frp.session import CoordinatorBody, ParticipantBody
from somrs.protocol.messages import directory, frp, knowledge, neighbours, reservations, traffic
from somrs.protocol.messages.bodies import REQUESTS
from somrs.protocol.soap.soap import CLIENTS, DIRECTORY, FRP, KNOWLEDGE, NAMESPACES, ORDERS, TRAFFIC, action, namespace_of
from somrs.protocol.soap.xml import Element, union_of
from somrs.protocol.soap.xsd import XS, schema_of

WSDL = "http://schemas.xmlsoap.org/wsdl/"
_SOAP12 = "http://schemas.xmlsoap.org/wsdl/soap12/"
_WSAW = "http://www.w3.org/2006/05/addressing/wsdl"
_POLICY = "http://www.w3.org/ns/ws-policy"
_WSAM = "http://www.w3.org/2007/05/addressing/metadata"
TARGETS = "urn:so-mrs:components:1.0"
"""How target namespaces begin; the name of the component follows."""
HTTP = "http://schemas.xmlsoap.org/soap/http"

Kinds = tuple[type[Struct], ...]

_ANSWERS: dict[type[Struct], Kinds] = {request: tuple(answers) for request, answers in REQUESTS.items()}
_SCHEMAS = {"frp": FRP, "directory": DIRECTORY, "knowledge": KNOWLEDGE, "clients": CLIENTS, "orders": ORDERS, "traffic": TRAFFIC}
_FOLLOWS_MAP: Kinds = (knowledge.MapChanged, knowledge.OntologyChanged)


def _requests(namespace: str) -> Kinds:
    return tuple(kind for kind in NAMESPACES[namespace] if kind in REQUESTS)


def _without_fault(body: object) -> Kinds:
    return tuple(kind for kind in union_of(body) if kind is not frp.Fault)


COMPONENTS: dict[str, tuple[str, Kinds]] = {
    "repository": ("Repository", (*_requests(KNOWLEDGE), reservations.Release, reservations.ClaimReservations)),
    "registry": ("Registry", (*_requests(DIRECTORY), *_FOLLOWS_MAP)),
    "task-manager": (
        "TaskManager",
        (
            *_requests(CLIENTS),
            *_without_fault(ParticipantBody),
            directory.ServicesJoined,
            directory.ServicesLeft,
            reservations.ReservationFree,
            reservations.ReservationLost,
            neighbours.NeighbourAwaited,
            *_FOLLOWS_MAP,
        ),
    ),
    "scheduler": ("Scheduler", (*_requests(ORDERS), *_FOLLOWS_MAP)),
    "traffic": ("Traffic", (*_requests(TRAFFIC), traffic.CancelTrip)),
    "devices": ("ServiceManager", (*_without_fault(CoordinatorBody), directory.ServiceTypesChanged)),
    "map-follower": ("MapFollower", _FOLLOWS_MAP),
    "simulator": ("Simulator", _FOLLOWS_MAP),
}
"""The name of a component and the messages that it accepts, by the first part of its path."""


def schema(name: str) -> bytes | None:
    """Return the schema of a protocol by its short name; None for an unknown name."""
    namespace = _SCHEMAS.get(name)
    return schema_of(namespace) if namespace is not None else None


def description(path: str, address: str) -> bytes | None:
    """Return the WSDL of the component at a path, for clients that reach it at `address`; None when the path belongs to no component."""
    component = COMPONENTS.get(path.strip("/").partition("/")[0])
    if component is None:
        return None
    name, kinds = component
    prefixes = {short: uri for short, uri in _SCHEMAS.items() if any(namespace_of(kind) == uri for kind in _message_types(kinds))}
    target = f"{TARGETS}:{name}"
    own_prefixes = {"wsdl": WSDL, "soap12": _SOAP12, "wsaw": _WSAW, "wsam": _WSAM, "wsp": _POLICY, "xs": XS, "c": target}
    root = etree.Element(f"{{{WSDL}}}definitions", nsmap=own_prefixes | prefixes)
    root.set("targetNamespace", target)
    root.set("name", name)
    _types(root, prefixes, address)
    short = {uri: prefix for prefix, uri in prefixes.items()}
    for kind in _message_types(kinds):
        message = _add(root, "message", name=kind.__name__)
        _add(message, "part", name="body", element=f"{short[namespace_of(kind)]}:{kind.__name__}")
    _port_type(root, name, kinds)
    _binding(root, name, kinds)
    port = _add(_add(root, "service", name=name), "port", name=f"{name}Port", binding=f"c:{name}Binding")
    etree.SubElement(port, f"{{{_SOAP12}}}address", {"location": address})
    document: bytes = etree.tostring(root, encoding="utf-8", xml_declaration=True, pretty_print=True)
    return document


def _message_types(kinds: Kinds) -> Kinds:
    """Return the messages that the operations accept and return."""
    return tuple(dict.fromkeys(message for kind in kinds for message in (kind, *_ANSWERS.get(kind, ()))))


def _types(root: Element, prefixes: dict[str, str], address: str) -> None:
    inline = etree.SubElement(_add(root, "types"), f"{{{XS}}}schema")
    for short, uri in prefixes.items():
        etree.SubElement(inline, f"{{{XS}}}import", {"namespace": uri, "schemaLocation": f"{address}?xsd={short}"})


def _port_type(root: Element, name: str, kinds: Kinds) -> None:
    port_type = _add(root, "portType", name=name)
    for kind in kinds:
        operation = _add(port_type, "operation", name=kind.__name__)
        _add(operation, "documentation").text = " ".join((kind.__doc__ or "").split())
        _message(operation, "input", kind)
        answers = _ANSWERS.get(kind, ())
        for answer in answers[:1]:
            _message(operation, "output", answer)
        for refusal in answers[1:]:
            _message(operation, "fault", refusal, name=refusal.__name__)


def _message(operation: Element, tag: str, kind: type[Struct], **attributes: str) -> None:
    element = _add(operation, tag, message=f"c:{kind.__name__}", **attributes)
    for namespace in (_WSAM, _WSAW):
        element.set(f"{{{namespace}}}Action", action(kind))


def _binding(root: Element, name: str, kinds: Kinds) -> None:
    binding = _add(root, "binding", name=f"{name}Binding", type=f"c:{name}")
    addressing = etree.SubElement(etree.SubElement(binding, f"{{{_POLICY}}}Policy"), f"{{{_WSAM}}}Addressing")
    etree.SubElement(addressing, f"{{{_POLICY}}}Policy")
    etree.SubElement(binding, f"{{{_SOAP12}}}binding", {"style": "document", "transport": HTTP})
    for kind in kinds:
        operation = _add(binding, "operation", name=kind.__name__)
        etree.SubElement(operation, f"{{{_SOAP12}}}operation", {"soapAction": action(kind), "style": "document"})
        _literal(_add(operation, "input"), "body")
        answers = _ANSWERS.get(kind, ())
        if answers:
            _literal(_add(operation, "output"), "body")
        for refusal in answers[1:]:
            _literal(_add(operation, "fault", name=refusal.__name__), "fault", name=refusal.__name__)


def _literal(parent: Element, tag: str, **attributes: str) -> None:
    etree.SubElement(parent, f"{{{_SOAP12}}}{tag}", {**attributes, "use": "literal"})


def _add(parent: Element, tag: str, **attributes: str) -> Element:
    return etree.SubElement(parent, f"{{{WSDL}}}{tag}", attributes)
