"""What browsers ask the windows for to add a passkey, and to sign in with one. It is for the name under which they reach the windows."""

from __future__ import annotations

import ipaddress
import logging
from collections.abc import Awaitable, Callable
from typing import Any
from urllib.parse import urlsplit

import msgspec
from msgspec import Struct
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from somrs.access.identity import sender
from somrs.access.passkeys import Challenges, challenge_of, registered, registration_options, sign_count_of, sign_in_options
from somrs.api.guard import SIGN_IN_HINT, refusal
from somrs.client.refusals import Unauthenticated
from somrs.errors import SomrsError, UsageError
from somrs.gui.sign_in_page import SIGN_IN, SignInPage, address_of, browser_of, next_page

log = logging.getLogger(__name__)

PASSKEYS = "/passkeys"
SIGN_IN_PASSKEY = f"{SIGN_IN}/passkey"

MOST_BYTES = 100_000
"""Bytes of what a browser sends."""

SIGNING_IN = "sign in"


class _NewPasskey(Struct, frozen=True, kw_only=True):
    name: str
    credential: dict[str, Any]


class _UsedPasskey(Struct, frozen=True, kw_only=True):
    credential: dict[str, Any]
    next: str = ""


class PasskeySignIn:
    """The routes of passkeys."""

    def __init__(self, page: SignInPage) -> None:
        self._page, self._challenges = page, Challenges()

    def routes(self) -> list[Route]:
        return [
            Route(f"{PASSKEYS}/options", _answering(self._begin_adding), methods=["POST"]),
            Route(PASSKEYS, _answering(self._add), methods=["POST"]),
            Route(f"{SIGN_IN_PASSKEY}/options", _answering(self._begin), methods=["POST"]),
            Route(SIGN_IN_PASSKEY, _answering(self._sign_in), methods=["POST"]),
        ]

    async def _begin_adding(self, request: Request) -> Response:
        account, state = _person(), self._page.store.read()
        state.account(account).check_own()
        host, earlier_ids = _host(request), [passkey.id for passkey in state.passkeys_of(account)]
        challenge = self._challenges.new(_adding(account))
        return Response(registration_options(host, account, state.id, earlier_ids, challenge), media_type="application/json")

    async def _add(self, request: Request) -> Response:
        account, content = _person(), await _content(request, _NewPasskey)
        challenge = challenge_of(content.credential)
        self._challenges.use(challenge, _adding(account))
        passkey = registered(content.credential, challenge, _host(request), _origin(request), account, content.name)
        self._page.store.add_passkey(passkey)
        return JSONResponse({})

    async def _begin(self, request: Request) -> Response:
        return Response(sign_in_options(_host(request), self._challenges.new(SIGNING_IN)), media_type="application/json")

    async def _sign_in(self, request: Request) -> Response:
        details = {"by": "a passkey"}
        try:
            content = await _content(request, _UsedPasskey)
            challenge = challenge_of(content.credential)
            self._challenges.use(challenge, SIGNING_IN)
            passkey = self._page.store.read().passkeys.get(str(content.credential.get("id")))
            if passkey is None:
                raise UsageError("This passkey is not known here; it may have been removed. Sign in in another way.")
            details |= {"name": passkey.account, "passkey": passkey.name}
            sign_count = sign_count_of(passkey, content.credential, challenge, _host(request), _origin(request))
            secret = self._page.store.open_session_by(passkey, sign_count, address_of(request), browser_of(request))
        except SomrsError as error:
            log.warning("somebody at %s could not sign in with a passkey: %s", address_of(request), error)
            await self._page.note_denial(request, details, str(error))
            raise
        response = JSONResponse({"next": next_page({"next": content.next})})
        self._page.set_cookie(request, response, secret)
        return response


def passkey_problem(host: str) -> str:
    """Why there can be no passkeys at a host; empty if there can."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return ""
    return "Passkeys are for names, and not for IP addresses: open this page at the server's name, or at localhost on the same computer."


def _host(request: Request) -> str:
    """The name under which the browser has reached this server."""
    host = urlsplit(_origin(request)).hostname or ""
    if problem := passkey_problem(host):
        raise UsageError(problem)
    return host


def _origin(request: Request) -> str:
    return str(request.base_url).rstrip("/")


def _adding(account: str) -> str:
    return f"add a passkey of {account}"


def _person() -> str:
    """Who has signed in. Raises Unauthenticated if nobody has."""
    identity = sender.get()
    if identity is None or identity.session is None:
        raise Unauthenticated(SIGN_IN_HINT)
    return identity.name


async def _content(request: Request, type: type[_NewPasskey] | type[_UsedPasskey]) -> Any:
    body = await request.body()
    try:
        return msgspec.json.decode(body[:MOST_BYTES], type=type)
    except msgspec.MsgspecError as error:
        raise UsageError(f"This is not the answer of a passkey: {error}.") from None


def _answering(serve: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    """An endpoint that answers with a report of what is wrong."""

    async def answer(request: Request) -> Response:
        try:
            return await serve(request)
        except SomrsError as error:
            return refusal(error)

    return answer
