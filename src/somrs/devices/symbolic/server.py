"""Serves a symbolic world at a TCP port: the common state for the programs of all its devices."""

from __future__ import annotations

import asyncio
import logging

from somrs.devices.link_security import DEVICES, Proof, start_listening
from somrs.devices.open_sockets import OpenSockets
from somrs.devices.symbolic.lines import (
    LONGEST,
    Answer,
    Apply,
    Begin,
    Estimate,
    Estimated,
    Hello,
    Look,
    Refused,
    Request,
    Result,
    Welcome,
    encode_line,
    read_request,
)
from somrs.devices.symbolic.world import SymbolicWorld
from somrs.errors import WireError
from somrs.ports import listen_at
from somrs.trust.credentials import Credentials

log = logging.getLogger(__name__)


class WorldServer:
    """Answers requests about one world. `speed`: a service of cost 1 takes 1 second at speed 1; None: services take no time.

    `credentials`: with them, a device is only spoken for by who has a certificate that names it.
    """

    def __init__(
        self,
        world: SymbolicWorld,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        speed: float | None = 1.0,
        credentials: Credentials | None = None,
    ) -> None:
        self._credentials = credentials
        self.world, self.host, self.port, self.speed = world, host, port, speed
        self._sockets = OpenSockets()

    async def start(self) -> None:
        """Listen, and set `port` to the actual port."""
        self._listener = await start_listening(self._serve, listen_at(self.host, self.port), LONGEST, self._credentials)
        self.port = self._listener.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        self._listener.close()
        self._sockets.close()
        await self._listener.wait_closed()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        proof = Proof.of(self._credentials, writer)
        try:
            if not self._sockets.add(writer):
                writer.write(encode_line(Refused(reason=f"this world serves {self._sockets.limit} connections, which is the limit")))
                return
            while line := await reader.readline():
                self._sockets.note_heard(writer)
                writer.write(encode_line(self._answered(line, proof)))
                await writer.drain()
        except (ConnectionError, ValueError) as error:  # ValueError: a line that is too long
            log.warning("a connection of a device ended: %s", error)
        finally:
            self._sockets.remove(writer)
            writer.close()

    def _answered(self, line: bytes, proof: Proof) -> Answer:
        try:
            request = read_request(line)
            proof.check(DEVICES, request.device)
            return self.answer(request)
        except WireError as error:
            return Refused(reason=error.text)

    def answer(self, message: Request) -> Answer:
        """Process a request, and return the reply."""
        if message.device not in self.world.map.objects:
            return Refused(reason=f"there is no {message.device} in this world; it has the objects that were on the map when it started")
        match message:
            case Hello(device=device):
                kind = self.world.map.objects[device].type
                return Welcome(type=kind, services=tuple(service.name for service in self.world.offers(device)))
            case _ if message.service not in self.world.ontology.services:
                return Refused(reason=f"there is no service type {message.service} in this world")
            case Estimate(device=device, service=service, inputs=inputs):
                cost = self.world.cost(service, inputs, device)
                return Estimated(cost=cost, seconds=(cost or 1.0) / self.speed if self.speed is not None else 0.0)
            case Begin(device=device, service=service, inputs=inputs):
                return self._make_result(message, self.world.refusal(service, inputs, device))
            case Apply(device=device, service=service, inputs=inputs):
                return self._make_result(message, self.world.perform(service, inputs, device))
            case Look():
                return self._make_result(message, None)

    def _make_result(self, message: Begin | Apply | Look, refusal: str | None) -> Result:
        if refusal is not None:
            log.warning("%s of %s is rejected: %s", message.service, message.device, refusal)
            return Result(situation=self.world.describe_failure(message.service, message.inputs, message.device), refusal=refusal)
        if isinstance(message, Apply):
            return Result(situation=self.world.result(message.service, message.inputs, message.device))
        effect = self.world.ontology.services[message.service].effect
        return Result(situation=self.world.describe(effect, message.device, message.inputs))
