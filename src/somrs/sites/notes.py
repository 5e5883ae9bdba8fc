"""Notes of an import: what was left out, assumed or changed, collected so that each kind is told once."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum


class Rank(IntEnum):
    """How much a note matters; the first matters most."""

    LEFT_OUT = 1
    """Something in the file is not on the map."""
    ASSUMED = 2
    """The file does not say something, and the import assumes it."""
    MOVED = 3
    """Something is not where the file has it."""
    KEPT = 4
    """Something that a reader may not expect to be on the map."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """One kind of remark, and all that it is about."""

    rank: Rank
    text: str
    subjects: tuple[str, ...]
    advice: str = ""
    """What to do about it, if that is not said by the text; several kinds may have the same advice."""

    def __str__(self) -> str:
        return f"{', '.join(self.subjects)}: {self.text}"


@dataclass(slots=True)
class NoteCollector:
    """Collects remarks by rank and text."""

    _subjects: dict[tuple[Rank, str, str], list[str]] = field(default_factory=dict)

    def add(self, rank: Rank, subject: str, text: str, advice: str = "") -> None:
        subjects = self._subjects.setdefault((rank, text, advice), [])
        if subject not in subjects:
            subjects.append(subject)

    def notes(self) -> tuple[Note, ...]:
        """One note for each kind: those that matter most first, then those about most subjects."""
        notes = [
            Note(rank=rank, text=text, subjects=tuple(subjects), advice=advice) for (rank, text, advice), subjects in self._subjects.items()
        ]
        return tuple(sorted(notes, key=lambda note: (note.rank, -len(note.subjects))))
