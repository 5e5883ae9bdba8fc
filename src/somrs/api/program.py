"""The API as a program: it serves the operations and the news below `/api`, by default at the loopback address."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from pathlib import Path

from starlette.applications import Starlette
from starlette.responses import RedirectResponse
from starlette.routing import Mount, Route

from somrs.access.auditor import Auditor
from somrs.access.store import AccessStore
from somrs.api.edge import Edge
from somrs.api.guard import Guard
from somrs.api.rest import application as api_application
from somrs.api.service import ApiService, open_api_service
from somrs.client.addresses import Addresses
from somrs.deployment.programs import until_stopped
from somrs.ports import listen_at
from somrs.runtime.bounded_http import BoundedConfig, QuietServer
from somrs.runtime.http import KEPT_TIME
from somrs.runtime.websocket_protocol import WebSocketProtocol

PATH = "/api"


async def run_api(
    data: Path, addresses: Addresses, host: str, port: int, allowed_hosts: Collection[str] = (), *, secure: bool = True
) -> None:
    """Serve the API until this process is asked to stop. `allowed_hosts`: see `Edge`. `secure`: only those have access who may."""
    server_socket, access = listen_at(host, port), AccessStore(data) if secure else None
    if access is not None:
        access.ensure_local_token()
    async with open_api_service(addresses, data, host) as service, served(service, server_socket, allowed_hosts, access) as url:
        await until_stopped("api", url)


@asynccontextmanager
async def served(
    service: ApiService, server_socket: socket.socket, allowed_hosts: Collection[str] = (), access: AccessStore | None = None
) -> AsyncIterator[str]:
    """Serve the API at the socket, and yield its URL. `access`: who has access; None: anybody."""
    host, port = server_socket.getsockname()[:2]
    auditor = Auditor(service.context.data)
    application = Edge(Guard(_site(service, auditor), access, auditor=auditor), allowed_hosts, auditor)
    # The server keeps connections longer than clients do, so that it does not close one just as a client sends a request.
    config = BoundedConfig(application, ws=WebSocketProtocol, timeout_keep_alive=KEPT_TIME + 15)
    server = QuietServer(config)
    serving = asyncio.create_task(server.serve(sockets=[server_socket]))
    while not server.started and not serving.done():
        await asyncio.sleep(0.01)
    try:
        yield f"http://{host}:{port}{PATH}"
    finally:
        server.end()
        with contextlib.suppress(asyncio.CancelledError):
            await serving


def _site(service: ApiService, auditor: Auditor) -> Starlette:
    api = api_application([*service.operations()], service.context.hub, {"/poses": service.scene.poses}, auditor)
    return Starlette(routes=[Mount(PATH, api), Route("/", lambda request: RedirectResponse(f"{PATH}/"))])
