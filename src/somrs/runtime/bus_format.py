"""The format of messages on the bus: msgpack."""

from __future__ import annotations

import msgspec

from somrs.errors import WireError
from somrs.kernel import codec
from somrs.kernel.codec import Codec
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.protocol.soap.document import MOST_BYTES, SENDER
from somrs.runtime.reception import Format

_MESSAGES: Codec[Message] = Codec(Message)


def encode(message: Message) -> bytes:
    """The message as msgpack. Raises WireError when it is too large for the other bindings."""
    document = codec.encode(message)
    if len(document) > MOST_BYTES:
        raise WireError(SENDER, f"the message has {len(document)} bytes; the limit is {MOST_BYTES}")
    return document


def decode(document: bytes) -> Message:
    """Return the message. Raises WireError for any invalid bytes."""
    try:
        return _MESSAGES.decode(document)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise WireError(SENDER, f"this is not a message: {error}") from None


def fault(error: WireError, relates_to: str | None = None) -> bytes:
    """The message that reports an error."""
    header = Header(sender=ANONYMOUS, recipient=ANONYMOUS, message_id=message_id(relates_to, "fault"), relates_to=relates_to)
    return encode(Message(header=header, body=frp.Fault(code=error.code, text=error.text[: MOST_BYTES // 8])))


MSGPACK = Format(encode, decode, fault)
