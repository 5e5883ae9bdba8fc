"""A component on a bus whose leaders come, go and stand still: what was acknowledged is there once, whoever goes on."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import signal
import sqlite3
from functools import partial
from pathlib import Path

import pytest

from somrs.deployment import continuation
from somrs.deployment.continuation import continuing
from somrs.errors import UsageError
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.host import Host
from somrs.runtime.node import Report
from somrs.runtime.wire import retry_unanswered
from somrs.storage import lease
from somrs.storage.journal import Journal
from somrs.storage.stream_log import StreamLog
from tests.support.hang import HANG_TIME
from tests.support.ledger import SCHEMA, Ledger, amount_message, doubled
from tests.support.nats_server import NatsServer

PATH = "/ledger"


class Process:
    """A process that continues the ledger, in a data folder. `leads` is set while it does."""

    def __init__(self, bus: BusAddress, folder: Path) -> None:
        self._bus, self.folder = bus, folder
        self.leads = asyncio.Event()
        self.ledger = Ledger()
        self._end_event = asyncio.Event()
        self._stands_still = False
        self._stream: StreamLog | None = None
        self._running = asyncio.create_task(self._run())

    async def _run(self) -> None:
        while not self._end_event.is_set() and not self._stands_still:
            with contextlib.suppress(UsageError):  # started again, as a supervisor does
                await self._run_once()

    async def _run_once(self) -> None:
        file = self.folder / "ledger.sqlite"

        async def carry_out(task: object, report: Report) -> object:
            return doubled(task)

        async with (
            continuing(self._bus, "ledger", file, lambda log: Journal(file, SCHEMA, log=log)) as continuation,
            Host(bus=self._bus) as host,
        ):
            self._stream = continuation._stream
            node = await continuation.add(host, PATH, lambda address: Ledger(f"{host.url}/sink", address), carry_out=carry_out)
            assert isinstance(node.component, Ledger)
            self.ledger = node.component
            self.leads.set()
            copying = asyncio.create_task(continuation._copy_at_times(continuation._stream)) if continuation._stream is not None else None
            waiting = [asyncio.create_task(work) for work in (self._end_event.wait(), node.broken.wait(), continuation._lost.wait())]
            await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            self.leads.clear()
            for task in [*waiting, *([copying] if copying is not None else [])]:
                task.cancel()

    def stand_still(self) -> None:
        """Renew the lease no more, as a process that stands still, until another one leads."""
        assert self._stream is not None
        self._stream._loop.call_soon_threadsafe(self._stream.lease.ended.set)
        self._stands_still = True

    async def end(self) -> None:
        self._end_event.set()
        if not self.leads.is_set():
            self._running.cancel()
        with contextlib.suppress(asyncio.CancelledError, UsageError):
            await self._running


@pytest.mark.parametrize("seed", range(3))
def test_what_was_acknowledged_is_there_once_whoever_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    for module in (lease, continuation):
        monkeypatch.setattr(module, "RENEWAL", 0.05)
    monkeypatch.setattr(lease, "LEASE_TIME", 0.3)
    monkeypatch.setattr(continuation, "COPY_AFTER", 25)
    monkeypatch.setattr(continuation, "KEPT", seed)
    chance = random.Random(seed)

    async def play(server: NatsServer) -> None:
        processes = [Process(server.address, tmp_path / "0")]
        client = Host(bus=server.address)
        await client.start()
        address, count = f"{server.address.gateway}{PATH}", 0
        for round in range(8):
            for _ in range(chance.randint(1, 20)):
                count += 1
                message = amount_message(count, 1, address, f"{server.address.gateway}/teller")
                answer = await retry_unanswered(partial(client.request, message, 1.0), HANG_TIME)
                assert answer.body.task == str(count), "every amount before was counted, and none twice"  # type: ignore[attr-defined]
            [leader] = [process for process in processes if process.leads.is_set()]
            if len(processes) < 3:
                folder = tmp_path / str(round + 1) if chance.random() < 0.5 else tmp_path / "back"
                if folder not in [process.folder for process in processes]:
                    processes.append(Process(server.address, folder))
            if len(processes) > 1 and chance.random() < 0.7:
                if chance.random() < 0.5:
                    await leader.end()
                else:
                    leader.stand_still()
                    while not any(process.leads.is_set() for process in processes if process is not leader):
                        await asyncio.sleep(0.02)
                    await leader.end()
                processes.remove(leader)
                while not any(process.leads.is_set() for process in processes):
                    await asyncio.sleep(0.02)
        log = StreamLog(server.address.servers, "yard", "ledger", "somebody")
        await log.open()
        first, _ = await log.bounds()
        await log.close()
        assert first > 1, "what a copy has is deleted from the stream"
        for process in processes:
            await process.end()
        await client.stop()

    with NatsServer(tmp_path) as server:
        asyncio.run(asyncio.wait_for(play(server), HANG_TIME))


def _fill_up(db: sqlite3.Connection) -> None:
    raise UsageError("the disk is full")


@pytest.mark.parametrize("reason", ["signal", "full disk"])
def test_a_standby_that_is_asked_to_stop_or_cannot_store_ends(tmp_path: Path, reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    async def interrupt_standby() -> None:
        while "(standby)" not in capsys.readouterr().out:
            await asyncio.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    async def play(server: NatsServer) -> None:
        leader = Process(server.address, tmp_path / "leader")
        await leader.leads.wait()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in the background of a shell
        file = tmp_path / "standby" / "ledger.sqlite"
        async with (
            continuing(server.address, "ledger", file, lambda log: Journal(file, SCHEMA, log=log)) as following,
            Host(bus=server.address) as host,
        ):
            client = Host(bus=server.address)
            await client.start()
            if reason == "signal":
                interrupting = asyncio.create_task(interrupt_standby())
            else:
                following.journal.disk.write(_fill_up)
                message = amount_message(1, 1, f"{server.address.gateway}{PATH}", f"{server.address.gateway}/teller")
                await retry_unanswered(partial(client.request, message, 1.0), HANG_TIME)
            try:
                await following.add(host, PATH, lambda address: Ledger(f"{host.url}/sink", address))
            finally:
                if reason == "signal":
                    interrupting.cancel()
                await client.stop()
                await leader.end()

    handler = signal.getsignal(signal.SIGINT)
    try:
        with NatsServer(tmp_path) as server, pytest.raises((SystemExit, UsageError)) as ending:
            asyncio.run(play(server))
    finally:
        signal.signal(signal.SIGINT, handler)
    assert isinstance(ending.value, SystemExit) if reason == "signal" else "disk is full" in str(ending.value), ending.value
