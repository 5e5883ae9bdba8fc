"""What goes over the bus: messages as msgpack, and subjects made from addresses."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.errors import WireError
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.soap.document import MOST_BYTES
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.bus_format import decode, encode, fault
from tests.support.bodies import KINDS, messages
from tests.support.sessions import message

BUS = BusAddress(servers="nats://127.0.0.1:4222", site="office", gateway="http://robots.example:8600")
segments = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="/"), min_size=1, max_size=8)


@given(st.sampled_from(KINDS).flatmap(messages))
def test_every_message_is_the_same_behind_the_bus(sent: Message) -> None:
    assert decode(encode(sent)) == sent


@given(st.binary(max_size=200))
def test_other_bytes_are_refused(document: bytes) -> None:
    with pytest.raises(WireError, match="this is not a message"):
        decode(document)


def test_a_message_with_a_wrong_value_is_refused() -> None:
    written = msgspec.msgpack.decode(encode(message(frp.Stop(reason="enough"))))
    written["body"]["reason"] = 7
    with pytest.raises(WireError, match=r"Expected `str`, got `int` - at `\$.body.reason`"):
        decode(msgspec.msgpack.encode(written))


def test_a_message_that_soap_could_not_carry_is_too_large_for_the_bus_as_well() -> None:
    with pytest.raises(WireError, match=f"the limit is {MOST_BYTES}"):
        encode(message(frp.Stop(reason="x" * MOST_BYTES)))


def test_a_fault_says_what_was_wrong_with_which_message() -> None:
    report = decode(fault(WireError("env:Sender", "no such thing"), "urn:uuid:1"))
    assert report.body == frp.Fault(code="env:Sender", text="no such thing")
    assert report.header.relates_to == "urn:uuid:1"


def test_a_subject_reads_like_its_address() -> None:
    assert BUS.subject("/devices/Robot001") == "somrs.office.devices.Robot001"


@given(st.lists(segments, min_size=1, max_size=3), st.lists(segments, min_size=1, max_size=3))
def test_no_two_addresses_have_the_same_subject(path: list[str], second_path: list[str]) -> None:
    subject, second_subject = (BUS.subject("/" + "/".join(map(_quoted, segments))) for segments in (path, second_path))
    assert (subject == second_subject) == (path == second_path)
    for token in subject.split("."):
        assert token
        assert not {*token} & {"*", ">", " ", "\t", "\n", "\r"}


def _quoted(segment: str) -> str:
    from urllib.parse import quote

    return quote(segment, safe="")


@pytest.mark.parametrize("name", ["", "two words", "a.b", "office>", "*"])
def test_a_name_that_no_subject_can_have_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="letters, digits"):
        BusAddress(servers="nats://127.0.0.1", site=name, gateway="http://127.0.0.1")
