"""The protocol between drivers of symbolic devices and the symbolic world: one JSON line as request, one as reply."""

from __future__ import annotations

from typing import Any

import msgspec
from msgspec import Struct

from somrs.errors import WireError

LONGEST = 1024 * 1024
"""Longest line that is read, in bytes."""


class Hello(Struct, frozen=True, kw_only=True, tag="hello", tag_field="ask"):
    """Request the type and the services of a device."""

    device: str


class Welcome(Struct, frozen=True, kw_only=True, tag="welcome", tag_field="say"):
    """Reply to `Hello`: the type of the device, and the names of the service types that it offers."""

    type: str
    services: tuple[str, ...]


class _Service(Struct, frozen=True, kw_only=True, tag_field="ask"):
    """A service of a device, with its inputs as Entish terms."""

    device: str
    service: str
    inputs: dict[str, str]


class Estimate(_Service, frozen=True, kw_only=True, tag="estimate"):
    """Request the cost and the duration of a service."""


class Estimated(Struct, frozen=True, kw_only=True, tag="estimated", tag_field="say"):
    cost: float
    seconds: float


class Begin(_Service, frozen=True, kw_only=True, tag="begin"):
    """Check whether the service can be performed now. Changes nothing."""


class Apply(_Service, frozen=True, kw_only=True, tag="do"):
    """Apply the effect of the service."""


class Look(_Service, frozen=True, kw_only=True, tag="look"):
    """Request the current values of the facts and attributes in the service's effect."""


class Result(Struct, frozen=True, kw_only=True, tag="came", tag_field="say"):
    """Reply. `refusal`: why the service cannot be performed, or None; `situation`: the current state of what its effect mentions."""

    situation: str
    refusal: str | None = None


class Refused(Struct, frozen=True, kw_only=True, tag="refused", tag_field="say"):
    """Reply to a line that could not be processed."""

    reason: str


Request = Hello | Estimate | Begin | Apply | Look
Answer = Welcome | Estimated | Result | Refused

_REQUESTS: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)
_ANSWERS: msgspec.json.Decoder[Answer] = msgspec.json.Decoder(Answer)


def encode_line(line: Request | Answer) -> bytes:
    return msgspec.json.encode(line) + b"\n"


def read_request(line: bytes) -> Request:
    """Decode a request of a device. Raises WireError."""
    return _read(_REQUESTS, line)  # type: ignore[no-any-return]  # the decoder determines the type


def read_answer(line: bytes) -> Answer:
    """Decode a reply of the world. Raises WireError."""
    return _read(_ANSWERS, line)  # type: ignore[no-any-return]  # as above


def _read(decoder: msgspec.json.Decoder[Any], line: bytes) -> Any:
    try:
        return decoder.decode(line)
    except msgspec.DecodeError as error:
        raise WireError("line", f"{line[:80]!r} is not a line of the symbolic world's protocol: {error}") from None
