"""Messages on a bus to the components of one process go together, wherever their process is."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from pathlib import Path

import pytest
from nats.aio.msg import Msg

from somrs.kernel.component import DeliveryFailed, Effect, Input, Notified, Send
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.runtime.bus import Bus
from somrs.runtime.host import Host
from tests.support.hang import HANG_TIME
from tests.support.nats_server import NatsServer

NAMES = ("Robot1", "Robot2", "Robot3")
TEXTS = [f"message {number}" for number in range(200)]


class Announcer:
    """Tells all recipients what it is notified of. `failures`: what it could not tell."""

    def __init__(self, address: str, recipients: list[str]) -> None:
        self.address, self.recipients = address, recipients
        self.failures: list[Message] = []

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case Notified(str() as reason):
                return [Send(self._message(recipient, reason), now + HANG_TIME) for recipient in self.recipients]
            case DeliveryFailed(message=message):
                self.failures.append(message)
        return []

    def _message(self, recipient: str, reason: str) -> Message:
        header = Header(
            sender=self.address,
            recipient=recipient,
            message_id=message_id(recipient, reason),
            reply_to=self.address,
            transaction="t1",
            participant="R#s1",
        )
        return Message(header=header, body=frp.Stop(reason=reason))


class Listeners:
    """A process with a component of each name, which keeps the texts of what it is told in `reasons`."""

    def __init__(self, server: NatsServer, reasons: Mapping[str, list[str]]) -> None:
        self.bus, self._reasons = Bus(server.address), reasons
        self.hangs = False

    def begin(self) -> None:
        for name in NAMES:
            self.bus.parts[f"/devices/{name}"] = partial(self._receive, name)

    async def _receive(self, name: str, message: Message) -> None:
        if self.hangs:
            await asyncio.Event().wait()
        assert isinstance(message.body, frp.Stop)
        self._reasons[name].append(message.body.reason)

    async def end(self) -> None:
        await self.bus.stop()
        await self.bus.close()


class Yard:
    """Two processes for the listeners, which begin in the first one, and a third with the announcer. `requests`: to components alone."""

    def __init__(self, server: NatsServer) -> None:
        self.reasons: dict[str, list[str]] = {name: [] for name in NAMES}
        self.process, self.next_process = Listeners(server, self.reasons), Listeners(server, self.reasons)
        self.announcer = Announcer(f"{server.address.gateway}/announcer", [f"{server.address.gateway}/devices/{name}" for name in NAMES])
        self.requests: list[str] = []
        self._host, self._server = Host(bus=server.address), server

    async def start(self) -> None:
        await self._host.start()
        for process in (self.process, self.next_process):
            await process.bus.start()
        self.process.begin()
        await self.process.bus.listening()
        self._node = self._host.add("/announcer", lambda address: self.announcer)

        async def observe(request: Msg) -> None:
            self.requests.append(request.subject)

        client = self.next_process.bus.client
        await client.subscribe(self._server.address.subject("/devices/*").replace("%2A", "*"), cb=observe)
        for _ in range(2):  # the first ping may overtake the subscription
            await client.flush()
        self.tell(TEXTS[0])
        await self._node.flush(HANG_TIME)
        while len(self.requests) < len(NAMES):
            await asyncio.sleep(0.01)

    def tell(self, text: str) -> None:
        self._node.feed(Notified(text))

    async def until_told(self) -> None:
        while any(len({*reasons}) < len(TEXTS) for reasons in self.reasons.values()):
            await asyncio.sleep(0.01)

    async def stop(self) -> None:
        await self._host.stop()
        for process in (self.process, self.next_process):
            process.hangs = False
            await process.end()


def in_a_yard(folder: Path, scenario: Callable[[Yard], Awaitable[None]]) -> None:
    async def run() -> None:
        async with asyncio.timeout(HANG_TIME):
            yard = Yard(server)
            await yard.start()
            await scenario(yard)
            await yard.stop()

    with NatsServer(folder) as server:
        asyncio.run(run())


def test_messages_to_one_process_go_together_once_a_reply_has_named_it(tmp_path: Path) -> None:
    async def scenario(yard: Yard) -> None:
        yard.requests.clear()
        for text in TEXTS[1:]:
            yard.tell(text)
        await yard.until_told()
        assert yard.reasons == dict.fromkeys(NAMES, TEXTS)
        assert not yard.requests

    in_a_yard(tmp_path, scenario)


async def _end(yard: Yard) -> None:
    await yard.process.end()


async def _hang(yard: Yard) -> None:
    yard.process.hangs = True


async def _remove(yard: Yard) -> None:
    for name in NAMES:
        del yard.process.bus.parts[f"/devices/{name}"]


@pytest.mark.parametrize("leave", [_end, _hang, _remove])
def test_components_that_are_in_another_process_now_get_everything_in_order(
    tmp_path: Path, leave: Callable[[Yard], Awaitable[None]]
) -> None:
    async def scenario(yard: Yard) -> None:
        await leave(yard)
        for number, text in enumerate(TEXTS[1:]):
            yard.tell(text)
            if number == len(TEXTS) // 2:
                yard.next_process.begin()
            if number % 10 == 0:
                await asyncio.sleep(0.001)
        await yard.until_told()
        assert {name: list(dict.fromkeys(reasons)) for name, reasons in yard.reasons.items()} == dict.fromkeys(NAMES, TEXTS)
        assert not yard.announcer.failures

    in_a_yard(tmp_path, scenario)
