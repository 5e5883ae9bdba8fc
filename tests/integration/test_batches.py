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
from somrs.protocol.messages.clients import CancelTask
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES
from somrs.runtime import batches
from somrs.runtime.batches import MAX_BATCH_SIZE, MEDIA_TYPE
from somrs.runtime.host import Host
from somrs.storage.journal import Journal
from tests.integration.test_node_durability import Brake, in_time, until


def said(text: str, to: str, number: int = 0, reply_to: str = "http://nobody") -> Message:
    return Message(
        header=Header(sender="http://nobody", recipient=to, message_id=message_id(text, to, number), reply_to=reply_to),
        body=CancelTask(task=text),
    )


class EarState(Struct):
    heard: list[str] = []


class Ear:
    """Notes what it hears."""

    def __init__(self, state: EarState | None = None) -> None:
        self.state = state or EarState()

    @property
    def heard(self) -> list[str]:
        return self.state.heard

    @property
    def open(self) -> list[str]:
        return []

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received) and isinstance(event.message.body, CancelTask):
            self.heard.append(event.message.body.task)
        return []


EAR = Schema(component="ear", version=1, state=EarState, timers=None, questions=None, tasks=None, answers=None, restore=Ear)


class Mouth:
    """Says what it is rung with, in order; `lost` is what did not get through."""

    def __init__(self) -> None:
        self.lost: list[str] = []
        self.letters: dict[str, list[Message]] = {}
        self.patience = 60.0

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case TimerFired(timer):
                return [Send(message, expires_at=now + self.patience) for message in self.letters[str(timer)]]
            case DeliveryFailed(message, _) if isinstance(message.body, CancelTask):
                self.lost.append(message.body.task)
        return []


class Relay:
    """Passes requests on, notes of which kind they are, and can stand for what else may be on the way, or in place of the other."""

    def __init__(self, to: str) -> None:
        self.to = to
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
        async with self._session.post(self.to + request.path, data=await request.read(), headers={"Content-Type": kind}) as answer:
            document = await answer.read()
            if self.cuts:
                self.cuts -= 1
                assert request.transport is not None
                request.transport.abort()
            headers = {name: answer.headers[name] for name in ("Content-Type", "Accept-Post") if name in answer.headers}
            if self.foreign:
                headers.pop("Accept-Post", None)
            return web.Response(status=answer.status, body=document, headers=headers)


class Stage:
    """A node that speaks, two that hear, in another process as far as it knows, and the relay between them."""

    def __init__(self) -> None:
        self.mouth, self.one, self.two = Mouth(), Ear(), Ear()
        self.here, self.there = Host(), Host()

    async def say(self, *letters: tuple[str, str] | Message) -> None:
        """Say all of it at once: texts to paths, or whole messages."""
        name = str(len(self.mouth.letters))
        self.mouth.letters[name] = [
            one if isinstance(one, Message) else said(one[1], f"{self.url}{one[0]}", number) for number, one in enumerate(letters)
        ]
        self.node.feed(TimerFired(name))

    async def __aenter__(self) -> Stage:
        await self.here.start()
        await self.there.start()
        self.there.add("/one", lambda address: self.one)
        self.there.add("/two", lambda address: self.two)
        self.node = self.here.add("/mouth", lambda address: self.mouth)
        self.relay = Relay(self.there.url)
        self.url = await self.relay.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.here.stop()
        await self.relay.stop()
        await self.there.stop()


def staged(scenario: Callable[[Stage], Awaitable[None]]) -> None:
    async def run() -> None:
        async with Stage() as stage:
            await scenario(stage)

    in_time(run)


NUMBERS = [str(number) for number in range(100)]


def test_what_is_due_goes_together_once_the_other_said_that_it_takes_that() -> None:
    async def scenario(stage: Stage) -> None:
        await stage.say(("/one", "hello"))
        await until(lambda: stage.one.heard == ["hello"])
        assert not stage.relay.batches, "nobody has said anything yet"
        await stage.here.delivered(5)
        await stage.say(*(("/one" if int(number) % 2 else "/two", number) for number in NUMBERS))
        await until(lambda: len(stage.one.heard) + len(stage.two.heard) == 101)
        assert stage.one.heard[1:] == NUMBERS[1::2]
        assert stage.two.heard == NUMBERS[::2]
        assert len(stage.relay.kinds) == 3, f"one, and then {MAX_BATCH_SIZE} and the rest"

    staged(scenario)


def test_other_stacks_never_see_a_batch() -> None:
    async def scenario(stage: Stage) -> None:
        stage.relay.foreign = True
        for _ in range(2):
            await stage.say(*(("/one", number) for number in NUMBERS[:10]))
            await stage.here.delivered(5)
        assert stage.one.heard == 2 * NUMBERS[:10]
        assert set(stage.relay.kinds) == {soap.MEDIA_TYPE}

    staged(scenario)


def test_another_stack_that_takes_the_place_of_a_node_gets_everything_alone() -> None:
    async def scenario(stage: Stage) -> None:
        await stage.say(("/one", "hello"))
        await stage.here.delivered(5)
        stage.relay.foreign = True
        await stage.say(*(("/one", number) for number in NUMBERS[:10]))
        await until(lambda: len(stage.one.heard) == 11)
        assert stage.one.heard[1:] == NUMBERS[:10]
        assert stage.relay.batches == 1

    staged(scenario)


def test_one_that_nobody_takes_does_not_hold_up_the_others() -> None:
    async def scenario(stage: Stage) -> None:
        stage.mouth.patience = 0.5
        await stage.say(("/one", "hello"))
        await stage.here.delivered(5)
        await stage.say(("/one", "1"), ("/gone", "lost"), ("/one", "2"), ("/gone", "too"), ("/two", "3"))
        await until(lambda: stage.one.heard == ["hello", "1", "2"] and stage.two.heard == ["3"])
        assert not stage.mouth.lost, "there was time yet"
        await stage.say(("/one", "4"), ("/two", "5"))
        await until(lambda: stage.one.heard[-1] == "4" and stage.two.heard[-1] == "5")
        await until(lambda: stage.mouth.lost == ["lost", "too"])
        assert (len(stage.one.heard), len(stage.two.heard)) == (4, 2), "what was taken is not sent again"

    staged(scenario)


def test_one_that_cannot_be_sent_does_not_spoil_the_others() -> None:
    async def scenario(stage: Stage) -> None:
        stage.mouth.patience = 0.5
        await stage.say(("/one", "hello"))
        await stage.here.delivered(5)
        await stage.say(("/one", "1"), ("/one", "\x00"), ("/two", "2"))
        await until(lambda: stage.one.heard == ["hello", "1"] and stage.two.heard == ["2"])
        await until(lambda: stage.mouth.lost == ["\x00"])

    staged(scenario)


def test_a_batch_whose_answer_is_lost_is_sent_again() -> None:
    async def scenario(stage: Stage) -> None:
        await stage.say(("/one", "hello"))
        await stage.here.delivered(5)
        stage.relay.cuts = 1
        await stage.say(("/one", "1"), ("/two", "2"), ("/one", "3"))
        await until(lambda: stage.one.heard == ["hello", "1", "3", "1", "3"])
        await stage.here.delivered(5)
        assert stage.two.heard == ["2", "2"], "who hears something twice knows it by its id"
        assert not stage.mouth.lost

    staged(scenario)


def test_large_messages_go_together_as_far_as_one_may_be_large() -> None:
    async def scenario(stage: Stage) -> None:
        await stage.say(("/one", "hello"))
        await stage.here.delivered(5)
        large = [letter * 100_000 for letter in "abcde"]
        await stage.say(*(("/one", text) for text in large))
        await until(lambda: stage.one.heard[1:] == large)
        assert stage.relay.kinds[1:] == [MEDIA_TYPE, MEDIA_TYPE, soap.MEDIA_TYPE]

    staged(scenario)


def test_who_waits_for_an_answer_on_the_connection_does_not_wait_for_others() -> None:
    async def scenario(stage: Stage) -> None:
        await stage.say(("/one", "hello"))
        await stage.here.delivered(5)
        await stage.say(*(said(number, f"{stage.url}/one", reply_to=ANONYMOUS) for number in NUMBERS[:3]))
        await until(lambda: len(stage.relay.kinds) == 2)
        await stage.say(("/two", "1"), ("/two", "2"))
        await until(lambda: stage.two.heard == ["1", "2"])
        assert stage.relay.batches == 1

    staged(scenario)


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
    async def scenario(stage: Stage) -> None:
        async with (
            aiohttp.ClientSession() as session,
            session.post(f"{stage.there.url}/one", data=batch, headers={"Content-Type": MEDIA_TYPE}) as answer,
        ):
            assert answer.status == status
        assert not stage.one.heard

    staged(scenario)


def test_each_message_of_a_batch_has_its_own_answer() -> None:
    async def scenario(stage: Stage) -> None:
        documents = [soap.encode(said("good", f"{stage.there.url}/one")), b"no XML", soap.encode(said("lost", f"{stage.there.url}/gone"))]
        async with (
            aiohttp.ClientSession() as session,
            session.post(f"{stage.there.url}/two", data=batches.batch(documents), headers={"Content-Type": MEDIA_TYPE}) as answer,
        ):
            outcomes = batches.outcomes_of(await answer.read())
        assert [status for status, _ in outcomes] == [202, 400, 404]
        assert b"this is no XML" in outcomes[1][1]
        assert stage.one.heard == ["good"]

    staged(scenario)


def test_a_batch_is_acknowledged_when_all_of_it_is_on_disk(tmp_path: Path) -> None:
    async def scenario(stage: Stage) -> None:
        journal, ear = Journal(tmp_path / "ear.sqlite", EAR), Ear()
        stage.there.add_journaled("/keeping", lambda address: ear, journal)
        await stage.say(("/keeping", "hello"))
        await stage.here.delivered(5)
        brake = Brake(journal.disk)
        await stage.say(("/keeping", "1"), ("/keeping", "2"))
        await until(lambda: ear.heard == ["hello", "1", "2"])
        await stage.here.delivered(0.2)
        assert stage.relay.kinds[1:] == [MEDIA_TYPE]
        kept = journal.disk.read(lambda db: db.execute("SELECT max(last) FROM entries").fetchone())
        delivered = asyncio.create_task(stage.here.delivered(30))
        await asyncio.sleep(0.1)
        assert not delivered.done(), "it is not on disk"
        brake.release()
        await delivered
        assert await asyncio.wrap_future(kept) == (4,), "that it started, and what it heard"
        assert ear.heard == ["hello", "1", "2"], "it was acknowledged, and not sent again"
        journal.close()

    staged(scenario)


def test_a_component_that_can_keep_nothing_more_does_not_stop_its_neighbours(tmp_path: Path) -> None:
    async def scenario(stage: Stage) -> None:
        stage.mouth.patience = 0.5
        journal = Journal(tmp_path / "ear.sqlite", EAR)
        stage.there.add_journaled("/full", lambda address: Ear(), journal)
        journal.disk.write(lambda db: db.execute("INSERT INTO nowhere VALUES (1)"))
        await stage.say(("/one", "hello"))
        await stage.here.delivered(5)
        await stage.say(("/full", "lost"), ("/one", "1"), ("/full", "too"), ("/two", "2"))
        await until(lambda: stage.one.heard == ["hello", "1"] and stage.two.heard == ["2"])
        await until(lambda: stage.mouth.lost == ["lost", "too"])
        journal.close()

    staged(scenario)
