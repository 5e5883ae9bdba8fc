"""A bare exchange over SOAP and HTTP between two processes, without a protocol: an Arrange is stored on disk and answered with Terms on the
same connection. This is a lower bound for the messages of SO-MRS."""

from __future__ import annotations

import sys
import uuid
from pathlib import Path

from contestants.journal import Journal
from contestants.programs import Programs, ready, wait_for_end
from somrs.deployment.programs import run_program
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import Header, Message, reply
from somrs.protocol.soap import soap
from somrs.runtime.http import Server
from somrs.runtime.wire import Wire

HOST = "127.0.0.1"
PATH = "/here"
GOAL = "Jar002 isOn Platform001"
ARRANGE = frp.Arrange(
    service_type="TransferObject",
    inputs={"Object": "Jar002", "Destination": "Platform001"},
    effect=GOAL,
    precondition="Jar002 isOn Cupboard001",
    earliest_start=1767225600.0,
    reply_by=1767225610.0,
)
TERMS = frp.Terms(effect=GOAL, price=4.0, duration=1.0, start_from=1767225600.0, valid_until=1767225720.0)


class Exchange:
    """The requesting side, which starts the other one. A conversation is one request and its answer."""

    async def start(self, data: Path) -> None:
        self._programs, self._wire = Programs(data), Wire()
        self._server_address = await self._programs.start("soap_exchange")

    async def converse(self, line: int) -> None:
        header = Header(
            sender="http://127.0.0.1:1/asks",
            recipient=self._server_address,
            message_id=uuid.uuid4().urn,
            transaction=uuid.uuid4().urn,
            participant="Robot1.TransferObject#s1",
        )
        answer = await self._wire.post(Message(header=header, body=ARRANGE))
        assert answer is not None, "it is answered on the same connection"
        assert isinstance(answer.body, frp.Terms), answer

    async def stop(self) -> None:
        await self._wire.close()
        await self._programs.end()


async def _serve() -> None:
    journal = Journal(Path("answers.sqlite"))

    async def answer(message: Message) -> Message:
        await journal.append(soap.encode(message))
        return reply(message, TERMS, server.url)

    server = Server(HOST, 0, {PATH: answer})
    await server.start()
    ready(f"{server.url}{PATH}")
    await wait_for_end()
    await server.stop()
    journal.close()


if __name__ == "__main__":
    assert len(sys.argv) == 1, "it takes no arguments"
    run_program(_serve())
