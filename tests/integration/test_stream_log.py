"""The entries of a component on a real NATS server: one writes, others read, and whoever was replaced cannot write any more."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

from somrs.errors import UsageError
from somrs.storage.stream_log import Batch, Replaced, StreamLog
from tests.support.hang import HANG_TIME
from tests.support.nats_server import NatsServer


def with_logs(folder: Path, scenario: Callable[[NatsServer, StreamLog, StreamLog], Coroutine[Any, Any, None]]) -> None:
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

    with NatsServer(folder) as server:
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
        assert await second.copied_number() is None
        assert await second.copied_address() is None
        assert await second.place_after(0) == 1
        assert await first.begin_writing(0)
        for number in (3, 4, 9, 12):
            await append(first, number, f"up to {number}".encode())
        for number, place in ((0, 2), (2, 2), (3, 3), (4, 4), (8, 4), (9, 5), (12, 6), (40, 6)):
            assert await second.place_after(number) == place, number
        file = tmp_path / "registry.sqlite"
        file.write_bytes(bytes(range(256)) * 3000)
        await first.store_copy(file, 9, "http://127.0.0.1:1/registry")
        await first.forget_before(4)
        assert await second.copied_number() == 9
        assert await second.copied_address() == "http://127.0.0.1:1/registry"
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
                await first.store_copy(tmp_path / "stored", number, "http://127.0.0.1:1/registry")

        storing = asyncio.create_task(store())
        while await second.copied_number() is None:
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
            await first.store_copy(tmp_path / "stored", 5, "http://127.0.0.1:1/registry")
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
        await first.store_copy(tmp_path / "stored", 5, "http://127.0.0.1:1/registry")
        await first.call(first._js.purge_stream("OBJ_somrs-journals", subject="$O.somrs-journals.C.>"))
        fetching = asyncio.create_task(second.fetch_copy(tmp_path / "fetched"))
        while "the copy of yard.registry on the bus is damaged" not in caplog.text:
            await asyncio.sleep(0.02)
        await first.store_copy(tmp_path / "stored", 5, "http://127.0.0.1:1/registry")
        await fetching
        assert (tmp_path / "fetched").read_bytes() == (tmp_path / "stored").read_bytes()

    with_logs(tmp_path, scenario)


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
