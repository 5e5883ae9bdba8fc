"""The entries of a component on a real NATS server: one writes, others read, and whoever was replaced cannot write any more."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

from somrs.errors import UsageError
from somrs.storage.stored_copy import CopyInfo, Replaced
from somrs.storage.stream_log import Batch, StreamLog
from tests.support.hang import HANG_TIME
from tests.support.nats_server import NatsServer


def with_logs(folder: Path, scenario: Callable[[NatsServer, StreamLog, StreamLog], Coroutine[Any, Any, None]], **settings: int) -> None:
    async def run() -> None:
        logs = [StreamLog(server.address.servers, "yard", "registry", identity) for identity in ("first", "second")]
        try:
            for log in logs:
                await log.open()
            async with asyncio.timeout(HANG_TIME):
                await scenario(server, *logs)
        finally:
            for log in logs:
                await log.close()

    with NatsServer(folder, settings=settings) as server:
        asyncio.run(run())


async def read_all(log: StreamLog) -> list[Batch]:
    batches: list[Batch] = []
    place, last = await log.bounds()
    while place <= last:
        if (batch := await log.batch(place)) is not None:
            batches.append(batch)
        place += 1
    return batches


async def append(log: StreamLog, number: int, document: bytes) -> None:
    await log.append(number, 1, document)


def test_one_leads_until_another_has_read_all_that_it_has_written(tmp_path: Path) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        lost = threading.Event()
        first.on_lost = lost.set
        assert await first.acquire()
        assert not await second.acquire()
        assert await first.begin_writing(0)
        await append(first, 2, b"one and two")
        assert not await second.begin_writing(0), "it has not read everything"
        for batch in await read_all(second):
            second.last = batch.sequence
        await append(first, 3, b"three")
        assert not await second.begin_writing(2), "an entry came between"
        second.last += 1
        await first.resign()
        assert await second.acquire()
        assert await second.begin_writing(3)
        with pytest.raises(Replaced, match=r"another process continues yard\.registry"):
            await append(first, 4, b"too late")
        await append(second, 4, b"four")
        written = [(batch.number, batch.document) for batch in await read_all(first) if batch.document]
        assert written == [(2, b"one and two"), (3, b"three"), (4, b"four")]
        assert not lost.is_set(), "it has given the lease up itself"

    with_logs(tmp_path, scenario)


def test_who_resigns_while_its_lease_is_renewed_hands_over_at_once(tmp_path: Path) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        assert await first.acquire()
        update, is_renewed = first.lease._bucket.update, threading.Event()

        async def slow_update(*arguments: Any, **options: Any) -> int:
            revision = await update(*arguments, **options)
            is_renewed.set()
            await asyncio.sleep(0.2)  # the answer is on its way
            return revision

        first.lease._bucket.update = slow_update  # type: ignore[method-assign]
        await asyncio.to_thread(is_renewed.wait)
        await first.resign()
        assert await second.acquire()

    with_logs(tmp_path, scenario)


def test_a_lease_ends_with_its_process_and_is_its_own_again_after_a_restart(tmp_path: Path) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        assert await first.acquire()
        await first.close()  # as if it was killed: it does not resign
        again = StreamLog(server.address.servers, "yard", "registry", "first")
        await again.open()
        assert not await second.acquire()
        assert await again.acquire(), "a restarted process does not wait for its own lease to end"
        await again.close()
        while not await second.acquire():
            await asyncio.sleep(0.05)
        first.__init__(server.address.servers, "yard", "registry", "first")  # type: ignore[misc]  # it is closed once more
        await first.open()
        assert not await first.acquire()

    with_logs(tmp_path, scenario)


def test_what_is_written_while_the_server_is_killed_is_there_once_and_in_order(tmp_path: Path) -> None:
    documents = [f"entry {number}".encode() for number in range(1, 151)]

    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        assert await first.begin_writing(0)
        half = asyncio.Event()

        async def write() -> None:
            for number, document in enumerate(documents, start=1):
                await append(first, number, document)
                if number == 50:
                    half.set()

        writing = asyncio.create_task(write())
        await half.wait()
        server.kill()
        await asyncio.sleep(0.1)
        await asyncio.to_thread(server.start)
        await writing
        assert [batch.document for batch in await read_all(second) if batch.document] == documents

    with_logs(tmp_path, scenario)


def test_a_place_is_found_by_its_number_and_what_a_copy_has_is_forgotten(tmp_path: Path) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        assert await second.copy_info() is None
        assert await second.place_after(0) == 1
        assert await first.begin_writing(0)
        for number in (3, 4, 9, 12):
            await append(first, number, f"up to {number}".encode())
        for number, place in ((0, 2), (2, 2), (3, 3), (4, 4), (8, 4), (9, 5), (12, 6), (40, 6)):
            assert await second.place_after(number) == place, number
        file = tmp_path / "registry.sqlite"
        file.write_bytes(bytes(range(256)) * 3000)
        await first.store_copy(file, CopyInfo(number=9, address="http://127.0.0.1:1/registry"))
        await first.forget_before(4)
        assert await second.copy_info() == CopyInfo(number=9, address="http://127.0.0.1:1/registry")
        await second.fetch_copy(tmp_path / "fetched")
        assert (tmp_path / "fetched").read_bytes() == file.read_bytes()
        assert await second.bounds() == (4, 5)
        assert await second.batch(3) is None
        assert await second.place_after(9) == 5

    with_logs(tmp_path, scenario)


def test_a_copy_that_is_replaced_while_it_is_fetched_is_fetched_as_it_is_then(tmp_path: Path) -> None:
    contents = [bytes([number]) * 700_000 for number in range(20)]

    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        async def store() -> None:
            for number, content in enumerate(contents):
                (tmp_path / "stored").write_bytes(content)
                await first.store_copy(tmp_path / "stored", CopyInfo(number=number, address="http://127.0.0.1:1/registry"))

        storing = asyncio.create_task(store())
        while await second.copy_info() is None:
            await asyncio.sleep(0.001)
        while not storing.done():
            await second.fetch_copy(tmp_path / "fetched")
            assert (tmp_path / "fetched").read_bytes() in contents
        await second.fetch_copy(tmp_path / "fetched")
        assert (tmp_path / "fetched").read_bytes() == contents[-1]

    with_logs(tmp_path, scenario)


def test_a_copy_is_stored_and_fetched_while_the_server_is_killed(tmp_path: Path) -> None:
    (tmp_path / "stored").write_bytes(bytes(range(256)) * 40_000)

    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        async def exchange() -> None:
            await first.store_copy(tmp_path / "stored", CopyInfo(number=5, address="http://127.0.0.1:1/registry"))
            await second.fetch_copy(tmp_path / "fetched")

        for pause in (0.0, 0.01, 0.03, 0.1):
            exchanging = asyncio.create_task(exchange())
            await asyncio.sleep(pause)
            await asyncio.to_thread(server.kill)
            await asyncio.sleep(0.05)
            await asyncio.to_thread(server.start)
            await exchanging
            assert (tmp_path / "fetched").read_bytes() == (tmp_path / "stored").read_bytes()

    with_logs(tmp_path, scenario)


def test_a_damaged_copy_is_said_and_the_next_one_is_waited_for(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "stored").write_bytes(bytes(range(256)) * 4000)

    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        await first.store_copy(tmp_path / "stored", CopyInfo(number=5, address="http://127.0.0.1:1/registry"))
        await first.call(first._js.purge_stream("somrs-copy-yard-registry", subject="somrs-copy.yard.registry.chunks.>"))
        fetching = asyncio.create_task(second.fetch_copy(tmp_path / "fetched"))
        while "the copy of yard.registry on the bus is damaged" not in caplog.text:
            await asyncio.sleep(0.02)
        await first.store_copy(tmp_path / "stored", CopyInfo(number=5, address="http://127.0.0.1:1/registry"))
        await fetching
        assert (tmp_path / "fetched").read_bytes() == (tmp_path / "stored").read_bytes()

    with_logs(tmp_path, scenario)


async def chunk_subjects(log: StreamLog) -> set[str]:
    """What is stored of copies of files."""
    state = (await log.call(log._js.stream_info("somrs-copy-yard-registry", subjects_filter="somrs-copy.yard.registry.chunks.>"))).state
    return set(state.subjects or {})


def test_a_leader_that_was_replaced_stores_no_copy_any_more(tmp_path: Path) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        (tmp_path / "older").write_bytes(b"older" * 100_000)
        (tmp_path / "newer").write_bytes(b"newer" * 100_000)
        assert await first.begin_writing(0)
        await first.store_copy(tmp_path / "older", CopyInfo(number=1, address="http://127.0.0.1:1/registry"))
        second.last = first.last
        assert await second.begin_writing(1)
        newer_info = CopyInfo(number=9, address="http://127.0.0.1:1/registry")
        await second.store_copy(tmp_path / "newer", newer_info)
        with pytest.raises(Replaced, match="it has stored a copy of its file on the bus"):
            await first.store_copy(tmp_path / "older", CopyInfo(number=2, address="http://127.0.0.1:1/registry"))
        assert await first.copy_info() == newer_info
        await first.fetch_copy(tmp_path / "fetched")
        assert (tmp_path / "fetched").read_bytes() == (tmp_path / "newer").read_bytes()
        assert len(await chunk_subjects(first)) == 1

    with_logs(tmp_path, scenario)


def test_a_copy_that_the_leader_before_has_stored_late_is_replaced(tmp_path: Path) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        (tmp_path / "stored").write_bytes(b"copy" * 100_000)
        assert await first.begin_writing(0)
        second.last = first.last
        assert await second.begin_writing(1)
        await first.store_copy(tmp_path / "stored", CopyInfo(number=2, address="http://127.0.0.1:1/registry"))
        newer_info = CopyInfo(number=9, address="http://127.0.0.1:1/registry")
        await second.store_copy(tmp_path / "stored", newer_info)
        assert await second.copy_info() == newer_info

    with_logs(tmp_path, scenario)


@pytest.mark.parametrize("next_copy", [True, False])
def test_what_an_interrupted_copy_has_left_is_removed(tmp_path: Path, next_copy: bool) -> None:
    """By the next copy, or by the next process that leads."""

    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        (tmp_path / "stored").write_bytes(bytes(range(256)) * 100_000)
        assert await first.begin_writing(0)
        info = CopyInfo(number=1, address="http://127.0.0.1:1/registry")
        await first.store_copy(tmp_path / "stored", info)
        stored_size = (tmp_path / "stored").stat().st_size
        storing = asyncio.create_task(first.store_copy(tmp_path / "stored", info))
        # Until the server has written some of it to its disk, which is later than it counts it.
        while sum(file.stat().st_size for file in tmp_path.rglob("*.blk")) < stored_size + 1_000_000:
            await asyncio.sleep(0.001)
        server.kill()
        await first.close()
        storing.cancel()
        await asyncio.to_thread(server.start)
        assert len(await chunk_subjects(second)) == 2
        second.last = first.last
        assert await second.begin_writing(1)
        if next_copy:
            await second.store_copy(tmp_path / "stored", info)
        assert len(await chunk_subjects(second)) == 1
        await second.fetch_copy(tmp_path / "fetched")
        assert (tmp_path / "fetched").read_bytes() == (tmp_path / "stored").read_bytes()
        first.__init__(server.address.servers, "yard", "registry", "first")  # type: ignore[misc]  # it is closed once more

    with_logs(tmp_path, scenario)


def test_a_journal_that_was_deleted_on_the_bus_is_made_anew_by_the_one_that_leads(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        assert await first.acquire()
        assert await first.begin_writing(0)
        for number in range(1, 6):
            await append(first, number, b"before")
        await first.call(first._js.delete_stream("somrs-journal-yard-registry"))
        await append(first, 6, b"after")
        assert "the journal of yard.registry on the bus was deleted" in caplog.text
        assert "the bus stores the inputs of yard.registry again" in caplog.text
        assert first.lacks_copy, "what was deleted has to come back"
        assert [batch.number for batch in await read_all(second)] == [6]
        second.last = 0
        await append(first, 7, b"more")
        assert not await second.begin_writing(6)

    with_logs(tmp_path, scenario)


def test_a_bus_without_room_is_said_and_what_waits_is_stored_when_there_is_room(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        from nats.js.api import StreamConfig

        assert await first.acquire()
        await second.call(second._js.add_stream(StreamConfig(name="ballast", subjects=["ballast"])))
        for _ in range(30):
            with contextlib.suppress(Exception):
                await second.call(second._js.publish("ballast", bytes(100_000)))
        writing = asyncio.create_task(append(first, 1, bytes(500_000)))
        while not first.problem:
            assert not writing.done()
            await asyncio.sleep(0.02)
        assert first.problem.startswith("the bus does not store the inputs of yard.registry: ")
        await asyncio.sleep(1.0)
        assert caplog.text.count("the bus does not store the inputs of yard.registry") == 1, "it is said once"
        await second.call(second._js.delete_stream("ballast"))
        await writing
        assert not first.problem
        assert [batch.number for batch in await read_all(second)] == [1]

    with_logs(tmp_path, scenario, max_file_store=2_000_000)


def test_an_entry_that_the_servers_do_not_accept_is_explained(tmp_path: Path) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        with pytest.raises(UsageError, match=r"an input of yard\.registry has 2000000 bytes; raise max_payload of the NATS servers"):
            await append(first, 1, b"x" * 2_000_000)

    with_logs(tmp_path, scenario)


def test_who_ends_does_not_wait_for_a_bus_that_is_away(tmp_path: Path) -> None:
    async def scenario(server: NatsServer, first: StreamLog, second: StreamLog) -> None:
        assert await first.begin_writing(0)
        server.kill()
        writing = asyncio.create_task(append(first, 1, b"one"))
        await asyncio.sleep(0.1)
        assert not writing.done()
        first.end_writing()
        with pytest.raises(UsageError, match=r"the last inputs of yard\.registry are not stored, because the bus cannot be reached"):
            await writing

    with_logs(tmp_path, scenario)
