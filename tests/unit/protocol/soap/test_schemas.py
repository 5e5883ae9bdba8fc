"""The schemas and descriptions that foreign stacks are generated from, to the letter."""

from __future__ import annotations

from enum import StrEnum

import pytest
from lxml import etree
from msgspec import Struct

from somrs.ontology.types import Value
from somrs.protocol.messages import frp, orders
from somrs.protocol.messages.bodies import REQUESTS
from somrs.protocol.soap import wsdl, xsd
from somrs.protocol.soap.soap import CLIENTS, DIRECTORY, FRP, KNOWLEDGE, NAMESPACES, ORDERS, TRAFFIC


class Color(StrEnum):
    RED = "red"
    DARK_RED = "dark red"


class Circle(Struct):
    radius: float


class Square(Struct):
    """A square,
    as they are."""

    side: int
    color: Color = Color.RED


class Drawing(Struct):
    """All kinds of fields."""

    shape: Circle | Square
    first_shapes: tuple[Circle | Square, ...]
    title: str | None
    notes: dict[str, str]
    values: dict[str, Value]
    one: Value
    colors: tuple[Color, ...] = ()
    done: bool = False


SCHEMA = """\
<?xml version='1.0' encoding='utf-8'?>
<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns:m="urn:so-mrs:frp:1.0" targetNamespace="urn:so-mrs:frp:1.0" \
elementFormDefault="qualified">
  <xs:complexType name="Drawing">
    <xs:annotation>
      <xs:documentation>All kinds of fields.</xs:documentation>
    </xs:annotation>
    <xs:sequence>
      <xs:element name="Transaction" type="xs:string"/>
      <xs:element name="Participant" type="xs:string"/>
      <xs:element name="Version" type="xs:string" minOccurs="0"/>
      <xs:element name="Shape">
        <xs:complexType>
          <xs:choice>
            <xs:element name="Circle" type="m:Circle"/>
            <xs:element name="Square" type="m:Square"/>
          </xs:choice>
        </xs:complexType>
      </xs:element>
      <xs:element name="FirstShapes" minOccurs="0" maxOccurs="unbounded">
        <xs:complexType>
          <xs:choice>
            <xs:element name="Circle" type="m:Circle"/>
            <xs:element name="Square" type="m:Square"/>
          </xs:choice>
        </xs:complexType>
      </xs:element>
      <xs:element name="Title" type="xs:string" minOccurs="0"/>
      <xs:element name="Notes" type="m:NamedStrings"/>
      <xs:element name="Values" type="m:NamedValues"/>
      <xs:element name="One" type="m:Value"/>
      <xs:element name="Colors" type="m:Color" minOccurs="0" maxOccurs="unbounded"/>
      <xs:element name="Done" type="xs:boolean" minOccurs="0"/>
    </xs:sequence>
  </xs:complexType>
  <xs:complexType name="Circle">
    <xs:sequence>
      <xs:element name="Transaction" type="xs:string"/>
      <xs:element name="Participant" type="xs:string"/>
      <xs:element name="Version" type="xs:string" minOccurs="0"/>
      <xs:element name="Radius" type="xs:double"/>
    </xs:sequence>
  </xs:complexType>
  <xs:complexType name="Square">
    <xs:annotation>
      <xs:documentation>A square, as they are.</xs:documentation>
    </xs:annotation>
    <xs:sequence>
      <xs:element name="Side" type="xs:long"/>
      <xs:element name="Color" type="m:Color" minOccurs="0"/>
    </xs:sequence>
  </xs:complexType>
  <xs:simpleType name="Color">
    <xs:restriction base="xs:token">
      <xs:enumeration value="red"/>
      <xs:enumeration value="dark red"/>
    </xs:restriction>
  </xs:simpleType>
  <xs:complexType name="NamedStrings">
    <xs:sequence>
      <xs:element name="Entry" type="m:NamedString" minOccurs="0" maxOccurs="unbounded"/>
    </xs:sequence>
  </xs:complexType>
  <xs:complexType name="NamedString">
    <xs:simpleContent>
      <xs:extension base="xs:string">
        <xs:attribute name="name" type="xs:string" use="required"/>
      </xs:extension>
    </xs:simpleContent>
  </xs:complexType>
  <xs:complexType name="Value">
    <xs:simpleContent>
      <xs:extension base="xs:string">
        <xs:attribute name="kind" default="text">
          <xs:simpleType>
            <xs:restriction base="xs:string">
              <xs:enumeration value="number"/>
              <xs:enumeration value="text"/>
              <xs:enumeration value="truth"/>
            </xs:restriction>
          </xs:simpleType>
        </xs:attribute>
      </xs:extension>
    </xs:simpleContent>
  </xs:complexType>
  <xs:complexType name="NamedValues">
    <xs:sequence>
      <xs:element name="Entry" type="m:NamedValue" minOccurs="0" maxOccurs="unbounded"/>
    </xs:sequence>
  </xs:complexType>
  <xs:complexType name="NamedValue">
    <xs:simpleContent>
      <xs:extension base="m:Value">
        <xs:attribute name="name" type="xs:string" use="required"/>
      </xs:extension>
    </xs:simpleContent>
  </xs:complexType>
  <xs:element name="Drawing" type="m:Drawing"/>
  <xs:element name="Circle" type="m:Circle"/>
</xs:schema>
"""

SMALL_SCHEMA = """\
<?xml version='1.0' encoding='utf-8'?>
<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns:m="urn:x" targetNamespace="urn:x" elementFormDefault="qualified">
  <xs:complexType name="Circle">
    <xs:sequence>
      <xs:element name="Radius" type="xs:double"/>
    </xs:sequence>
  </xs:complexType>
  <xs:element name="Circle" type="m:Circle"/>
</xs:schema>
"""

DESCRIPTION = """\
<?xml version='1.0' encoding='utf-8'?>
<wsdl:definitions xmlns:wsdl="http://schemas.xmlsoap.org/wsdl/" xmlns:soap12="http://schemas.xmlsoap.org/wsdl/soap12/" \
xmlns:wsaw="http://www.w3.org/2006/05/addressing/wsdl" xmlns:wsam="http://www.w3.org/2007/05/addressing/metadata" \
xmlns:wsp="http://www.w3.org/ns/ws-policy" xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns:c="urn:so-mrs:components:1.0:Painter" \
xmlns:frp="urn:so-mrs:frp:1.0" xmlns:orders="urn:so-mrs:orders:1.0" targetNamespace="urn:so-mrs:components:1.0:Painter" name="Painter">
  <wsdl:types>
    <xs:schema>
      <xs:import namespace="urn:so-mrs:frp:1.0" schemaLocation="http://h/painter?xsd=frp"/>
      <xs:import namespace="urn:so-mrs:orders:1.0" schemaLocation="http://h/painter?xsd=orders"/>
    </xs:schema>
  </wsdl:types>
  <wsdl:message name="SaveTemplate">
    <wsdl:part name="body" element="orders:SaveTemplate"/>
  </wsdl:message>
  <wsdl:message name="TemplateKept">
    <wsdl:part name="body" element="orders:TemplateKept"/>
  </wsdl:message>
  <wsdl:message name="OrdersRejected">
    <wsdl:part name="body" element="orders:OrdersRejected"/>
  </wsdl:message>
  <wsdl:message name="Query">
    <wsdl:part name="body" element="frp:Query"/>
  </wsdl:message>
  <wsdl:message name="Status">
    <wsdl:part name="body" element="frp:Status"/>
  </wsdl:message>
  <wsdl:message name="Execute">
    <wsdl:part name="body" element="frp:Execute"/>
  </wsdl:message>
  <wsdl:portType name="Painter">
    <wsdl:operation name="SaveTemplate">
      <wsdl:documentation></wsdl:documentation>
      <wsdl:input message="c:SaveTemplate" wsam:Action="urn:so-mrs:orders:1.0:SaveTemplate" \
wsaw:Action="urn:so-mrs:orders:1.0:SaveTemplate"/>
      <wsdl:output message="c:TemplateKept" wsam:Action="urn:so-mrs:orders:1.0:TemplateKept" \
wsaw:Action="urn:so-mrs:orders:1.0:TemplateKept"/>
      <wsdl:fault message="c:OrdersRejected" name="OrdersRejected" wsam:Action="urn:so-mrs:orders:1.0:OrdersRejected" \
wsaw:Action="urn:so-mrs:orders:1.0:OrdersRejected"/>
    </wsdl:operation>
    <wsdl:operation name="Query">
      <wsdl:documentation>Request the state of the participant.</wsdl:documentation>
      <wsdl:input message="c:Query" wsam:Action="urn:so-mrs:frp:1.0:Query" wsaw:Action="urn:so-mrs:frp:1.0:Query"/>
      <wsdl:output message="c:Status" wsam:Action="urn:so-mrs:frp:1.0:Status" wsaw:Action="urn:so-mrs:frp:1.0:Status"/>
    </wsdl:operation>
    <wsdl:operation name="Execute">
      <wsdl:documentation>Start. `precondition` is the present situation; it includes the condition of the Terms.</wsdl:documentation>
      <wsdl:input message="c:Execute" wsam:Action="urn:so-mrs:frp:1.0:Execute" wsaw:Action="urn:so-mrs:frp:1.0:Execute"/>
    </wsdl:operation>
  </wsdl:portType>
  <wsdl:binding name="PainterBinding" type="c:Painter">
    <wsp:Policy>
      <wsam:Addressing>
        <wsp:Policy/>
      </wsam:Addressing>
    </wsp:Policy>
    <soap12:binding style="document" transport="http://schemas.xmlsoap.org/soap/http"/>
    <wsdl:operation name="SaveTemplate">
      <soap12:operation soapAction="urn:so-mrs:orders:1.0:SaveTemplate" style="document"/>
      <wsdl:input>
        <soap12:body use="literal"/>
      </wsdl:input>
      <wsdl:output>
        <soap12:body use="literal"/>
      </wsdl:output>
      <wsdl:fault name="OrdersRejected">
        <soap12:fault name="OrdersRejected" use="literal"/>
      </wsdl:fault>
    </wsdl:operation>
    <wsdl:operation name="Query">
      <soap12:operation soapAction="urn:so-mrs:frp:1.0:Query" style="document"/>
      <wsdl:input>
        <soap12:body use="literal"/>
      </wsdl:input>
      <wsdl:output>
        <soap12:body use="literal"/>
      </wsdl:output>
    </wsdl:operation>
    <wsdl:operation name="Execute">
      <soap12:operation soapAction="urn:so-mrs:frp:1.0:Execute" style="document"/>
      <wsdl:input>
        <soap12:body use="literal"/>
      </wsdl:input>
    </wsdl:operation>
  </wsdl:binding>
  <wsdl:service name="Painter">
    <wsdl:port name="PainterPort" binding="c:PainterBinding">
      <soap12:address location="http://h/painter"/>
    </wsdl:port>
  </wsdl:service>
</wsdl:definitions>
"""


@pytest.mark.parametrize(
    ("namespace", "kinds", "document"), [(FRP, (Drawing, Circle), SCHEMA), ("urn:x", (Circle,), SMALL_SCHEMA)], ids=["contracts", "others"]
)
def test_a_schema_says_what_the_fields_are(
    monkeypatch: pytest.MonkeyPatch, namespace: str, kinds: tuple[type[Struct], ...], document: str
) -> None:
    monkeypatch.setattr(xsd, "NAMESPACES", {namespace: kinds})
    assert xsd.schema_of(namespace).decode() == document


def test_a_description_has_an_operation_for_each_message(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = (orders.SaveTemplate, frp.Query, frp.Execute)
    monkeypatch.setitem(wsdl.COMPONENTS, "painter", ("Painter", kinds))
    for path in ("/painter", "painter/", "/painter/x"):
        description = wsdl.description(path, "http://h/painter")
        assert description is not None
        assert description.decode() == DESCRIPTION


@pytest.mark.parametrize(
    ("name", "namespace"), [("frp", FRP), ("directory", DIRECTORY), ("knowledge", KNOWLEDGE), ("clients", CLIENTS), ("orders", ORDERS)]
)
def test_a_schema_goes_by_the_short_name_of_its_protocol(name: str, namespace: str) -> None:
    document = wsdl.schema(name)
    assert document is not None
    elements = etree.fromstring(document).iterfind(f"{{{xsd.XS}}}element")
    assert [element.get("name") for element in elements] == [kind.__name__ for kind in NAMESPACES[namespace]]


REPORTS = ["Terms", "Refuse", "Progress", "Completed", "Failed", "Stopped", "Compensated", "Stranded", "Status"]
MAP = ["MapChanged", "OntologyChanged"]


@pytest.mark.parametrize(
    ("path", "name", "namespace", "other_messages"),
    [
        ("repository", "Repository", KNOWLEDGE, ["Release", "ClaimReservations"]),
        ("registry", "Registry", DIRECTORY, MAP),
        (
            "task-manager",
            "TaskManager",
            CLIENTS,
            [*REPORTS, "ServicesJoined", "ServicesLeft", "ReservationFree", "ReservationLost", "NeighbourAwaited", *MAP],
        ),
        ("scheduler", "Scheduler", ORDERS, MAP),
        (
            "devices",
            "ServiceManager",
            None,
            ["Arrange", "Accept", "Cancel", "Execute", "Stop", "Compensate", "Query", "End", "ServiceTypesChanged"],
        ),
        ("traffic", "Traffic", TRAFFIC, ["CancelTrip"]),
        ("map-follower", "MapFollower", None, MAP),
        ("simulator", "Simulator", None, MAP),
    ],
)
def test_what_a_component_understands(path: str, name: str, namespace: str | None, other_messages: list[str]) -> None:
    requests = [kind.__name__ for kind in NAMESPACES[namespace] if kind in REQUESTS] if namespace is not None else []
    component_name, kinds = wsdl.COMPONENTS[path]
    assert (component_name, [kind.__name__ for kind in kinds]) == (name, requests + other_messages)


def test_there_is_no_schema_of_another_protocol_and_no_description_of_another_component() -> None:
    assert wsdl.schema("nothing") is None
    assert wsdl.description("/nothing/repository", "http://h/nothing") is None
