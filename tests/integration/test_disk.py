"""A file whose reads are given up: it goes on."""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from pathlib import Path

import pytest

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
