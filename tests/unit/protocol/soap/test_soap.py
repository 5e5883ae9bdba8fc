"""Messages as SOAP: every body survives the journey, and whatever else comes gets a Fault that says what was wrong."""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree
from msgspec import Struct, structs

from somrs.errors import WireError
from somrs.ontology.types import Value
from somrs.protocol.messages import frp, knowledge, submission
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES, SENDER
from somrs.protocol.soap.soap import decode, encode
from tests.support.bodies import KINDS, messages
from tests.support.examples import examples

HEADER = Header(
    sender="http://here/task-manager",
    recipient="http://there/devices/Robot1",
    message_id=message_id("m"),
    reply_to="http://here/task-manager",
    transaction=message_id("t"),
    participant="Robot1.TransferObject#s1",
)
ARRANGE = Message(
    header=HEADER,
    body=frp.Arrange(service_type="TransferObject", inputs={"Object": "Jar1", "Destination": "Table2"}, effect="Jar1 isOn Table2"),
)
DOCUMENT = encode(ARRANGE).decode()


def query(formula: str) -> Message:
    return Message(
        header=Header(sender=ANONYMOUS, recipient="http://r", message_id=message_id("q")), body=knowledge.QueryMap(formula=formula)
    )


def refused(document: str | bytes) -> WireError:
    with pytest.raises(WireError) as caught:
        decode(document.encode() if isinstance(document, str) else document)
    return caught.value


def changed(old: str, new: str) -> str:
    """The document with one thing in it changed."""
    assert DOCUMENT.count(old) == 1, f"{old} is not once in {DOCUMENT}"
    return DOCUMENT.replace(old, new)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_body_survives(kind: type[Struct]) -> None:
    @examples(15)
    @given(messages(kind))
    def survives(message: Message) -> None:
        assert decode(encode(message)) == message

    survives()


@pytest.mark.parametrize("text", ["", " ", "\r", "a\r\nb\n", "\ta ", "<![CDATA[x]]>", "&lt;", "ł 日本 \U0001f916", "\u0085\u2028\ufffd"])
def test_texts_survive(text: str) -> None:
    assert decode(encode(query(text))) == query(text)
    named = structs.replace(ARRANGE, body=frp.Execute(inputs={f"{text}x": text}))
    assert decode(encode(named)) == named


def test_values_keep_their_kind() -> None:
    outputs: dict[str, Value] = {"a": 1.0, "b": True, "c": "1", "d": "true", "e": float("inf"), "f": 1e-300, "g": False, "h": ""}
    body = decode(encode(structs.replace(ARRANGE, body=frp.Completed(situation="", outputs=outputs)))).body
    assert isinstance(body, frp.Completed)
    assert {name: (type(value), value) for name, value in body.outputs.items()} == {n: (type(v), v) for n, v in outputs.items()}


@pytest.mark.parametrize("character", ["\x00", "\x0b", "\x1f", "\ud800", "\ufffe", "\uffff"])
def test_what_xml_cannot_carry_is_refused_when_it_is_sent(character: str) -> None:
    for message in (
        query(f"a{character}"),
        structs.replace(ARRANGE, body=frp.Execute(inputs={character: "x"})),
        structs.replace(ARRANGE, header=structs.replace(HEADER, participant=character)),
        structs.replace(ARRANGE, header=structs.replace(HEADER, sender=character)),
    ):
        with pytest.raises(WireError, match="character"):
            encode(message)


def test_a_fault_says_its_reason_even_if_xml_cannot_carry_it() -> None:
    answer = decode(soap.fault(WireError("wsa:ActionNotSupported", "no \x00\ud800 such"), message_id("m")))
    assert answer.body == frp.Fault(code="wsa:ActionNotSupported", text="no ?? such")
    assert answer.header.relates_to == message_id("m")


@pytest.mark.parametrize(
    ("code", "expected_code"),
    [("Sender", "env:Sender"), ("Receiver", "env:Receiver"), ("ActionNotSupported", "wsa:ActionNotSupported"), ("x:y", "env:Sender")],
)
def test_fault_codes_without_a_prefix(code: str, expected_code: str) -> None:
    assert decode(encode(structs.replace(ARRANGE, body=frp.Fault(code=code, text="t")))).body == frp.Fault(code=expected_code, text="t")


def test_the_prefixes_of_a_foreign_fault_mean_what_they_are_bound_to() -> None:
    document = soap.fault(WireError("wsa:ActionNotSupported", "no")).decode()
    foreign = document.replace("env:", "S:").replace("xmlns:env", "xmlns:S").replace("wsa:", "a:").replace("xmlns:wsa", "xmlns:a")
    assert decode(foreign.encode()).body == frp.Fault(code="wsa:ActionNotSupported", text="no")


@pytest.mark.parametrize("body", [knowledge.Rejected(problems=("a", "b")), submission.TaskRejected(problem="no task")])
def test_a_refusal_is_a_soap_fault_with_the_answer_in_it(body: knowledge.Rejected | submission.TaskRejected) -> None:
    message = Message(header=Header(sender="http://a", recipient="http://b", message_id=message_id(1), relates_to=message_id(2)), body=body)
    document = encode(message)
    assert etree.fromstring(document).findtext(f".//{{{soap.ENV}}}Fault/{{{soap.ENV}}}Reason/{{{soap.ENV}}}Text") in ("a\nb", "no task")
    assert decode(document) == message


# Whatever comes

ENTITIES = '<!ENTITY l0 "lol">' + "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp037"])
@pytest.mark.parametrize(
    "declared",
    [
        "<!DOCTYPE x>",
        f"<!DOCTYPE x [{ENTITIES}]>",
        '<!DOCTYPE x SYSTEM "SECRET">',
        '<!DOCTYPE x [<!ENTITY l11 SYSTEM "SECRET">]>',
        '<!DOCTYPE x [<!ENTITY % p SYSTEM "SECRET"> %p;]>',
        "<!-- a --><?pi?>\n<!DOCTYPE x []>",
    ],
)
def test_no_document_type_is_looked_at(declared: str, encoding: str, tmp_path: Path) -> None:
    """A file that is named is a pipe: whoever opened it would hang."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    document = declared.replace("SECRET", pipe.as_uri()) + DOCUMENT.partition("?>")[2].replace("TransferObject<", "&l11;<")
    for text in (document, f'<?xml version="1.0" encoding="{encoding}"?>{document}'):
        assert refused(text.encode(encoding)).code == SENDER
    if encoding in ("utf-8", "utf-8-sig", "utf-16"):
        assert "document type declaration" in refused(document.encode(encoding)).text


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_unicode_encodings_are_read(encoding: str) -> None:
    assert decode(DOCUMENT.partition("?>")[2].encode(encoding)) == ARRANGE
    assert decode(f'<?xml version="1.0" encoding="{encoding[:6].rstrip("-")}"?>{DOCUMENT.partition("?>")[2]}'.encode(encoding)) == ARRANGE


def test_size() -> None:
    free_bytes = MOST_BYTES - len(encode(query("")))
    assert len(encode(query("a" * free_bytes))) == MOST_BYTES
    assert decode(encode(query("a" * free_bytes))) == query("a" * free_bytes)
    with pytest.raises(WireError, match="262145 bytes"):
        encode(query("a" * (free_bytes + 1)))
    assert "262145 bytes" in refused(encode(query("a" * free_bytes)) + b" ").text


@pytest.mark.parametrize("depth", [33, 200, 60_000])
def test_depth(depth: int) -> None:
    assert refused("<a>" * depth + "</a>" * min(depth, 1000)).code == SENDER
    assert refused(changed("<m:ServiceType>TransferObject", f"<m:ServiceType>{'<a>' * depth}{'</a>' * depth}")[:MOST_BYTES]).code == SENDER


@pytest.mark.parametrize("name", ["To", "From", "ReplyTo", "FaultTo", "Action", "MessageID", "RelatesTo"])
def test_a_repeated_addressing_header(name: str) -> None:
    address = "<wsa:Address>http://x</wsa:Address>" if name in ("From", "ReplyTo", "FaultTo") else "http://x"
    block = f"<wsa:{name}>{address}</wsa:{name}>"
    assert refused(changed("</env:Header>", f"{block}{block}</env:Header>")).code == soap.CARDINALITY


def test_relations_of_another_kind_may_be_there_besides() -> None:
    other_relation = '<wsa:RelatesTo RelationshipType="urn:x">urn:y</wsa:RelatesTo>'
    assert decode(changed("</env:Header>", f"{other_relation * 2}</env:Header>").encode()) == ARRANGE


@pytest.mark.parametrize("header", ["x:Security", "wsa:Strange"])
def test_headers_that_are_not_understood(header: str) -> None:
    def with_header(attributes: str) -> str:
        return changed("</env:Header>", f'<{header} xmlns:x="urn:x" {attributes}/></env:Header>')

    for flag in ("1", "true", " true "):
        assert refused(with_header(f'env:mustUnderstand="{flag}"')).code == "env:MustUnderstand"
        assert refused(with_header(f'env:mustUnderstand="{flag}" env:role="{soap.ENV}/role/next"')).code == "env:MustUnderstand"
        assert decode(with_header(f'env:mustUnderstand="{flag}" env:role="{soap.ENV}/role/none"').encode()) == ARRANGE
    for optional in ("", 'env:mustUnderstand="0"', 'env:mustUnderstand="false"'):
        assert decode(with_header(optional).encode()) == ARRANGE


def not_understood(fault: bytes) -> list[str]:
    """The names that the NotUnderstood blocks of a Fault have, as `{namespace}name`."""
    blocks = etree.fromstring(fault).iterfind(f"{{{soap.ENV}}}Header/{{{soap.ENV}}}NotUnderstood")
    split = [(block.nsmap, *block.get("qname", "").rpartition(":")) for block in blocks]
    return [f"{{{names.get(prefix, soap.XML)}}}{name}" if prefix else name for names, prefix, _, name in split]


def test_a_fault_names_every_header_that_was_not_understood() -> None:
    attribute = 'env:mustUnderstand="1"'
    blocks = (
        f'<x:A xmlns:x="urn:x" {attribute}/><B xmlns="urn:y?a=1&amp;b=2" {attribute}/><wsa:Strange {attribute}/>'
        f"<xml:c {attribute}/><d {attribute}/>"
    )
    document = changed("</env:Header>", f"{blocks}</env:Header>")
    fault = soap.fault(refused(document))
    assert not_understood(fault) == ["{urn:x}A", "{urn:y?a=1&b=2}B", f"{{{soap.WSA}}}Strange", f"{{{soap.XML}}}c", "d"]
    assert decode(fault).body == frp.Fault(code="env:MustUnderstand", text="the header {urn:x}A is not understood here")


def test_so_many_headers_are_not_understood_that_a_fault_cannot_name_them_all() -> None:
    blocks = "".join(f'<h{i}{"x" * (i == 0) * 1000} env:mustUnderstand="1"/>' for i in range(1000))
    assert not_understood(soap.fault(refused(changed("</env:Header>", f"{blocks}</env:Header>")))) == [f"h{i}" for i in range(1, 21)]


def test_addressing_headers_for_another_role_are_not_ours() -> None:
    for role in (f"{soap.ENV}/role/none", "urn:gateway"):
        blocks = f'<wsa:MessageID env:role="{role}">urn:theirs</wsa:MessageID><wsa:ReplyTo env:role="{role}"/>'
        assert decode(changed("</env:Header>", f"{blocks}</env:Header>").encode()) == ARRANGE
    ours = f'<wsa:FaultTo env:role="{soap.ENV}/role/ultimateReceiver"/>'
    assert refused(changed("</env:Header>", f"{ours}</env:Header>")).code == soap.INVALID_HEADER


@pytest.mark.parametrize("code", [soap.CARDINALITY, soap.ACTION_MISMATCH, soap.NO_ADDRESS])
def test_what_is_invalid_in_a_header_is_said_beneath_its_being_invalid(code: str) -> None:
    """WS-Addressing 1.0 SOAP Binding, 6.4.1."""
    fault = soap.fault(WireError(code, "no"))
    assert [value.text for value in etree.fromstring(fault).iter(f"{{{soap.ENV}}}Value")] == ["env:Sender", soap.INVALID_HEADER, code]
    assert decode(fault).body == frp.Fault(code=code, text="no")


def test_a_code_beneath_one_that_is_known_may_be_strange() -> None:
    fault = soap.fault(WireError(soap.CARDINALITY, "no")).decode()
    assert decode(fault.replace(soap.CARDINALITY, "strange:Own").encode()).body == frp.Fault(code=soap.INVALID_HEADER, text="no")


@pytest.mark.parametrize(
    ("document", "code", "excerpt"),
    [
        (DOCUMENT.replace(soap.ENV, "http://schemas.xmlsoap.org/soap/envelope/"), "env:VersionMismatch", "SOAP 1.2"),
        ("<a/>", SENDER, "a SOAP Envelope was expected"),
        ("", SENDER, "not well-formed XML"),
        ("{}", SENDER, "not well-formed XML"),
        (changed("</env:Body>", "<a/></env:Body>"), SENDER, "2 elements"),
        (re.sub("<env:Body>.*</env:Body>", "<env:Body/>", DOCUMENT), SENDER, "0 elements"),
        (re.sub("<env:Body>.*</env:Body>", "", DOCUMENT), SENDER, "one Body"),
        (DOCUMENT.replace("m:Arrange", "m:Arange"), soap.ACTION_NOT_SUPPORTED, "Arange is not a known message"),
        (DOCUMENT.replace(f'xmlns:m="{soap.FRP}"', 'xmlns:m="urn:so-mrs:frp:2.0"'), "frp:UnknownVersion", "frp:2.0"),
        (changed(f"{soap.FRP}:Arrange", f"{soap.FRP}:Cancel"), soap.ACTION_MISMATCH, "urn:so-mrs:frp:1.0:Arrange"),
        (re.sub("<wsa:Action>.*</wsa:Action>", "", DOCUMENT), soap.HEADER_REQUIRED, "wsa:Action is missing"),
        (re.sub("<wsa:MessageID>.*</wsa:MessageID>", "", DOCUMENT), soap.HEADER_REQUIRED, "wsa:MessageID is missing"),
        (re.sub("<wsa:To>.*</wsa:To>", "<wsa:To> </wsa:To>", DOCUMENT), soap.INVALID_HEADER, "wsa:To is empty"),
        (re.sub("<wsa:ReplyTo>.*</wsa:ReplyTo>", "<wsa:ReplyTo/>", DOCUMENT), soap.INVALID_HEADER, "wsa:ReplyTo is empty"),
        (re.sub("<wsa:MessageID>", "<wsa:MessageID><a/>", DOCUMENT), soap.INVALID_HEADER, "elements are in wsa:MessageID"),
        (re.sub("(<wsa:ReplyTo>)(.*)(</wsa:ReplyTo>)", r"\1\2\2\3", DOCUMENT), soap.CARDINALITY, "wsa:ReplyTo has 2 addresses"),
        (re.sub("(<wsa:ReplyTo>).*(</wsa:ReplyTo>)", r"\1<a/>\2", DOCUMENT), soap.NO_ADDRESS, "wsa:ReplyTo has 0 addresses"),
        (changed("<m:Version>1.0<", "<m:Version>9.9<"), "frp:UnknownVersion", "9.9"),
        (re.sub("<m:Transaction>.*</m:Transaction>", "", DOCUMENT), SENDER, "Transaction and Participant"),
        (re.sub("<m:Participant>.*</m:Participant>", "<m:Participant/>", DOCUMENT), SENDER, "Transaction and Participant"),
        (changed("<m:Version>", "<m:Participant>x</m:Participant><m:Version>"), SENDER, "Participant is there twice"),
        (re.sub("<m:Effect>.*</m:Effect>", "", DOCUMENT), SENDER, "Arrange: Effect is missing"),
        (changed("<m:Effect>", "<m:Effect/><m:Effect>"), SENDER, "Effect is there twice"),
        (changed("<m:Effect>", "<m:Efect/><m:Effect>"), SENDER, "Efect in urn:so-mrs:frp:1.0 is unknown"),
        (changed("<m:Effect>", "<m:ReplyBy>soon</m:ReplyBy><m:Effect>"), SENDER, "ReplyBy: 'soon' is no number"),
        (changed("<m:Effect>", "<m:ReplyBy>١</m:ReplyBy><m:Effect>"), SENDER, "is no number"),
        (changed(' name="Object"', ' name="Destination"'), SENDER, "two entries are named 'Destination'"),
        (changed(' name="Object"', ""), SENDER, "Entry elements with a name"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_message(document: str, code: str, excerpt: str) -> None:
    error = refused(document)
    assert error.code == code
    assert excerpt in error.text


def test_ids_are_one_in_either_spelling() -> None:
    bare = message_id("m").removeprefix("urn:uuid:")
    for spelling in (f"uuid:{bare}", f"urn:uuid:{bare.upper()}", f" URN:UUID:{bare} "):
        assert decode(changed(message_id("m"), spelling).encode()) == ARRANGE


def test_sender_and_reply_to_may_be_missing() -> None:
    for name in ("From", "ReplyTo"):
        document = re.sub(f"<wsa:{name}>.*</wsa:{name}>", "", DOCUMENT)
        header = decode(document.encode()).header
        assert (header.sender if name == "From" else header.reply_to) == ANONYMOUS


@examples(50)
@given(st.binary(max_size=200) | st.text(max_size=100).map(lambda text: text.encode(errors="surrogatepass")))
def test_no_bytes_do_harm(document: bytes) -> None:
    refused(document)


EXAMPLES = [
    DOCUMENT.encode(),
    encode(query("a")),
    soap.fault(WireError("wsa:X", "y")),
    encode(structs.replace(ARRANGE, body=frp.Fault(code="frp:X", text=""))),
    encode(structs.replace(ARRANGE, body=knowledge.Rejected(problems=("a",)))),
]


@examples(100)
@given(st.data())
def test_no_mutation_does_harm(data: st.DataObject) -> None:
    """Bytes replaced, pieces cut out or doubled, tags exchanged: a message comes out of it, or a WireError."""
    document = data.draw(st.sampled_from(EXAMPLES))
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(document)))
        end = data.draw(st.integers(start, min(len(document), start + 40)))
        pieces = [document[end : end + 30], document[start:end] * 2]
        piece = data.draw(st.sampled_from([b"", b"<", b"/>", b"&#0;", b"&x;", b"<a/>", b"<?a?>", b"xmlns:a=''", b"\xff", b" ", *pieces]))
        document = document[:start] + piece + document[end:]
    with contextlib.suppress(WireError):
        assert isinstance(decode(document), Message)
