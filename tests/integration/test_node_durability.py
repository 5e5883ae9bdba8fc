"""What a node does with a disk, over real sockets: nothing leaves before it is on disk, and nothing that was acknowledged is lost."""

from __future__ import annotations

import asyncio
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from msgspec import structs

from somrs.errors import RemoteError, UsageError
from somrs.kernel.component import DeliveryFailed, Effect, Input, Received, Send, TimerFired
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.submission import CancelTask
from somrs.runtime.host import Host
from somrs.runtime.node import Report
from somrs.runtime.wire import Wire
from somrs.storage.disk import Disk, Kind
from somrs.storage.journal import Journal
from tests.support.hang import HANG_TIME
from tests.support.lab import CLIENT
from tests.support.ledger import SCHEMA, Ledger, Sink, Teller, amount_message, doubled, expected
from tests.support.paths import ROOT

NOTES = Kind(
    owner="a test's",
    content="note",
    rival="another test",
    application=1,
    version=1,
    tables="CREATE TABLE notes (text TEXT);",
)


def run_with_timeout(scenario: Callable[[], Awaitable[None]]) -> None:
    async def run() -> None:
        async with asyncio.timeout(HANG_TIME):  # nothing here takes a second; it must not wait for ever
            await scenario()

    asyncio.run(run())


async def wait_until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.005)


async def double(task: object, report: Report) -> object:
    return doubled(task)


class Brake:
    """Holds a disk up."""

    def __init__(self, disk: Disk) -> None:
        self._release_event = threading.Event()
        disk.write(lambda db: self._wait())

    def _wait(self) -> None:
        assert self._release_event.wait(HANG_TIME)

    def release(self) -> None:
        self._release_event.set()


def test_nothing_leaves_before_it_is_on_disk(tmp_path: Path) -> None:
    async def scenario() -> None:
        host, wire, sink = Host(), Wire(), Sink()
        await host.start()
        sink_at = host.add("/sink", lambda address: sink).address
        journal = Journal(tmp_path / "ledger.sqlite", SCHEMA)

        def make_ledger(address: str) -> Ledger:
            return Ledger(sink_at, address, patience=0.05)

        node = host.add_journaled("/ledger", make_ledger, journal, carry_out=double)
        await asyncio.sleep(0.1)
        brake = Brake(journal.disk)
        posted = [
            asyncio.ensure_future(wire.post(amount_message(number, 10 + number, node.address, CLIENT, "http://127.0.0.1:1/nobody")))
            for number in (0, 1)
        ]
        twice = asyncio.ensure_future(wire.post(amount_message(0, 10, node.address, CLIENT, "http://127.0.0.1:1/nobody")))
        ledger = node.component
        assert isinstance(ledger, Ledger)
        await wait_until(lambda: ledger.total == 21 and len(ledger.reminded) == 2)
        await asyncio.sleep(0.1)
        assert not sink.received
        assert not any(request.done() for request in (*posted, twice)), "not even what is known already, as long as it may be lost"
        assert not ledger.doubled, "what is asked may move a robot"
        brake.release()
        await asyncio.gather(*posted, twice)
        await wait_until(lambda: set(sink.received) == expected([10, 11]))
        first = [text for kind, text, _ in sink.received if kind == "receipt"]
        assert sorted(first) == ["10", "11"]
        await wire.close()
        await host.stop()
        journal.close()

    run_with_timeout(scenario)


def test_with_nothing_to_wait_for_nothing_waits(tmp_path: Path) -> None:
    """A message that only reads goes its way while the disk is busy with others'."""

    async def scenario() -> None:
        host = Host()
        await host.start()
        message = amount_message(1, 7, f"{host.url}/ledger")
        known_inputs: list[Input] = []
        journal = Journal(tmp_path / "ledger.sqlite", structs.replace(SCHEMA, is_read_only=lambda event: event in known_inputs))
        host.add_journaled("/ledger", lambda address: Ledger(), journal, carry_out=double)
        assert (await host.request(message)).body == CancelTask(task="7")
        known_inputs.append(Received(message))
        await wait_until(lambda: journal.disk.durable == journal.disk.position)
        brake = Brake(journal.disk)
        assert (await host.request(message)).body == CancelTask(task="7")
        brake.release()
        await host.stop()
        journal.close()

    run_with_timeout(scenario)


class Chatter:
    """Two of them send a number to and fro, until it is large enough; all of it is remembered in order."""

    def __init__(self, address: str, peer_address: str, last_number: int) -> None:
        self.address, self.peer_address, self.last_number = address, peer_address, last_number
        self.received_texts: list[str] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case TimerFired():
                return [self._send_text(f"{lane}:0") for lane in range(3)]
            case Received(Message(body=CancelTask(task=text))):
                self.received_texts.append(text)
                lane, _, number = text.partition(":")
                return [self._send_text(f"{lane}:{int(number) + 1}")] if int(number) < self.last_number else []
        return []

    def _send_text(self, text: str) -> Send:
        header = Header(sender=self.address, recipient=self.peer_address, message_id=message_id(text))
        return Send(Message(header=header, body=CancelTask(task=text)))


def test_messages_within_a_process_keep_their_order_and_let_others_have_their_turn() -> None:
    async def scenario() -> None:
        host = Host()
        await host.start()
        first_address, second_address = f"{host.url}/one", f"{host.url}/two"
        first, second = Chatter(first_address, second_address, 20_000), Chatter(second_address, first_address, 20_000)
        node = host.add("/one", lambda address: first)
        host.add("/two", lambda address: second)
        node.feed(TimerFired("go"))
        turns = 0
        while len(first.received_texts) + len(second.received_texts) < 60_003:
            turns += 1
            await asyncio.sleep(0)
        assert turns > 1000, "the loop was held up"
        for texts, odd in ((first.received_texts, 1), (second.received_texts, 0)):
            assert [text.partition(":")[0] for text in texts[:3]] == ["0", "1", "2"]
            assert all(
                [text for text in texts if text.startswith(f"{lane}:")] == [f"{lane}:{n}" for n in range(odd, 20_001, 2)]
                for lane in range(3)
            )
        await host.stop()

    run_with_timeout(scenario)


class Refusing:
    """Meets a defect in everything it hears."""

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received):
            raise ZeroDivisionError("division by zero")
        return []


class Notes(Teller):
    """A teller that notes what did not get through."""

    def __init__(self, ledger: str) -> None:
        super().__init__(ledger)
        self.undelivered: list[str] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, DeliveryFailed):
            self.undelivered.append(event.reason)
        return super().handle(event, now)


def test_a_defect_within_the_process_is_the_senders_business_too() -> None:
    async def scenario() -> None:
        host = Host()
        await host.start()
        notes = Notes(f"{host.url}/refusing")
        host.add("/refusing", lambda address: Refusing())
        node = host.add("/notes", lambda address: notes)
        node.feed(TimerFired("7"))
        await wait_until(lambda: bool(notes.undelivered))
        assert notes.undelivered == ["ZeroDivisionError: division by zero"]
        await host.stop()

    run_with_timeout(scenario)


def test_a_full_disk_stops_its_component_and_senders_go_on_repeating(tmp_path: Path) -> None:
    async def scenario() -> None:
        host, wire, sink = Host(), Wire(), Sink()
        await host.start()
        sink_at = host.add("/sink", lambda address: sink).address
        journal = Journal(tmp_path / "ledger.sqlite", SCHEMA)
        node = host.add_journaled("/ledger", lambda address: Ledger(sink_at, address), journal, carry_out=double)
        journal.disk.write_and_wait(lambda db: db.execute("PRAGMA max_page_count = 1").fetchone())
        journal.disk.write(lambda db: db.execute("INSERT INTO entries VALUES ('', -1, zeroblob(100000))"))
        message = amount_message(1, 5, node.address, CLIENT, "http://127.0.0.1:1/nobody")
        for _ in range(2):
            with pytest.raises(RemoteError, match=r"HTTP 503.*accepts no more inputs, because it could not store .* database or dis"):
                await wire.post(message)
        reply_message = await wire.post(amount_message(2, 6, node.address))
        assert reply_message is not None
        assert isinstance(reply_message.body, frp.Fault), "who waits for an answer gets one"
        assert reply_message.body.code == "env:Receiver"
        assert not sink.received
        await wire.close()
        await host.stop()
        journal.close()

    run_with_timeout(scenario)


class Hasty(Notes):
    """Says everything for a moment only, and notes when that was over and when it was told so."""

    def __init__(self, ledger: str) -> None:
        super().__init__(ledger)
        self.expired_at, self.told_at = 0.0, 0.0

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, DeliveryFailed):
            self.told_at = now
        else:
            self.expired_at = now + 0.3
        return [Send(effect.message, expires_at=self.expired_at) for effect in super().handle(event, now) if isinstance(effect, Send)]


def test_what_a_full_disk_did_not_take_is_repeated_within_the_process_too(tmp_path: Path) -> None:
    async def scenario() -> None:
        host = Host()
        await host.start()
        journal = Journal(tmp_path / "ledger.sqlite", SCHEMA)
        disk = journal.disk
        tellers = [Hasty(f"{host.url}/ledger"), Hasty(f"{host.url}/ledger")]
        host.add_journaled("/ledger", lambda address: Ledger(), journal, carry_out=double)
        first, second = (host.add(f"/teller{number}", lambda address, teller=teller: teller) for number, teller in enumerate(tellers))  # type: ignore[misc]
        brake = Brake(disk)
        disk.write(lambda db: db.execute("INSERT INTO nowhere VALUES (1)"))
        first.feed(TimerFired("7"))  # handled, and then not kept
        await asyncio.sleep(0.05)
        assert disk.failed is None
        brake.release()
        await wait_until(lambda: disk.failed is not None)
        second.feed(TimerFired("8"))  # not even handled
        await wait_until(lambda: all(teller.undelivered for teller in tellers))
        assert all(teller.told_at >= teller.expired_at for teller in tellers)
        assert all("could not store one" in reason for teller in tellers for reason in teller.undelivered)
        await host.stop()
        journal.close()

    run_with_timeout(scenario)


def test_a_stop_and_a_start_lose_nothing(tmp_path: Path) -> None:
    """Timers go on where they were, open questions are asked again, what was not delivered is sent again, and nothing twice."""

    async def scenario() -> None:
        wire, sink, started_tasks = Wire(), Sink(), list[object]()
        far = Host()
        await far.start()
        port, sink_at = 0, f"{far.url}/sink"
        release_event = asyncio.Event()
        reminded_in_time: list[bool] = []

        async def wait(task: object, report: Report) -> object:
            started_tasks.append(task)
            await release_event.wait()
            return doubled(task)

        for life in range(3):
            host = Host(port=port)
            await host.start()
            port = int(host.url.rpartition(":")[2])
            journal = Journal(tmp_path / "ledger.sqlite", SCHEMA)
            node = host.add_journaled("/ledger", lambda address: Ledger(sink_at, address, patience=1.0), journal, carry_out=wait)
            ledger = node.component
            assert isinstance(ledger, Ledger)
            assert ledger.starts == life + 1
            if life == 0:
                await wire.post(amount_message(0, 4, node.address, CLIENT, "http://127.0.0.1:1/nobody"))
            if life == 2:
                # The timers of a loop fire in the order in which they are due, however late.
                asyncio.get_running_loop().call_later(0.95, lambda ledger=ledger: reminded_in_time.append(bool(ledger.reminded)))  # type: ignore[misc]
                await wait_until(lambda: bool(reminded_in_time))
                assert reminded_in_time == [True], "the timer went on, and was not begun anew"
                far.add("/sink", lambda address: sink)
                release_event.set()
                await wait_until(lambda: set(sink.received) == expected([4]))
            await asyncio.sleep(0.05)
            await host.stop()
            (entry_count,) = journal.disk.write_and_wait(lambda db: db.execute("SELECT count(*) FROM entries").fetchone())
            assert entry_count == 0, "a clean stop leaves a snapshot, and nothing to be handled again"
            journal.close()
        assert started_tasks == ["4"] * 3
        assert len(sink.received) == 3
        await wire.close()
        await far.stop()

    run_with_timeout(scenario)


HOSTED = """
import asyncio, sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from tests.support.ledger import SCHEMA, Ledger, doubled
from somrs.runtime.host import Host
from somrs.storage.journal import Journal
from somrs.deployment.programs import say_ready

async def main():
    journal = Journal(Path(sys.argv[1]), SCHEMA)
    port = int(journal.address.rpartition(":")[2].partition("/")[0]) if journal.address else 0
    rim = Host(port=port)
    await rim.start()
    async def double(task, report):
        return doubled(task)
    node = rim.add_journaled("/ledger", lambda address: Ledger(sys.argv[2], address, patience=0.3), journal, carry_out=double)
    say_ready("ledger", node.address)
    await asyncio.sleep(3600)

asyncio.run(main())
"""


def test_what_was_acknowledged_survives_a_kill(tmp_path: Path) -> None:
    """A process is killed again and again while it is told things; it comes back where it was, and says everything."""
    file = tmp_path / "ledger.sqlite"

    async def scenario() -> None:
        host, wire, sink = Host(), Wire(), Sink()
        await host.start()
        sink_at = host.add("/sink", lambda address: sink).address
        acknowledged: list[int] = []
        addresses: set[str] = set()
        count = 0

        async def post_number(number: int, recipient: str) -> None:
            try:
                await wire.post(amount_message(number, number, recipient, CLIENT, "http://127.0.0.1:1/nobody"))
            except RemoteError:
                return
            acknowledged.append(number)

        for kill_after in (40, 5, None):
            line = [sys.executable, "-c", HOSTED, str(file), sink_at, str(ROOT)]
            child = await asyncio.create_subprocess_exec(*line, stdout=subprocess.PIPE)
            assert child.stdout is not None
            address = (await child.stdout.readline()).decode().rpartition('"at":"')[2].strip().rstrip('"}')
            addresses.add(address)
            pending_posts: list[asyncio.Future[None]] = []
            try:
                if kill_after is None:
                    await wait_until(
                        lambda: {text for kind, text, _ in sink.received if kind == "doubled"} >= {str(2 * n) for n in acknowledged}
                    )
                    await wait_until(lambda: {id for kind, _, id in sink.received if kind == "reminder"} >= ids("reminder", acknowledged))
                    break
                target_count = len(acknowledged) + kill_after
                while len(acknowledged) < target_count:
                    pending_posts = [post for post in pending_posts if not post.done()]
                    while len(pending_posts) < 8:
                        pending_posts.append(asyncio.ensure_future(post_number(count, address)))
                        count += 1
                    await asyncio.wait(pending_posts, return_when=asyncio.FIRST_COMPLETED)
            finally:
                child.kill()
                await asyncio.gather(*pending_posts)
                await child.wait()
        assert len(addresses) == 1, "those who know it by its address find it there again"
        assert len(acknowledged) >= 45
        await wire.close()
        await host.stop()
        journal = Journal(file, SCHEMA)
        journaled, _ = journal.begin(address, lambda address: Ledger())
        assert isinstance(journaled.component, Ledger)
        kept_amounts = set(journaled.component.amounts.values())
        assert kept_amounts >= set(acknowledged)
        assert kept_amounts <= set(range(count))
        journal.close()
        with sqlite3.connect(file) as db:
            archived = {int(effect) for (effect,) in db.execute("SELECT effect FROM records")}
        db.close()
        assert archived == kept_amounts

    run_with_timeout(scenario)


def ids(kind: str, numbers: list[int]) -> set[str]:
    return {message_id(kind, message_id("told", number)) for number in numbers}


def test_a_commit_survives_a_power_cut(tmp_path: Path) -> None:
    """As far as SQLite promises it, https://www.sqlite.org/pragma.html#pragma_synchronous; no test here cuts the power."""
    disk = Disk(tmp_path / "notes.sqlite", NOTES)
    modes = disk.write_and_wait(lambda db: [db.execute(f"PRAGMA {name}").fetchone()[0] for name in ("journal_mode", "synchronous")])
    assert modes == ["wal", 2]
    disk.close()


def test_a_disk_takes_no_more_once_it_failed(tmp_path: Path) -> None:
    disk = Disk(tmp_path / "notes.sqlite", NOTES)
    disk.write(lambda db: db.execute("INSERT INTO notes VALUES ('one')"))
    disk.write_and_wait(lambda db: None)
    disk.write(lambda db: db.execute("INSERT INTO notes VALUES ('two')"))
    disk.write(lambda db: db.execute("INSERT INTO nowhere VALUES (1)"))
    disk.write_and_wait(lambda db: None)
    disk.write(lambda db: db.execute("INSERT INTO notes VALUES ('three')"))
    notes = disk.read(lambda db: [text for (text,) in db.execute("SELECT text FROM notes")]).result()
    assert notes in (["one"], ["one", "two"])
    assert disk.durable < disk.position
    assert "no such table: nowhere" in str(disk.failed)
    disk.close()
    with pytest.raises(UsageError, match="is closed"):
        disk.read(lambda db: None)
