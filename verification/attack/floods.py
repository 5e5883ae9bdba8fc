"""Too much of everything: slow and large headers and bodies, connections, WebSockets, topics."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

import msgspec
import websockets

from somrs.limits import Limits
from somrs.protocol.soap.document import MOST_BYTES
from verification.attack.target import JSON, SOAP, Line, Target, expect, memory_of, request_bytes

BOUNDS = Limits()
LARGE = 50 * 2**20


@contextlib.asynccontextmanager
async def connections(target: Target, url: str, count: int, content: bytes) -> AsyncIterator[list[Line]]:
    """So many connections to a server, on each of which this was sent."""
    async with contextlib.AsyncExitStack() as stack:
        lines = []
        for _ in range(count):
            with contextlib.suppress(ConnectionError):
                line = await stack.enter_async_context(target.connection(url))
                await line.send(content)
                lines.append(line)
        yield lines


async def connections_that_send_nothing_keep_nobody_out(target: Target) -> None:
    for url in {**target.web, **target.soap}.values():
        for content in (b"", b"GET / HTTP/1.1\r\nX: "):
            async with connections(target, url, BOUNDS.connections + 300, content):
                await target.check()


async def slow_requests_end(target: Target) -> None:
    urls = [*target.web.values(), *target.soap.values()]
    starts = (b"", b"GET / HT", b"GET / HTTP/1.1\r\nX: x\r\n", b"POST /api/tasks HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\n1")

    async def trickle(url: str, start: bytes) -> None:
        async with target.connection(url) as line:
            await line.send(start)
            trickling = asyncio.create_task(_trickle(line))
            try:
                await line.end()
            finally:
                trickling.cancel()

    await asyncio.gather(*(trickle(url, start) for url in urls for start in starts))


async def _trickle(line: Line) -> None:
    while True:
        await asyncio.sleep(1)
        await line.send(b"x")


async def large_headers_are_not_kept(target: Target) -> None:
    for server, url in {**target.web, **target.soap}.items():
        program = {"API": "api", "windows": "gui"}.get(server, server.lower().replace(" ", "-"))
        process_id = target.system.programs[program].process.pid
        for start in (b"GET /", b"GET / HTTP/1.1\r\nX: ", b"GET / HTTP/1.1\r\nHost: "):
            before = memory_of(process_id)
            async with target.connection(url) as line:
                sending = asyncio.create_task(line.send(start + b"x" * LARGE))
                answer = await line.answer()
                sending.cancel()
            expect(answer.status in (0, 400, 431), f"{server}: a header of 50 MB gets {answer.status}")
            grown = memory_of(process_id) - before
            expect(grown < LARGE / 2, f"{server}: a header of 50 MB takes {grown / 2**20:.0f} MB")


async def large_bodies_are_refused(target: Target) -> None:
    for server, url in target.web.items():
        head = request_bytes(url, "POST", {**JSON, **target.authorization(url), "Content-Length": str(300 * 2**20)}, path="/api/tasks")
        async with target.connection(url) as line:
            await line.send(head)
            answer = await line.answer()
        expect(answer.status == 413, f"{server}: a body of 300 MB gets {answer.status}")
    for server, url in target.soap.items():
        answer = await target.request(url, "POST", SOAP, b" " * (MOST_BYTES + 1))
        expect(answer.status == 413, f"{server}: a message of {MOST_BYTES + 1} bytes gets {answer.status}")


async def endless_bodies_end(target: Target) -> None:
    chunk = b"10000\r\n" + b" " * 0x10000 + b"\r\n"
    for server, url in {**target.web, **target.soap}.items():
        kind = JSON if server in target.web else SOAP
        path = "/api/tasks" if server in target.web else None
        head = request_bytes(url, "POST", {**kind, **target.authorization(url), "Transfer-Encoding": "chunked"}, path=path).replace(
            b"Content-Length: 0\r\n", b""
        )
        async with target.connection(url) as line:
            sending = asyncio.create_task(_repeat(line, head, chunk))
            answer = await line.answer()
            sending.cancel()
        expect(answer.status in (0, 413), f"{server}: an endless body gets {answer.status}")


async def _repeat(line: Line, head: bytes, chunk: bytes) -> None:
    await line.send(head)
    for _ in range(2000):
        await line.send(chunk)


async def websockets_are_bounded(target: Target) -> None:
    url = f"{target.api.replace('http', 'ws', 1)}/live"
    async with contextlib.AsyncExitStack() as stack:
        refused = 0
        for _ in range(BOUNDS.websockets + 50):
            try:
                await stack.enter_async_context(websockets.connect(url, additional_headers=target.authorization(target.api)))
            except websockets.InvalidStatus as error:
                expect(error.response.status_code == 503, f"one WebSocket too many gets {error.response.status_code}")
                refused += 1
        expect(refused >= 50, f"only {refused} of {BOUNDS.websockets + 50} WebSockets are refused")
        await target.check()


async def websockets_take_no_nonsense(target: Target) -> None:
    for server, base in target.web.items():
        url = f"{base.removesuffix('/api').replace('http', 'ws', 1)}/api/live"
        texts: list[str | bytes] = [
            "",
            "{",
            "[" * 100_000,
            '{"follow": 1}',
            '{"follow": ["' + "x" * 100_000 + '"]}',
            b"\x00\xff",
            '{"follow": [], "confirm": 1e999}',
        ]
        texts += [msgspec.json.encode({"follow": [f"task {number}" for number in range(20_000)]}).decode(), "x" * (2 * BOUNDS.frame_bytes)]
        for text in texts:
            with contextlib.suppress(websockets.ConnectionClosed):
                async with websockets.connect(url, additional_headers=target.authorization(base)) as socket:
                    await socket.send(text)
                    async with asyncio.timeout(60):
                        await socket.recv()
        answer = await target.request(base, path="/api/tasks")
        expect(answer.status == 200, f"{server}: after the WebSockets, the list of tasks is {answer.status}")


async def topics_are_bounded(target: Target) -> None:
    url = f"{target.api.replace('http', 'ws', 1)}/live"
    async with contextlib.AsyncExitStack() as stack:
        for number in range(5):
            socket = await stack.enter_async_context(websockets.connect(url, additional_headers=target.authorization(target.api)))
            await socket.send(msgspec.json.encode({"follow": [f"task {number}-{task}" for task in range(5000)]}).decode())
            problem = await socket.recv()
            expect("limit" in str(problem) or "at most" in str(problem), f"5,000 topics get {problem!r:.100}")
        await target.check()


async def the_simulator_takes_no_nonsense(target: Target) -> None:
    address = target.system.addresses.simulator
    assert address is not None, "the system has a simulator"
    hello = b'{"say":"hello","version":1}\n'
    for content in (
        b"\n",
        b"x" * 100_000 + b"\n",
        b"[" * 60_000 + b"\n",
        hello + b'{"ask":"picture","id":1,"width":1000000000}\n',
        hello + b'{"say":"hello","version":1,"rate":1e308}\n',
        hello + b'{"ask":"follow","id":1,"rate":1e308}\n',
        hello * 1000,
    ):
        async with target.connection(address) as line:
            await line.send(content)
            await line.line()
    async with connections(target, address, BOUNDS.connections + 300, b""), target.connection(address) as line:
        await line.send(hello)
        expect(b"welcome" in await line.line(), "silent connections keep an operator from the simulator")
