"""Files that never change are asked for once."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from nicegui import app as nicegui_app
from starlette.types import Message, Receive, Scope, Send

from somrs.gui.assets import publish
from somrs.gui.cache import CONDITIONS, MAX_BYTES, Cache

FOREVER = "public, max-age=31536000, immutable"


class Server:
    """Answers all with what it has, in two pieces, and sets a cookie each time."""

    def __init__(self, body: bytes = b"var a", status: int = 200, cache: str = FOREVER, vary: str = "Accept-Encoding, Cookie") -> None:
        self.body, self.status, self.request_count = body, status, 0
        self.headers = {"cache-control": cache, "vary": vary, "content-length": str(len(body))}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self.begin(send)
        await send({"type": "http.response.body", "body": self.body[:3], "more_body": True})
        await send({"type": "http.response.body", "body": self.body[3:]})

    async def begin(self, send: Send) -> None:
        self.request_count += 1
        cookie = (b"set-cookie", f"session={self.request_count}".encode())
        headers = [*((name.encode(), value.encode()) for name, value in self.headers.items()), cookie]
        await send({"type": "http.response.start", "status": self.status, "headers": headers})


def get_file(
    app: Cache, path: str = "/_nicegui/a.js", method: str = "GET", query: str = "", **headers: str
) -> tuple[int, dict[str, str], bytes]:
    scope: dict[str, Any] = {"type": "http", "method": method, "path": path, "query_string": query.encode()}
    scope["headers"] = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    messages: list[Message] = []

    async def receive() -> Message:
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        messages.append(message)

    asyncio.run(app(scope, receive, send))
    response_headers = {name.decode(): value.decode() for name, value in messages[0]["headers"]}
    return messages[0]["status"], response_headers, b"".join(message.get("body", b"") for message in messages[1:])


def test_what_never_changes_is_asked_for_once_and_is_anyones() -> None:
    server = Server()
    app = Cache(server)
    first, second = get_file(app), get_file(app)
    assert first == second == (200, {"cache-control": FOREVER, "content-length": "5", "vary": "Accept-Encoding"}, b"var a")
    assert server.request_count == 1
    get_file(app, "/_nicegui/b.js")
    get_file(app, accept_encoding="br, gzip")
    get_file(app, accept_encoding="gzip")
    assert server.request_count == 3, "another file, and the same compressed"


def test_what_varies_with_nothing_but_cookies_varies_with_nothing() -> None:
    assert "vary" not in get_file(Cache(Server(vary="Cookie")))[1]


@pytest.mark.parametrize(
    "server",
    [Server(cache="no-cache"), Server(status=404), Server(body=bytes(MAX_BYTES + 1))],
    ids=["what may change", "what is not there", "what is too large"],
)
def test_nothing_else_is_kept(server: Server) -> None:
    app = Cache(server)
    count_before = server.request_count
    assert get_file(app)[2] == get_file(app)[2] == server.body
    assert server.request_count == count_before + 2


def test_no_more_is_kept_than_there_is_room_for() -> None:
    server = Server(body=bytes(MAX_BYTES // 2))
    app = Cache(server)
    for path in ("/_nicegui/a.js", "/_nicegui/./a.js", "/_nicegui/././a.js"):
        get_file(app, path)
        get_file(app, path)
    assert server.request_count == 4, "the first two are kept"


def test_answers_for_one_who_asks_keep_their_cookie() -> None:
    assert get_file(Cache(Server(cache="no-cache")))[1]["set-cookie"] == "session=1"


@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_part_of_a_file_or_one_under_a_condition_is_asked_for(condition: str) -> None:
    server = Server()
    app = Cache(server)
    get_file(app)
    get_file(app, **{condition.replace("-", "_"): "x"})
    assert server.request_count == 2


def test_other_requests_pass() -> None:
    server = Server()
    app = Cache(server)
    get_file(app)
    get_file(app, method="HEAD")
    get_file(app, query="a=1")
    get_file(app, path="/map")
    get_file(app, path="/map")
    assert server.request_count == 5


def test_a_file_is_whole_though_the_first_who_asked_for_it_left() -> None:
    class Heeds(Server):
        """Says no more once nobody listens, as Starlette's middleware does."""

        async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
            await self.begin(send)
            waiting = asyncio.ensure_future(receive())
            await asyncio.sleep(0)
            is_disconnected = waiting.done() and waiting.result()["type"] == "http.disconnect"
            waiting.cancel()
            await send({"type": "http.response.body", "body": b"" if is_disconnected else self.body})

    server = Heeds()
    app = Cache(server)
    assert get_file(app)[2] == get_file(app)[2] == b"var a"
    assert server.request_count == 1


def test_a_file_that_ended_too_early_is_not_kept() -> None:
    class Dies(Server):
        async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
            await self.begin(send)
            await send({"type": "http.response.body", "body": b"v", "more_body": True})

    server = Dies()
    app = Cache(server)
    get_file(app)
    get_file(app)
    assert server.request_count == 2


def test_a_published_file_is_kept_under_an_address_of_its_content() -> None:
    path = publish("look.css", "a {}")
    status, headers, body = get_file(Cache(nicegui_app), path)
    assert (status, body, headers["content-type"], headers["cache-control"]) == (200, b"a {}", "text/css; charset=utf-8", FOREVER)
    assert publish("look.css", "a {}") == path != publish("look.css", "b {}")
    server = Server()
    app = Cache(server)
    assert get_file(app, path) == get_file(app, path)
    assert server.request_count == 1
