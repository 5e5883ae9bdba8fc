"""Nobody fills a server: who sends too much, too slowly or too often reads why, and others are served meanwhile."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable

import pytest
import websockets
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from somrs.limits import Limits
from somrs.ports import listen_at
from somrs.runtime.bounded_http import BoundedConfig, QuietServer
from somrs.runtime.websocket_protocol import WebSocketProtocol
from tests.support.hang import HANG_TIME

LARGE = 4_000_000
"""More than the kernel buffers between two sockets of this computer."""


async def _measure(request: Request) -> Response:
    return PlainTextResponse(str(len(await request.body())))


async def _write_much(request: Request) -> Response:
    return Response(b"x" * (10 * LARGE))


async def _echo(socket: WebSocket) -> None:
    await socket.accept()
    async for text in socket.iter_text():
        await socket.send_text(text)


class Client:
    """A connection on which bytes are sent as they are."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    async def send(self, content: bytes) -> None:
        self._writer.write(content)
        await self._writer.drain()

    async def answer(self) -> tuple[int, str]:
        """The status and the body of an answer; 0 if the connection ends without one."""
        try:
            head = (await self._reader.readuntil(b"\r\n\r\n")).decode()
        except (asyncio.IncompleteReadError, ConnectionError):
            return 0, ""
        length = next(int(line.partition(":")[2]) for line in head.lower().splitlines() if line.startswith("content-length"))
        return int(head.split()[1]), (await self._reader.readexactly(length)).decode()

    async def end(self) -> bytes:
        """What arrives until the connection ends."""
        try:
            return await self._reader.read()
        except ConnectionError:
            return b""


class Servings:
    """A server, and the connections to it."""

    def __init__(self, server: QuietServer, config: BoundedConfig, port: int, stack: contextlib.AsyncExitStack) -> None:
        self.server, self.config, self.port, self._stack = server, config, port, stack

    async def connect(self, content: bytes = b"") -> Client:
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        self._stack.callback(writer.close)
        client = Client(reader, writer)
        await client.send(content)
        return client

    async def left(self) -> None:
        """Wait until the server has no connections."""
        while self.server.server_state.connections:
            await asyncio.sleep(0.1)

    async def ask(self, content: bytes) -> tuple[int, str]:
        return await (await self.connect(content)).answer()


Scenario = Callable[[Servings], Awaitable[None]]


def run_scenario(bounds: Limits, scenario: Scenario) -> None:
    """Run the scenario against a server, which still answers afterwards, and has forgotten all bodies."""

    async def run() -> None:
        async with asyncio.timeout(HANG_TIME), contextlib.AsyncExitStack() as stack, _served(bounds) as (server, config, port):
            servings = Servings(server, config, port, stack)
            await scenario(servings)
            assert await servings.ask(post(b"abc")) == (200, "3")
            while config.held_bytes:
                await asyncio.sleep(0.01)

    asyncio.run(run())


@contextlib.asynccontextmanager
async def _served(bounds: Limits) -> AsyncIterator[tuple[QuietServer, BoundedConfig, int]]:
    routes = [Route("/", _measure, methods=["POST"]), Route("/much", _write_much), WebSocketRoute("/echo", _echo)]
    config = BoundedConfig(Starlette(routes=routes), bounds=bounds, lifespan="off", ws=WebSocketProtocol)
    listener, server = listen_at("127.0.0.1", 0), QuietServer(config)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    while not server.started:
        await asyncio.sleep(0.01)
    yield server, config, listener.getsockname()[1]
    server.end()
    await serving


def post(body: bytes, *headers: str, length: int | None = None) -> bytes:
    lines = ("POST / HTTP/1.1", "Host: x", f"Content-Length: {len(body) if length is None else length}", *headers)
    return "\r\n".join((*lines, "", "")).encode() + body


CHUNKED = b"POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n"


@pytest.mark.parametrize(
    ("request_bytes", "code"),
    [
        (post(b"abc", "X: " + "x" * 900), 200),
        (post(b"abc", "X: " + "x" * 1100), 431),
        (post(b"abc", *(f"X{i}: x" for i in range(500))), 431),
        (b"GET /" + b"x" * LARGE, 431),
        (b"GET / HTTP/1.1\r\nX: " + b"x" * LARGE, 431),
        (b"GET / HTTP/1.1\r\n" + b"X: x\r\n" * LARGE, 431),
        (post(b"x" * 5000), 200),
        (post(b"x" * 5001), 413),
        (post(b"", length=5001), 413),
        (post(b"x" * LARGE), 413),
        (CHUNKED + b"1000\r\n" + b"x" * 4096 + b"\r\n1000\r\n" + b"x" * 4096 + b"\r\n0\r\n\r\n", 413),
        (CHUNKED + b"1;" + b"x" * LARGE, 413),
        (CHUNKED + b"0\r\n" + b"X: x\r\n" * (LARGE // 6), 413),
        (CHUNKED + b"3\r\nabc\r\n0\r\nHost: y\r\n\r\n", 200),
    ],
)
def test_headers_and_bodies_of_any_size(request_bytes: bytes, code: int) -> None:
    async def scenario(servings: Servings) -> None:
        answer_code, text = await servings.ask(request_bytes)
        assert answer_code == code, text
        assert code == 200 or "which is the limit" in text

    run_scenario(Limits(header_bytes=1000, body_bytes=5000), scenario)


@pytest.mark.parametrize(
    ("request_bytes", "code"),
    [
        (b"", 408),
        (b"GET / HT", 408),
        (b"GET / HTTP/1.1\r\nX: x\r\n", 408),
        (post(b"a", length=2), 408),
        (CHUNKED + b"5\r\nab", 408),
    ],
)
def test_who_is_slow_reads_so(request_bytes: bytes, code: int) -> None:
    async def scenario(servings: Servings) -> None:
        client = await servings.connect()
        for byte in request_bytes:
            await client.send(bytes([byte]))
        answer_code, text = await client.answer()
        assert answer_code == code, text
        assert "did not arrive within 1 s" in text

    run_scenario(Limits(request_seconds=1), scenario)


@pytest.mark.parametrize(("rate", "code"), [(1, 200), (2**20, 408)])
def test_a_large_body_has_as_much_time_as_the_rate_takes(rate: int, code: int) -> None:
    async def scenario(servings: Servings) -> None:
        large = await servings.connect(post(b"a" * 1000, length=1001))
        assert (await (await servings.connect(b"GET / HT")).answer())[0] == 408, "now the time for those who send nothing is over"
        if code == 200:
            await large.send(b"b")
        assert (await large.answer())[0] == code

    run_scenario(Limits(request_seconds=1, bytes_per_second=rate), scenario)


def test_a_client_that_reads_nothing_of_its_answer_is_left() -> None:
    async def scenario(servings: Servings) -> None:
        client = await servings.connect(b"GET /much HTTP/1.1\r\nHost: x\r\n\r\n")
        await servings.left()
        assert len(await client.end()) < 10 * LARGE

    run_scenario(Limits(send_seconds=1), scenario)


def test_a_full_server_leaves_whom_nothing_was_heard_of() -> None:
    async def scenario(servings: Servings) -> None:
        working = await servings.connect(post(b"a", length=2))
        answered = await servings.connect(post(b"a"))
        assert await answered.answer() == (200, "1")
        idle = [await servings.connect(b"GET / HT") for _ in range(20)]
        assert await servings.ask(post(b"abc")) == (200, "3")
        assert await idle[0].end() == b"", "it waited longest"
        await working.send(b"b")
        assert await working.answer() == (200, "2"), "its request had begun"

    run_scenario(Limits(connections=5, request_seconds=1000), scenario)


def test_a_server_that_is_full_of_work_says_so() -> None:
    async def scenario(servings: Servings) -> None:
        clients = [await servings.connect(post(b"a", length=2)) for _ in range(3)]
        code, text = await servings.ask(post(b"abc"))
        assert (code, "3 connections, which is the limit; try again later" in text) == (503, True)
        for client in clients:
            await client.send(b"b")
            assert await client.answer() == (200, "2")

    run_scenario(Limits(connections=3), scenario)


def test_bodies_that_are_too_large_together() -> None:
    async def scenario(servings: Servings) -> None:
        first = await servings.connect(post(b"x" * 3000, length=3001))
        while servings.config.held_bytes < 3000:
            await asyncio.sleep(0.01)
        code, text = await servings.ask(post(b"x" * 3000, length=3001))
        assert (code, "try again later" in text) == (503, True)
        await first.send(b"x")
        assert await first.answer() == (200, "3001")

    run_scenario(Limits(body_bytes=4000, bodies_bytes=5000), scenario)


def test_answers_that_are_due_come_first() -> None:
    async def scenario(servings: Servings) -> None:
        client = await servings.connect(post(b"abc") + post(b"ab") + post(b"x" * 200))
        answers = [await client.answer() for _ in range(3)]
        assert answers[-1][0] in (0, 413)
        assert [answer for answer in answers if answer[0] == 200] == [(200, "3"), (200, "2")][: sum(code == 200 for code, _ in answers)]

    run_scenario(Limits(body_bytes=100), scenario)


def test_websockets_are_few_and_their_messages_small() -> None:
    async def scenario(servings: Servings) -> None:
        url = f"ws://127.0.0.1:{servings.port}/echo"
        async with websockets.connect(url) as first, websockets.connect(url) as second:
            for socket in (first, second):
                await socket.send("x" * 1000)
                assert await socket.recv() == "x" * 1000
            with pytest.raises(websockets.InvalidStatus) as refusal:
                await websockets.connect(url)
            assert refusal.value.response.status_code == 503
            await first.send("x" * 1001)
            with pytest.raises(websockets.ConnectionClosed) as closing:
                await first.recv()
            assert closing.value.rcvd is not None
            assert closing.value.rcvd.code == 1009
            await second.send("still here")
            assert await second.recv() == "still here"
            async with websockets.connect(url) as third:
                await third.send("x")

    run_scenario(Limits(websockets=2, frame_bytes=1000), scenario)


HANDSHAKE = b"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: eHh4eHh4eHh4eHh4eHh4eA==\r\n"


@pytest.mark.parametrize(
    ("path", "header", "code"),
    [
        (b"/echo", b"Authorization: Bearer " + b"A" * 10_000, 431),
        (b"/echo", b"\r\n".join(b"X-%d: 1" % number for number in range(500)), 431),
        (b"/echo?" + b"a" * 10_000, b"X: 1", 414),
    ],
)
def test_a_handshake_that_is_too_large_is_answered_and_ended(path: bytes, header: bytes, code: int) -> None:
    async def scenario(servings: Servings) -> None:
        client = await servings.connect(b"GET " + path + b" HTTP/1.1\r\nHost: robots.example\r\n" + HANDSHAKE + header + b"\r\n\r\n")
        assert (await client.answer())[0] == code
        assert await client.end() == b""

    run_scenario(Limits(), scenario)
