"""Signing in at a real OpenID Connect provider, and at one that answers wrongly."""

from __future__ import annotations

import asyncio
import html
import re
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from urllib.parse import parse_qs, urljoin, urlsplit

import httpx
import pytest
from aiohttp import web
from aiohttp.test_utils import TestServer
from starlette.applications import Starlette
from starlette.routing import Route

from somrs.access import oidc
from somrs.access.oidc import MOST_BYTES, Provider
from somrs.access.oidc_settings import read_oidc_settings
from somrs.access.rights import PersonRole
from somrs.access.store import AccessStore
from somrs.api.guard import Guard
from somrs.errors import UsageError
from somrs.gui.sign_in import SignIn, is_open, sign_in_first
from somrs.gui.sign_in_page import SIGN_OUT
from somrs.storage.audit_log import Actor, AuditEntry, AuditLog
from tests.integration.test_sign_in import who
from tests.support.oidc_provider import PEOPLE, RunningProvider, running_provider

OWN_URL = "http://robots.example"
ADDRESS = "10.0.0.1"


@pytest.fixture(scope="module")
def provider() -> Iterator[RunningProvider]:
    with running_provider(OWN_URL) as running:
        yield running


@pytest.fixture(autouse=True)
def _right_again(provider: RunningProvider) -> Iterator[None]:
    yield
    provider.answer_wrongly("")
    provider.change_people(PEOPLE)


@pytest.fixture
def store(tmp_path: Path) -> AccessStore:
    return AccessStore(tmp_path)


class Visitor:
    """A browser with cookies of this system, `browser`, and of the provider."""

    def __init__(self, browser: httpx.AsyncClient, provider_client: httpx.AsyncClient) -> None:
        self.browser, self._provider_client = browser, provider_client

    async def identified(self, login: str, page: str = "/map") -> str:
        """Begin to sign in, prove to be somebody at the provider, and return the address to which it sends the browser back."""
        redirection = await self.browser.get(f"/sign-in/provider?next={page}")
        assert redirection.status_code == 303, redirection.text
        address = str(redirection.headers["location"])
        while not address.startswith(OWN_URL):
            answer = await self._provider_client.get(address)
            if not answer.has_redirect_location:  # who has signed in there before is not asked again
                form = re.search(r'<form[^>]* action="([^"]+)"', answer.text)
                assert form is not None, answer.text
                sent = {"prompt": "login", "login": login, "password": "x"}
                answer = await self._provider_client.post(urljoin(address, html.unescape(form[1])), data=sent)
            address = urljoin(address, answer.headers["location"])
        return address

    async def sign_in(self, login: str) -> httpx.Response:
        return await self.browser.get(await self.identified(login))


@asynccontextmanager
async def visitor(store: AccessStore, provider: Provider, address: str = ADDRESS) -> AsyncIterator[Visitor]:
    pages = Starlette(routes=[*SignIn(store, "/look.css", provider=provider).routes(), Route("/map", who)])
    transport = httpx.ASGITransport(app=Guard(pages, store, is_open=is_open, refuse=sign_in_first), client=(address, 1))
    async with (
        httpx.AsyncClient(transport=transport, base_url=OWN_URL, headers={"Accept": "text/html"}) as browser,
        httpx.AsyncClient(timeout=None) as provider_client,
    ):
        yield Visitor(browser, provider_client)


def configured(provider: RunningProvider, folder: Path, further: str = "") -> Provider:
    return Provider(read_oidc_settings(provider.write_settings(folder, further)))


def alert(response: httpx.Response) -> str:
    shown = re.search(r'role="alert">([^<]*)<', response.text)
    return html.unescape(shown[1]) if shown is not None else ""


def sign_ins(folder: Path) -> list[AuditEntry]:
    return [entry for entry in AuditLog(folder).entries() if entry.act == "access.sign_in"]


def test_a_session_begins_and_ends(tmp_path: Path, store: AccessStore, provider: RunningProvider) -> None:
    async def run() -> None:
        async with visitor(store, configured(provider, tmp_path)) as ada:
            form = await ada.browser.get("/sign-in?next=/map%3Fstorey=1")
            assert (
                '<a class="somrs-sign-in-other" href="/sign-in/provider?next=%2Fmap%3Fstorey%3D1">Sign in with Example Ltd</a>' in form.text
            )
            signed_in = await ada.sign_in("ada")
            assert 'content="0;url=/map"' in signed_in.text
            session_cookie, flow_cookie = signed_in.headers.get_list("set-cookie")
            assert "HttpOnly; Max-Age=43200; Path=/; SameSite=strict" in session_cookie
            assert "Max-Age=0" in flow_cookie
            assert (await ada.browser.get("/map")).text == "Ada Lovelace"
            sign_out = await ada.browser.post(SIGN_OUT)
            refresh = re.search(r'content="0;url=([^"]+)"', sign_out.text)
            assert refresh is not None
            address = urlsplit(html.unescape(refresh[1]))
            assert f"{address.scheme}://{address.netloc}" == provider.issuer
            assert parse_qs(address.query) == {"client_id": ["somrs"], "post_logout_redirect_uri": [f"{OWN_URL}/sign-in"]}
            assert (await ada.browser.get("/map")).status_code == 303
        (account,) = store.read().accounts.values()
        assert (account.name, account.role, account.provider) == ("Ada Lovelace", PersonRole.ENGINEER, provider.issuer)
        (entry,) = sign_ins(tmp_path)
        assert (entry.outcome, entry.actor) == ("done", Actor(name="Ada Lovelace", address=ADDRESS))
        assert entry.details["by"] == provider.issuer
        assert entry.details["role"] == "engineer"

    asyncio.run(run())


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        ("issuer", "The answer is of https://evil.example and not of Example Ltd. Begin again."),
        ("audience", "The answer of Example Ltd is for ['another-client'] and not for this system. Begin again."),
        ("nonce", "The answer of Example Ltd is for another sign-in. Begin again."),
        ("expired", "The answer of Example Ltd is not valid any more. Begin again; if that does not help, a clock is wrong."),
        ("early", "The answer of Example Ltd is not valid yet: a clock is wrong, there or here."),
        ("key", "The answer is signed with a key that is none of Example Ltd."),
        ("forged", "The answer of Example Ltd is not signed as it has to be"),
        ("unsigned", "The answer of Example Ltd is not signed as it has to be"),
    ],
)
def test_answers_that_prove_nothing(tmp_path: Path, store: AccessStore, provider: RunningProvider, fault: str, problem: str) -> None:
    async def run() -> None:
        async with visitor(store, configured(provider, tmp_path)) as ada:
            provider.answer_wrongly(fault)
            refused = await ada.sign_in("ada")
            assert refused.status_code == 403
            assert alert(refused).startswith(problem)
            assert (await ada.browser.get("/map")).status_code == 303
            provider.answer_wrongly("")
            assert "Signed in" in (await ada.sign_in("ada")).text, "another try is looked at"
        denied, done = sign_ins(tmp_path)
        assert (denied.outcome, denied.actor, denied.details["by"]) == ("denied", Actor(name="", address=ADDRESS), provider.issuer)
        assert denied.details["why"].startswith(problem)
        assert done.outcome == "done"

    asyncio.run(run())


def test_a_code_proves_who_one_is_once_and_in_one_browser(tmp_path: Path, store: AccessStore, provider: RunningProvider) -> None:
    async def run() -> None:
        client = configured(provider, tmp_path)
        async with visitor(store, client) as ada, visitor(store, client, "10.0.0.2") as thief:
            address = await ada.identified("ada")
            await thief.identified("eve")
            foreign = await thief.browser.get(address)
            assert alert(foreign) == "This sign-in did not begin in this browser, or too long ago. Begin again."
            assert alert(await thief.browser.get(address)) == alert(foreign), "without anything that has redirection, too"
            flow = dict(ada.browser.cookies)
            assert "Signed in" in (await ada.browser.get(address)).text
            thief.browser.cookies = httpx.Cookies(flow)
            replayed = await thief.browser.get(address)
            assert alert(replayed) == "Example Ltd does not accept this sign-in any more: it was used, or its time is over. Begin again."
            assert (await thief.browser.get("/map")).status_code == 303

    asyncio.run(run())


def test_what_the_provider_says_instead_of_a_code(tmp_path: Path, store: AccessStore, provider: RunningProvider) -> None:
    async def run() -> None:
        async with visitor(store, configured(provider, tmp_path)) as eve:
            redirection = await eve.browser.get("/sign-in/provider")
            state = parse_qs(urlsplit(redirection.headers["location"]).query)["state"][0]
            answer = {"state": state, "error": "access_denied", "error_description": "<b>not today</b>", "iss": provider.issuer}
            refused = await eve.browser.get("/sign-in/return", params=answer)
            assert alert(refused) == "Example Ltd did not sign you in (access_denied: <b>not today</b>)."
            assert "<b>" not in refused.text
            redirection = await eve.browser.get("/sign-in/provider")
            state = parse_qs(urlsplit(redirection.headers["location"]).query)["state"][0]
            mixed_up = await eve.browser.get("/sign-in/return", params={"state": state, "code": "1", "iss": "https://evil.example"})
            assert alert(mixed_up) == "The answer is of https://evil.example and not of Example Ltd. Begin again."

    asyncio.run(run())


def test_the_provider_changes_its_keys(tmp_path: Path, store: AccessStore, provider: RunningProvider) -> None:
    async def run() -> None:
        async with visitor(store, configured(provider, tmp_path)) as ada:
            for _ in range(2):
                assert "Signed in" in (await ada.sign_in("ada")).text
                provider.change_keys()

    asyncio.run(run())


def test_a_key_that_the_provider_has_withdrawn_proves_nothing(
    tmp_path: Path, store: AccessStore, provider: RunningProvider, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def run() -> None:
        async with visitor(store, configured(provider, tmp_path)) as ada:
            assert "Signed in" in (await ada.sign_in("ada")).text
            provider.change_keys()
            provider.answer_wrongly("withdrawn")
            monkeypatch.setattr(oidc, "DISCOVERY_SECONDS", -1.0)  # the time is over for which what it said is used
            assert alert(await ada.sign_in("ada")) == "The answer is signed with a key that is none of Example Ltd."
            provider.answer_wrongly("")
            assert "Signed in" in (await ada.sign_in("ada")).text

    asyncio.run(run())


def test_the_provider_says_what_the_role_is(tmp_path: Path, store: AccessStore, provider: RunningProvider) -> None:
    async def run() -> None:
        client = configured(provider, tmp_path)
        async with visitor(store, client) as grace, visitor(store, client, "10.0.0.2") as eve:
            assert "Signed in" in (await grace.sign_in("grace")).text
            assert store.read().accounts["Grace"].role is PersonRole.ADMINISTRATOR, "the role with most rights counts"
            provider.change_people({**PEOPLE, "grace": {"name": "Grace Hopper", "groups": ["robot-operators"]}})
            await grace.sign_in("grace")
            assert {account.name: account.role for account in store.read().accounts.values()} == {"Grace": PersonRole.OPERATOR}, (
                "the name stays"
            )
            refused_change = pytest.raises(UsageError, match=f"Grace signs in at {provider.issuer}, which also says what the role is")
            with refused_change:
                store.set_role("Grace", PersonRole.ENGINEER)
            with refused_change:
                store.set_password("Grace", "hash")
            provider.change_people({**PEOPLE, "grace": {"name": "Grace"}})
            assert (await grace.browser.get("/map")).text == "Grace"
            refused = await eve.sign_in("grace")
            assert alert(refused) == "Example Ltd knows you as Grace, but has given you no role here. Ask who runs this site."
            assert (await grace.browser.get("/map")).status_code == 303, "who has no role any more is signed out everywhere"
        entries = sign_ins(tmp_path)
        assert [(entry.outcome, entry.details.get("role"), entry.details.get("before")) for entry in entries] == [
            ("done", "administrator", None),
            ("done", "operator", "administrator"),
            ("denied", None, None),
        ]
        assert entries[-1].details["name"] == "Grace"

    asyncio.run(run())


def test_nobody_gets_the_name_of_somebody_else(tmp_path: Path, store: AccessStore, provider: RunningProvider) -> None:
    async def run() -> None:
        store.add_account("Grace", PersonRole.ADMINISTRATOR)
        client = configured(provider, tmp_path, "everyone: viewer\n")
        for login in ("ada", "ada2", "grace", "nameless", "eve"):
            async with visitor(store, client) as person:
                assert "Signed in" in (await person.sign_in(login)).text
        assert {account.name: account.role for account in store.read().accounts.values()} == {
            "Grace": PersonRole.ADMINISTRATOR,
            "Ada Lovelace": PersonRole.ENGINEER,
            "Ada Lovelace (ada.2)": PersonRole.OPERATOR,
            "Grace (grace)": PersonRole.ADMINISTRATOR,
            "nameless": PersonRole.OPERATOR,
            "Eve": PersonRole.VIEWER,
        }

    asyncio.run(run())


def test_a_provider_that_is_away_keeps_nobody_from_signing_in_otherwise_or_out(tmp_path: Path, store: AccessStore) -> None:
    async def run() -> None:
        with running_provider(OWN_URL) as provider:
            client = configured(provider, tmp_path)
            async with visitor(store, client) as ada:
                assert "Signed in" in (await ada.sign_in("ada")).text
        new_client = Provider(client.settings)
        async with visitor(store, new_client) as ada_later:
            ada_later.browser.cookies = ada.browser.cookies
            assert (await ada_later.browser.get("/map")).text == "Ada Lovelace"
            assert (await ada_later.browser.post(SIGN_OUT)).headers["location"] == "/sign-in"
            refused = await ada_later.browser.get("/sign-in/provider")
            assert refused.status_code == 503
            assert alert(refused).startswith(f"Example Ltd cannot be reached at {provider.issuer}/.well-known/openid-configuration")
            assert 'name="password"' in refused.text

    asyncio.run(run())


@pytest.mark.parametrize(
    ("content", "status", "problem"),
    [
        (b"x" * (MOST_BYTES + 1), 200, f"Example Ltd answers with more than {MOST_BYTES} bytes at http"),
        (b"<html>", 200, "Example Ltd answers with what is not understood"),
        (b"{}", 200, "Example Ltd answers with what is not understood"),
        (b"", 500, "Example Ltd answers with status 500 at http"),
    ],
)
def test_what_is_no_provider(tmp_path: Path, store: AccessStore, content: bytes, status: int, problem: str) -> None:
    async def answer(_: web.Request) -> web.Response:
        return web.Response(body=content, status=status)

    async def run() -> None:
        application = web.Application()
        application.router.add_get("/.well-known/openid-configuration", answer)
        async with TestServer(application) as server:
            file = RunningProvider(f"http://127.0.0.1:{server.port}").write_settings(tmp_path)
            async with visitor(store, Provider(read_oidc_settings(file))) as ada:
                refused = await ada.browser.get("/sign-in/provider")
                assert (refused.status_code, alert(refused)[: len(problem)]) == (503, problem)

    asyncio.run(run())


def test_a_provider_has_to_be_called_as_it_calls_itself(tmp_path: Path, store: AccessStore, provider: RunningProvider) -> None:
    async def run() -> None:
        file = provider.write_settings(tmp_path)
        file.write_text(file.read_text("utf-8").replace("127.0.0.1", "localhost"), encoding="utf-8")
        async with visitor(store, Provider(read_oidc_settings(file))) as ada:
            refused = await ada.browser.get("/sign-in/provider")
            assert alert(refused) == f"Example Ltd calls itself {provider.issuer}; whoever runs this site has to write that as `issuer`"

    asyncio.run(run())
