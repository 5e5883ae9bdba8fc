"""Signing in and out: by a one-time link, or by name and password. The form is plain HTML, and needs no other file than the style sheet."""

from __future__ import annotations

import asyncio
import html
import logging
import time
from collections.abc import Callable, Mapping
from urllib.parse import parse_qs, quote

from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route
from starlette.types import Scope

from somrs.access.identity import sender
from somrs.access.passwords import SignInDelays, is_right
from somrs.access.state import MAX_NAME, SESSION_TIME
from somrs.access.store import AccessStore
from somrs.errors import SomrsError
from somrs.limits import limits
from somrs.storage.audit_log import Actor

log = logging.getLogger(__name__)

SIGN_IN, SIGN_OUT = "/sign-in", "/sign-out"

_PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Sign in · SO-MRS</title>{head}
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="stylesheet" href="{style}"></head>
<body class="somrs-sign-in"><main><h1>SO-MRS</h1>{content}</main></body></html>"""

_FORM = """<p>Sign in to see and operate this site.</p>{problem}
<form method="post" action="/sign-in"><input type="hidden" name="next" value="{next}">
<label>Name <input name="name" autocomplete="username" value="{name}" required autofocus></label>
<label>Password <input name="password" type="password" autocomplete="current-password" required></label>
<button>Sign in</button></form>
<p class="somrs-hint">No password? <code>somrs user link NAME</code>, where the system runs, prints a link to sign in with.</p>"""

_FIRST_FORM = """<p>Nobody has an account here yet. You become the administrator, who can add others.</p>{problem}
<form method="post" action="/sign-in"><input type="hidden" name="next" value="{next}"><input type="hidden" name="link" value="{link}">
<label>Your name <input name="name" autocomplete="name" value="{name}" maxlength="80" required autofocus></label>
<button>Begin</button></form><p class="somrs-hint">The name is recorded with what you do.</p>"""


class SignIn:
    """The routes to sign in and out. `style`: the address of the style sheet."""

    def __init__(self, store: AccessStore, style: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._store, self._style, self._clock = store, style, clock
        bounds = limits()
        self._delays = SignInDelays(bounds.sign_in_tries, float(bounds.sign_in_seconds))

    def routes(self) -> list[Route]:
        return [
            Route(SIGN_IN, self._open, methods=["GET"]),
            Route(SIGN_IN, self._submit, methods=["POST"]),
            Route(SIGN_OUT, self._leave, methods=["POST"]),
        ]

    async def _open(self, request: Request) -> Response:
        fields = {name: request.query_params.get(name, "") for name in ("link", "next")}
        if not fields["link"]:
            return self._form(fields)
        link = self._store.link(fields["link"])
        if link is None:
            if sender.get() is not None:
                return _redirect(fields)
            return self._form(fields | {"link": ""}, "This link was used, or its time is over.")
        if link.account is None:
            return self._form(fields)
        return await self._signed_in(request, fields)

    async def _submit(self, request: Request) -> Response:
        sent = parse_qs((await request.body()).decode(errors="replace"), keep_blank_values=True)
        fields = {name: sent.get(name, [""])[0] for name in ("link", "next", "name", "password")}
        return await self._signed_in(request, fields) if fields["link"] else await self._check_password(request, fields)

    async def _signed_in(self, request: Request, fields: Mapping[str, str]) -> Response:
        """Sign in by a link."""
        try:
            secret = self._store.use_link(fields["link"], fields.get("name", ""), _address(request), _browser(request))
        except SomrsError as error:
            await self._note_denial(_address(request), {}, str(error))
            return self._form(fields, str(error))
        return self._begin_session(request, fields, secret)

    async def _check_password(self, request: Request, fields: Mapping[str, str]) -> Response:
        name, address = " ".join(fields["name"].split()), _address(request)
        if seconds := self._delays.seconds_left(name, address, self._clock()):
            problem = f"There were too many wrong tries. The next one is possible in {seconds:.0f} s."
            await self._note_denial(address, {"name": name[:MAX_NAME]}, "too many wrong tries")
            return self._form(fields, problem, 429, {"Retry-After": f"{seconds:.0f}"})
        # Before the check, which takes a while: tries at the same time count, too.
        self._delays.note_failure(name, address, self._clock())
        account = self._store.read().accounts.get(name)
        if not await asyncio.to_thread(is_right, fields["password"], account.password if account is not None else None):
            log.warning("somebody at %s tried to sign in as %r with a wrong name or password", address, name[:MAX_NAME])
            await self._note_denial(address, {"name": name[:MAX_NAME]}, "a wrong name or password")
            return self._form(fields, "The name or the password is wrong.", 403)
        self._delays.note_success(name, address)
        return self._begin_session(request, fields, self._store.open_session(name, address, _browser(request)))

    async def _note_denial(self, address: str, details: Mapping[str, object], reason: str) -> None:
        await asyncio.to_thread(self._store.auditor.denied, "access.sign_in", Actor(name="", address=address), reason, details)

    def _begin_session(self, request: Request, fields: Mapping[str, str], secret: str) -> Response:
        # The page itself goes on: browsers send the cookie with no request that another site's page has begun, nor with its redirections.
        head = f'<meta http-equiv="refresh" content="0;url={html.escape(_next_page(fields))}">'
        content = f'<p>Signed in. <a href="{html.escape(_next_page(fields))}">Go on</a></p>'
        response = HTMLResponse(_PAGE.format(head=head, style=self._style, content=content), headers={"Cache-Control": "no-store"})
        is_https = request.url.scheme == "https"
        response.set_cookie(self._store.read().cookie, secret, max_age=int(SESSION_TIME), httponly=True, samesite="strict", secure=is_https)
        return response

    async def _leave(self, request: Request) -> Response:
        identity = sender.get()
        if identity is not None and identity.session is not None:
            self._store.end_session(identity.session)
        response = RedirectResponse(SIGN_IN, 303)
        response.delete_cookie(self._store.read().cookie, httponly=True, samesite="strict")
        return response

    def _form(self, fields: Mapping[str, str], problem: str = "", code: int = 200, headers: Mapping[str, str] | None = None) -> Response:
        shown = {name: html.escape(fields.get(name, "")) for name in ("link", "next", "name")}
        alert = f'<p class="somrs-problem" role="alert">{html.escape(problem)}</p>' if problem else ""
        content = (_FIRST_FORM if fields.get("link") else _FORM).format(problem=alert, **shown)
        page = _PAGE.format(head="", style=self._style, content=content)
        return HTMLResponse(page, code, {"Cache-Control": "no-store", **(headers or {})})


def sign_in_first(scope: Scope) -> Response | None:
    """What a page answers to those who are not signed in: the form, which leads back to the page. None: it is no page."""
    accepted = dict(scope["headers"]).get(b"accept", b"")
    if scope["method"] != "GET" or b"text/html" not in accepted or scope["path"].startswith("/api"):
        return None
    query = scope["query_string"].decode("latin-1")
    page = f"{scope['path']}{f'?{query}' if query else ''}"
    return RedirectResponse(SIGN_IN if page == "/" else f"{SIGN_IN}?next={quote(page, safe='')}", 303)


def _redirect(fields: Mapping[str, str]) -> Response:
    return RedirectResponse(_next_page(fields), 303)


def _next_page(fields: Mapping[str, str]) -> str:
    """The page of this server that was wanted; the first one if it is of another."""
    page = fields.get("next", "")
    is_own = page.startswith("/") and not page.startswith(("//", "/\\")) and page.isprintable()
    return page if is_own else "/"


def _address(request: Request) -> str:
    return request.client.host if request.client is not None else ""


def _browser(request: Request) -> str:
    return request.headers.get("user-agent", "")
