"""Whether the sender of a message may send it: by the certificate of the connection on which it came."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from functools import lru_cache
from typing import Any, NamedTuple

from somrs.errors import UsageError, WireError
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.rights import DENIED, check_right
from somrs.storage.audit_log import Actor, AuditLog
from somrs.trust.credentials import Credentials, Peer, peer_of
from somrs.trust.identity import Identity

log = logging.getLogger(__name__)

MOST_DENIALS = 1000
"""How many senders with types of messages are counted."""

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
        peer = _peer(_Hashable(certificate))
        credentials.check(peer, time.time())
        return peer.identity

    return prove


class Denials:
    """Refuses what senders have no right to send. The first time that a sender sends such a type of message is recorded in the `audit_log`,
    and then each tenth, hundredth and so on. `check_message`: raises WireError for a message that its sender may not send."""

    def __init__(self, audit_log: AuditLog | None = None, check_message: Callable[[Message, Identity], None] = check_right) -> None:
        self._audit_log, self._check_message = audit_log, check_message
        self.counts: Counter[tuple[Actor, str]] = Counter()

    def check(self, message: Message, proof: Proof, address: str = "") -> None:
        """Raises WireError if the message is denied. `address`: from where it came."""
        name = ""
        try:
            identity = proof()
            name = identity.name
            self._check_message(message, identity)
        except UsageError as error:
            self._note(Actor(name=name, address=address), message, str(error))
            raise WireError(DENIED, str(error)) from None
        except WireError as error:
            self._note(Actor(name=name, address=address), message, error.text)
            raise

    def _note(self, actor: Actor, message: Message, text: str) -> None:
        key = (actor, type(message.body).__name__)
        if key not in self.counts and len(self.counts) >= MOST_DENIALS:
            self.counts.clear()
        self.counts[key] += 1
        if not is_noteworthy(count := self.counts[key]):
            return
        log.warning("denied: %s (%d times)", text, count)
        if self._audit_log is not None:
            try:
                self._audit_log.append(f"send {key[1]}", "denied", actor, {"why": text, "times": count})
            except UsageError as error:
                log.error("not in the audit log: %s", error)


def is_noteworthy(count: int) -> bool:
    """Whether what has happened so many times is recorded: the first time, the tenth, the hundredth and so on."""
    return count == int("1".ljust(len(str(count)), "0"))


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
