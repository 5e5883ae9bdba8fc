"""The base class of all message bodies."""

from __future__ import annotations

from msgspec import Struct


class MessageBody(Struct, frozen=True, kw_only=True, tag=True, gc=False):
    """The body of a message. Its tag is the name of its class."""
