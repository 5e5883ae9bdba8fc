"""The implementations of `somrs people` and `somrs reply`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from somrs.client import terminal
from somrs.client.people import codes, open_assignments, put_reply
from somrs.devices.person.assignments import Assignment, Reply, ReplyKind
from somrs.errors import UsageError


def people(data: Path, *, json: bool) -> None:
    """List the open assignments, and the codes of the people's pages."""
    assignments, page_codes = open_assignments(data), codes(data)
    if json:
        terminal.print_json({"codes": page_codes, "assignments": assignments})
        return
    console = terminal.console()
    if page_codes:
        rows = ((name, f"/person/{code}", sum(a.person == name for a in assignments)) for name, code in page_codes.items())
        console.print(terminal.table("People", ("name", "page in the windows", "open assignments"), rows))
    if not assignments:
        print("no open assignments")
        return
    rows_of_assignments = ((a.number, a.person, _text(a), _state(a)) for a in assignments)
    console.print(terminal.table("Open assignments", ("number", "to", "what to do", "state"), rows_of_assignments))
    print("Reply with: somrs reply NUMBER accept, decline, not-now, done or could-not.")


def _text(assignment: Assignment) -> str:
    work = assignment.work
    action = "stop " if work.stops else "undo " if work.undoes else ""
    return f"{action}{work.service_type}: {work.effect}"


def _state(assignment: Assignment) -> str:
    since = assignment.accepted or assignment.asked
    if assignment.work.stops:
        return "not needed any more; what is so now?"
    return f"{'accepted' if assignment.accepted else 'asked'} {(time.time() - since) / 60:.0f} min ago"


def reply(
    number: int, kind: ReplyKind, reason: str, situation: str | None, values: Sequence[str], searched: Sequence[str], data: Path
) -> None:
    """Reply to an assignment. `values`: NAME=TERM; `searched`: names of objects. Raises UsageError for an unsuitable reply."""
    terms: dict[str, str] = {}
    for text in values:
        name, separator, value = text.partition("=")
        if not separator:
            raise UsageError(f"{text!r} is not a value: write NAME=TERM, such as Weight='1.2 kg'")
        terms[name.strip().removeprefix("?")] = value.strip()
    if situation is not None and kind not in (ReplyKind.COULD_NOT, ReplyKind.DONE):
        raise UsageError("--situation says what is so after the work; use it with done or could-not")
    put_reply(number, Reply(kind=kind, reason=reason, situation=situation, values=terms, searched=tuple(searched)), data)
    print("reply accepted")
