"""Messages that were recorded and are sent again, on the bus of a whole system: by who has sent them, and by others."""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import nats
from nats.aio.client import Client as Connection
from nats.aio.msg import Msg

from somrs.cli.import_commands import import_sources
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.deployment.system import OWN_BUS, System
from somrs.protocol.messages.directory import Discover, Discovered
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Fault, Outcome
from somrs.protocol.messages.records import ReadRecords
from somrs.protocol.messages.rights import DENIED
from somrs.protocol.messages.submission import Submit
from somrs.runtime import batches
from somrs.runtime.bus_address import token_of
from somrs.runtime.bus_format import decode
from somrs.trust.credentials import FOLDER, Credentials
from tests.support import warm
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT

PARCELS = ROOT / "examples" / "parcels"
GOAL = "letter lies harbour AND crate lies mill"
NEXT_GOAL = "letter lies mill"


@dataclass(frozen=True, slots=True)
class Recorded:
    """A request as it was on the bus."""

    subject: str
    payload: bytes

    @property
    def sender(self) -> str:
        return self.subject.split(".")[2]

    def of(self, sender: str) -> str:
        """The subject of the same request from another sender."""
        tokens = self.subject.split(".")
        return ".".join((*tokens[:2], token_of(sender), *tokens[3:]))

    @property
    def messages(self) -> list[Message]:
        return [decode(document) for document in batches.documents_of(self.payload)]


async def connected(addresses: Addresses, credentials: Credentials) -> Connection:
    assert addresses.bus is not None
    return await nats.connect(
        addresses.bus.servers, tls=credentials.client, tls_handshake_first=True, inbox_prefix=f"_INBOX.{credentials.name}"
    )


class Replayer:
    """Sends recorded requests again, over a connection with the certificate of `credentials`."""

    def __init__(self, connection: Connection, credentials: Credentials) -> None:
        self._connection, self._token = connection, token_of(credentials.name)
        self._answers: dict[str, asyncio.Future[bytes]] = {}

    async def start(self) -> None:
        await self._connection.subscribe(f"somrs-from.*.*.answers.{self._token}.>", cb=self._receive)

    async def _receive(self, answer: Msg) -> None:
        self._answers[answer.subject.rpartition(".")[2]].set_result(answer.data)

    async def send(self, subject: str, payload: bytes) -> list[tuple[int, bytes]]:
        """The outcomes of a batch."""
        number = str(len(self._answers))
        answer = self._answers[number] = asyncio.get_running_loop().create_future()
        await self._connection.publish(subject, payload, reply=f"_INBOX.{self._token}.replay.{number}")
        return batches.outcomes_of(await answer)


async def state_of(client: Client) -> tuple[object, ...]:
    """What the system knows and has done. Any change of the map has another version."""
    services = await client.ask(client.addresses.registry, Discover(), Discovered)
    records = (await client.records(ReadRecords(brief=True))).records
    return (
        (await client.query(GOAL)).version,
        sorted(str(fact) for fact in (await client.map()).facts()),
        sorted(offer.service for offer in services.offers),
        [(record.task, record.submitted_at) for record in records],
        [view.task for view in await client.tasks()],
    )


def has_effect(message: Message) -> bool:
    """Whether it does more than to read."""
    return not type(message.body).__name__.startswith(("Read", "Watch", "Query", "Discover", "Subscribe", "Consider"))


async def record(connection: Connection, client: Client) -> list[Recorded]:
    """All requests on the bus while a task is done."""
    requests: list[Recorded] = []

    async def keep(request: Msg) -> None:
        if ".answers." not in request.subject:
            requests.append(Recorded(request.subject, request.data))

    subscription = await connection.subscribe("somrs-from.>", cb=keep)
    await accomplish(client, GOAL)
    await connection.flush()
    await subscription.unsubscribe()
    return [request for request in requests if all(map(has_effect, request.messages))]


async def accomplish(client: Client, effect: str) -> None:
    task = await client.submit(Submit(effect=effect))
    views = [news.view async for news in client.news(task)]
    assert views[-1].outcome is Outcome.ACCOMPLISHED, views[-1].explanation


def test_what_was_recorded_has_no_effect_when_it_is_sent_again(tmp_path: Path) -> None:
    async def run() -> None:
        data = tmp_path / "run"
        data.mkdir()
        files = import_sources([PARCELS / "domain.pddl", PARCELS / "problem.pddl"], data)
        async with (
            System(files, data, speed="20", launcher=warm.launcher(), bus=OWN_BUS) as system,
            Client(system.addresses) as client,
        ):
            programs = data / FOLDER / "programs"
            all_rights = Credentials(programs / "bus.pem")
            connection = await connected(system.addresses, all_rights)
            requests = await record(connection, client)
            kinds = Counter(type(message.body).__name__ for request in requests for message in request.messages)
            assert {"Submit", "Arrange", "Accept", "Execute", "Completed", "Reserve", "UpdateMap"} <= {*kinds}, kinds
            earlier_state = await state_of(client)

            replayer = Replayer(connection, all_rights)
            await replayer.start()
            for request in requests:  # as their senders would send them
                await replayer.send(request.subject, request.payload)
            assert await state_of(client) == earlier_state

            for name in ("van1", "scheduler", "client"):
                credentials = Credentials(programs / f"{name}.pem")
                stranger = await connected(system.addresses, credentials)
                replayer = Replayer(stranger, credentials)
                await replayer.start()
                for request in requests:
                    if request.sender == name:
                        continue
                    outcomes = await replayer.send(request.of(name), request.payload)
                    for message, (_, document) in zip(request.messages, outcomes, strict=True):
                        answer = decode(document).body if document else None
                        is_denied = isinstance(answer, Fault) and answer.code == DENIED
                        # The Scheduler and clients may submit: the task is the one that was submitted.
                        assert is_denied or type(message.body).__name__ == "Submit", (name, message, answer)
                await stranger.close()
            assert await state_of(client) == earlier_state

            await accomplish(client, NEXT_GOAL)
            assert len((await client.records(ReadRecords(brief=True))).records) == 2
            await connection.close()

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))
