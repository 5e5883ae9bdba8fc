"""The form to sign in, as browsers and attackers use it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from somrs.access.identity import sender
from somrs.access.passwords import hashed_password
from somrs.access.rights import PersonRole
from somrs.access.store import AccessStore
from somrs.api.guard import Guard
from somrs.gui.sign_in import SignIn, is_open, sign_in_first
from somrs.gui.sign_in_page import SIGN_IN, SIGN_OUT

PASSWORD = "a few easy words"


def who(request: object) -> PlainTextResponse:
    identity = sender.get()
    return PlainTextResponse(identity.name if identity is not None else "nobody")


@asynccontextmanager
async def browser(store: AccessStore, *, scheme: str = "http", address: str = "10.0.0.1") -> AsyncIterator[httpx.AsyncClient]:
    pages = Starlette(routes=[*SignIn(store, "/look.css", lambda: 100.0).routes(), Route("/map", who)])
    guard = Guard(pages, store, is_open=is_open, refuse=sign_in_first)
    transport = httpx.ASGITransport(app=guard, client=(address, 1))
    async with httpx.AsyncClient(transport=transport, base_url=f"{scheme}://robots.example", headers={"Accept": "text/html"}) as client:
        yield client


def store_with_ada(tmp_path: Path) -> AccessStore:
    store = AccessStore(tmp_path)
    store.add_account("Ada", PersonRole.ADMINISTRATOR, hashed_password(PASSWORD))
    return store


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_a_session_begins_and_ends(tmp_path: Path, scheme: str) -> None:
    async def run() -> None:
        store = store_with_ada(tmp_path)
        async with browser(store, scheme=scheme) as client:
            first = await client.get("/map?storey=1")
            assert (first.status_code, first.headers["location"]) == (303, "/sign-in?next=%2Fmap%3Fstorey%3D1")
            signed_in = await client.post(SIGN_IN, data={"name": "Ada", "password": PASSWORD, "next": "/map?storey=1"})
            cookie = signed_in.headers["set-cookie"]
            assert "HttpOnly" in cookie
            assert "SameSite=strict" in cookie
            assert ("Secure" in cookie) == (scheme == "https")
            assert 'content="0;url=/map?storey=1"' in signed_in.text
            assert (await client.get("/map")).text == "Ada"
            stolen_cookie = {"Cookie": cookie.partition(";")[0]}
            assert (await client.post(SIGN_OUT)).headers["location"] == SIGN_IN
            assert (await client.get("/map")).status_code == 303
            client.cookies.clear()
            assert (await client.get("/map", headers=stolen_cookie)).status_code == 303, "the session has ended, and not only the cookie"

    asyncio.run(run())


@pytest.mark.parametrize("page", ["//evil.example", "https://evil.example", "/\\evil.example", "javascript:alert(1)", "/a\nb", ""])
def test_nobody_is_led_elsewhere(tmp_path: Path, page: str) -> None:
    async def run() -> None:
        async with browser(store_with_ada(tmp_path)) as client:
            signed_in = await client.post(SIGN_IN, data={"name": "Ada", "password": PASSWORD, "next": page})
            assert 'content="0;url=/"' in signed_in.text

    asyncio.run(run())


def test_what_is_typed_is_text(tmp_path: Path) -> None:
    async def run() -> None:
        async with browser(store_with_ada(tmp_path)) as client:
            markup = '"><script>alert(1)</script>'
            refused = await client.post(SIGN_IN, data={"name": markup, "password": "x", "next": markup})
            assert refused.status_code == 403
            assert "<script" not in refused.text
            assert "&lt;script&gt;" in refused.text

    asyncio.run(run())


def test_how_long_wrong_passwords_delay_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOMRS_LIMIT_SIGN_IN_TRIES", "1")
    monkeypatch.setenv("SOMRS_LIMIT_SIGN_IN_SECONDS", "2")

    async def run() -> None:
        time_passed = [0.0]
        pages = Starlette(routes=SignIn(store_with_ada(tmp_path), "/look.css", lambda: time_passed[0]).routes())
        transport = httpx.ASGITransport(app=pages, client=("10.0.0.1", 1))
        async with httpx.AsyncClient(transport=transport, base_url="http://robots.example") as client:
            delays = []
            for _ in range(4):
                assert (await client.post(SIGN_IN, data={"name": "Ada", "password": "wrong"})).status_code == 403
                delays.append((await client.post(SIGN_IN, data={"name": "Ada", "password": PASSWORD})).headers["retry-after"])
                time_passed[0] += 2.0
            assert delays == ["1", "2", "2", "2"]

    asyncio.run(run())


def test_wrong_passwords_delay_the_next_try_and_nobody_else(tmp_path: Path) -> None:
    async def run() -> None:
        store = store_with_ada(tmp_path)
        async with browser(store) as client:
            wrong = {"name": "Ada", "password": "wrong"}
            statuses = [(await client.post(SIGN_IN, data=wrong)).status_code for _ in range(3)]
            late = await client.post(SIGN_IN, data={"name": "Ada", "password": PASSWORD})
            assert (statuses, late.status_code) == ([403] * 3, 429)
            assert late.headers["retry-after"] == "1"
            unknown = await client.post(SIGN_IN, data={"name": "Nobody", "password": PASSWORD})
            assert "The name or the password is wrong." in unknown.text
            link = store.add_link("Ada")
            assert "Signed in" in (await client.get(f"{SIGN_IN}?link={link}")).text, "a link works always"

    asyncio.run(run())
