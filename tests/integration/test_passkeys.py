"""Passkeys at the windows' server: adding them, signing in with them, and answers that prove nothing."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.applications import Starlette
from starlette.routing import Route

from somrs.access.passkeys import CHALLENGE_TIME, Challenges
from somrs.access.rights import PersonRole
from somrs.access.state import MAX_PASSKEYS, Subject
from somrs.access.store import AccessStore
from somrs.api.guard import Guard
from somrs.errors import UsageError
from somrs.gui.sign_in import SignIn, is_open, sign_in_first
from somrs.storage.audit_log import Actor, AuditLog
from tests.integration.test_access import bearer
from tests.integration.test_sign_in import who
from tests.support.soft_authenticator import SoftAuthenticator

OWN_URL = "http://robots.example"
ADDRESS = "10.0.0.1"


@asynccontextmanager
async def browser(store: AccessStore, url: str = OWN_URL) -> AsyncIterator[httpx.AsyncClient]:
    pages = Starlette(routes=[*SignIn(store, "/look.css", passkey_script="/passkeys.js").routes(), Route("/map", who)])
    guard = Guard(pages, store, is_open=is_open, refuse=sign_in_first)
    transport = httpx.ASGITransport(app=guard, client=(ADDRESS, 1))
    async with httpx.AsyncClient(transport=transport, base_url=url, headers={"Accept": "text/html"}) as client:
        yield client


def store_with_ada(tmp_path: Path) -> AccessStore:
    store = AccessStore(tmp_path)
    store.add_account("Ada", PersonRole.ADMINISTRATOR)
    return store


async def add(client: httpx.AsyncClient, store: AccessStore, device: SoftAuthenticator, name: str, person: str = "Ada") -> httpx.Response:
    """Add the device's passkey to an account."""
    session = bearer(store.open_session(person))
    options = await client.post("/passkeys/options", headers=session)
    assert options.status_code == 200, options.text
    return await client.post("/passkeys", json={"name": name, "credential": device.create(options.json())}, headers=session)


async def sign_in(client: httpx.AsyncClient, device: SoftAuthenticator) -> httpx.Response:
    options = (await client.post("/sign-in/passkey/options")).json()
    return await client.post("/sign-in/passkey", json={"credential": device.get(options), "next": "/map"})


def test_a_passkey_signs_a_person_in(tmp_path: Path) -> None:
    async def run() -> None:
        store, device = store_with_ada(tmp_path), SoftAuthenticator(OWN_URL)
        async with browser(store) as client:
            assert "passkey" not in (await client.get("/sign-in")).text, "nobody has one"
            assert (await add(client, store, device, "Phone")).status_code == 200
            assert 'data-next="/map"' in (await client.get("/sign-in?next=/map")).text
            signed_in = await sign_in(client, device)
            assert (signed_in.status_code, signed_in.json()) == (200, {"next": "/map"})
            assert "HttpOnly" in signed_in.headers["set-cookie"]
            assert (await client.get("/map")).text == "Ada"
        (passkey,) = store.read().passkeys_of("Ada")
        assert (passkey.name, passkey.host, passkey.sign_count) == ("Phone", "robots.example", 1)
        assert passkey.used_at is not None
        addition, *_, usage = (entry for entry in AuditLog(tmp_path).entries() if "passkey" in (entry.details or {}))
        assert (addition.act, addition.actor, addition.details["passkey"]) == (
            "access.add_passkey",
            Actor(name="Ada", address=ADDRESS),
            "Phone",
        )
        assert (usage.act, usage.actor) == ("access.sign_in", Actor(name="Ada", address=ADDRESS))
        assert (usage.details["by"], usage.details["passkey"]) == ("a passkey", "Phone")

    asyncio.run(run())


def forget_user(device: SoftAuthenticator) -> None:
    device.recognizes_user = False


def act_for_another_page(device: SoftAuthenticator) -> None:
    device.origin = "http://evil.example"


def act_for_another_host(device: SoftAuthenticator) -> None:
    device.host = "evil.example"


def count_backwards(device: SoftAuthenticator) -> None:
    device.sign_count = -1


def have_another_key(device: SoftAuthenticator) -> None:
    device._key = SoftAuthenticator(OWN_URL)._key


def be_another_device(device: SoftAuthenticator) -> None:
    device.id = SoftAuthenticator(OWN_URL).id


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        (forget_user, "The passkey Phone of Ada proves nothing: User verification is required"),
        (act_for_another_page, "The passkey Phone of Ada proves nothing: Unexpected client data origin"),
        (act_for_another_host, "The passkey Phone of Ada proves nothing: Unexpected RP ID hash"),
        (count_backwards, "The passkey Phone of Ada proves nothing: Response sign count of 0 was not greater than current count of 1"),
        (have_another_key, "The passkey Phone of Ada proves nothing: Could not verify authentication signature"),
        (be_another_device, "This passkey is not known here; it may have been removed. Sign in in another way."),
    ],
)
def test_answers_that_prove_nothing(tmp_path: Path, fault: Callable[[SoftAuthenticator], None], problem: str) -> None:
    async def run() -> None:
        store, device = store_with_ada(tmp_path), SoftAuthenticator(OWN_URL)
        async with browser(store) as client:
            await add(client, store, device, "Phone")
            await sign_in(client, device)
            client.cookies.clear()
            fault(device)
            refused = await sign_in(client, device)
            assert refused.status_code == 400
            assert refused.json()["problem"].startswith(problem)
            assert "set-cookie" not in refused.headers
        *_, entry = AuditLog(tmp_path).entries()
        assert (entry.act, entry.outcome, entry.actor) == ("access.sign_in", "denied", Actor(name="", address=ADDRESS))
        assert entry.details["why"].startswith(problem)

    asyncio.run(run())


def test_an_answer_counts_once_and_for_what_it_was_asked(tmp_path: Path) -> None:
    async def run() -> None:
        store, device = store_with_ada(tmp_path), SoftAuthenticator(OWN_URL)
        store.add_account("Eve", PersonRole.VIEWER)
        async with browser(store) as client:
            await add(client, store, device, "Phone")
            options = (await client.post("/sign-in/passkey/options")).json()
            answer = {"credential": device.get(options)}
            assert (await client.post("/sign-in/passkey", json=answer)).status_code == 200
            client.cookies.clear()
            replayed = await client.post("/sign-in/passkey", json=answer)
            assert replayed.json()["problem"] == "The passkey was used too late, or a second time. Begin again."
            of_ada = (await client.post("/passkeys/options", headers=bearer(store.open_session("Ada")))).json()
            credential = SoftAuthenticator(OWN_URL).create(of_ada)
            of_eve = bearer(store.open_session("Eve"))
            stolen = await client.post("/passkeys", json={"name": "Mine", "credential": credential}, headers=of_eve)
            assert stolen.json()["problem"] == "The passkey was used too late, or a second time. Begin again."
            assert not store.read().passkeys_of("Eve")

    asyncio.run(run())


@pytest.mark.parametrize("content", [None, {}, {"credential": {}}, {"credential": {"response": {"clientDataJSON": 7}}}, [], "x"])
def test_what_is_no_answer(tmp_path: Path, content: Any) -> None:
    async def run() -> None:
        async with browser(store_with_ada(tmp_path)) as client:
            refused = await client.post("/sign-in/passkey", json=content)
            assert refused.status_code == 400
            assert refused.json()["problem"].startswith("This is not the answer of a passkey")

    asyncio.run(run())


def test_several_passkeys_of_a_person(tmp_path: Path) -> None:
    async def run() -> None:
        store, phone, key = store_with_ada(tmp_path), SoftAuthenticator(OWN_URL), SoftAuthenticator(OWN_URL)
        async with browser(store) as client:
            assert (await client.post("/passkeys/options")).status_code == 401
            await add(client, store, phone, "Phone")
            same_name = await add(client, store, key, "phone")
            assert same_name.json()["problem"] == "you have a passkey phone already; choose another name"
            assert (await add(client, store, key, "Key on the ring")).status_code == 200
            offered = await client.post("/passkeys/options", headers=bearer(store.open_session("Ada")))
            assert len(offered.json()["excludeCredentials"]) == 2, "the browser makes no second one on the same device"
            first, _ = store.read().passkeys_of("Ada")
            store.remove_passkey("Ada", first.id)
            assert (await sign_in(client, phone)).status_code == 400
            assert (await sign_in(client, key)).status_code == 200
            store.remove_passkeys("Ada")
            assert (await client.get("/map")).status_code == 303, "the session has ended, too"
            assert (await sign_in(client, key)).status_code == 400
            for number in range(MAX_PASSKEYS):
                assert (await add(client, store, SoftAuthenticator(OWN_URL), f"Passkey {number}")).status_code == 200
            too_many = await add(client, store, SoftAuthenticator(OWN_URL), "One more")
            assert "you have 20 passkeys, which is the most" in too_many.json()["problem"]

    asyncio.run(run())


def test_passkeys_end_with_their_account(tmp_path: Path) -> None:
    async def run() -> None:
        store, device = store_with_ada(tmp_path), SoftAuthenticator(OWN_URL)
        store.add_account("Eve", PersonRole.VIEWER)
        async with browser(store) as client:
            await add(client, store, device, "Phone", "Eve")
            store.remove_account("Eve")
            store.add_account("Eve", PersonRole.ADMINISTRATOR)
            assert (await sign_in(client, device)).status_code == 400

    asyncio.run(run())


def test_who_signs_in_at_a_provider_has_no_passkeys(tmp_path: Path) -> None:
    async def run() -> None:
        store = AccessStore(tmp_path)
        subject = Subject(issuer="https://login.example", id="7")
        session = bearer(store.open_session_of(subject, ["Ada"], PersonRole.VIEWER, 3600.0))
        async with browser(store) as client:
            refused = await client.post("/passkeys/options", headers=session)
            assert refused.json()["problem"].startswith("Ada signs in at https://login.example")

    asyncio.run(run())


def test_addresses_without_a_name_have_no_passkeys(tmp_path: Path) -> None:
    async def run() -> None:
        store = store_with_ada(tmp_path)
        async with browser(store, "http://127.0.0.1:8080") as client:
            refused = await client.post("/passkeys/options", headers=bearer(store.open_session("Ada")))
            assert refused.json()["problem"].startswith("Passkeys are for names, and not for IP addresses")

    asyncio.run(run())


def test_challenges_end() -> None:
    now = [100.0]
    challenges = Challenges(lambda: now[0])
    early, late = challenges.new("sign in"), challenges.new("sign in")
    now[0] += CHALLENGE_TIME - 1
    challenges.use(early, "sign in")
    now[0] += 2
    for challenge in (early, late, b"", Challenges(lambda: now[0]).new("sign in")):
        with pytest.raises(UsageError, match="Begin again"):
            challenges.use(challenge, "sign in")
