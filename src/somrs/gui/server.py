"""The windows' server: the pages and, below `/api`, a proxy to the API. Browsers connect to this server only. It listens on the loopback
address by default."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from somrs.access.auditor import Auditor
from somrs.access.oidc import Provider
from somrs.access.oidc_settings import read_oidc_settings
from somrs.access.store import AccessStore
from somrs.api.edge import Edge
from somrs.api.guard import Guard
from somrs.api.remote import LiveApi, live_api
from somrs.client.addresses import Addresses
from somrs.client.api_client import address_of, local_token_reader
from somrs.deployment.programs import until_stopped
from somrs.gui.cache import FILES, Cache
from somrs.gui.proxy import Proxy
from somrs.gui.sign_in import SignIn, is_open, sign_in_first
from somrs.ports import listen_at
from somrs.runtime.bounded_http import BoundedConfig, QuietServer
from somrs.runtime.websocket_protocol import WebSocketProtocol

if TYPE_CHECKING:
    from fastapi import FastAPI

SECRET_FILE = "gui.secret"
"""File in the data folder with the key that signs browser cookies, so that browser settings survive a restart."""

RECONNECT_TIME = 60.0
"""Seconds for which a page is kept when its browser does not respond, e.g. while it draws a large scene. It counts as disconnected after
0.4 of this time. A page that was dropped is reloaded, and unsaved input is lost."""


async def run_gui(
    data: Path,
    addresses: Addresses,
    host: str,
    port: int,
    allowed_hosts: Collection[str] = (),
    *,
    secure: bool = True,
    oidc: Path | None = None,
) -> None:
    """Serve the windows until the process is stopped. `allowed_hosts`: see `Edge`. `secure`: people have to sign in. `oidc`: the file of
    the provider at which they do so; None: there is none."""
    provider = Provider(read_oidc_settings(oidc)) if oidc is not None else None
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str((data / "gui").resolve()))  # NiceGUI reads this when it is imported
    listener, access = listen_at(host, port), AccessStore(data) if secure else None
    # What is done for nobody in particular only sees.
    async with live_api(address_of(addresses), local_token_reader(data, only_sees=True)) as api:
        auditor = Auditor(data)
        pages = _application(api, data, access, provider, has_certificates=addresses.trust is not None)
        guard = Guard(Cache(pages), access, is_open=_is_open, refuse=sign_in_first, auditor=auditor)
        application = Edge(guard, allowed_hosts, auditor)
        server = QuietServer(BoundedConfig(application, ws=WebSocketProtocol))
        serving = asyncio.create_task(server.serve(sockets=[listener]))
        while not server.started and not serving.done():
            await asyncio.sleep(0.01)
        await until_stopped("gui", f"http://{host}:{listener.getsockname()[1]}")
        server.end()
        with contextlib.suppress(asyncio.CancelledError):
            await serving


def _is_open(path: str) -> bool:
    """Whether a path is for people who are not signed in: the form, and files that are the same for all."""
    return is_open(path) or path.startswith(FILES)


def _application(api: LiveApi, data: Path, access: AccessStore | None, provider: Provider | None, *, has_certificates: bool) -> FastAPI:
    from fastapi import FastAPI
    from nicegui import app, ui

    from somrs.gui.pages import access as access_page
    from somrs.gui.pages import define, fleet, history, map, missing, ontology, person, start, tasks
    from somrs.gui.passkey_list import SCRIPT
    from somrs.gui.shell import LOOK

    pages = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    pages.mount("/api", Proxy(api.client))
    if access is not None:
        pages.router.routes.extend(SignIn(access, LOOK, provider=provider, passkey_script=SCRIPT).routes())
    app.state.has_certificates = has_certificates
    app.config.quasar_config["loadingBar"]["skipHijack"] = True  # no bar for requests: it has no name, and no page waits for one
    for page_module in (access_page, start, map, ontology, define, tasks, fleet, history, person, missing):
        page_module.register(api)
    ui.run_with(
        pages,
        title="SO-MRS",
        dark=None,
        storage_secret=_secret(data),
        show_welcome_message=False,
        reconnect_timeout=RECONNECT_TIME,
        language="en-US",
        tailwind=False,  # all styles are in look.css; Tailwind would parse the page again at each change
    )
    return pages


def _secret(data: Path) -> str:
    file = data / SECRET_FILE
    if not file.exists():
        file.touch(mode=0o600)
        file.write_text(secrets.token_urlsafe(32), encoding="ascii")
    return file.read_text(encoding="ascii")
