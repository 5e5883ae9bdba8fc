"""Questions to people, and their answers, in an SQLite file in the data folder. The driver of the person writes the questions; the
command line and the windows write the answers (docs/decisions/0010).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from somrs.devices.person.store import open_store
from somrs.errors import UsageError

FILE = "questions.sqlite"
"""Name of the file in the data folder of the system."""
_TABLE = (
    "CREATE TABLE IF NOT EXISTS questions (number INTEGER PRIMARY KEY AUTOINCREMENT, person TEXT, about TEXT, text TEXT,"
    " asked REAL, until REAL, answer TEXT, problem TEXT DEFAULT '', ended TEXT)"
)
_COLUMNS = "number, person, about, text, asked, until, answer, problem, ended"


class Question(Struct, frozen=True, kw_only=True):
    """A question to a person about an object. Times are seconds since 1970."""

    number: int
    person: str
    about: str
    text: str
    asked: float
    until: float
    answer: str | None = None
    """An answer that has not been checked yet; empty when the person cannot tell."""
    problem: str = ""
    """The error in the previous answer."""
    ended: str | None = None
    """Why the question is closed: `taken` for an accepted answer, or another reason, for people."""


class Questions:
    """The questions of one data folder. Numbers are never reused, so that no answer goes to another question."""

    def __init__(self, folder: Path) -> None:
        self._db = open_store(folder / FILE, (_TABLE,), "questions")

    def close(self) -> None:
        self._db.close()

    def ask(self, person: str, object_name: str, text: str, seconds: float) -> int:
        """Add a question that stays open for `seconds`. Return its number."""
        now = time.time()
        row = (person, object_name, text, now, now + seconds)
        cursor = self._db.execute("INSERT INTO questions (person, about, text, asked, until) VALUES (?, ?, ?, ?, ?) RETURNING number", row)
        return int(cursor.fetchone()[0])

    def open(self) -> list[Question]:
        """The open questions, oldest first."""
        return self._read("ended IS NULL AND until > ? ORDER BY number", (time.time(),))

    def read(self, number: int) -> Question | None:
        return next(iter(self._read("number = ?", (number,))), None)

    def _read(self, condition: str, values: Sequence[object]) -> list[Question]:
        rows = self._db.execute(f"SELECT {_COLUMNS} FROM questions WHERE {condition}", values).fetchall()
        return [Question(**dict(zip(_COLUMNS.split(", "), row, strict=True))) for row in rows]

    def answer(self, number: int, answer: str) -> None:
        """Answer a question. `read` returns the result of the check. Raises UsageError if the question is not open."""
        updated = self._db.execute("UPDATE questions SET answer = ?, problem = '' WHERE number = ? AND ended IS NULL", (answer, number))
        if not updated.rowcount:
            question = self.read(number)
            reason = "there is no such question" if question is None else f"it is closed: {question.ended}"
            raise UsageError(f"question {number} cannot be answered: {reason}; `somrs questions` lists those that are open")

    def reject(self, number: int, problem: str) -> None:
        """Reject the answer and keep the question open."""
        self._db.execute("UPDATE questions SET answer = NULL, problem = ? WHERE number = ?", (problem, number))

    def end(self, number: int, reason: str) -> None:
        self._db.execute("UPDATE questions SET ended = ? WHERE number = ? AND ended IS NULL", (reason, number))

    def end_all(self, person: str, reason: str) -> None:
        """Close all open questions to a person."""
        self._db.execute("UPDATE questions SET ended = ? WHERE person = ? AND ended IS NULL", (reason, person))
