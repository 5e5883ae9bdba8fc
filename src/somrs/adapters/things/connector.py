"""What connects things: a broker, a server or a Modbus device. The modules `mqtt`, `http` and `modbus` have one connector each."""

from __future__ import annotations

import logging
from typing import Protocol

from somrs.adapters.things.conversion import Raw
from somrs.adapters.things.model import Command, Connection, Source
from somrs.adapters.things.state import Payload, SourceKey
from somrs.errors import SomrsError

log = logging.getLogger(__name__)

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 15.0
"""Seconds after which a connection is tried again: at first, and at the longest."""


class Rejection(SomrsError):
    """A thing did not take a message. `is_received`: it has received it, and refused it."""

    def __init__(self, description: str, *, is_received: bool) -> None:
        self.description, self.is_received = description, is_received
        super().__init__(description)


class Listener(Protocol):
    """Receives what connectors hear."""

    def received(self, key: SourceKey, payload: Payload) -> None:
        """A message of a source."""

    def unreadable(self, key: SourceKey, problem: str) -> None:
        """A source cannot be read, for a reason that stays: the other end refuses it. Its next message is the end of this."""

    def reached(self, connection: str, is_reached: bool) -> None:
        """The connection is there, or it is refused or lost. That it does not answer is neither."""


class Connector(Protocol):
    """One connection, which is tried again until it is there."""

    async def run(self) -> None:
        """Connect, and pass on what is heard, until it is cancelled."""

    def follow(self, source: Source) -> None:
        """Pass on the messages of a source, too."""

    def unfollow(self, source: Source) -> None:
        """Pass on the messages of a source no more."""

    async def send(self, command: Command, raw: Raw) -> None:
        """Send a message, as soon as the connection is there, and return when it has been taken. Raises Rejection and InputError."""


def why_not_there(error: Exception, connection: Connection, *, is_refused: bool = False) -> str:
    """What is wrong with a connection, and what to do. `is_refused`: the other end does not accept who asks."""
    text = str(error)
    if is_refused:
        return f"refuses {connection.user or 'who has no user'} ({text}); correct user and password_file"
    if "CERTIFICATE_VERIFY_FAILED" in text:
        return f"has a certificate that is not trusted ({text}); write who has signed it: certificates: {{authority: FILE}}"
    if "CERTIFICATE_REQUIRED" in text:
        return f"wants a certificate ({text}); write certificates: {{certificate: FILE, key: FILE}}"
    return f"is not there ({text}); it is tried again"


class ConnectionNotes:
    """Logs how a connection is, whenever it changes."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._last_text = connection, ""

    def note(self, text: str, *, is_bad: bool = True) -> None:
        if text != self._last_text:
            log.log(logging.WARNING if is_bad else logging.INFO, "%s (%s): %s", self._connection.name, self._connection, text)
            self._last_text = text

    def forget(self) -> None:
        """Log the next text, whatever it is."""
        self._last_text = ""
