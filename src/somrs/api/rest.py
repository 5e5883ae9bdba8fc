"""The operations over HTTP and the news over a WebSocket, below `/api`. `/api` itself shows their documentation."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import BaseRoute, Match, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from somrs.access.auditor import FAILED, Auditor, current_actor
from somrs.access.rights import Right
from somrs.api.guard import refusal, require
from somrs.api.openapi import document
from somrs.api.topics import allowed_topics
from somrs.api.unknown_fields import unknown_fields
from somrs.client.api_client import JSON
from somrs.client.hub import Hub, NewsSubscription
from somrs.client.live_news import Confirmed, Follow
from somrs.client.operations import Document, Operation, Parameter
from somrs.client.refusals import Forbidden, NotFound, Unauthenticated, WrongFormat, WrongMethod, error_report, status
from somrs.entish.parse import nearest
from somrs.errors import InputError, SomrsError
from somrs.limits import limits
from somrs.protocol.messages.ranges import check_ranges

log = logging.getLogger(__name__)

PAGE_LIBRARY = "fastapi_swagger"
"""The package that contains the files of the documentation page; it is not imported."""

_PAGE_FILES: list[str | tuple[str, str]] = [("somrs.api", "page"), (PAGE_LIBRARY, "resources")]
"""The folders with the files of the page, by package."""

_PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>SO-MRS: the API</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="stylesheet" href="{root}/page/swagger-ui.css">
<link rel="stylesheet" href="{root}/page/page.css"></head><body><div id="api" data-root="{root}"></div>
<script src="{root}/page/swagger-ui-bundle.js"></script><script type="module" src="{root}/page/page.js"></script></body></html>"""


def _has_page() -> bool:
    """Whether the package with the documentation page is installed."""
    return find_spec(PAGE_LIBRARY) is not None


SocketEndpoint = Callable[[WebSocket], Awaitable[None]]


def application(operations: Sequence[Operation], hub: Hub, sockets: Mapping[str, SocketEndpoint], auditor: Auditor) -> Starlette:
    """The web application: the operations, `openapi.json`, the news at `live`, other `sockets`, and at the root the documentation page.

    `auditor`: records what changes something, and what was denied to those who were let in. Where the package `PAGE_LIBRARY` is not
    installed, the root returns the OpenAPI document.
    """

    @cache
    def document_bytes() -> bytes:
        return json.dumps(document(operations)).encode()

    async def openapi(request: Request) -> Response:
        require(Right.SEE)
        return Response(document_bytes(), media_type="application/json")

    async def page(request: Request) -> Response:
        require(Right.SEE)
        return HTMLResponse(_PAGE.format(root=request.scope.get("root_path", "").rstrip("/")))

    async def live(socket: WebSocket) -> None:
        await _serve_news(socket, hub)

    routes: list[BaseRoute] = [
        *([Route("/", page), Mount("/page", StaticFiles(packages=_PAGE_FILES))] if _has_page() else [Route("/", openapi)]),
        Route("/openapi.json", openapi),
        *(WebSocketRoute(path, for_viewers(endpoint)) for path, endpoint in {"/live": live, **sockets}.items()),
        # Paths without parameters come first: `/tasks/preview` is not the task `preview`.
        *(
            Route(operation.path, _endpoint(operation, auditor), methods=[operation.method])
            for operation in sorted(operations, key=lambda operation: operation.path.count("{"))
        ),
    ]
    routes.append(WebSocketRoute("/{path:path}", _deny_socket))
    # Starlette itself would answer in plain text.
    return Starlette(routes=routes, exception_handlers={HTTPException: _refuse_unserved, SomrsError: _refuse})


async def _refuse(request: Request, error: Exception) -> Response:
    assert isinstance(error, SomrsError)
    return refusal(error)


async def _refuse_unserved(request: Request, error: Exception) -> Response:
    """Answer a request for which there is no route: the path does not exist, or does not have the method."""
    assert isinstance(error, HTTPException)
    path, root = request.url.path, request.scope.get("root_path", "")
    routes = [route for route in request.app.routes if isinstance(route, Route)]
    if error.status_code == 405:
        at_path = [route for route in routes if route.matches(request.scope)[0] is not Match.NONE]
        methods = sorted({method for route in at_path for method in route.methods or ()} - {"HEAD"}) or ["GET"]
        problem = f"{path} has no {request.method}; it has {' and '.join(methods)}"
        return refusal(WrongMethod(problem), {"Allow": ", ".join(methods)})
    if path in _sockets(request):
        return refusal(NotFound(f"{path} is a WebSocket; connect to it with ws:// in place of http://"))
    hint = nearest(path.removeprefix(root), {route.path for route in routes}).replace(" /", f" {root}/")
    return refusal(NotFound(f"there is no {path}; {hint or f'{root}/openapi.json describes what there is'}"))


def for_viewers(endpoint: SocketEndpoint) -> SocketEndpoint:
    """A WebSocket for those who have the right to see."""

    async def serve(socket: WebSocket) -> None:
        try:
            require(Right.SEE)
        except SomrsError as error:
            await socket.send_denial_response(refusal(error))
        else:
            await endpoint(socket)

    return serve


async def _deny_socket(socket: WebSocket) -> None:
    problem = f"there is no WebSocket at {socket.url.path}; there are {' and '.join(_sockets(socket))}"
    await socket.send_denial_response(refusal(NotFound(problem)))


def _sockets(connection: HTTPConnection) -> list[str]:
    """The paths of the WebSockets."""
    root = connection.scope.get("root_path", "")
    sockets = [route for route in connection.app.routes if isinstance(route, WebSocketRoute)]
    return [f"{root}{route.path}" for route in sockets if route.endpoint is not _deny_socket]


def _endpoint(operation: Operation, auditor: Auditor) -> Any:
    async def serve(request: Request) -> Response:
        try:
            identity = require(operation.required_right)
            _check_parameters(operation, request)
            arguments = {parameter.name: value for parameter in operation.parameters for value in await _read_argument(parameter, request)}
            if not identity.speaks_for_others:
                arguments = with_author(operation, arguments, identity.name)
            if operation.changes:
                result = await _recorded(operation, arguments, auditor)
            else:
                result = await operation.function(**arguments)
        except (Forbidden, Unauthenticated) as error:
            await asyncio.to_thread(auditor.denied, operation.name, current_actor(), str(error))
            return refusal(error)
        except SomrsError as error:
            return refusal(error)
        if isinstance(result, Document):
            headers = {"Content-Disposition": f'attachment; filename="{result.name}"'}
            return Response(result.content, media_type=result.media_type, headers=headers)
        return Response(msgspec.json.encode(result), media_type="application/json")

    return serve


async def _recorded(operation: Operation, arguments: dict[str, Any], auditor: Auditor) -> Any:
    """The result of an operation that changes something, which is recorded unless nothing was changed."""
    actor = current_actor()
    try:
        result = await operation.function(**arguments)
    except BaseException as error:  # whatever ended it, also when it was cancelled: something may have been done
        if not isinstance(error, SomrsError) or status(error) >= 500:
            await asyncio.to_thread(auditor.done, operation.name, actor, {**arguments, "problem": str(error)}, FAILED)
        raise
    answer = {"result": result} if isinstance(result, msgspec.Struct) else {}
    await asyncio.to_thread(auditor.done, operation.name, actor, {**arguments, **answer})
    return result


AUTHOR_NAMES = ("by", "author")
"""Names of the parameters, and of the fields of bodies, that say who does what the request is about."""


def with_author(operation: Operation, arguments: dict[str, Any], name: str) -> dict[str, Any]:
    """The arguments with this name as that of the author, whatever the request states."""
    signed: dict[str, Any] = {parameter.name: name for parameter in operation.parameters if parameter.name in AUTHOR_NAMES}
    body: Any = arguments.get("body")
    for field in AUTHOR_NAMES:
        if field in getattr(body, "__struct_fields__", ()):
            signed["body"] = body = msgspec.structs.replace(body, **{field: name})
    return arguments | signed


def _check_parameters(operation: Operation, request: Request) -> None:
    """Raise InputError for a query parameter that the operation does not have, since the client expects it to have an effect."""
    names = [parameter.name for parameter in operation.parameters if parameter.place == "query"]
    for name in request.query_params:
        if name not in names:
            hint = nearest(name, names) or f"it takes {', '.join(names)}" if names else "it takes none"
            raise InputError(f"{operation.method} {operation.path} has no parameter {name}; {hint}")


async def _read_argument(parameter: Parameter, request: Request) -> list[Any]:
    """The value of the parameter in the request; an empty list if the parameter is optional and absent."""
    try:
        if parameter.place == "body":
            content = await request.body()
            if not content and not parameter.required:
                return []
            _check_format(request)
            value = msgspec.json.decode(content, type=parameter.type)
            if unknown := [*unknown_fields(msgspec.json.decode(content), value)]:
                raise InputError(f"the body: {'; '.join(unknown)}")
            check_ranges(value)
            return [value]
        text = request.path_params.get(parameter.name) if parameter.place == "path" else request.query_params.get(parameter.name)
        if text is None and not parameter.required:
            return []
        if text is None:
            raise InputError(f"{parameter.name} is missing; add it to the query: ?{parameter.name}=...")
        value = msgspec.convert(text, type=parameter.type, strict=False)
        check_ranges(value, parameter.name)
        return [value]
    except (msgspec.ValidationError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        location = "the body" if parameter.place == "body" else parameter.name
        raise InputError(f"{location}: {error}; the API's documentation page describes what is expected") from None


def _check_format(request: Request) -> None:
    """Raise WrongFormat for a body that is not JSON. What pages of other sites may send without asking is not (Fetch Standard, 2.2.2)."""
    sent = request.headers.get("content-type", "")
    if sent.partition(";")[0].strip().lower() != JSON:
        raise WrongFormat(f"send JSON, with the header `Content-Type: {JSON}`; the body was sent as {sent or 'nothing'}")


async def _serve_news(socket: WebSocket, hub: Hub) -> None:
    """Send the news of the topics in the latest `Follow` message that exist, until the connection ends."""
    await socket.accept()
    bounds = limits()
    with hub.subscribe() as subscription:
        sender = asyncio.create_task(_send_news(socket, subscription))
        try:
            while True:
                request = msgspec.json.decode(await socket.receive_text(), type=Follow)
                topics, problem = allowed_topics(request.follow, hub.topics - subscription.own_topics(), bounds)
                subscription.follow(topics)
                if problem:
                    report = error_report(NotFound(f"{problem}. The other topics of the message are followed"))
                    await socket.send_text(msgspec.json.encode(report).decode())
                if request.confirm is not None:
                    await socket.send_text(msgspec.json.encode(Confirmed(confirmed=request.confirm)).decode())
        except (msgspec.MsgspecError, RecursionError) as error:
            await socket.close(1008, f'send the topics to follow, such as {{"follow": ["map"]}}: {error}'[:120])
        except (WebSocketDisconnect, OSError, RuntimeError, KeyError):  # the connection ended, or the message is not text
            pass
        finally:
            sender.cancel()


async def _send_news(socket: WebSocket, subscription: NewsSubscription) -> None:
    async for news in subscription:
        await socket.send_text(msgspec.json.encode(news).decode())
