"""How a component's file joins the journal on a bus: who of both has entries that the other one lacks, and who goes on.

| the file | the bus | what goes on |
|---|---|---|
| is new, or has nothing that the bus lacks | has a copy | the bus; its copy takes the place of a file that is behind it |
| went on without the bus | did not go on | the file; the bus gets a copy of it |
| went on without the bus | went on, or has another history | what a person chooses; until then, nothing |
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path

from somrs.errors import UsageError
from somrs.storage.bus_histories import join_history, leave_histories, read_common_numbers
from somrs.storage.journal import Journal, Log
from somrs.storage.lease import RENEWAL
from somrs.storage.stored_copy import CopyInfo
from somrs.storage.stream_log import StreamLog

log = logging.getLogger(__name__)

OpenJournal = Callable[[Log | None], Journal]
"""Opens the journal of a component, in its file, with this log."""

CHOICE = "SOMRS_JOURNAL"
"""The environment variable that says which of two histories goes on, if a person has to choose."""


class Choice(StrEnum):
    """What goes on if the file and the bus both have what the other one lacks."""

    BUS = "bus"
    """The file is put aside."""
    FILE = "file"
    """The history on the bus is replaced."""


@dataclass(frozen=True, slots=True)
class JoinedJournal:
    """An open journal. `common_number`: if the file went on without the bus, the number of the last entry that both have. `replaces`: the
    file takes the place of the history on the bus."""

    journal: Journal
    common_number: int | None = None
    replaces: bool = False


async def join(stream: StreamLog | None, file: Path, address: str, open_journal: OpenJournal) -> JoinedJournal:
    """Open the journal of the component with this address, with the copy on the bus in place of the file where that goes on.

    Raises UsageError when the journal cannot be opened, or when a person has to choose.
    """
    while True:
        journal = open_journal(stream)
        if stream is None:
            journal.disk.write_and_wait(partial(leave_histories, number=journal.number))
            return JoinedJournal(journal)
        try:
            joined = await _compared(stream, journal, address)
        except BaseException:  # whatever the error is, nobody else has the journal to close it
            journal.close()
            raise
        if joined is not None:
            return joined
        is_put_aside = not journal.is_new and not _is_behind(journal, await stream.copy_info())
        journal.close()
        if is_put_aside:
            _put_aside(file)
        if await stream.copy_info() is None:
            await asyncio.sleep(RENEWAL)
        else:
            await _fetch(stream, file)


async def _compared(stream: StreamLog, journal: Journal, address: str) -> JoinedJournal | None:
    """The journal with which the component can go on; None if the copy on the bus has to take its place, or is waited for."""
    copy = await stream.copy_info()
    if copy is None:
        # Only the one that leads begins a new journal; the others wait for its copy.
        return JoinedJournal(journal) if not journal.is_new or await stream.acquire() else None
    if journal.is_new:
        return None
    if not journal.can_continue_at(address):
        # Nothing of it goes on: it begins anew, and follows the bus from its first entry, or from the copy.
        return JoinedJournal(journal) if journal.open or copy.number == 0 or copy.address != address else None
    common_number = _common_number(journal, copy)
    if common_number is not None and journal.number <= common_number:
        is_current = copy.history in _numbers(journal) or not copy.history
        return JoinedJournal(journal) if journal.number >= copy.number and is_current else None
    last_number = await stream.last_number()
    if common_number is not None and last_number <= common_number:
        return JoinedJournal(journal, common_number)
    match os.environ.get(CHOICE):
        case Choice.BUS:
            return None
        case Choice.FILE:
            return JoinedJournal(journal, replaces=True)
    raise UsageError(_conflict(journal, common_number, last_number))


def _numbers(journal: Journal) -> dict[str, int | None]:
    return journal.disk.read(read_common_numbers).result()


def _common_number(journal: Journal, copy: CopyInfo) -> int | None:
    """The number of the last entry that the file and the bus have in common; None if they have different histories."""
    if not copy.history or journal.number == 0:  # a copy of an earlier program, or a file without entries
        return journal.number
    numbers = _numbers(journal)
    for history in (copy.history, *copy.replaced):
        if history in numbers:
            number = numbers[history]
            return number if number is not None else journal.number
    return None


def _is_behind(journal: Journal, copy: CopyInfo | None) -> bool:
    """Whether the bus has all that the file has."""
    common_number = _common_number(journal, copy) if copy is not None else None
    return common_number is not None and journal.number <= common_number


def _conflict(journal: Journal, common_number: int | None, last_number: int) -> str:
    if common_number is None:
        difference = "its history is another one than that on the bus"
    else:
        own_count, bus_count = journal.number - common_number, last_number - common_number
        difference = f"it has gone on without this bus ({own_count} inputs), and the bus without it ({bus_count} inputs)"
    return (
        f"{journal.disk.path}: {difference}, and only one can go on. Start it once with {CHOICE}={Choice.BUS} to go on from the bus: the "
        f"file is put aside; or with {CHOICE}={Choice.FILE} to go on from the file: what the bus has is dropped"
    )


def _put_aside(file: Path) -> None:
    """Keep a file that does not go on, under another name."""
    number = 1
    while (new_path := file.with_name(f"{file.name}-put-aside-{number}")).exists():
        number += 1
    for suffix in ("-wal", "-shm", ""):
        source = file.with_name(file.name + suffix)
        if source.exists():
            source.replace(new_path.with_name(new_path.name + suffix))
    log.warning("%s does not go on, and is %s now", file, new_path)


async def _fetch(stream: StreamLog, file: Path) -> None:
    copy = file.with_suffix(".copy")
    try:
        await stream.fetch_copy(copy)
    except OSError as error:
        raise UsageError(f"{copy}: the copy on the bus cannot be written here: {error}; check the free disk space") from None
    for suffix in ("-wal", "-shm"):
        file.with_name(file.name + suffix).unlink(missing_ok=True)
    copy.replace(file)


def note_joined(journal: Journal, history: str, number: int) -> None:
    """Note in the file that it goes on with a history on the bus."""
    if _numbers(journal).get(history, number) is not None:
        journal.disk.write_and_wait(lambda db: join_history(db, history, number))
