"""The windows' server: the pages, and, below `/api`, the API, which runs elsewhere. Browsers ask nobody else, and it binds the loopback
address unless told otherwise."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import uvicorn

from somrs.api.remote import LiveApi, live_api
from somrs.client.api_client import address_of
from somrs.client.client import Addresses
from somrs.deployment.programs import until_stopped
from somrs.gui.cache import Cache
from somrs.gui.proxy import Proxy
from somrs.ports import bound
from somrs.runtime.http import QuietServer

if TYPE_CHECKING:
    from fastapi import FastAPI

SECRET_FILE = "gui.secret"
"""In the data folder: what the cookies of browsers are signed with, so that a restart does not forget their settings."""

RECONNECT_TIME = 60.0
"""Seconds for which a page is kept whose browser is silent, as one that is busy with drawing may be: 0.4 of them until it counts as gone,
and all of them until it is forgotten. A page that was forgotten is loaded anew, and what people were doing on it is lost."""


async def run_gui(data: Path, addresses: Addresses, host: str, port: int) -> None:
    """Serve the windows until this process is to end."""
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str((data / "gui").resolve()))  # read when NiceGUI is imported
    listener = bound(host, port)
    async with live_api(address_of(addresses)) as api:
        config = uvicorn.Config(
            Cache(_application(api, data)), log_level="warning", access_log=False, ws="websockets-sansio", timeout_graceful_shutdown=1
        )
        server = QuietServer(config)
        serving = asyncio.create_task(server.serve(sockets=[listener]))
        while not server.started and not serving.done():
            await asyncio.sleep(0.01)
        await until_stopped("gui", f"http://{host}:{listener.getsockname()[1]}")
        server.should_exit = True
        with contextlib.suppress(asyncio.CancelledError):
            await serving


def _application(api: LiveApi, data: Path) -> FastAPI:
    from fastapi import FastAPI
    from nicegui import app, ui

    from somrs.gui.pages import define, fleet, history, map, ontology, start, tasks

    pages = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    pages.mount("/api", Proxy(api.client))
    app.add_static_file(local_file=str(resources.files("somrs.gui").joinpath("look.css")), url_path="/look/look.css")
    for page_module in (start, map, ontology, define, tasks, fleet, history):
        page_module.register(api)
    ui.run_with(
        pages,
        title="SO-MRS",
        dark=None,
        storage_secret=_secret(data),
        show_welcome_message=False,
        reconnect_timeout=RECONNECT_TIME,
        language="en-US",
        tailwind=False,  # the look is all in look.css; Tailwind would read every page anew at each of its changes
    )
    return pages


def _secret(data: Path) -> str:
    file = data / SECRET_FILE
    if not file.exists():
        file.touch(mode=0o600)
        file.write_text(secrets.token_urlsafe(32), encoding="ascii")
    return file.read_text(encoding="ascii")
