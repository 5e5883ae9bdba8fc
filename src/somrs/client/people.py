"""People who do steps of plans: their assignments, their availability, and their replies (`devices/person/assignments.py`)."""

from __future__ import annotations

from pathlib import Path

from somrs.client.addresses import Addresses
from somrs.client.reply_wait import wait_until_accepted
from somrs.devices.person.assignments import FILE, Assignment, Assignments, Reply, ReplyKind
from somrs.errors import UsageError


def open_assignments(data: Path, person: str | None = None) -> list[Assignment]:
    """The open assignments of a person, or of all, oldest first. Raises UsageError if no system runs in the folder."""
    store = _store(data)
    if store is None:
        return []
    try:
        return store.open(person)
    finally:
        store.close()


def codes(data: Path) -> dict[str, str]:
    """The codes of the pages of people, by their names."""
    store = _store(data)
    if store is None:
        return {}
    try:
        return store.codes()
    finally:
        store.close()


def missed_assignments(data: Path) -> dict[str, Assignment]:
    """The latest assignment of each person, where the person did not reply in time."""
    store = _store(data)
    if store is None:
        return {}
    try:
        return {name: assignment for name in store.codes() if (assignment := store.missed(name)) is not None}
    finally:
        store.close()


def put_reply(number: int, reply: Reply, data: Path) -> None:
    """Reply to an assignment, and wait until the person's program has accepted the reply.

    Raises:
        UsageError: the reply is unsuitable or too late.
        RemoteError: the person's program did not process it within `PATIENCE`.
    """
    store = _store(data)
    if store is None:
        raise UsageError(f"there is no assignment {number}; nobody has been asked to do anything")
    try:
        store.reply(number, reply)
        wait_until_accepted(
            lambda: store.read(number),
            lambda assignment: assignment.ended == reply.kind.value or (reply.kind is ReplyKind.ACCEPT and assignment.accepted is not None),
            reply="reply",
            still_open="the assignment is still open; reply again",
        )
    finally:
        store.close()


def _store(data: Path) -> Assignments | None:
    """The assignments; None if there are none. Raises UsageError if no system runs in the folder."""
    if not (data / FILE).exists():
        Addresses.read(data)
        return None
    return Assignments(data)
