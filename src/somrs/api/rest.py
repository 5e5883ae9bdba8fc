"""The operations over HTTP, and the news over a WebSocket, below `/api`. `/api` itself is the page that describes them."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from somrs.api.openapi import document
from somrs.client.hub import Hub, NewsSubscription
from somrs.client.live_news import Confirmed, Follow
from somrs.client.operations import Document, Operation, Parameter
from somrs.client.refusals import error_report, status
from somrs.entish.parse import nearest
from somrs.errors import InputError, SomrsError

log = logging.getLogger(__name__)

PAGE_LIBRARY = "fastapi_swagger"
"""Has the files of the page, and is not imported."""

PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>SO-MRS: the API</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="stylesheet" href="{root}/page/swagger-ui.css">
</head><body><div id="api"></div><script src="{root}/page/swagger-ui-bundle.js"></script>
<script>SwaggerUIBundle({{url: "{root}/openapi.json", dom_id: "#api", validatorUrl: null}})</script></body></html>"""


def has_page() -> bool:
    """Whether the library is installed that shows what the API is."""
    return find_spec(PAGE_LIBRARY) is not None


def application(operations: Sequence[Operation], hub: Hub, more: Sequence[Route | WebSocketRoute | Mount] = ()) -> Starlette:
    """Serves the operations, `openapi.json`, the page that shows it (without its library, the document itself), and the news at `live`."""

    @cache
    def described() -> bytes:
        return json.dumps(document(operations)).encode()

    async def openapi(request: Request) -> Response:
        return Response(described(), media_type="application/json")

    async def page(request: Request) -> Response:
        return HTMLResponse(PAGE.format(root=request.scope.get("root_path", "").rstrip("/")))

    async def live(socket: WebSocket) -> None:
        await _tell(socket, hub)

    routes: list[Any] = [
        *([Route("/", page), Mount("/page", StaticFiles(packages=[(PAGE_LIBRARY, "resources")]))] if has_page() else [Route("/", openapi)]),
        Route("/openapi.json", openapi),
        WebSocketRoute("/live", live),
        *more,
        # What has no parameter in its path comes first: `/tasks/preview` is not the task `preview`.
        *(Route(one.path, _served(one), methods=[one.method]) for one in sorted(operations, key=lambda one: one.path.count("{"))),
    ]
    return Starlette(routes=routes)


def _served(one: Operation) -> Any:
    async def serve(request: Request) -> Response:
        try:
            _known(one, request)
            arguments = {parameter.name: value for parameter in one.parameters for value in await _given(parameter, request)}
            found = await one.function(**arguments)
        except SomrsError as error:
            return Response(msgspec.json.encode(error_report(error)), status_code=status(error), media_type="application/json")
        if isinstance(found, Document):
            headers = {"Content-Disposition": f'attachment; filename="{found.name}"'}
            return Response(found.content, media_type=found.media_type, headers=headers)
        return Response(msgspec.json.encode(found), media_type="application/json")

    return serve


def _known(one: Operation, request: Request) -> None:
    """Raises InputError for a parameter that the operation does not have: whoever said it wanted something else than what it would do."""
    names = [parameter.name for parameter in one.parameters if parameter.place == "query"]
    for name in request.query_params:
        if name not in names:
            hint = nearest(name, names) or f"it takes {', '.join(names)}" if names else "it takes none"
            raise InputError(f"{one.method} {one.path} has no parameter {name}; {hint}")


async def _given(parameter: Parameter, request: Request) -> list[Any]:
    """The value that the request gives for the parameter; none, if it gives none and need not."""
    try:
        if parameter.place == "body":
            content = await request.body()
            if not content and not parameter.required:
                return []
            return [msgspec.json.decode(content, type=parameter.type)]
        text = request.path_params.get(parameter.name) if parameter.place == "path" else request.query_params.get(parameter.name)
        if text is None and not parameter.required:
            return []
        if text is None:
            raise InputError(f"{parameter.name} is missing; say it in the query: ?{parameter.name}=...")
        return [msgspec.convert(text, type=parameter.type, strict=False)]
    except (msgspec.ValidationError, msgspec.DecodeError) as error:
        where = "the body" if parameter.place == "body" else parameter.name
        raise InputError(f"{where}: {error}; the API's page says what is expected") from None


async def _tell(socket: WebSocket, hub: Hub) -> None:
    """Send the news of the topics that were asked for last, until the connection ends."""
    await socket.accept()
    with hub.subscribe() as listening:
        telling = asyncio.create_task(_telling(socket, listening))
        try:
            while True:
                wanted = msgspec.json.decode(await socket.receive_text(), type=Follow)
                listening.follow(wanted.follow)
                if wanted.confirm is not None:
                    await socket.send_text(msgspec.json.encode(Confirmed(confirmed=wanted.confirm)).decode())
        except msgspec.MsgspecError as error:
            await socket.close(1008, f'say what you want to hear of, such as {{"follow": ["map"]}}: {error}'[:120])
        except (WebSocketDisconnect, RuntimeError, KeyError):  # the connection ended, or what came is no text
            pass
        finally:
            telling.cancel()


async def _telling(socket: WebSocket, listening: NewsSubscription) -> None:
    async for news in listening:
        await socket.send_text(msgspec.json.encode(news).decode())
