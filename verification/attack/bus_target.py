"""A system on a bus that is attacked, and the attackers: programs with a certificate of a low role, or anybody on a bus without any."""

from __future__ import annotations

import asyncio
import contextlib
import uuid
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

import nats
from nats.aio.client import Client as Connection
from nats.aio.msg import Msg

from somrs.client.client import Client
from somrs.deployment.system import OWN_BUS, System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.runtime.bus_address import BusAddress, token_of
from somrs.trust.authority import Authority
from somrs.trust.credentials import Credentials
from somrs.trust.identity import Identity, Role
from verification.attack.target import PATIENCE, Defect, Target, expect, memory_of

LOW_ROLES = {"Intruder1": Role.DEVICE, "Intruder2": Role.VIEWER, "Intruder3": Role.CLIENT}
GOALS = ("Jar002 isOn Platform001", "Jar002 isOn Table001")

INBOXES = "_INBOX."


class Attacker:
    """A program on the bus. `token`: its name in subjects; None if it has no certificate.

    Whoever may listen to everything hears everything: `overheard` has what came that its certificate does not permit.
    """

    def __init__(self, bus: BusAddress, name: str, token: str | None, connection: Connection) -> None:
        self.bus, self.name, self.token, self.connection = bus, name, token, connection
        self.overheard: list[str] = []
        self._inbox = f"{INBOXES}{name}.{uuid.uuid4().hex}"
        self._answers: dict[str, asyncio.Future[bytes]] = {}

    @classmethod
    async def connected(cls, bus: BusAddress, name: str, credentials: Credentials | None) -> Attacker:
        """Connect, as soon as the servers know the certificate."""
        options: dict[str, Any] = {"tls": credentials.client, "tls_handshake_first": True} if credentials is not None else {}
        connection = await nats.connect(bus.servers, error_cb=_ignore, max_reconnect_attempts=-1, reconnect_time_wait=0.05, **options)
        attacker = cls(bus, name, token_of(name) if credentials is not None else None, connection)
        await connection.subscribe(f"{attacker._inbox}.*", cb=attacker._take)
        if attacker.token is not None:
            await connection.subscribe(f"somrs-from.{bus.site}.*.answers.{attacker.token}.>", cb=attacker._take)
        return attacker

    def subject(self, path: str, sender: str | None = None) -> str:
        """The subject of a component's messages from this program, or in the name of another one."""
        subject = self.bus.subject(path)
        return subject if self.token is None else self.bus.with_sender(subject, sender if sender is not None else self.token)

    async def publish(self, subject: str, payload: bytes, reply: str = "") -> None:
        await self.connection.publish(subject, payload, reply=reply)
        await self.connection.flush()

    async def ask(self, subject: str, payload: bytes) -> bytes:
        """Send a request, and return the answer. Raises Defect if none comes."""
        number = uuid.uuid4().hex
        answer: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        self._answers[number] = answer
        try:
            await self.connection.publish(subject, payload, reply=f"{self._inbox}.{number}")
            async with asyncio.timeout(PATIENCE):
                return await answer
        except TimeoutError:
            raise Defect(f"{subject} does not answer {payload[-300:]!r}") from None
        finally:
            del self._answers[number]

    async def overhear(self, pattern: str) -> None:
        """Try to listen to what is for others."""
        subscription = await self.connection.subscribe(pattern, cb=self._note)
        await self.connection.flush()
        with contextlib.suppress(nats.errors.Error):
            await subscription.unsubscribe()

    async def _take(self, message: Msg) -> None:
        answer = self._answers.get(message.subject.rpartition(".")[2])
        if answer is not None and not answer.done():
            answer.set_result(message.data)

    async def _note(self, message: Msg) -> None:
        if self.token is not None:
            self.overheard.append(message.subject)


async def _ignore(error: Exception) -> None:
    """Attackers are told what they may not."""


class BusTarget:
    """A system on a bus, and its attackers."""

    def __init__(self, system: System, client: Client, attackers: list[Attacker]) -> None:
        assert system.addresses.bus is not None, "it is on a bus"
        self.bus, self.attackers = system.addresses.bus, attackers
        self._target, self._tasks = Target(system, client), 0

    async def check(self) -> None:
        """Raises Defect if somebody has heard what is not for it, a task is not accomplished, or as `Target.check`."""
        for attacker in self.attackers:
            expect(not attacker.overheard, f"{attacker.name} has heard {attacker.overheard[:3]}")
        await self._target.check()
        server = self._target.system.programs["bus"].process.pid
        for child in Path(f"/proc/{server}/task/{server}/children").read_text().split():
            expect(memory_of(int(child)) < 400 * 2**20, f"the NATS server needs {memory_of(int(child)) / 2**20:.0f} MB")
        self._tasks += 1
        client = self._target.client
        task = await client.submit(Submit(effect=GOALS[self._tasks % 2]))
        try:
            async with asyncio.timeout(PATIENCE):
                view = [news.view async for news in client.news(task)][-1]
        except TimeoutError:
            raise Defect(f"a task does not end within {PATIENCE:g} s") from None
        expect(view.outcome is Outcome.ACCOMPLISHED, f"a task is not accomplished: {view.explanation}")

    def memory(self) -> dict[str, int]:
        """The memory of each program, in MB."""
        return {name: memory_of(program.process.pid) // 2**20 for name, program in self._target.system.programs.items()}


@contextlib.asynccontextmanager
async def attacked_bus(data: Path, *, certificates: bool) -> AsyncIterator[BusTarget]:
    """Run the system of the first scenario on a bus of its own."""
    with resources.as_file(resources.files("somrs.demo") / "data" / "scenario-1.yaml") as site:
        system = System([site], data, speed="max", world=WorldKind.KINEMATIC, bus=OWN_BUS, certificates=certificates)
        async with system, Client(system.addresses) as client:
            bus = system.addresses.bus
            assert bus is not None, "it is on a bus"
            names = LOW_ROLES if certificates else {"anybody": None}
            attackers = [await _attacker(data, bus, name, role) for name, role in names.items()]
            try:
                yield BusTarget(system, client, attackers)
            finally:
                for attacker in attackers:
                    await attacker.connection.close()


async def _attacker(data: Path, bus: BusAddress, name: str, role: Role | None) -> Attacker:
    if role is None:
        return await Attacker.connected(bus, name, None)
    identity = Identity(name=name, roles=frozenset({role}))
    certificate, _ = Authority.of_data(data).issue_program(identity, ("127.0.0.1",), datetime.now(UTC))
    return await Attacker.connected(bus, name, Credentials(certificate))
