"""A broker that loses a retained message at the moment of a subscription, as NATS does when it retains it a little later than it passes it
on: the thing's state is had nevertheless."""

from __future__ import annotations

import asyncio

import pytest

from somrs.adapters.things import mqtt
from somrs.adapters.things.model import Connection, Source
from somrs.adapters.things.mqtt import MqttConnector
from somrs.adapters.things.state import Payload, SourceKey
from tests.support.cable import Cable
from tests.support.hang import HANG_TIME


class LosingBroker:
    """A broker that retains one message at each topic, and sends it with a subscription only from the one with this number on."""

    def __init__(self, first_kept: int) -> None:
        self._first_kept, self.subscriptions = first_kept, 0

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while not reader.at_eof():
            head = await reader.read(2)
            body = await reader.readexactly(head[1]) if len(head) == 2 else b""
            match head[0] >> 4 if head else 0:
                case 1:  # CONNECT (3.1.1, 2.2.1)
                    writer.write(b"\x20\x02\x00\x00")
                case 8:  # SUBSCRIBE
                    writer.write(b"\x90\x03" + body[:2] + b"\x00")
                    self.subscriptions += 1
                    if self.subscriptions >= self._first_kept:
                        message = body[2:-1] + b"online"
                        writer.write(bytes([0x31, len(message)]) + message)


class Ear:
    """Hears what a connector receives."""

    def __init__(self) -> None:
        self.heard: asyncio.Future[tuple[SourceKey, Payload]] = asyncio.get_running_loop().create_future()

    def received(self, key: SourceKey, payload: Payload) -> None:
        if not self.heard.done():
            self.heard.set_result((key, payload))

    def unreadable(self, key: SourceKey, problem: str) -> None:
        raise AssertionError("a broker refuses no reading")

    def reached(self, connection: str, is_reached: bool) -> None:
        pass


@pytest.mark.parametrize("first_kept", [1, 2, 3])
def test_what_a_broker_has_lost_comes_with_a_later_subscription(monkeypatch: pytest.MonkeyPatch, first_kept: int) -> None:
    monkeypatch.setattr(mqtt, "RENEWALS", (0.05, 0.05))

    async def play() -> None:
        broker = LosingBroker(first_kept)
        server = await asyncio.start_server(broker.serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        connector = MqttConnector(Connection(name="house", scheme="mqtt", host="127.0.0.1", port=port), ear := Ear())
        connector.follow(Source(connection="house", place="lamps/1/status"))
        running = asyncio.create_task(connector.run())
        assert await ear.heard == (("house", "lamps/1/status", None), b"online")
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        server.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_the_next_server_of_a_broker_is_used_when_one_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt, "FIRST_PAUSE", 0.05)

    async def play() -> None:
        silent, talking = LosingBroker(first_kept=1000), LosingBroker(first_kept=1)
        async with (
            await asyncio.start_server(silent.serve, "127.0.0.1", 0) as first,
            await asyncio.start_server(talking.serve, "127.0.0.1", 0) as last,
        ):
            servers = [server.sockets[0].getsockname() for server in (first, last)]
            async with Cable(servers[0][1]) as port:
                house = Connection(name="house", scheme="mqtt", host="127.0.0.1", port=port, further_servers=(servers[1],))
                connector = MqttConnector(house, ear := Ear())
                connector.follow(Source(connection="house", place="lamps/1/status"))
                running = asyncio.create_task(connector.run())
                while not silent.subscriptions:
                    await asyncio.sleep(0.01)
                assert not ear.heard.done()
            assert await ear.heard == (("house", "lamps/1/status", None), b"online")
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))
