"""The system that is attacked: real processes, with methods that send bytes to them, and that look whether they are well."""

from __future__ import annotations

import asyncio
import contextlib
import re
import uuid
from collections.abc import AsyncIterator, Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import msgspec

from somrs.access.store import local_token
from somrs.client.client import Client
from somrs.deployment.system import System
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.soap import soap

PATIENCE = 60.0
"""Seconds after which an answer that does not come is a failure. It decides nothing in the system."""

MOST_MEMORY = 400 * 2**20
"""Bytes that a process may need, whatever is sent to it. At rest, the largest of them needs some 200 MB."""

_DEFECT = re.compile(r"^Traceback|could not be handled|Exception in ASGI|Fatal error|exception was never retrieved", re.MULTILINE)
"""What a log has if a program was not prepared for something."""

SOAP = {"Content-Type": "application/soap+xml; charset=utf-8"}
JSON = {"Content-Type": "application/json"}


class Defect(Exception):
    """The system does not keep a promise."""


class Skipped(Exception):
    """An attack cannot be tried here."""


def expect(condition: object, text: str) -> None:
    """Raises Defect unless the condition holds."""
    if not condition:
        raise Defect(text)


class Answer(NamedTuple):
    """An HTTP response. `status`: 0 if the connection ended without one."""

    status: int
    headers: Mapping[str, str]
    content: bytes

    @property
    def text(self) -> str:
        return self.content.decode(errors="replace")


class Line:
    """A TCP connection to a server."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    async def send(self, content: bytes) -> None:
        """Send bytes, as far as the server takes them."""
        with contextlib.suppress(ConnectionError):
            self._writer.write(content)
            await self._writer.drain()

    async def answer(self) -> Answer:
        """The next response. Raises Defect if none comes, and the connection does not end."""
        try:
            async with asyncio.timeout(PATIENCE):
                return await self._answer()
        except TimeoutError:
            raise Defect(f"there is no answer within {PATIENCE:g} s") from None
        except (ConnectionError, asyncio.IncompleteReadError):
            return Answer(0, {}, b"")

    async def _answer(self) -> Answer:
        first, *lines = (await self._reader.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")
        headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        status = int(first.split()[1])
        if status == 101:
            return Answer(status, headers, b"")
        if headers.get("transfer-encoding") == "chunked":
            content = b""
            while size := int(await self._reader.readline(), 16):
                content += await self._reader.readexactly(size)
                await self._reader.readline()
            await self._reader.readline()
            return Answer(status, headers, content)
        return Answer(status, headers, await self._reader.readexactly(int(headers.get("content-length", 0))))

    async def end(self) -> bytes:
        """What comes until the server ends the connection."""
        try:
            async with asyncio.timeout(PATIENCE):
                return await self._reader.read()
        except TimeoutError:
            raise Defect("the server does not end the connection") from None
        except ConnectionError:
            return b""

    async def line(self) -> bytes:
        """The next line of text."""
        with contextlib.suppress(ConnectionError):
            async with asyncio.timeout(PATIENCE):
                return await self._reader.readline()
        return b""

    def close(self) -> None:
        self._writer.close()


class Target:
    """A system in a folder, and its servers by name: those of SOAP, and those of browsers."""

    def __init__(self, system: System, client: Client) -> None:
        self.system, self.client = system, client
        self.soap: dict[str, str] = {
            "Repository": system.addresses.repository,
            "Registry": system.addresses.registry,
            "Task Manager": system.addresses.task_manager,
        }
        api = system.addresses.api
        assert api is not None, "the system has an API"
        self.api = api
        self.web = {"API": api} | ({"windows": system.addresses.gui} if system.addresses.gui is not None else {})
        self._log_sizes: dict[Path, int] = {}

    @contextlib.asynccontextmanager
    async def connection(self, url: str) -> AsyncIterator[Line]:
        parts = urlsplit(url if "//" in url else f"//{url}")
        line = Line(*await asyncio.open_connection(parts.hostname, parts.port, limit=2**24))
        try:
            yield line
        finally:
            line.close()

    def authorization(self, url: str) -> dict[str, str]:
        """The header of an honest client: attacks have its rights, as a browser would send its cookie."""
        return {"Authorization": f"Bearer {local_token(self.system.data)}"} if url in self.web.values() else {}

    async def request(
        self, url: str, method: str = "GET", headers: Mapping[str, str] | None = None, body: bytes = b"", *, path: str | None = None
    ) -> Answer:
        """Send a request as it is given here, whatever HTTP allows."""
        return await self.send_as(self.authorization(url) | dict(headers or {}), url, method, body, path=path)

    async def send_as(
        self, headers: Mapping[str, str], url: str, method: str = "GET", body: bytes = b"", *, path: str | None = None
    ) -> Answer:
        """Send a request with these headers, and nothing that proves who sends it besides."""
        async with self.connection(url) as line:
            await line.send(request_bytes(url, method, headers, body, path=path))
            return await line.answer()

    async def post_message(self, address: str, body: Body, **header: str | None) -> Answer:
        """Send a message to a component, with these fields in its header."""
        fields = {"sender": ANONYMOUS, "recipient": address, "message_id": uuid.uuid4().urn, **header}
        message = Message(header=msgspec.convert(fields, Header), body=body)
        return await self.request(address, "POST", SOAP, soap.encode(message))

    # Whether it is well

    async def check(self) -> None:
        """Raises Defect if a component does not answer, a process has ended, needs much memory, or has logged a defect."""
        await self.client.ontology()
        await self.client.rows()
        await self.client.services()
        answer = await self.request(self.api, path="/api/tasks")
        expect(answer.status == 200, f"the API answers {answer.status}: {answer.text[:200]}")
        for name, program in self.system.programs.items():
            expect(program.process.returncode is None, f"{name} has ended")
            size = memory_of(program.process.pid)
            expect(size < MOST_MEMORY, f"{name} needs {size / 2**20:.0f} MB")
        for problem in self._problems():
            raise Defect(problem)

    def _problems(self) -> Iterator[str]:
        for file in sorted((self.system.data / "logs").glob("*.log")):
            size = self._log_sizes.get(file, 0)
            new_text = file.read_bytes()[size:].decode(errors="replace")
            self._log_sizes[file] = size + len(new_text.encode())
            if (defect := _DEFECT.search(new_text)) is not None:
                yield f"{file.name}: {new_text[defect.start() :][-1500:]}"


def request_bytes(
    url: str, method: str = "GET", headers: Mapping[str, str] | None = None, body: bytes = b"", *, path: str | None = None
) -> bytes:
    """A request as bytes. Headers that are not given are those of an honest client."""
    parts = urlsplit(url)
    all_headers = {"Host": parts.netloc, "Content-Length": str(len(body)), **(headers or {})}
    lines = [
        f"{method} {path if path is not None else parts.path or '/'} HTTP/1.1",
        *(f"{name}: {text}" for name, text in all_headers.items()),
    ]
    return "\r\n".join((*lines, "", "")).encode("latin-1") + body


def memory_of(process_id: int) -> int:
    """The memory that a process has in use, in bytes."""
    for line in Path(f"/proc/{process_id}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024
    return 0


@contextlib.asynccontextmanager
async def attacked_system(data: Path) -> AsyncIterator[Target]:
    """Run the system of the first scenario, in a kinematic world."""
    with resources.as_file(resources.files("somrs.demo") / "data" / "scenario-1.yaml") as site:
        # Without certificates, what is attacked is reached by anybody, and defends itself.
        system = System([site], data, speed="max", world=WorldKind.KINEMATIC, windows=True, certificates=False)
        async with system, Client(system.addresses) as client:
            yield Target(system, client)
