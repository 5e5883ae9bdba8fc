"""Assignments: steps of plans that people do, in an SQLite file in the data folder. The program of the person writes the assignments and
checks the replies; the window, the command line and the API write the replies (docs/decisions/0037).

An assignment is open until the person has done it, could not do it, or declined it, or until nobody needs it any more.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path

import msgspec
from msgspec import Struct

from somrs.devices.person.store import open_store
from somrs.errors import UsageError

FILE = "people.sqlite"
"""Name of the file in the data folder of the system."""
UNANSWERED = "there was no answer in time"
"""Why an assignment is closed that the person has neither accepted nor declined."""
CODE_LENGTH = 8
"""Of the 31 to the power of 8 codes, a guess at 1,000 a second finds one of 10 people within some years."""
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ23456789"
"""The characters of codes, without those that look like others."""
_TABLES = (
    "CREATE TABLE IF NOT EXISTS people (name TEXT PRIMARY KEY, code TEXT UNIQUE)",
    "CREATE TABLE IF NOT EXISTS assignments (number INTEGER PRIMARY KEY AUTOINCREMENT, person TEXT, work BLOB, asked REAL, accepted REAL,"
    " reply BLOB, problem TEXT DEFAULT '', ended TEXT)",
)


class ReplyKind(StrEnum):
    """What a person says to an assignment."""

    ACCEPT = "accept"
    """The person does it."""
    DECLINE = "decline"
    """The person does not do it; nothing was begun."""
    NOT_NOW = "not now"
    """The person has no time at present; nothing was begun."""
    DONE = "done"
    COULD_NOT = "could not"
    """The person tried, and the effect does not hold."""


_BEFORE_WORK = (ReplyKind.ACCEPT, ReplyKind.DECLINE, ReplyKind.NOT_NOW)


class Reply(Struct, frozen=True, kw_only=True):
    """A reply. `reason`: for people. `situation`: what holds now, a formula: after work that could not be done or was stopped, or what the
    person has found out. A typed variable in it is an object that the person saw: `?Seen: Jar isOn Table001 AND ?Seen.Color = Red`.

    `values`: the values of the variables that the effect leaves open, as Entish terms. `searched`: supports and spaces that the person has
    seen whole; what `situation` does not mention is not there.
    """

    kind: ReplyKind
    reason: str = ""
    situation: str | None = None
    values: dict[str, str] = {}
    searched: tuple[str, ...] = ()


class Outcome(Struct, frozen=True):
    """What may be so after work that ended early: in words, and as a formula."""

    text: str
    situation: str


class Work(Struct, frozen=True, kw_only=True):
    """What a person is to do: make `effect` true. `undoes`: it undoes a step. `open_variables`: what the person has to find out.

    `stops`: the person worked on it, and is to stop and say what is so now. `objects`: the objects that it is about; `aim`: the effect in
    words; `present`: what the map says now, in words; `outcomes`: what can be left of it.
    """

    transaction: str
    service_type: str
    inputs: dict[str, str]
    effect: str
    objects: tuple[str, ...] = ()
    open_variables: tuple[str, ...] = ()
    undoes: bool = False
    participant: str = ""
    stops: bool = False
    aim: str = ""
    present: str = ""
    outcomes: tuple[Outcome, ...] = ()


class Assignment(Struct, frozen=True, kw_only=True):
    """A step that a person is asked to do. Times are seconds since 1970."""

    number: int
    person: str
    work: Work
    asked: float
    accepted: float | None = None
    reply: Reply | None = None
    """A reply that has not been checked yet."""
    problem: str = ""
    """What is wrong with the previous reply."""
    ended: str | None = None
    """Why the assignment is closed: the kind of the last reply, or another reason, for people."""


class Assignments:
    """The assignments of one data folder, and the codes of the people. Numbers are never reused."""

    def __init__(self, folder: Path) -> None:
        self._db = open_store(folder / FILE, _TABLES, "assignments")

    def close(self) -> None:
        self._db.close()

    # Codes

    def code_of(self, person: str) -> str:
        """The code by which the person's page is found; made when it is first needed."""
        code = "".join(secrets.choice(_LETTERS) for _ in range(CODE_LENGTH))
        self._db.execute("INSERT OR IGNORE INTO people (name, code) VALUES (?, ?)", (person, code))
        return str(self._db.execute("SELECT code FROM people WHERE name = ?", (person,)).fetchone()[0])

    def codes(self) -> dict[str, str]:
        """The codes by the names of the people."""
        return dict(self._db.execute("SELECT name, code FROM people ORDER BY name").fetchall())

    # The person's program

    def assign(self, person: str, work: Work) -> int:
        """Add an assignment. Return its number."""
        row = (person, msgspec.json.encode(work), time.time())
        cursor = self._db.execute("INSERT INTO assignments (person, work, asked) VALUES (?, ?, ?) RETURNING number", row)
        return int(cursor.fetchone()[0])

    def accept(self, number: int) -> None:
        """Note that the person has accepted. Removes the reply."""
        self._db.execute("UPDATE assignments SET accepted = ?, reply = NULL WHERE number = ?", (time.time(), number))

    def reject(self, number: int, problem: str) -> None:
        """Reject the reply, and keep the assignment open."""
        self._db.execute("UPDATE assignments SET reply = NULL, problem = ? WHERE number = ?", (problem, number))

    def end(self, number: int, reason: str) -> None:
        self._db.execute("UPDATE assignments SET ended = ? WHERE number = ? AND ended IS NULL", (reason, number))

    def end_all(self, person: str, reason: str) -> None:
        """Close all open assignments of a person."""
        self._db.execute("UPDATE assignments SET ended = ? WHERE person = ? AND ended IS NULL", (reason, person))

    def has_declined(self, person: str, transaction: str, effect: str) -> bool:
        """Whether the person has declined to make this effect true for this transaction."""
        past = self._read("person = ? AND ended = ?", (person, ReplyKind.DECLINE))
        return any((a.work.transaction, a.work.effect) == (transaction, effect) for a in past)

    def latest(self, person: str, transaction: str, participant: str) -> Assignment | None:
        """The latest assignment of a participant of a task."""
        assignments = self._read("person = ?", (person,))
        ids = transaction, participant
        return next((a for a in reversed(assignments) if (a.work.transaction, a.work.participant) == ids), None)

    # Its readers

    def open(self, person: str | None = None) -> list[Assignment]:
        """The open assignments of a person, or of all, oldest first."""
        if person is None:
            return self._read("ended IS NULL", ())
        return self._read("ended IS NULL AND person = ?", (person,))

    def missed(self, person: str) -> Assignment | None:
        """The person's latest assignment, if the person did not answer it."""
        latest = self._read("number = (SELECT MAX(number) FROM assignments WHERE person = ?)", (person,))
        return latest[0] if latest and latest[0].ended == UNANSWERED else None

    def read(self, number: int) -> Assignment | None:
        return next(iter(self._read("number = ?", (number,))), None)

    def _read(self, condition: str, values: Sequence[object]) -> list[Assignment]:
        columns = "number, person, work, asked, accepted, reply, problem, ended"
        rows = self._db.execute(f"SELECT {columns} FROM assignments WHERE {condition} ORDER BY number", values).fetchall()
        return [_assignment(*row) for row in rows]

    def reply(self, number: int, reply: Reply) -> None:
        """Reply to an assignment. `read` returns the result of the check.

        Raises:
            UsageError: the assignment is not open, or has been accepted and can no longer be declined.
        """
        assignment = self.read(number)
        if assignment is None or assignment.ended is not None:
            reason = "it does not exist" if assignment is None else f"it is closed: {assignment.ended}"
            raise UsageError(f"there is no reply to assignment {number}: {reason}; `somrs people` lists those that are open")
        if assignment.work.stops and reply.kind in _BEFORE_WORK:
            raise UsageError(f"assignment {number} asks what is so now that the work has stopped: reply done, or could not with what is so")
        if assignment.accepted is not None and reply.kind in _BEFORE_WORK:
            raise UsageError(f"assignment {number} is accepted already: reply done, or could not with what is left")
        self._db.execute("UPDATE assignments SET reply = ?, problem = '' WHERE number = ?", (msgspec.json.encode(reply), number))


def _assignment(
    number: int, person: str, work: bytes, asked: float, accepted: float | None, reply: bytes | None, problem: str, ended: str | None
) -> Assignment:
    return Assignment(
        number=number,
        person=person,
        work=msgspec.json.decode(work, type=Work),
        asked=asked,
        accepted=accepted,
        reply=msgspec.json.decode(reply, type=Reply) if reply is not None else None,
        problem=problem,
        ended=ended,
    )
