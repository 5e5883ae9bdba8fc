"""What components store on a bus with certificates: each reaches its own streams only, at a real NATS server."""

from __future__ import annotations

import asyncio
import itertools
import json
from pathlib import Path

import pytest
from nats.aio.client import Client
from nats.aio.msg import Msg
from nats.js.api import StreamConfig

from somrs.deployment.bus import addresses_on, list_site
from somrs.storage.lease import RENEWAL
from somrs.storage.stored_copy import CopyInfo
from somrs.storage.stores import Stores
from somrs.storage.stream_log import StreamLog
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Role
from tests.support.hang import HANG_TIME
from tests.support.secure_bus import SecureBus, secure_bus

STORING = {
    "repository": Role.REPOSITORY,
    "registry": Role.REGISTRY,
    "registry-2": Role.REGISTRY,
    "task-manager": Role.TASK_MANAGER,
    "task-manager-2": Role.TASK_MANAGER,
    "scheduler": Role.SCHEDULER,
}
OTHERS = {"Robot1": Role.DEVICE, "viewer": Role.VIEWER, "api": Role.API, "traffic": Role.TRAFFIC, "gateway": Role.GATEWAY}


async def store(bus: SecureBus, component: str, credentials: Credentials, file: Path) -> None:
    """Lead a component, with an entry and a copy."""
    log = StreamLog(bus.address.servers, "yard", component, component, credentials)
    await log.open()
    assert await log.acquire()
    assert await log.begin_writing(0)
    await log.append(1, 1, component.encode())
    await log.store_copy(file, CopyInfo(number=1, address=f"{bus.address.gateway}/{component}"))
    await log.close()


async def state(client: Client, stores: Stores) -> list[object]:
    """What JetStream has of a component."""
    js = client.jetstream()
    infos = [await js.stream_info(stream) for stream in (stores.journal, stores.copies)]
    return [(info.config.subjects, info.config.republish, info.state.first_seq, info.state.last_seq, info.state.messages) for info in infos]


def requests(stores: Stores) -> list[str]:
    """What would read, change or delete what a component has stored."""
    streams = [f"{request}.{stream}" for stream in (stores.journal, stores.copies) for request in ("INFO", "MSG.GET", "PURGE", "DELETE")]
    streams += [f"{request}.{stream}" for stream in (stores.journal, stores.copies) for request in ("UPDATE", "CREATE", "MSG.DELETE")]
    return [
        *(f"$JS.API.STREAM.{request}" for request in streams),
        f"$JS.API.CONSUMER.CREATE.{stores.journal}",
        f"$JS.API.CONSUMER.CREATE.{stores.copies}.mine.{stores.copies_subject}.>",
        f"$JS.API.DIRECT.GET.{stores.copies}.{stores.copies_subject}.info",
        stores.journal_subject,
        f"{stores.copies_subject}.info",
        f"{stores.copies_subject}.chunks.1",
        f"$KV.somrs-leaders.{stores.key}",
        f"somrs-stores.{stores.key}",
        "$JS.API.DIRECT.GET.KV_somrs-sites.$KV.somrs-sites.yard",
        "$JS.API.CONSUMER.CREATE.KV_somrs-sites",
    ]


def test_each_component_reaches_its_own_streams_only(tmp_path: Path) -> None:
    async def play() -> None:
        async with secure_bus(tmp_path) as bus:
            await list_site(addresses_on(bus.address), bus.enrolled("gateway", Role.GATEWAY))
            credentials = {name: bus.enrolled(name, role) for name, role in (STORING | OTHERS).items()}
            file = tmp_path / "file"
            file.write_bytes(b"a copy")
            for name in STORING:
                await store(bus, name, credentials[name], file)
            second = bus.enrolled("bus-2", Role.BUS)
            await bus.known(second)
            observer = await bus.connected(second, [])
            states = {name: await state(observer, Stores("yard", name)) for name in STORING}
            for name, component in itertools.product(credentials, STORING):
                if name != component:
                    await assert_denied(bus, credentials[name], requests(Stores("yard", component)))
            assert {name: await state(observer, Stores("yard", name)) for name in STORING} == states
            await observer.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


async def assert_denied(bus: SecureBus, credentials: Credentials, subjects: list[str], payload: bytes = b"") -> None:
    """The servers deny to publish to each of the subjects."""
    problems: list[str] = []
    client = await bus.connected(credentials, problems)
    for subject in subjects:
        await client.publish(subject, payload, reply=f"_INBOX.{credentials.name}.1")
    for _ in range(100):  # errors are told in a task of their own
        await client.flush()
    missing = [subject for subject in subjects if not any(f'"{subject.lower()}"' in problem.lower() for problem in problems)]
    await client.close()
    assert missing == [], f"{credentials.name} may"


@pytest.mark.parametrize("name", ["registry", "gateway", "viewer"])
def test_nobody_but_the_servers_makes_streams_that_would_speak_for_others(tmp_path: Path, name: str) -> None:
    """A stream could publish what it stores anew, on any subject."""

    async def play() -> None:
        async with secure_bus(tmp_path) as bus:
            await list_site(addresses_on(bus.address), bus.enrolled("gateway", Role.GATEWAY))
            credentials = bus.enrolled(name, (STORING | OTHERS)[name])
            await bus.known(credentials)
            forged = json.dumps(StreamConfig(name="mine").as_dict()).encode()
            streams = ("mine", "somrs-journal-yard-registry", "somrs-copy-yard-registry", "KV_somrs-sites", "KV_somrs-leaders")
            await assert_denied(bus, credentials, [f"$JS.API.STREAM.CREATE.{stream}" for stream in streams], forged)

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_answers_of_jetstream_in_the_place_of_entries_replace_nobody(tmp_path: Path) -> None:
    """JetStream answers where a request says, and permissions do not see it: in a journal, or in a lease."""

    async def play() -> None:
        async with secure_bus(tmp_path) as bus:
            await list_site(addresses_on(bus.address), bus.enrolled("gateway", Role.GATEWAY))
            registry, manager = bus.enrolled("registry", Role.REGISTRY), bus.enrolled("task-manager", Role.TASK_MANAGER)
            registry_stores, manager_stores = Stores("yard", "registry"), Stores("yard", "task-manager")
            leader, standby = (StreamLog(bus.address.servers, "yard", "task-manager", name, manager) for name in ("first", "second"))
            log = StreamLog(bus.address.servers, "yard", "registry", "registry", registry)
            for stream in (log, leader, standby):
                await stream.open()
            assert await leader.acquire()
            assert await leader.begin_writing(0)
            await leader.append(1, 1, b"one")
            client = await bus.connected(registry, [])
            for subject in (manager_stores.journal_subject, f"$KV.somrs-leaders.{manager_stores.key}"):
                await client.publish(f"$JS.API.STREAM.INFO.{registry_stores.journal}", b"", reply=subject)
            while (await leader.bounds())[1] < 3:
                await asyncio.sleep(0.02)
            assert await standby.last_number() == 1
            await leader.append(2, 1, b"two")
            assert [batch and batch.document for batch in [await standby.batch(place) for place in (2, 3, 4)]] == [b"one", b"", b"two"]
            assert (await standby.last_number(), await standby.place_after(1)) == (2, 4)
            await asyncio.sleep(2 * RENEWAL)
            assert leader.lease.is_held
            assert not await standby.acquire()
            for stream in (log, leader, standby):
                await stream.close()
            await client.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))


def test_who_answers_itself_speaks_for_nobody(tmp_path: Path) -> None:
    """A program may ask components how they are, and be one that answers; the question says where."""

    async def play() -> None:
        async with secure_bus(tmp_path) as bus:
            registry, problems, answered = bus.enrolled("registry", Role.REGISTRY), list[str](), asyncio.Event()
            await bus.known(registry)
            client = await bus.connected(registry, problems)

            async def answer(question: Msg) -> None:
                await question.respond(b"forged")
                answered.set()

            await client.subscribe("somrs-status.yard", cb=answer)
            await client.publish("somrs-status.yard", b"", reply="somrs-from.yard.gateway.repository")
            await answered.wait()
            while not any('"somrs-from.yard.gateway.repository"' in problem for problem in problems):
                await client.flush()
            await client.close()

    asyncio.run(asyncio.wait_for(play(), HANG_TIME))
