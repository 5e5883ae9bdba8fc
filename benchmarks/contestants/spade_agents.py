"""SPADE: eleven agents that use XMPP over sockets, with SPADE's own server.

SPADE does not use XMPP between agents of one process. Therefore the manager, the bidders and the server are in three processes, which is
also the fastest variant here. An agent writes received messages to the floor's journal before it answers; SPADE itself stores nothing. The
server does not store its users on disk, which makes it faster.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import shutil
import sys
import uuid
from collections.abc import Awaitable, Callable
from importlib.util import find_spec
from pathlib import Path

import msgspec

from contestants.contest import BIDDERS
from contestants.conversation import Bidder, Negotiation, Note, Speaker
from contestants.journal import Journal
from contestants.programs import Programs, free_port, ready, wait_for_end
from somrs.deployment.programs import run_program

DOMAIN = "localhost"
PATIENCE = 60.0
"""Seconds after which an agent repeats its wait for a message."""

Hear = Callable[[Note], list[Note]]

_ENCODER = msgspec.json.Encoder()
_DECODER = msgspec.json.Decoder(Note)


def _jid(name: str) -> str:
    return f"{name}@{DOMAIN}"


async def _agent(name: str, port: int, journal: Journal, hear: Hear) -> tuple[object, Callable[[list[Note]], Awaitable[None]]]:
    """Connect an agent, and return it with its function to send notes."""
    from spade.agent import Agent
    from spade.behaviour import CyclicBehaviour
    from spade.message import Message

    class Listening(CyclicBehaviour):
        async def run(self) -> None:
            message = await self.receive(timeout=PATIENCE)
            if message is not None:
                self.agent.submit(self.handle(message.body))  # the next message does not wait for the disk

        async def handle(self, text: str) -> None:
            document = text.encode()
            await journal.append(document)
            await self.speak(hear(_DECODER.decode(document)))

        async def speak(self, notes: list[Note]) -> None:
            for note in notes:
                await self.send(Message(to=note.recipient, body=_ENCODER.encode(note).decode(), metadata={"performative": note.kind}))

    agent = Agent(_jid(name), "secret", port=port)
    listening = Listening()
    agent.add_behaviour(listening)
    await agent.start(auto_register=True)
    return agent, listening.speak


class Spade:
    """The manager's process, which starts the other two."""

    async def start(self, data: Path) -> None:
        self._programs = Programs(data)
        port = free_port()
        await self._programs.start("spade_agents", "server", str(port))
        await self._programs.start("spade_agents", "bidders", str(port))
        self._journal = Journal(data / "manager.sqlite")
        self._open: dict[str, tuple[Negotiation, asyncio.Future[None]]] = {}
        self._speaker = Speaker(_jid("manager"))
        self._bidders = tuple(_jid(f"robot-{number}") for number in range(BIDDERS))
        self._agent, self._speak = await _agent("manager", port, self._journal, self._hear)

    async def converse(self, line: int) -> None:
        transaction = uuid.uuid4().urn
        finished: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        negotiation = Negotiation(self._speaker, transaction, self._bidders)
        self._open[transaction] = negotiation, finished
        await self._speak(negotiation.open())
        await finished

    async def stop(self) -> None:
        await self._agent.stop()  # type: ignore[attr-defined]  # SPADE has no types
        self._journal.close()
        await self._programs.end()

    def _hear(self, note: Note) -> list[Note]:
        negotiation, finished = self._open[note.transaction]
        answers = negotiation.receive(note)
        if negotiation.is_finished:
            del self._open[note.transaction]
            finished.set_result(None)
        return answers


async def _bidders(port: int) -> None:
    journal = Journal(Path("bidders.sqlite"))
    agents = []
    for number in range(BIDDERS):
        bidder = Bidder(_jid(f"robot-{number}"), number)

        def hear(note: Note, bidder: Bidder = bidder) -> list[Note]:
            answer = bidder.answer(note)
            return [answer] if answer is not None else []

        agents.append(await _agent(f"robot-{number}", port, journal, hear))
    ready()
    await wait_for_end()
    for agent, _ in agents:
        await agent.stop()  # type: ignore[attr-defined]  # SPADE has no types
    journal.close()


async def _server(port: int) -> None:
    import loguru
    from pyjabber.server import Server
    from pyjabber.server_parameters import Parameters

    loguru.logger.remove()
    spec = find_spec("pyjabber")
    assert spec is not None, "it was imported above"
    assert spec.origin is not None, "it has a file"
    certificates = Path("certificates").resolve()
    shutil.copytree(Path(spec.origin).parent / "network" / "certs", certificates)  # the server writes its own beside them
    server = Server(
        Parameters(
            host=DOMAIN,
            client_port=port,
            server_port=free_port(),
            database_in_memory=True,
            cert_path=str(certificates),
            connection_timeout=3600,
        )
    )
    # The server uses the loopback address only, and not its web pages, whose port cannot be chosen.
    server._public_ip = server._http_server = None
    serving = asyncio.create_task(server.start())
    await server.ready.wait()
    ready()
    await wait_for_end()
    serving.cancel()
    for child in multiprocessing.active_children():  # the server hashes passwords in child processes
        child.kill()
    os._exit(0)  # the server ignores the cancellation


if __name__ == "__main__":
    run_program((_server if sys.argv[1] == "server" else _bidders)(int(sys.argv[2])))
