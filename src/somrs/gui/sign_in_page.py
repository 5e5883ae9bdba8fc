"""The page to sign in, and how a session begins. It is plain HTML, and needs no other file than the style sheet."""

from __future__ import annotations

import asyncio
import html
from collections.abc import Mapping
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from somrs.access.state import SESSION_TIME
from somrs.access.store import AccessStore
from somrs.storage.audit_log import Actor

SIGN_IN, SIGN_OUT = "/sign-in", "/sign-out"
PROVIDER_PAGE = f"{SIGN_IN}/provider"
"""Leads to the provider at which people sign in."""

_PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Sign in · SO-MRS</title>{head}
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="stylesheet" href="{style}"></head>
<body class="somrs-sign-in"><main><h1>SO-MRS</h1>{content}</main></body></html>"""

_FORM = """<p>Sign in to see and operate this site.</p>{problem}{others}
<form method="post" action="/sign-in"><input type="hidden" name="next" value="{next}">
<label>Name <input name="name" autocomplete="username" value="{name}" required autofocus></label>
<label>Password <input name="password" type="password" autocomplete="current-password" required></label>
<button>Sign in</button></form>
<p class="somrs-hint">No password? <code>somrs user link NAME</code>, where the system runs, prints a link to sign in with.</p>"""

_OTHERS = """<div class="somrs-sign-in-ways"{hidden}>{ways}<p class="somrs-sign-in-or">or</p></div>"""
_PROVIDER = """<a class="somrs-sign-in-other" href="{page}?next={next}">Sign in with {name}</a>"""
_PASSKEY = """<button type="button" class="somrs-sign-in-passkey" data-next="{next}" hidden>Sign in with a passkey</button>"""

_FIRST_FORM = """<p>Nobody has an account here yet. You become the administrator, who can add others.</p>{problem}
<form method="post" action="/sign-in"><input type="hidden" name="next" value="{next}"><input type="hidden" name="link" value="{link}">
<label>Your name <input name="name" autocomplete="name" value="{name}" maxlength="80" required autofocus></label>
<button>Begin</button></form><p class="somrs-hint">The name is recorded with what you do.</p>"""


class SignInPage:
    """The page to sign in. `style`: the address of the style sheet. `provider`: the name of the provider, empty without one.
    `passkey_script`: the address of the script of passkeys, empty without them."""

    def __init__(self, store: AccessStore, style: str, provider: str = "", passkey_script: str = "") -> None:
        self.store, self._style, self._provider, self._passkey_script = store, style, provider, passkey_script

    def form(self, fields: Mapping[str, str], problem: str = "", code: int = 200, headers: Mapping[str, str] | None = None) -> Response:
        """The form, with what was typed before and what was wrong about it."""
        shown = {name: html.escape(fields.get(name, "")) for name in ("link", "next", "name")}
        alert = f'<p class="somrs-problem" role="alert">{html.escape(problem)}</p>' if problem else ""
        has_passkeys = bool(self._passkey_script and self.store.read().passkeys)
        head = f'<script type="module" src="{self._passkey_script}"></script>' if has_passkeys else ""
        ways = self._other_ways(next_page(fields), has_passkeys=has_passkeys)
        content = (_FIRST_FORM if fields.get("link") else _FORM).format(problem=alert, others=ways, **shown)
        page = _PAGE.format(head=head, style=self._style, content=content)
        return HTMLResponse(page, code, {"Cache-Control": "no-store", **(headers or {})})

    def _other_ways(self, target: str, *, has_passkeys: bool) -> str:
        """The ways to sign in besides a password. The script shows that by passkeys, where the browser has them."""
        address = html.escape(quote(target, safe=""))
        provider = _PROVIDER.format(page=PROVIDER_PAGE, next=address, name=html.escape(self._provider)) if self._provider else ""
        passkey = _PASSKEY.format(next=html.escape(target)) if has_passkeys else ""
        hidden = "" if provider else " hidden"
        return _OTHERS.format(ways=provider + passkey, hidden=hidden) if provider or passkey else ""

    def begin_session(self, request: Request, fields: Mapping[str, str], secret: str, seconds: float = SESSION_TIME) -> Response:
        """Give the browser the secret of a session, and lead it on."""
        response = self.leading_on(next_page(fields), "Signed in.")
        self.set_cookie(request, response, secret, seconds)
        return response

    def set_cookie(self, request: Request, response: Response, secret: str, seconds: float = SESSION_TIME) -> None:
        """Give the browser the secret of a session."""
        is_https, cookie = request.url.scheme == "https", self.store.read().cookie
        response.set_cookie(cookie, secret, max_age=int(seconds), httponly=True, samesite="strict", secure=is_https)

    def leading_on(self, address: str, text: str) -> Response:
        """A page that goes on itself. Browsers send the cookie with no request that another site's page has begun, nor with its
        redirections; and the policy of the pages does not let forms lead to other sites."""
        target = html.escape(address)
        content = f'<p>{text} <a href="{target}">Go on</a></p>'
        head = f'<meta http-equiv="refresh" content="0;url={target}">'
        return HTMLResponse(_PAGE.format(head=head, style=self._style, content=content), headers={"Cache-Control": "no-store"})

    async def note_denial(self, request: Request, details: Mapping[str, object], reason: str) -> None:
        """Record that somebody could not sign in."""
        actor = Actor(name="", address=address_of(request))
        await asyncio.to_thread(self.store.auditor.denied, "access.sign_in", actor, reason, details)


def next_page(fields: Mapping[str, str]) -> str:
    """The page of this server that was wanted; the first one if it is of another."""
    page = fields.get("next", "")
    is_own = page.startswith("/") and not page.startswith(("//", "/\\")) and page.isprintable()
    return page if is_own else "/"


def address_of(request: Request) -> str:
    return request.client.host if request.client is not None else ""


def browser_of(request: Request) -> str:
    return request.headers.get("user-agent", "")
