"""What the programs of devices and the program of a symbolic world say to each other: one JSON line, and one line back."""

from __future__ import annotations

from typing import Any

import msgspec
from msgspec import Struct

from somrs.errors import WireError

LONGEST = 1024 * 1024
"""Bytes of the longest line that is read."""


class Hello(Struct, frozen=True, kw_only=True, tag="hello", tag_field="ask"):
    """What can this device do?"""

    device: str


class Welcome(Struct, frozen=True, kw_only=True, tag="welcome", tag_field="say"):
    """What the device is, and the names of the service types that it offers."""

    type: str
    services: tuple[str, ...]


class _Service(Struct, frozen=True, kw_only=True, tag_field="ask"):
    """A service of a device, with its inputs as Entish terms."""

    device: str
    service: str
    inputs: dict[str, str]


class Estimate(_Service, frozen=True, kw_only=True, tag="estimate"):
    """What would it cost?"""


class Estimated(Struct, frozen=True, kw_only=True, tag="estimated", tag_field="say"):
    cost: float
    seconds: float


class Begin(_Service, frozen=True, kw_only=True, tag="begin"):
    """Could it be done now? Nothing changes by asking."""


class Apply(_Service, frozen=True, kw_only=True, tag="do"):
    """Do it."""


class Look(_Service, frozen=True, kw_only=True, tag="look"):
    """What holds of what its effect speaks of?"""


class Result(Struct, frozen=True, kw_only=True, tag="came", tag_field="say"):
    """How it is: `refusal` says why it cannot be done, or could not; `situation`, what holds now of what the effect speaks of."""

    situation: str
    refusal: str | None = None


class Refused(Struct, frozen=True, kw_only=True, tag="refused", tag_field="say"):
    """The line could not be answered."""

    reason: str


Request = Hello | Estimate | Begin | Apply | Look
Answer = Welcome | Estimated | Result | Refused

_REQUESTS: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)
_ANSWERS: msgspec.json.Decoder[Answer] = msgspec.json.Decoder(Answer)


def encode_line(line: Request | Answer) -> bytes:
    return msgspec.json.encode(line) + b"\n"


def read_request(line: bytes) -> Request:
    """What a device asks. Raises WireError."""
    return _read(_REQUESTS, line)  # type: ignore[no-any-return]  # the decoder says


def read_answer(line: bytes) -> Answer:
    """What the world says. Raises WireError."""
    return _read(_ANSWERS, line)  # type: ignore[no-any-return]  # as above


def _read(decoder: msgspec.json.Decoder[Any], line: bytes) -> Any:
    try:
        return decoder.decode(line)
    except msgspec.DecodeError as error:
        raise WireError("line", f"{line[:80]!r} is no line of a symbolic world: {error}") from None
