"""A message: a header, which is the same for all, and a body. The bodies are in the other modules of this package."""

from __future__ import annotations

import uuid
from hashlib import sha1

from msgspec import Struct

from somrs.protocol.messages.bodies import Body

VERSION = "1.0"
"""The version of the protocol, in every header."""

ANONYMOUS = "http://www.w3.org/2005/08/addressing/anonymous"
"""WS-Addressing 1.0 Core, 2.1: reply on the connection on which the message came."""

_NAMESPACE = uuid.UUID("6f1c9f0e-5a58-5b5e-9a36-50e4c0a0f5f1").bytes
_VARIANT = {digit: "89ab"[int(digit, 16) % 4] for digit in "0123456789abcdef"}


class Header(Struct, frozen=True, kw_only=True, gc=False):
    """The sender, the recipient, and what the message belongs to (paper, "Protocol for failure handling and recovery").

    Addresses are URLs. `transaction` and `participant` are set in messages of the Failure Recovery Protocol only; together with
    `relates_to`, they correlate its messages.
    """

    sender: str
    recipient: str
    message_id: str
    relates_to: str | None = None
    reply_to: str = ANONYMOUS
    transaction: str | None = None
    participant: str | None = None
    version: str = VERSION


class Message(Struct, frozen=True, kw_only=True, gc=False):
    # A message is a tree of values: the collector of cycles has nothing to find in the thousands that tasks keep.

    header: Header
    body: Body


def message_id(*parts: object) -> str:
    """Return a deterministic id: the same parts give the same id, so that a repeated message is the same message."""
    text = "/".join(map(str, parts))
    digest = sha1(_NAMESPACE + text.encode(), usedforsecurity=False).hexdigest()
    # RFC 9562, 5.5. `uuid.uuid5` returns the same value, but creates an object first and takes several times as long.
    return f"urn:uuid:{digest[:8]}-{digest[8:12]}-5{digest[13:16]}-{_VARIANT[digest[16]]}{digest[17:20]}-{digest[20:32]}"


def normalised_id(text: str) -> str:
    """Return the one form of an id: `uuid:X` and `urn:uuid:X`, in either case, are the same."""
    bare = text.strip()
    lowered = bare.lower()
    for prefix in ("urn:uuid:", "uuid:"):
        if lowered.startswith(prefix):
            return f"urn:uuid:{lowered.removeprefix(prefix)}"
    return bare


def reply(request: Message, body: Body, sender: str) -> Message:
    """Return the reply to a message: addressed to its ReplyTo, related to it, in the same transaction."""
    header = request.header
    return Message(
        header=Header(
            sender=sender,
            recipient=header.reply_to,
            message_id=message_id(header.message_id, "reply", type(body).__name__),
            relates_to=header.message_id,
            reply_to=sender,
            transaction=header.transaction,
            participant=header.participant,
        ),
        body=body,
    )
