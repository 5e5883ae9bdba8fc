"""People who do steps of plans: their assignments, their availability, and their replies (`devices/person/assignments.py`)."""

from __future__ import annotations

import time
from pathlib import Path

from somrs.client.client import Addresses
from somrs.devices.person.assignments import FILE, Assignment, Assignments, Reply, ReplyKind
from somrs.errors import RemoteError, UsageError

REPLY_PATIENCE = 10.0
"""Seconds within which a person's program processes a reply, if it runs."""


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
        RemoteError: the person's program did not process it within `REPLY_PATIENCE`.
    """
    store = _store(data)
    if store is None:
        raise UsageError(f"there is no assignment {number}; nobody has been asked to do anything")
    try:
        store.reply(number, reply)
        _wait(store, number, reply.kind)
    finally:
        store.close()


def _store(data: Path) -> Assignments | None:
    """The assignments; None if there are none. Raises UsageError if no system runs in the folder."""
    if not (data / FILE).exists():
        Addresses.read(data)
        return None
    return Assignments(data)


def _wait(store: Assignments, number: int, kind: ReplyKind) -> None:
    end, person = time.monotonic() + REPLY_PATIENCE, ""
    while time.monotonic() < end:
        assignment = store.read(number)
        assert assignment is not None, "assignments are not deleted"
        person = assignment.person
        if assignment.ended == kind.value or (kind is ReplyKind.ACCEPT and assignment.accepted is not None):
            return
        if assignment.ended is not None:
            raise UsageError(f"the reply came too late: {assignment.ended}")
        if assignment.problem:
            raise UsageError(f"{assignment.problem}\nthe assignment is still open; reply again")
        time.sleep(0.1)
    raise RemoteError(f"the reply was not accepted within {REPLY_PATIENCE:.0f} s; is the program of {person} running?")
