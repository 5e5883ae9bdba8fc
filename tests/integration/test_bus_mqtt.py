"""MQTT at a bus with certificates: who may use which topics, with a real NATS server."""

from __future__ import annotations

import asyncio
import contextlib
import ssl
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from pathlib import Path

import aiomqtt
import pytest
from nats.aio.msg import Msg

from somrs.errors import UsageError
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role
from tests.support.hang import HANG_TIME
from tests.support.secure_bus import SecureBus, secure_bus

TOPICS = "uagv/v2/ACME.1/0001/#"  # with a point, which is no separator in topics
VEHICLE = Identity(name="Forklift1", roles=frozenset({Role.THING}), topics=frozenset({TOPICS}))
OTHER_VEHICLE = Identity(name="Forklift2", roles=frozenset({Role.THING}), topics=frozenset({"uagv/v2/ACME/0002/#"}))
ADAPTER = Identity(name="vda5050", roles=frozenset({Role.DEVICE}), topics=frozenset({"#"}))


def credentials_of(bus: SecureBus, identity: Identity) -> Credentials:
    return Credentials(bus.authority.issue_program(identity, ("127.0.0.1",), datetime.now(UTC))[0])


@contextlib.asynccontextmanager
async def client(bus: SecureBus, identity: Identity) -> AsyncIterator[aiomqtt.Client]:
    """A client of MQTT with the certificate of an identity, as soon as the servers know that."""
    host, _, port = bus.mqtt.rpartition(":")
    credentials = credentials_of(bus, identity)
    while True:
        try:
            async with contextlib.AsyncExitStack() as stack:
                connected = await stack.enter_async_context(aiomqtt.Client(host, int(port), tls_context=credentials.client))
                leaving = stack.pop_all()
            break
        except aiomqtt.MqttError:
            await asyncio.sleep(0.05)
    async with leaving:
        yield connected


async def received(connection: aiomqtt.Client) -> tuple[str, bytes]:
    message = await anext(aiter(connection.messages))
    assert isinstance(message.payload, bytes)
    return message.topic.value, message.payload


async def is_refused(bus: SecureBus, context: ssl.SSLContext | None) -> bool:
    """Whether the server ends a connection without taking it."""
    host, _, port = bus.mqtt.rpartition(":")
    connect = b"\x10\x0d\x00\x04MQTT\x04\x02\x00\x3c\x00\x01a"
    reader, writer = await asyncio.open_connection(host, int(port), ssl=context)
    writer.write(connect)
    try:
        return await reader.read() in (b"", b"\x20\x02\x00\x05")  # not authorised (3.1.1, 3.2.2.3)
    except ConnectionError:
        return True
    finally:
        writer.close()


def test_a_vehicle_uses_its_topics_and_no_others_and_an_adapter_uses_all(tmp_path: Path) -> None:
    async def play() -> None:
        async with (
            secure_bus(tmp_path, mqtt=True) as bus,
            client(bus, ADAPTER) as adapter,
            client(bus, VEHICLE) as vehicle,
            client(bus, OTHER_VEHICLE) as stranger,
        ):
            await adapter.subscribe("#", qos=1)
            await vehicle.subscribe("uagv/v2/ACME.1/0001/order", qos=1)
            for filter in ("#", "uagv/v2/ACME.1/0001/#", "uagv/v2/ACME.1/0001/order", "$MQTT/#"):
                (code,) = await stranger.subscribe(filter)
                assert code.is_failure if hasattr(code, "is_failure") else code == 0x80, filter
            await stranger.publish("uagv/v2/ACME.1/0001/state", b"forged")
            await stranger.publish("uagv/v2/ACME.1/0001/order", b"forged", retain=True)
            await stranger.publish("uagv/v2/ACME/0002/state", b"true", qos=1)
            assert await received(adapter) == ("uagv/v2/ACME/0002/state", b"true")
            await vehicle.publish("uagv/v2/ACME.1/0001/state", b"here", qos=1, retain=True)
            assert await received(adapter) == ("uagv/v2/ACME.1/0001/state", b"here")
            await adapter.publish("uagv/v2/ACME.1/0001/order", b"go")
            assert await received(vehicle) == ("uagv/v2/ACME.1/0001/order", b"go")

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_topics_and_subjects_of_the_components_are_different_worlds(tmp_path: Path) -> None:
    async def play() -> None:
        async with secure_bus(tmp_path, mqtt=True) as bus, client(bus, ADAPTER) as adapter:
            server = await bus.connected(bus.enrolled("bus", Role.BUS), [])
            taken: list[str] = []

            async def take(message: Msg) -> None:
                taken.append(message.subject)

            await server.subscribe(">", cb=take)
            await server.flush()
            await adapter.subscribe("#")
            for topic in ("somrs-from/yard/Robot1/repository", "somrs-status/yard", "$JS/API/STREAM/DELETE/KV_somrs-sites"):
                await adapter.publish(topic, b"forged")
            await server.publish("somrs.of.components", b"")
            await server.publish("somrs-status.yard", b"")
            await adapter.publish("last", b"")
            assert [(await received(adapter))[0] for _ in range(3)] == ["somrs-from/yard/Robot1/repository", "somrs-status/yard", "last"]
            await server.flush()
            assert [subject for subject in taken if subject.startswith("somrs")] == ["somrs.of.components", "somrs-status.yard"]
            await server.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_nobody_speaks_mqtt_without_a_certificate_with_topics_that_holds(tmp_path: Path) -> None:
    async def play() -> None:
        async with secure_bus(tmp_path, mqtt=True) as bus:
            robot = bus.enrolled("Robot1", Role.DEVICE)
            await bus.known(robot)
            assert await asyncio.gather(*(is_refused(bus, context) for context in (None, robot.client))) == [True, True]
            async with client(bus, ADAPTER) as adapter:
                with contextlib.suppress(aiomqtt.MqttError):
                    async with client(bus, VEHICLE) as vehicle:
                        bus.authority.revoke("Forklift1", datetime.now(UTC))
                        await asyncio.wait([vehicle._disconnected])
                await adapter.subscribe("still")
                await adapter.publish("still", b"")
                assert await received(adapter) == ("still", b"")

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_a_thing_without_topics_is_not_invited(tmp_path: Path) -> None:
    bus = SecureBus(tmp_path)
    with pytest.raises(UsageError, match="Scale1 could do nothing: say which topics it uses"):
        bus.authority.invite(Identity(name="Scale1", roles=frozenset({Role.THING})), datetime.now(UTC))
