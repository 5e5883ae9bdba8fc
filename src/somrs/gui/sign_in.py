"""Signing in by a one-time link, or by name and password; and signing out."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from urllib.parse import parse_qs, quote

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route
from starlette.types import Scope

from somrs.access.identity import sender
from somrs.access.oidc import Provider
from somrs.access.passwords import SignInDelays, is_right
from somrs.access.state import MAX_NAME
from somrs.access.store import AccessStore
from somrs.errors import SomrsError
from somrs.gui.passkeys import PasskeySignIn
from somrs.gui.provider_sign_in import ProviderSignIn
from somrs.gui.sign_in_page import SIGN_IN, SIGN_OUT, SignInPage, address_of, browser_of, next_page
from somrs.limits import limits

log = logging.getLogger(__name__)


class SignIn:
    """The routes to sign in and out. `style`: the address of the style sheet. `provider`: at which people sign in, too. `passkey_script`:
    the address of the script of passkeys; empty: people have none."""

    def __init__(
        self,
        store: AccessStore,
        style: str,
        clock: Callable[[], float] = time.monotonic,
        provider: Provider | None = None,
        passkey_script: str = "",
    ) -> None:
        self._store, self._clock = store, clock
        self._page = SignInPage(store, style, provider.settings.name if provider is not None else "", passkey_script)
        self._passkeys = PasskeySignIn(self._page) if passkey_script else None
        self._provider = ProviderSignIn(self._page, provider) if provider is not None else None
        bounds = limits()
        self._delays = SignInDelays(bounds.sign_in_tries, float(bounds.sign_in_seconds))

    def routes(self) -> list[Route]:
        return [
            Route(SIGN_IN, self._open, methods=["GET"]),
            Route(SIGN_IN, self._submit, methods=["POST"]),
            Route(SIGN_OUT, self._leave, methods=["POST"]),
            *(self._provider.routes() if self._provider is not None else ()),
            *(self._passkeys.routes() if self._passkeys is not None else ()),
        ]

    async def _open(self, request: Request) -> Response:
        fields = {name: request.query_params.get(name, "") for name in ("link", "next")}
        if not fields["link"]:
            return self._page.form(fields)
        link = self._store.link(fields["link"])
        if link is None:
            if sender.get() is not None:
                return RedirectResponse(next_page(fields), 303)
            return self._page.form(fields | {"link": ""}, "This link was used, or its time is over.")
        if link.account is None:
            return self._page.form(fields)
        return await self._signed_in(request, fields)

    async def _submit(self, request: Request) -> Response:
        sent = parse_qs((await request.body()).decode(errors="replace"), keep_blank_values=True)
        fields = {name: sent.get(name, [""])[0] for name in ("link", "next", "name", "password")}
        return await self._signed_in(request, fields) if fields["link"] else await self._check_password(request, fields)

    async def _signed_in(self, request: Request, fields: Mapping[str, str]) -> Response:
        """Sign in by a link."""
        try:
            secret = self._store.use_link(fields["link"], fields.get("name", ""), address_of(request), browser_of(request))
        except SomrsError as error:
            await self._page.note_denial(request, {}, str(error))
            return self._page.form(fields, str(error))
        return self._page.begin_session(request, fields, secret)

    async def _check_password(self, request: Request, fields: Mapping[str, str]) -> Response:
        name, address = " ".join(fields["name"].split()), address_of(request)
        if seconds := self._delays.seconds_left(name, address, self._clock()):
            problem = f"There were too many wrong tries. The next one is possible in {seconds:.0f} s."
            await self._page.note_denial(request, {"name": name[:MAX_NAME]}, "too many wrong tries")
            return self._page.form(fields, problem, 429, {"Retry-After": f"{seconds:.0f}"})
        # Before the check, which takes a while: tries at the same time count, too.
        self._delays.note_failure(name, address, self._clock())
        account = self._store.read().accounts.get(name)
        if not await asyncio.to_thread(is_right, fields["password"], account.password if account is not None else None):
            log.warning("somebody at %s tried to sign in as %r with a wrong name or password", address, name[:MAX_NAME])
            await self._page.note_denial(request, {"name": name[:MAX_NAME]}, "a wrong name or password")
            return self._page.form(fields, "The name or the password is wrong.", 403)
        self._delays.note_success(name, address)
        return self._page.begin_session(request, fields, self._store.open_session(name, address, browser_of(request)))

    async def _leave(self, request: Request) -> Response:
        identity = sender.get()
        response: Response = RedirectResponse(SIGN_IN, 303)
        if identity is not None and identity.session is not None:
            account = self._store.read().accounts.get(identity.name)
            self._store.end_session(identity.session)
            if self._provider is not None and account is not None and account.subject is not None:
                response = await self._provider.leave(request)
        response.delete_cookie(self._store.read().cookie, httponly=True, samesite="strict")
        return response


def is_open(path: str) -> bool:
    """Whether a path is for people who are not signed in."""
    return path in (SIGN_IN, SIGN_OUT) or path.startswith(f"{SIGN_IN}/")


def sign_in_first(scope: Scope) -> Response | None:
    """What a page answers to those who are not signed in: the form, which leads back to the page. None: it is no page."""
    accepted = dict(scope["headers"]).get(b"accept", b"")
    if scope["method"] != "GET" or b"text/html" not in accepted or scope["path"].startswith("/api"):
        return None
    query = scope["query_string"].decode("latin-1")
    page = f"{scope['path']}{f'?{query}' if query else ''}"
    return RedirectResponse(SIGN_IN if page == "/" else f"{SIGN_IN}?next={quote(page, safe='')}", 303)
