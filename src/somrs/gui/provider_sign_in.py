"""Signing in at an OpenID Connect provider: leads the browser there, and takes it back."""

from __future__ import annotations

import base64
import logging

import msgspec
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from somrs.access.oidc import Flow, Provider
from somrs.errors import SomrsError
from somrs.gui.sign_in_page import PROVIDER_PAGE, SIGN_IN, SignInPage, address_of, browser_of

log = logging.getLogger(__name__)

RETURN_PAGE = f"{SIGN_IN}/return"
"""The provider sends browsers back to this page, and has to know its address."""

FLOW_TIME = 3600
"""Seconds in which a sign-in at the provider has to be complete."""

HOUR = 3600.0

MOST_NEXT = 1500
"""Characters of the page that was wanted: browsers drop cookies of more than 4096 bytes."""


class ProviderSignIn:
    """The routes to sign in at a provider. What has begun is in a cookie of the browser, so it outlasts a restart of this program."""

    def __init__(self, page: SignInPage, provider: Provider) -> None:
        self._page, self._provider = page, provider

    def routes(self) -> list[Route]:
        return [Route(PROVIDER_PAGE, self._begin, methods=["GET"]), Route(RETURN_PAGE, self._finish, methods=["GET"])]

    async def leave(self, request: Request) -> Response:
        """Lead who has signed out here to the provider, where one can sign out, too."""
        try:
            address = await self._provider.sign_out_url(_own_url(request, SIGN_IN))
        except SomrsError as error:
            log.warning("%s", error)
            address = None
        return self._page.leading_on(address, "Signed out here.") if address else RedirectResponse(SIGN_IN, 303)

    async def _begin(self, request: Request) -> Response:
        fields = {"next": request.query_params.get("next", "")}
        try:
            address, flow = await self._provider.begin(_own_url(request, RETURN_PAGE), fields["next"][:MOST_NEXT])
        except SomrsError as error:
            log.warning("%s", error)
            return self._page.form(fields, str(error), 503)
        response = RedirectResponse(address, 303)
        content = base64.urlsafe_b64encode(msgspec.json.encode(flow)).decode()
        # Not `strict`: the request with which the browser comes back has been begun by the provider's page.
        is_https = request.url.scheme == "https"
        response.set_cookie(self._cookie, content, max_age=FLOW_TIME, path=SIGN_IN, httponly=True, samesite="lax", secure=is_https)
        return response

    async def _finish(self, request: Request) -> Response:
        flow, settings = _flow(request.cookies.get(self._cookie, "")), self._provider.settings
        fields, store, details = {"next": flow.next if flow is not None else ""}, self._page.store, {"by": settings.issuer}
        try:
            person = await self._provider.person(flow, request.query_params, _own_url(request, RETURN_PAGE))
            if person.role is None:
                details["name"] = person.names[0]
                store.end_sessions_of(person.subject, "no role any more")
                problem = f"{settings.name} knows you as {person.names[0]}, but has given you no role here. Ask who runs this site."
                response = await self._refuse(request, fields, details, problem)
            else:
                seconds = settings.hours * HOUR
                arguments = person.subject, person.names, person.role, seconds, address_of(request), browser_of(request)
                response = self._page.begin_session(request, fields, store.open_session_of(*arguments), seconds)
        except SomrsError as error:
            response = await self._refuse(request, fields, details, str(error))
        response.delete_cookie(self._cookie, path=SIGN_IN, httponly=True, samesite="lax")
        return response

    async def _refuse(self, request: Request, fields: dict[str, str], details: dict[str, str], problem: str) -> Response:
        log.warning("somebody at %s could not sign in: %s", address_of(request), problem)
        await self._page.note_denial(request, details, problem)
        return self._page.form(fields, problem, 403)

    @property
    def _cookie(self) -> str:
        return f"{self._page.store.read().cookie}_flow"


def _own_url(request: Request, page: str) -> str:
    """A page of this server, as the browser names it."""
    return f"{str(request.base_url).rstrip('/')}{page}"


def _flow(cookie: str) -> Flow | None:
    """What a browser has kept; None if that is nothing."""
    try:
        return msgspec.json.decode(base64.urlsafe_b64decode(cookie), type=Flow)
    except (ValueError, msgspec.MsgspecError):
        return None
