"""A data folder that goes on without its bus, or with another one, and comes back: what was acknowledged is lost to nobody silently."""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Callable, Coroutine
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

from somrs.deployment.continuation import Continuation, continuing
from somrs.deployment.joining import CHOICE, Choice
from somrs.errors import UsageError
from somrs.ports import free_range
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.host import Host
from somrs.runtime.node import Report
from somrs.runtime.wire import retry_unanswered
from somrs.storage.journal import Journal
from somrs.storage.stream_log import StreamLog
from tests.support.hang import HANG_TIME
from tests.support.ledger import SCHEMA, Ledger, amount_message, doubled
from tests.support.nats_server import NatsServer

PATH = "/ledger"


class Site:
    """A ledger that is at one address, with and without its bus."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.port = folder, free_range("127.0.0.1", 2)
        self.gateway = f"http://127.0.0.1:{self.port}"
        self.count = 0

    def server(self, name: str = "bus") -> NatsServer:
        (self.folder / name).mkdir()
        return NatsServer(self.folder / name, self.gateway)

    @contextlib.asynccontextmanager
    async def running(self, data: str, bus: BusAddress | None) -> AsyncIterator[Continuation]:
        """The ledger with this data folder."""
        file = self.folder / data / "ledger.sqlite"

        async def carry_out(task: object, report: Report) -> object:
            return doubled(task)

        async with (
            continuing(bus, "ledger", file, lambda log: Journal(file, SCHEMA, log=log)) as continuation,
            Host("127.0.0.1", self.port if bus is None else 0, bus=bus) as host,
        ):
            await continuation.add(host, PATH, lambda address: Ledger(f"{host.url}/sink", address), carry_out=carry_out)
            yield continuation

    async def send(self, amount: int, bus: BusAddress | None) -> int:
        """Have the ledger add an amount. Returns the total."""
        self.count += 1
        client = Host(bus=bus) if bus is not None else Host("127.0.0.1", 0)
        await client.start()
        try:
            message = amount_message(self.count, amount, f"{self.gateway}{PATH}", f"{client.url}/teller")
            answer = await retry_unanswered(partial(client.request, message, 1.0), HANG_TIME)
        finally:
            await client.stop()
        return int(answer.body.task)  # type: ignore[attr-defined]

    async def total(self, data: str, bus: BusAddress | None, *amounts: int) -> int:
        """Run the ledger with this data folder, and have it add amounts."""
        total = 0
        async with self.running(data, bus):
            for amount in (*amounts, 0):
                total = await self.send(amount, bus)
        return total


def play(folder: Path, scenario: Callable[[Site, NatsServer], Coroutine[Any, Any, None]]) -> None:
    site = Site(folder)
    with site.server() as server:
        asyncio.run(asyncio.wait_for(scenario(site, server), HANG_TIME))


def test_a_folder_that_went_on_without_its_bus_goes_on_with_it(tmp_path: Path) -> None:
    async def scenario(site: Site, server: NatsServer) -> None:
        assert await site.total("first", server.address, 1) == 1
        assert await site.total("second", server.address, 2) == 3
        assert await site.total("first", server.address) == 3
        assert await site.total("first", None, 10, 20) == 33
        assert await site.total("first", server.address, 100) == 133
        assert await site.total("second", server.address) == 133, "it has what the first did without the bus"

    play(tmp_path, scenario)


def test_a_folder_that_did_nothing_without_the_bus_follows_it(tmp_path: Path) -> None:
    async def scenario(site: Site, server: NatsServer) -> None:
        assert await site.total("first", server.address, 1) == 1
        file = site.folder / "first" / "ledger.sqlite"
        async with continuing(None, "ledger", file, lambda log: Journal(file, SCHEMA, log=log)):
            pass
        assert await site.total("second", server.address, 2) == 3
        assert await site.total("first", server.address) == 3

    play(tmp_path, scenario)


@pytest.mark.parametrize(("amounts_without", "amounts_on_bus"), [((10,), (100,)), ((10,), (100,) * 9), ((10,) * 9, (100,))])
@pytest.mark.parametrize("choice", Choice)
def test_who_went_on_while_the_bus_went_on_too_is_refused_until_somebody_chooses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, amounts_without: tuple[int, ...], amounts_on_bus: tuple[int, ...], choice: Choice
) -> None:
    async def scenario(site: Site, server: NatsServer) -> None:
        await site.total("first", server.address, 1)
        await site.total("first", None, *amounts_without)
        assert await site.total("second", server.address, *amounts_on_bus) == 1 + sum(amounts_on_bus)
        with pytest.raises(UsageError, match=rf"only one can go on\. Start it once with {CHOICE}=bus to go on from the bus"):
            await site.total("first", server.address)
        assert await site.total("second", server.address) == 1 + sum(amounts_on_bus)
        assert await site.total("first", None) == 1 + sum(amounts_without), "it is as it was"
        monkeypatch.setenv(CHOICE, choice)
        chosen_total = 1 + sum(amounts_on_bus if choice is Choice.BUS else amounts_without)
        assert await site.total("first", server.address) == chosen_total
        assert (site.folder / "first" / "ledger.sqlite-put-aside-1").exists() is (choice is Choice.BUS)
        monkeypatch.delenv(CHOICE)
        assert await site.total("second", server.address, 1000) == chosen_total + 1000
        assert await site.total("first", server.address) == chosen_total + 1000

    play(tmp_path, scenario)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_lost_silently_whoever_goes_on_with_which_bus(tmp_path: Path, seed: int) -> None:
    """Folders run one after the other, on one of two buses or on none. What each of them and each bus has is known: what one of two has
    goes on if it has all of the other one, and else nothing does."""
    chance = random.Random(seed)

    async def scenario(site: Site, server: NatsServer) -> None:
        with site.server("other") as other_server:
            buses: dict[str, NatsServer | None] = {"bus": server, "other": other_server, "none": None}
            histories: dict[str, list[int]] = {}
            refused_count = 0
            for amount in range(1, 26):
                data, name = chance.choice(["first", "second"]), chance.choice([*buses])
                bus, own, on_bus = buses[name], histories.get(data, []), histories.get(name, [])
                address = bus.address if bus is not None else None
                if bus is not None and own != on_bus[: len(own)] and on_bus != own[: len(on_bus)]:
                    refused_count += 1
                    with pytest.raises(UsageError, match="only one can go on"):
                        await site.total(data, address)
                    continue
                history = [*max(own, on_bus, key=len), amount] if bus is not None else [*own, amount]
                assert await site.total(data, address, amount) == sum(history), (data, name, histories)
                histories[data] = history
                if bus is not None:
                    histories[name] = history
            assert refused_count

    play(tmp_path, scenario)


def test_a_folder_with_another_history_is_refused(tmp_path: Path) -> None:
    async def scenario(site: Site, server: NatsServer) -> None:
        await site.total("first", server.address, 1)
        await site.total("stranger", None, 10)
        with pytest.raises(UsageError, match="its history is another one than that on the bus"):
            await site.total("stranger", server.address)
        assert await site.total("first", server.address) == 1

    play(tmp_path, scenario)


def test_a_folder_goes_to_another_bus_and_back(tmp_path: Path) -> None:
    async def scenario(site: Site, server: NatsServer) -> None:
        with site.server("other") as other_server:
            assert await site.total("first", server.address, 1) == 1
            assert await site.total("first", other_server.address, 2) == 3
            assert await site.total("first", server.address, 4) == 7
            assert await site.total("second", server.address, 8) == 15
            assert await site.total("third", other_server.address, 16) == 19
            with pytest.raises(UsageError, match="only one can go on"):
                await site.total("first", other_server.address)
            assert await site.total("first", server.address) == 15

    play(tmp_path, scenario)


async def die(self: Continuation, stream: StreamLog) -> None:
    raise RuntimeError("killed")


async def is_killed_before_its_copy(site: Site, data: str, bus: BusAddress) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Continuation, "_copy", die)
        with pytest.raises(RuntimeError, match="killed"):
            await site.total(data, bus)


def test_a_leader_that_dies_before_the_bus_has_its_copy_loses_nothing(tmp_path: Path) -> None:
    async def scenario(site: Site, server: NatsServer) -> None:
        await site.total("first", server.address, 1)
        await site.total("first", None, 10)
        await is_killed_before_its_copy(site, "first", server.address)
        assert await site.total("first", server.address) == 11
        assert await site.total("second", server.address) == 11, "the bus has it, too"

    play(tmp_path, scenario)


def test_a_leader_that_begins_anew_elsewhere_and_dies_before_its_copy_begins_anew_again(tmp_path: Path) -> None:
    async def scenario(site: Site, server: NatsServer) -> None:
        await site.total("first", server.address, 1, 2)
        site.port += 1
        site.gateway = f"http://127.0.0.1:{site.port}"
        elsewhere = msgspec.structs.replace(server.address, gateway=site.gateway)
        await is_killed_before_its_copy(site, "second", elsewhere)
        assert await site.total("second", elsewhere) == 0, "what was said at the other address is not handled again"
        assert await site.total("second", elsewhere, 100) == 100
        assert await site.total("third", elsewhere, 1000) == 1100

    play(tmp_path, scenario)


def test_a_standby_without_room_for_the_copy_says_so_and_begins_when_there_is_room(tmp_path: Path) -> None:
    async def scenario(site: Site, server: NatsServer) -> None:
        await site.total("first", server.address, 1)
        (site.folder / "second").mkdir()
        (site.folder / "second" / "ledger.copy").symlink_to("/dev/full")
        with pytest.raises(UsageError, match="No space left on device; check the free disk space"):
            await site.total("second", server.address)
        (site.folder / "second" / "ledger.copy").unlink()
        assert await site.total("second", server.address, 2) == 3

    play(tmp_path, scenario)


def test_the_bus_has_all_again_after_its_journal_was_deleted_by_hand(tmp_path: Path) -> None:
    async def scenario(site: Site, server: NatsServer) -> None:
        async with site.running("first", server.address) as continuation:
            stream = continuation._stream
            assert stream is not None
            copying = asyncio.create_task(continuation._copy_at_times(stream))
            await site.send(1, server.address)
            await stream.call(stream._js.delete_stream("somrs-journal-yard-ledger"))
            assert await site.send(2, server.address) == 3
            while (copy := await stream.copy_info()) is None or copy.number == 0:
                await asyncio.sleep(0.02)
            copying.cancel()
            assert await site.send(4, server.address) == 7
        assert await site.total("second", server.address) == 7

    play(tmp_path, scenario)


def test_a_folder_that_changes_to_a_bus_and_back_misses_nothing(tmp_path: Path) -> None:
    """A component that begins anew at another address has fewer entries than before."""

    async def scenario(site: Site, server: NatsServer) -> None:
        async def at_port(port: int, bus: BusAddress | None, *amounts: int) -> int:
            site.port, site.gateway = port, f"http://127.0.0.1:{port}"
            return await site.total("first", bus, *amounts)

        first_port, second_port = site.port, site.port + 1
        on_bus = msgspec.structs.replace(server.address, gateway=f"http://127.0.0.1:{second_port}")
        assert await at_port(first_port, None, 1, 2, 3, 4, 5) == 15
        assert await at_port(second_port, on_bus, 10) == 10
        assert await at_port(first_port, None, 100) == 100

    play(tmp_path, scenario)
