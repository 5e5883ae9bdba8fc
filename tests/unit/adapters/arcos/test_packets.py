"""ARCOS packets in a stream that is torn, shifted and noisy."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.arcos.packets import PacketParser, checksum, frame

BODIES = st.binary(min_size=1, max_size=60)
FILLER = frame(b"\x00" * 247)
"""Longer than any packet that noise could have begun."""


def torn(data: bytes, cuts: list[int]) -> list[bytes]:
    places = sorted({cut % (len(data) + 1) for cut in cuts})
    return [data[start:end] for start, end in zip([0, *places], [*places, len(data)], strict=True)]


@given(st.binary(min_size=1, max_size=247))
def test_a_packet_is_read_as_it_was_written(body: bytes) -> None:
    assert PacketParser().feed(frame(body)) == [body]


def test_packets_of_the_manual() -> None:
    """The synchronization packets, and CLOSE, as they are on the line."""
    assert frame(b"\x00") == bytes.fromhex("fafb03000000")
    assert frame(b"\x01") == bytes.fromhex("fafb03010001")
    assert frame(b"\x02") == bytes.fromhex("fafb03020002")
    assert frame(bytes.fromhex("043b0100")) == bytes.fromhex("fafb06043b0100053b")


@given(st.lists(BODIES, max_size=6), st.lists(st.integers(0, 400), max_size=12))
def test_packets_may_arrive_in_any_pieces(bodies: list[bytes], cuts: list[int]) -> None:
    parser = PacketParser()
    stream = b"".join(frame(body) for body in bodies)
    assert [body for piece in torn(stream, cuts) for body in parser.feed(piece)] == bodies
    assert parser.discarded == 0


@given(st.binary(max_size=300), BODIES)
def test_after_any_noise_packets_are_found_again(noise: bytes, body: bytes) -> None:
    bodies = PacketParser().feed(noise + frame(body) + FILLER + FILLER)
    assert body in bodies


@given(BODIES, st.integers(0, 10**6), st.integers(1, 255), BODIES)
def test_a_damaged_packet_is_left_out(body: bytes, place: int, damage: int, following: bytes) -> None:
    packet = bytearray(frame(body))
    packet[place % len(packet)] ^= damage
    bodies = PacketParser().feed(bytes(packet) + frame(following) + FILLER + FILLER)
    assert following in bodies


@given(st.lists(st.binary(max_size=80), max_size=8))
def test_no_bytes_whatever_crash_the_parser_and_what_it_finds_has_the_right_checksum(pieces: list[bytes]) -> None:
    parser, stream = PacketParser(), b"".join(pieces)
    for piece in pieces:
        for body in parser.feed(piece):
            assert checksum(body).to_bytes(2, "big") in stream


def test_a_lost_byte_costs_one_packet() -> None:
    first, second, third = frame(b"first"), frame(b"second"), frame(b"third")
    for index in range(len(second)):
        damaged = second[:index] + second[index + 1 :]
        bodies = PacketParser().feed(first + damaged + third + FILLER)
        assert bodies[0] == b"first"
        assert b"third" in bodies
