"""Several messages in one request: between nodes that told each other so, in order, each with its own fate, within limits."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import aiohttp
import msgspec
import pytest
from aiohttp import web
from msgspec import Struct

from somrs.kernel.codec import Schema
from somrs.kernel.component import DeliveryFailed, Effect, Input, Received, Send, TimerFired
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.protocol.messages.submission import CancelTask
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES
from somrs.runtime import batches
from somrs.runtime.batches import MAX_BATCH_SIZE, MEDIA_TYPE
from somrs.runtime.host import Host
from somrs.storage.journal import Journal
from tests.integration.test_node_durability import Brake, run_with_timeout, wait_until


def text_message(text: str, recipient: str, number: int = 0, reply_to: str = "http://127.0.0.1:1/nobody") -> Message:
    return Message(
        header=Header(
            sender="http://127.0.0.1:1/nobody", recipient=recipient, message_id=message_id(text, recipient, number), reply_to=reply_to
        ),
        body=CancelTask(task=text),
    )


class ReceiverState(Struct):
    received_texts: list[str] = []


class Receiver:
    """Notes what it hears."""

    def __init__(self, state: ReceiverState | None = None) -> None:
        self.state = state or ReceiverState()

    @property
    def received_texts(self) -> list[str]:
        return self.state.received_texts

    @property
    def open(self) -> list[str]:
        return []

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received) and isinstance(event.message.body, CancelTask):
            self.received_texts.append(event.message.body.task)
        return []


RECEIVER = Schema(component="ear", version=1, state=ReceiverState, timers=None, questions=None, tasks=None, answers=None, restore=Receiver)


class Sender:
    """Says what it is rung with, in order; `lost` is what did not get through."""

    def __init__(self) -> None:
        self.lost: list[str] = []
        self.messages: dict[str, list[Message]] = {}
        self.patience = 60.0

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case TimerFired(timer):
                return [Send(message, expires_at=now + self.patience) for message in self.messages[str(timer)]]
            case DeliveryFailed(message, _) if isinstance(message.body, CancelTask):
                self.lost.append(message.body.task)
        return []


class Relay:
    """Passes requests on, notes of which kind they are, and can stand for what else may be on the way, or in place of the other."""

    def __init__(self, target_url: str) -> None:
        self.target_url = target_url
        self.kinds: list[str] = []
        self.foreign = False
        """Says nothing of batches, and takes none."""
        self.cuts = 0
        """So many answers are still to be lost."""

    async def start(self) -> str:
        app = web.Application()
        app.router.add_post("/{path:.*}", self._pass)
        self._runner = web.AppRunner(app)
        await self._runner.setup()
        site = web.TCPSite(self._runner, "127.0.0.1", 0)
        await site.start()
        self._session = aiohttp.ClientSession()
        return f"http://127.0.0.1:{self._runner.addresses[0][1]}"

    async def stop(self) -> None:
        await self._session.close()
        await self._runner.cleanup()

    @property
    def batches(self) -> int:
        return self.kinds.count(MEDIA_TYPE)

    async def _pass(self, request: web.Request) -> web.Response:
        kind = request.headers["Content-Type"]
        self.kinds.append(kind.partition(";")[0])
        if self.foreign and kind == MEDIA_TYPE:
            return web.Response(status=415)
        async with self._session.post(self.target_url + request.path, data=await request.read(), headers={"Content-Type": kind}) as answer:
            document = await answer.read()
            if self.cuts:
                self.cuts -= 1
                assert request.transport is not None
                request.transport.abort()
            headers = {name: answer.headers[name] for name in ("Content-Type", "Accept-Post") if name in answer.headers}
            if self.foreign:
                headers.pop("Accept-Post", None)
            return web.Response(status=answer.status, body=document, headers=headers)


class Network:
    """A node that speaks, two that hear, in another process as far as it knows, and the relay between them."""

    def __init__(self) -> None:
        self.sender, self.first_receiver, self.second_receiver = Sender(), Receiver(), Receiver()
        self.sender_host, self.receiver_host = Host(), Host()

    async def send_all(self, *items: tuple[str, str] | Message) -> None:
        """Say all of it at once: texts to paths, or whole messages."""
        name = str(len(self.sender.messages))
        self.sender.messages[name] = [
            item if isinstance(item, Message) else text_message(item[1], f"{self.url}{item[0]}", number)
            for number, item in enumerate(items)
        ]
        self.node.feed(TimerFired(name))

    async def __aenter__(self) -> Network:
        await self.sender_host.start()
        await self.receiver_host.start()
        self.receiver_host.add("/one", lambda address: self.first_receiver)
        self.receiver_host.add("/two", lambda address: self.second_receiver)
        self.node = self.sender_host.add("/mouth", lambda address: self.sender)
        self.relay = Relay(self.receiver_host.url)
        self.url = await self.relay.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.sender_host.stop()
        await self.relay.stop()
        await self.receiver_host.stop()


def run_scenario(scenario: Callable[[Network], Awaitable[None]]) -> None:
    async def run() -> None:
        async with Network() as network:
            await scenario(network)

    run_with_timeout(run)


NUMBERS = [str(number) for number in range(100)]


def test_what_is_due_goes_together_once_the_other_said_that_it_takes_that() -> None:
    async def scenario(network: Network) -> None:
        await network.send_all(("/one", "hello"))
        await wait_until(lambda: network.first_receiver.received_texts == ["hello"])
        assert not network.relay.batches, "nobody has said anything yet"
        await network.sender_host.delivered(5)
        await network.send_all(*(("/one" if int(number) % 2 else "/two", number) for number in NUMBERS))
        await wait_until(lambda: len(network.first_receiver.received_texts) + len(network.second_receiver.received_texts) == 101)
        assert network.first_receiver.received_texts[1:] == NUMBERS[1::2]
        assert network.second_receiver.received_texts == NUMBERS[::2]
        assert len(network.relay.kinds) == 3, f"one, and then {MAX_BATCH_SIZE} and the rest"

    run_scenario(scenario)


def test_other_stacks_never_see_a_batch() -> None:
    async def scenario(network: Network) -> None:
        network.relay.foreign = True
        for _ in range(2):
            await network.send_all(*(("/one", number) for number in NUMBERS[:10]))
            await network.sender_host.delivered(5)
        assert network.first_receiver.received_texts == 2 * NUMBERS[:10]
        assert set(network.relay.kinds) == {soap.MEDIA_TYPE}

    run_scenario(scenario)


def test_another_stack_that_takes_the_place_of_a_node_gets_everything_alone() -> None:
    async def scenario(network: Network) -> None:
        await network.send_all(("/one", "hello"))
        await network.sender_host.delivered(5)
        network.relay.foreign = True
        await network.send_all(*(("/one", number) for number in NUMBERS[:10]))
        await wait_until(lambda: len(network.first_receiver.received_texts) == 11)
        assert network.first_receiver.received_texts[1:] == NUMBERS[:10]
        assert network.relay.batches == 1

    run_scenario(scenario)


def test_one_that_nobody_takes_does_not_hold_up_the_others() -> None:
    async def scenario(network: Network) -> None:
        network.sender.patience = 0.5
        await network.send_all(("/one", "hello"))
        await network.sender_host.delivered(5)
        await network.send_all(("/one", "1"), ("/gone", "lost"), ("/one", "2"), ("/gone", "too"), ("/two", "3"))
        await wait_until(
            lambda: network.first_receiver.received_texts == ["hello", "1", "2"] and network.second_receiver.received_texts == ["3"]
        )
        assert not network.sender.lost, "there was time yet"
        await network.send_all(("/one", "4"), ("/two", "5"))
        await wait_until(lambda: network.first_receiver.received_texts[-1] == "4" and network.second_receiver.received_texts[-1] == "5")
        await wait_until(lambda: network.sender.lost == ["lost", "too"])
        assert (len(network.first_receiver.received_texts), len(network.second_receiver.received_texts)) == (4, 2), (
            "what was taken is not sent again"
        )

    run_scenario(scenario)


def test_one_that_cannot_be_sent_does_not_spoil_the_others() -> None:
    async def scenario(network: Network) -> None:
        network.sender.patience = 0.5
        await network.send_all(("/one", "hello"))
        await network.sender_host.delivered(5)
        await network.send_all(("/one", "1"), ("/one", "\x00"), ("/two", "2"))
        await wait_until(
            lambda: network.first_receiver.received_texts == ["hello", "1"] and network.second_receiver.received_texts == ["2"]
        )
        await wait_until(lambda: network.sender.lost == ["\x00"])

    run_scenario(scenario)


def test_a_batch_whose_answer_is_lost_is_sent_again() -> None:
    async def scenario(network: Network) -> None:
        await network.send_all(("/one", "hello"))
        await network.sender_host.delivered(5)
        network.relay.cuts = 1
        await network.send_all(("/one", "1"), ("/two", "2"), ("/one", "3"))
        await wait_until(lambda: network.first_receiver.received_texts == ["hello", "1", "3", "1", "3"])
        await network.sender_host.delivered(5)
        assert network.second_receiver.received_texts == ["2", "2"], "who hears something twice knows it by its id"
        assert not network.sender.lost

    run_scenario(scenario)


def test_large_messages_go_together_as_far_as_one_may_be_large() -> None:
    async def scenario(network: Network) -> None:
        await network.send_all(("/one", "hello"))
        await network.sender_host.delivered(5)
        large = [letter * 100_000 for letter in "abcde"]
        await network.send_all(*(("/one", text) for text in large))
        await wait_until(lambda: network.first_receiver.received_texts[1:] == large)
        assert network.relay.kinds[1:] == [MEDIA_TYPE, MEDIA_TYPE, soap.MEDIA_TYPE]

    run_scenario(scenario)


def test_who_waits_for_an_answer_on_the_connection_does_not_wait_for_others() -> None:
    async def scenario(network: Network) -> None:
        await network.send_all(("/one", "hello"))
        await network.sender_host.delivered(5)
        await network.send_all(*(text_message(number, f"{network.url}/one", reply_to=ANONYMOUS) for number in NUMBERS[:3]))
        await wait_until(lambda: len(network.relay.kinds) == 2)
        await network.send_all(("/two", "1"), ("/two", "2"))
        await wait_until(lambda: network.second_receiver.received_texts == ["1", "2"])
        assert network.relay.batches == 1

    run_scenario(scenario)


@pytest.mark.parametrize(
    ("batch", "status"),
    [
        (b"\xc1", 400),
        (msgspec.msgpack.encode("text"), 400),
        (msgspec.msgpack.encode([b""] * (MAX_BATCH_SIZE + 1)), 400),
        (b"\x00" * (MOST_BYTES + 1), 413),
    ],
    ids=["no msgpack", "no array", "too many", "too large"],
)
def test_what_is_no_batch_is_not_taken(batch: bytes, status: int) -> None:
    async def scenario(network: Network) -> None:
        async with (
            aiohttp.ClientSession() as session,
            session.post(f"{network.receiver_host.url}/one", data=batch, headers={"Content-Type": MEDIA_TYPE}) as answer,
        ):
            assert answer.status == status
        assert not network.first_receiver.received_texts

    run_scenario(scenario)


def test_each_message_of_a_batch_has_its_own_answer() -> None:
    async def scenario(network: Network) -> None:
        documents = [
            soap.encode(text_message("good", f"{network.receiver_host.url}/one")),
            b"no XML",
            soap.encode(text_message("lost", f"{network.receiver_host.url}/gone")),
        ]
        async with (
            aiohttp.ClientSession() as session,
            session.post(f"{network.receiver_host.url}/two", data=batches.batch(documents), headers={"Content-Type": MEDIA_TYPE}) as answer,
        ):
            outcomes = batches.outcomes_of(await answer.read())
        assert [status for status, _ in outcomes] == [202, 400, 404]
        assert b"this is not well-formed XML" in outcomes[1][1]
        assert network.first_receiver.received_texts == ["good"]

    run_scenario(scenario)


def test_a_batch_is_acknowledged_when_all_of_it_is_on_disk(tmp_path: Path) -> None:
    async def scenario(network: Network) -> None:
        journal, receiver = Journal(tmp_path / "ear.sqlite", RECEIVER), Receiver()
        network.receiver_host.add_journaled("/keeping", lambda address: receiver, journal)
        await network.send_all(("/keeping", "hello"))
        await network.sender_host.delivered(5)
        brake = Brake(journal.disk)
        await network.send_all(("/keeping", "1"), ("/keeping", "2"))
        await wait_until(lambda: receiver.received_texts == ["hello", "1", "2"])
        await network.sender_host.delivered(0.2)
        assert network.relay.kinds[1:] == [MEDIA_TYPE]
        stored_number = journal.disk.read(lambda db: db.execute("SELECT max(last) FROM entries").fetchone())
        delivered = asyncio.create_task(network.sender_host.delivered(30))
        await asyncio.sleep(0.1)
        assert not delivered.done(), "it is not on disk"
        brake.release()
        await delivered
        assert await asyncio.wrap_future(stored_number) == (4,), "that it started, and what it heard"
        assert receiver.received_texts == ["hello", "1", "2"], "it was acknowledged, and not sent again"
        journal.close()

    run_scenario(scenario)


def test_a_component_that_can_keep_nothing_more_does_not_stop_its_neighbours(tmp_path: Path) -> None:
    async def scenario(network: Network) -> None:
        network.sender.patience = 0.5
        journal = Journal(tmp_path / "ear.sqlite", RECEIVER)
        network.receiver_host.add_journaled("/full", lambda address: Receiver(), journal)
        journal.disk.write(lambda db: db.execute("INSERT INTO nowhere VALUES (1)"))
        await network.send_all(("/one", "hello"))
        await network.sender_host.delivered(5)
        await network.send_all(("/full", "lost"), ("/one", "1"), ("/full", "too"), ("/two", "2"))
        await wait_until(
            lambda: network.first_receiver.received_texts == ["hello", "1"] and network.second_receiver.received_texts == ["2"]
        )
        await wait_until(lambda: network.sender.lost == ["lost", "too"])
        journal.close()

    run_scenario(scenario)
