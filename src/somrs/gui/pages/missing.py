"""The answer to an address that has no page."""

from __future__ import annotations

from nicegui import Client, app, ui
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from somrs.api.remote import LiveApi
from somrs.entish.parse import nearest
from somrs.gui.shell import PAGE_LINKS, page


def register(api: LiveApi) -> None:
    @app.exception_handler(404)
    async def show_page(request: Request, error: Exception) -> Response:
        if "text/html" not in request.headers.get("accept", ""):
            return PlainTextResponse("Not Found", 404)
        path = request.url.path
        hint = nearest(path, [place.path for place in PAGE_LINKS])
        with (
            Client(ui.page(""), request=request) as client,
            page("No such page", "", api, [*request.query_params]),
            ui.element("div").classes("somrs-sheet somrs-task-none").props('role="status"'),
        ):
            ui.icon("link_off").props('aria-hidden="true"')
            ui.label(f"There is no page {path}").classes("somrs-title").props('role="heading" aria-level="1"')
            ui.label(f"{hint[:1].upper()}{hint[1:]}" if hint else "Choose a page in the menu above.")
            ui.link("First page", "/")
        return client.build_response(request, 404)
