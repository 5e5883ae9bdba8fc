"""The implementations of `somrs people` and `somrs reply`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from rich.text import Text

from somrs.api.service import open_api_service
from somrs.client import terminal
from somrs.client.addresses import Addresses
from somrs.client.people import codes, open_assignments, put_reply
from somrs.devices.person.assignments import Assignment, Reply, ReplyKind
from somrs.errors import RemoteError, UsageError


async def people(data: Path, *, json: bool) -> None:
    """List the open assignments, the codes of the people's pages, and what is wrong in their offers."""
    assignments, page_codes = open_assignments(data), codes(data)
    problems = await _offer_problems(data)
    if json:
        terminal.print_json({"codes": page_codes, "assignments": assignments, "problems": problems})
        return
    console = terminal.console()
    if page_codes:
        rows = ((name, f"/person/{code}", sum(a.person == name for a in assignments)) for name, code in page_codes.items())
        console.print(terminal.table("People", ("name", "page in the windows", "open assignments"), rows))
    for problem in problems:
        console.print(Text(problem, "red"))
    if not assignments:
        print("no open assignments")
        return
    rows_of_assignments = ((a.number, a.person, _text(a), _state(a)) for a in assignments)
    console.print(terminal.table("Open assignments", ("number", "to", "what to do", "state"), rows_of_assignments))
    print("Reply with: somrs reply NUMBER accept, decline, not-now, done or could-not.")


async def _offer_problems(data: Path) -> list[str]:
    """What is wrong in the offers of people; nothing is known of it while no system runs."""
    try:
        async with open_api_service(Addresses.read(data), data) as service:
            listed = await service.people.list()
    except (UsageError, RemoteError):
        return []
    return [f"{person.name}: {problem}" for person in listed.people for problem in person.problems]


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
