"""A file whose reads are given up, and one whose contents are kept elsewhere first."""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from pathlib import Path

import pytest

from somrs.errors import UsageError
from somrs.storage.disk import Disk
from somrs.storage.journal_file import KIND
from tests.support.hang import HANG_TIME


@pytest.mark.parametrize("moment", ["while it waits", "while it is done"])
def test_a_read_that_is_given_up_stops_nothing_else(tmp_path: Path, moment: str) -> None:
    async def play() -> None:
        disk = Disk(tmp_path / "task-manager.sqlite", KIND)
        has_begun, may_end = threading.Event(), threading.Event()

        def slow(db: sqlite3.Connection) -> int:
            has_begun.set()
            may_end.wait(HANG_TIME)
            return 1

        first_read = asyncio.wrap_future(disk.read(slow))
        await asyncio.to_thread(has_begun.wait, HANG_TIME)
        second_read = asyncio.wrap_future(disk.read(lambda db: 2))
        (first_read if moment == "while it is done" else second_read).cancel()
        may_end.set()
        assert await asyncio.wrap_future(disk.read(lambda db: 3)) == 3
        assert (await second_read if moment == "while it is done" else await first_read) in (1, 2)
        disk.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def insert(db: sqlite3.Connection) -> None:
    db.execute("INSERT INTO entries VALUES ('', 1, x'01')")


def count(db: sqlite3.Connection) -> int:
    (rows,) = db.execute("SELECT count(*) FROM entries").fetchone()
    return int(rows)


def test_what_is_kept_elsewhere_first_is_durable_then_and_in_the_file_when_somebody_reads_it(tmp_path: Path) -> None:
    async def play() -> None:
        disk = Disk(tmp_path / "task-manager.sqlite", KIND, syncs=False)
        is_away, notices = asyncio.Event(), list[int]()
        disk.store_first(is_away.wait)  # type: ignore[arg-type]  # its result is not used
        disk.listen(lambda: notices.append(disk.durable))
        for _ in range(3):
            disk.write(insert)
        await asyncio.sleep(0.01)
        assert disk.durable == 0
        assert await asyncio.wrap_future(disk.read(count)) == 0
        is_away.set()
        await disk.stored()
        assert disk.durable == 3
        assert notices == [3]
        assert await asyncio.wrap_future(disk.read(count)) == 3
        disk.write(insert)
        await disk.stored()
        disk.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))
    disk = Disk(tmp_path / "task-manager.sqlite", KIND)
    assert disk.read(count).result() == 4
    disk.close()


def test_what_cannot_be_kept_elsewhere_is_not_in_the_file(tmp_path: Path) -> None:
    async def refuse() -> None:
        raise UsageError("another process continues it")

    async def play() -> None:
        disk = Disk(tmp_path / "task-manager.sqlite", KIND, syncs=False)
        disk.store_first(refuse)
        disk.write(insert)
        await disk.stored()
        assert str(disk.failed) == "another process continues it"
        assert disk.durable == 0
        assert await asyncio.wrap_future(disk.read(count)) == 0
        disk.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))
