"""SOAP envelopes as they are on the wire, to the letter, and what is read from those of others."""

from __future__ import annotations

import pytest
from lxml import etree
from msgspec import Struct, structs

from somrs.errors import WireError
from somrs.protocol.messages import frp, knowledge, submission
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_DEPTH, SENDER, parse
from somrs.protocol.soap.soap import decode, encode

HEADER = Header(sender=ANONYMOUS, recipient="http://b", message_id="urn:uuid:1")
IN_CONTRACT = structs.replace(HEADER, transaction="t1", participant="p1")
QUERY = Message(header=HEADER, body=knowledge.QueryMap(formula="A isOn B"))
START = f"<?xml version='1.0' encoding='utf-8'?>\n<env:Envelope xmlns:env=\"{soap.ENV}\" xmlns:wsa=\"{soap.WSA}\""
END = "</env:Body></env:Envelope>"


def refused(document: str) -> WireError:
    with pytest.raises(WireError) as caught:
        decode(document.encode())
    return caught.value


def fault_document(codes: str, text: str = "no", detail: str = "", relates_to: str = "") -> str:
    return (
        f"{START}><env:Header><wsa:Action>{soap.WSA}/fault</wsa:Action>{relates_to}</env:Header><env:Body>"
        f'<env:Fault xmlns:frp="{soap.FRP}"><env:Code>{codes}</env:Code>'
        f'<env:Reason><env:Text xml:lang="en">{text}</env:Text></env:Reason>{detail}</env:Fault>{END}'
    )


def test_a_message_outside_a_contract() -> None:
    assert encode(QUERY).decode() == (
        f'{START} xmlns:m="{soap.KNOWLEDGE}"><env:Header><wsa:To>http://b</wsa:To>'
        f"<wsa:Action>{soap.KNOWLEDGE}:QueryMap</wsa:Action><wsa:MessageID>urn:uuid:1</wsa:MessageID></env:Header><env:Body>"
        f"<m:QueryMap><m:Formula>A isOn B</m:Formula></m:QueryMap>{END}"
    )


def test_a_message_of_a_contract_with_all_that_a_header_may_have() -> None:
    header = structs.replace(IN_CONTRACT, sender="http://a", reply_to="http://c", relates_to="urn:uuid:0")
    assert encode(Message(header=header, body=frp.Stop(reason="r"))).decode() == (
        f'{START} xmlns:m="{soap.FRP}"><env:Header><wsa:To>http://b</wsa:To>'
        "<wsa:From><wsa:Address>http://a</wsa:Address></wsa:From><wsa:ReplyTo><wsa:Address>http://c</wsa:Address></wsa:ReplyTo>"
        f"<wsa:Action>{soap.FRP}:Stop</wsa:Action><wsa:MessageID>urn:uuid:1</wsa:MessageID>"
        "<wsa:RelatesTo>urn:uuid:0</wsa:RelatesTo></env:Header><env:Body>"
        "<m:Stop><m:Transaction>t1</m:Transaction><m:Participant>p1</m:Participant><m:Version>1.0</m:Version>"
        f"<m:Reason>r</m:Reason></m:Stop>{END}"
    )


def test_a_fault_within_a_contract_says_which() -> None:
    document = encode(Message(header=IN_CONTRACT, body=frp.Fault(code="frp:NotAllowed", text="no"))).decode()
    assert document.partition("<env:Body>")[2] == (
        f'<env:Fault xmlns:frp="{soap.FRP}"><env:Code><env:Value>env:Sender</env:Value><env:Subcode>'
        '<env:Value>frp:NotAllowed</env:Value></env:Subcode></env:Code><env:Reason><env:Text xml:lang="en">no</env:Text></env:Reason>'
        "<env:Detail><frp:Transaction>t1</frp:Transaction><frp:Participant>p1</frp:Participant><frp:Version>1.0</frp:Version></env:Detail>"
        f"</env:Fault>{END}"
    )
    assert f"<wsa:Action>{soap.WSA}/fault</wsa:Action>" in document
    assert decode(document.encode()) == Message(header=IN_CONTRACT, body=frp.Fault(code="frp:NotAllowed", text="no"))


def test_a_fault_outside_a_contract_has_no_detail() -> None:
    assert "Detail" not in encode(Message(header=HEADER, body=frp.Fault(code="Sender", text="no"))).decode()


def test_that_a_recipient_cannot_answer_now_is_not_the_senders_fault() -> None:
    """WS-Addressing 1.0 SOAP Binding, 6.4.5."""
    body = frp.Fault(code="wsa:EndpointUnavailable", text="it stops")
    document = encode(Message(header=HEADER, body=body))
    assert b"<env:Value>env:Receiver</env:Value><env:Subcode><env:Value>wsa:EndpointUnavailable</env:Value>" in document
    assert decode(document).body == body


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (knowledge.Rejected(problems=("a", "b")), "a\nb"),
        (submission.TaskRejected(problem="no task"), "no task"),
    ],
)
def test_a_refusal_says_why_in_its_reason(body: knowledge.Rejected | submission.TaskRejected, reason: str) -> None:
    root = etree.fromstring(encode(Message(header=HEADER, body=body)))
    assert root.findtext(f".//{{{soap.ENV}}}Text") == reason
    assert [element.text for element in root.iter(f"{{{soap.ENV}}}Value")] == [SENDER]
    assert root.findtext(f".//{{{soap.WSA}}}Action") == soap.action(type(body))


@pytest.mark.parametrize(
    ("error", "codes"),
    [
        (WireError("env:Receiver", "no"), "<env:Value>env:Receiver</env:Value>"),
        (
            WireError("wsa:ActionNotSupported", "no"),
            "<env:Value>env:Sender</env:Value><env:Subcode><env:Value>wsa:ActionNotSupported</env:Value></env:Subcode>",
        ),
        (
            WireError("wsa:InvalidAddress", "no"),
            "<env:Value>env:Sender</env:Value><env:Subcode><env:Value>wsa:InvalidAddressingHeader</env:Value>"
            "<env:Subcode><env:Value>wsa:InvalidAddress</env:Value></env:Subcode></env:Subcode>",
        ),
        (WireError("env:Unknown", "no"), "<env:Value>env:Sender</env:Value>"),
        (WireError("wsa:not a name", "no"), "<env:Value>env:Sender</env:Value>"),
        (WireError("xyz:Name", "no"), "<env:Value>env:Sender</env:Value>"),
    ],
)
def test_the_codes_of_a_fault(error: WireError, codes: str) -> None:
    assert soap.fault(error).decode() == fault_document(codes)


@pytest.mark.parametrize("name", ["Sender", "Receiver", "VersionMismatch", "MustUnderstand", "DataEncodingUnknown"])
def test_the_codes_of_soap_need_no_prefix(name: str) -> None:
    assert decode(encode(Message(header=HEADER, body=frp.Fault(code=name, text="t")))).body == frp.Fault(code=f"env:{name}", text="t")


def test_a_fault_names_what_it_answers_and_says_no_more_than_it_may() -> None:
    document = soap.fault(WireError("env:Sender", "x" * 4001 + "<"), "urn:uuid:7").decode()
    related = "<wsa:RelatesTo>urn:uuid:7</wsa:RelatesTo>"
    assert document == fault_document("<env:Value>env:Sender</env:Value>", "x" * 4000, relates_to=related)


@pytest.mark.parametrize(("code", "upgrade"), [("env:VersionMismatch", True), ("env:Sender", False)])
def test_an_unknown_version_of_soap_is_told_which_one_is_known(code: str, upgrade: bool) -> None:
    block = '<env:Upgrade><env:SupportedEnvelope qname="env:Envelope"/></env:Upgrade></env:Header>'
    assert (block in soap.fault(WireError(code, "no")).decode()) is upgrade


def test_headers_that_were_not_understood_are_named_with_their_namespaces() -> None:
    document = soap.fault(WireError("env:MustUnderstand", "no", ("{urn:x}A", f"{{{soap.XML}}}b", "c"))).decode()
    assert document.partition("fault</wsa:Action>")[2].partition("</env:Header>")[0] == (
        '<env:NotUnderstood xmlns:h="urn:x" qname="h:A"/><env:NotUnderstood qname="xml:b"/><env:NotUnderstood qname="c"/>'
    )


@pytest.mark.parametrize(
    ("change", "header"),
    [
        (("<wsa:To>http://b</wsa:To>", ""), {"recipient": ANONYMOUS}),
        (("<wsa:To>http://b</wsa:To>", "<wsa:To> http://b\n</wsa:To>"), {}),
        (("</env:Header>", "<wsa:RelatesTo>uuid:7</wsa:RelatesTo></env:Header>"), {"relates_to": "urn:uuid:7"}),
        (
            ("</env:Header>", f'<wsa:RelatesTo RelationshipType="{soap.WSA}/reply">urn:uuid:7</wsa:RelatesTo></env:Header>'),
            {"relates_to": "urn:uuid:7"},
        ),
        (("</env:Header>", '<wsa:RelatesTo RelationshipType="urn:x">urn:uuid:7</wsa:RelatesTo></env:Header>'), {}),
        (("</env:Header>", "<wsa:From><x/><wsa:Address>http://a</wsa:Address></wsa:From></env:Header>"), {"sender": "http://a"}),
        (("</env:Header>", '<x env:role="urn:x" env:mustUnderstand="1"/><wsa:FaultTo env:role="urn:x"/></env:Header>'), {}),
    ],
)
def test_headers_of_others(change: tuple[str, str], header: dict[str, str]) -> None:
    document = encode(QUERY).decode().replace(*change)
    assert decode(document.encode()) == Message(header=structs.replace(HEADER, **header), body=QUERY.body)


@pytest.mark.parametrize(
    ("change", "code", "text"),
    [
        (("QueryMap>", "Quary>"), "wsa:ActionNotSupported", f"{{{soap.KNOWLEDGE}}}Quary is not a known message"),
        (("<wsa:Action>", "<wsa:Actoin>"), SENDER, None),
        ((":QueryMap</wsa", ":ReadMap</wsa"), "wsa:ActionMismatch", None),
        (("<wsa:To>http://b</wsa:To>", "<wsa:To/>"), "wsa:InvalidAddressingHeader", "the header wsa:To is empty"),
        (
            ("<wsa:To>http://b</wsa:To>", "<wsa:To><a/>x</wsa:To>"),
            "wsa:InvalidAddressingHeader",
            "elements are in wsa:To, where a URI was expected",
        ),
        (
            ("</env:Header>", "<wsa:From/></env:Header>"),
            "wsa:InvalidAddressingHeader",
            "the header wsa:From is empty",
        ),
        (
            ("</env:Header>", "<wsa:From><a/></wsa:From></env:Header>"),
            "wsa:MissingAddressInEPR",
            "the header wsa:From has 0 addresses, and one was expected",
        ),
        (
            ("</env:Header>", f"<wsa:From>{'<wsa:Address>x</wsa:Address>' * 2}</wsa:From></env:Header>"),
            "wsa:InvalidCardinality",
            "the header wsa:From has 2 addresses, and one was expected",
        ),
        (
            ("</env:Header>", "<wsa:To>x</wsa:To></env:Header>"),
            "wsa:InvalidCardinality",
            "the header wsa:To is there more than once",
        ),
        (("<env:Header>", "<a/><env:Header>"), SENDER, "an Envelope holds one Body, behind at most one Header"),
        (("</env:Body>", "</env:Body><a/>"), SENDER, "an Envelope holds one Body, behind at most one Header"),
        (("</env:Body>", "<a/></env:Body>"), SENDER, "the Body has 2 elements, and one was expected"),
    ],
)
def test_what_is_wrong_is_said_exactly(change: tuple[str, str], code: str, text: str | None) -> None:
    document = encode(QUERY).decode()
    assert change[0] in document
    error = refused(document.replace(*change))
    assert error.code == code
    assert text is None or error.text == text


def test_long_names_are_cut() -> None:
    long = "x" * 200
    error = refused(encode(QUERY).decode().replace("m:QueryMap>", f"{long}>"))
    assert error.text == f"{'x' * 120} is not a known message"


def test_headers_that_must_be_understood_are_named_up_to_a_length() -> None:
    blocks = "".join(f'<{name} env:mustUnderstand="1"/>' for name in ("a" * 501, "b" * 500, "c"))
    error = refused(encode(QUERY).decode().replace("</env:Header>", f"{blocks}</env:Header>"))
    assert (error.code, error.text) == ("env:MustUnderstand", f"the header {'a' * 120} is not understood here")
    assert error.headers == ("b" * 500, "c")


def test_an_envelope_without_a_header_is_read_as_far_as_it_goes() -> None:
    document = f"{START}><env:Body><a/></env:Body></env:Envelope>"
    assert refused(document).text == "a is not a known message"
    fault = fault_document("<env:Value>env:Receiver</env:Value>")
    bare = fault.partition("<env:Header>")[0] + fault.partition("</env:Header>")[2]
    message = decode(bare.encode())
    assert message.body == frp.Fault(code="env:Receiver", text="no")
    assert message.header == Header(sender=ANONYMOUS, recipient=ANONYMOUS, message_id=message_id("fault", None))


def test_a_fault_without_an_id_has_one_made_of_what_it_answers() -> None:
    related = "<wsa:RelatesTo>urn:uuid:7</wsa:RelatesTo>"
    header = decode(fault_document("<env:Value>env:Sender</env:Value>", relates_to=related).encode()).header
    assert (header.message_id, header.relates_to) == (message_id("fault", "urn:uuid:7"), "urn:uuid:7")


@pytest.mark.parametrize(
    ("codes", "code"),
    [
        ("<env:Value>env:Receiver</env:Value>", "env:Receiver"),
        ("<env:Value> env:Receiver\n</env:Value>", "env:Receiver"),
        ("<env:Value>strange:Own</env:Value>", "env:Sender"),
        ("", "env:Sender"),
        (
            "<env:Value>env:Receiver</env:Value><env:Subcode><env:Value>frp:A</env:Value>"
            "<env:Subcode><env:Value>wsa:B</env:Value></env:Subcode></env:Subcode>",
            "wsa:B",
        ),
        ("<env:Value>env:Receiver</env:Value><env:Subcode><env:Value>x:A</env:Value></env:Subcode>", "env:Receiver"),
    ],
)
def test_the_innermost_code_that_is_known_counts(codes: str, code: str) -> None:
    assert decode(fault_document(codes).encode()).body == frp.Fault(code=code, text="no")


def test_a_fault_without_a_reason_says_so() -> None:
    document = fault_document("<env:Value>env:Sender</env:Value>")
    silent = document.partition("<env:Reason>")[0] + document.partition("</env:Reason>")[2]
    assert decode(silent.encode()).body == frp.Fault(code="env:Sender", text="no reason was given")
    strange = fault_document("<env:Value>env:Sender</env:Value>", detail="<env:Detail><a/></env:Detail>")
    assert decode(strange.encode()).body == frp.Fault(code="env:Sender", text="no")


@pytest.mark.parametrize(
    ("kind", "action"),
    [(frp.Fault, f"{soap.WSA}/fault"), (frp.Stop, f"{soap.FRP}:Stop"), (knowledge.ReadMap, f"{soap.KNOWLEDGE}:ReadMap")],
)
def test_the_action_of_a_type_of_message(kind: type[Struct], action: str) -> None:
    assert soap.action(kind) == action


def test_what_cannot_be_carried_names_the_element() -> None:
    for header, name in ((structs.replace(HEADER, recipient="\x00"), "To"), (structs.replace(HEADER, relates_to="\x00"), "RelatesTo")):
        with pytest.raises(WireError) as caught:
            encode(Message(header=header, body=QUERY.body))
        assert (caught.value.code, caught.value.text) == (SENDER, f"{name} has a character that XML cannot carry")


@pytest.mark.parametrize("depth", [MOST_DEPTH, MOST_DEPTH + 1])
def test_how_deep_a_document_may_be(depth: int) -> None:
    document = b"<a>" * depth + b"</a>" * depth
    if depth == MOST_DEPTH:
        assert parse(document).tag == "a"
        return
    with pytest.raises(WireError) as caught:
        parse(document)
    assert (caught.value.code, caught.value.text) == (SENDER, "the document is nested more than 32 deep")
