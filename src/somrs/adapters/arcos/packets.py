"""The frame of ARCOS packets, which is the same in both directions, and a parser that finds packets in a stream of bytes.

    FA FB  count  body ...  checksum (2 bytes, high byte first)

`count` is the length of the body and of the checksum. The first byte of the body is the number of a command, or the type of a report.
Source: Pioneer 3 Operations Manual, chapter 6 (ARCOS), "Packet protocols".
"""

from __future__ import annotations

HEADER = b"\xfa\xfb"
LARGEST_COUNT = 249
"""A packet has at most so many bytes after its count (Operations Manual, table 3)."""
SMALLEST_COUNT = 3


def checksum(body: bytes) -> int:
    """The checksum of a body: the sum of its pairs of bytes, and a single byte at the end by exclusive or. 16 bits."""
    total = sum(int.from_bytes(body[index : index + 2], "big") for index in range(0, len(body) - 1, 2)) & 0xFFFF
    return total ^ body[-1] if len(body) % 2 else total


def frame(body: bytes) -> bytes:
    """The packet with a body of 1 to 247 bytes."""
    assert SMALLEST_COUNT - 2 <= len(body) <= LARGEST_COUNT - 2, "the length of a body"
    return HEADER + bytes([len(body) + 2]) + body + checksum(body).to_bytes(2, "big")


def packet_length(body: bytes) -> int:
    """How many bytes the packet with a body has."""
    return len(HEADER) + 1 + len(body) + 2


class PacketParser:
    """Finds packets in a stream of bytes that may be torn, shifted or noisy.

    Only what has the right checksum is a packet. What seemed to be one and is none is searched for packets again, from its second byte on.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.discarded = 0
        """How many bytes belonged to no packet."""

    @property
    def is_waiting(self) -> bool:
        """Whether a packet has begun that is not complete."""
        return bool(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """Take in bytes, and return the bodies of the packets that they complete."""
        self._buffer += data
        bodies = []
        while (length := self._find()) is not None:
            body = bytes(self._buffer[3 : length - 2])
            if checksum(body) == int.from_bytes(self._buffer[length - 2 : length], "big"):
                bodies.append(body)
                del self._buffer[:length]
            else:
                self._discard(1)
        return bodies

    def _find(self) -> int | None:
        """Discard what is before the next header, and return the length of its packet; None if not all of it has arrived."""
        while True:
            start = self._buffer.find(HEADER)
            if start < 0:
                # The first byte of a header may be the last one so far.
                self._discard(len(self._buffer) - self._buffer.endswith(HEADER[:1]))
                return None
            self._discard(start)
            if len(self._buffer) < 3:
                return None
            count = self._buffer[2]
            if SMALLEST_COUNT <= count <= LARGEST_COUNT:
                return 3 + count if len(self._buffer) >= 3 + count else None
            self._discard(1)

    def _discard(self, count: int) -> None:
        self.discarded += count
        del self._buffer[:count]
