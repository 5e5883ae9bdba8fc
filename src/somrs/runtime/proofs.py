"""Whether the sender of a message may send it: by the certificate of the connection on which it came."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from functools import lru_cache
from typing import Any, NamedTuple

from somrs.errors import UsageError, WireError
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.rights import DENIED, check_right
from somrs.storage.audit_log import Actor, AuditLog
from somrs.storage.denial_counts import DenialCounts
from somrs.trust.connections import Peer, peer_of
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity

log = logging.getLogger(__name__)

Proof = Callable[[], Identity]
"""Returns the identity that is proven now. Raises UsageError if its certificate does not hold any more."""


class Source(NamedTuple):
    """Where messages come from. `host`: the IP address of the connection; None in a binding whose members are known. `proof`: who the
    sender is; None if nobody has to prove it."""

    host: str | None = None
    proof: Proof | None = None


NO_SOURCE = Source()
"""That of a binding whose members are known."""

current_source: ContextVar[Source] = ContextVar("current_source", default=NO_SOURCE)
"""Where the message comes from that is handled now."""


def proof_of(credentials: Credentials, certificate: Mapping[str, Any] | None) -> Proof:
    """The proof of who has the certificate of a connection."""

    def prove() -> Identity:
        if certificate is None:
            raise UsageError("this connection has no certificate; only messages with one are accepted here")
        return credentials.prove(_peer(_Hashable(certificate)), time.time())

    return prove


class Denials:
    """Refuses what senders have no right to send, and records it in the `audit_log`, as often as `DenialCounts` says. `check_message`:
    raises WireError for a message that its sender may not send."""

    def __init__(self, audit_log: AuditLog | None = None, check_message: Callable[[Message, Identity], None] = check_right) -> None:
        self._audit_log, self._check_message = audit_log, check_message
        self._counts = DenialCounts()

    def check(self, message: Message, proof: Proof, address: str = "") -> Identity:
        """Returns who has sent the message. Raises WireError if it is denied. `address`: from where it came."""
        name = ""
        try:
            identity = proof()
            name = identity.full_name
            self._check_message(message, identity)
        except UsageError as error:
            self._note(Actor(name=name, address=address), message, str(error))
            raise WireError(DENIED, str(error)) from None
        except WireError as error:
            self._note(Actor(name=name, address=address), message, error.text)
            raise
        return identity

    def _note(self, actor: Actor, message: Message, text: str) -> None:
        kind = type(message.body).__name__
        if (count := self._counts.add((actor, kind))) is None:
            return
        log.warning("denied: %s (%d times)", text, count)
        if self._audit_log is not None:
            try:
                self._audit_log.append(f"send {kind}", "denied", actor, {"why": text, "times": count})
            except UsageError as error:
                log.error("not in the audit log: %s", error)


class _Hashable:
    """A certificate of a connection. The same object is the same certificate."""

    def __init__(self, certificate: Mapping[str, Any]) -> None:
        self.certificate = certificate

    def __hash__(self) -> int:
        return id(self.certificate)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Hashable) and other.certificate is self.certificate


@lru_cache(maxsize=2000)
def _peer(certificate: _Hashable) -> Peer:
    return peer_of(certificate.certificate)
