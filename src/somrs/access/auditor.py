"""Writes to the audit log what people and programs do and try, without holding up what they do."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from somrs.access.identity import sender, user_of_process
from somrs.errors import UsageError
from somrs.storage.audit_log import Actor, AuditLog
from somrs.storage.denial_counts import DenialCounts

log = logging.getLogger(__name__)

DONE, DENIED, FAILED = "done", "denied", "failed"
"""The outcomes of acts. `failed`: it is not known whether it was done, or how much of it."""

LONG = 4000
"""Bytes of details that are recorded whole; of longer ones, the beginning."""

HIDDEN_FIELDS = frozenset({"password", "current", "secret", "link"})
"""The names of parameters and fields whose values are secret."""


def current_actor() -> Actor:
    """Who sent the request that is worked on; without one, the user of this process."""
    identity = sender.get()
    return Actor(name=identity.name, address=identity.address) if identity is not None else Actor(name=user_of_process())


class Auditor:
    """Records acts in the log of a data folder.

    Of the same denials, only some are recorded (`DenialCounts`). What cannot be recorded is reported in the program's own log, and does not
    keep anybody from operating the site: a full disk must not take the stop button away.
    """

    def __init__(self, data: Path) -> None:
        self.log = AuditLog(data)
        self._denials = DenialCounts()

    def done(self, act: str, actor: Actor, details: Mapping[str, object], outcome: str = DONE) -> None:
        self._append(act, outcome, actor, shown(details))

    def denied(self, act: str, actor: Actor, reason: str, details: Mapping[str, object] | None = None) -> None:
        """Record what somebody tried who may not do it, or has not proven who it is."""
        if (count := self._denials.add((act, actor))) is not None:
            self._append(act, DENIED, actor, shown({**(details or {}), "why": reason, **({"times": count} if count > 1 else {})}))

    def _append(self, act: str, outcome: str, actor: Actor, details: object) -> None:
        try:
            self.log.append(act, outcome, actor, details)
        except UsageError as error:
            log.error(
                "not in the audit log: %s, %s, by %s at %s: %s", act, outcome, actor.name or "nobody known", actor.address or "?", error
            )


def shown(details: Mapping[str, object]) -> Any:
    """Details as they are recorded: without secrets, and not longer than `LONG`."""
    content = _without_secrets(msgspec.to_builtins(details))
    document = msgspec.json.encode(content)
    return content if len(document) <= LONG else {"bytes": len(document), "begins": document[:LONG].decode(errors="replace")}


def _without_secrets(content: Any) -> Any:
    if isinstance(content, dict):
        return {name: "(secret)" if name in HIDDEN_FIELDS and value else _without_secrets(value) for name, value in content.items()}
    if isinstance(content, list | tuple):
        return [_without_secrets(value) for value in content]
    return content


def actor_text(actor: Actor | None) -> str:
    """Who did something, for people."""
    if actor is None:
        return "(erased)"
    return (actor.name or "nobody known") + (f" ({actor.address})" if actor.address else "")


def detail_text(details: Any) -> str:
    """Details in a line, for people."""
    if details is None:
        return "(erased)"
    return ", ".join(
        f"{name}: {value if isinstance(value, str) else msgspec.json.encode(value).decode()}" for name, value in details.items()
    )
