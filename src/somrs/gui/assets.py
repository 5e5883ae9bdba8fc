"""Text files of the windows, each at an address that changes with its content: browsers request it once and keep it."""

from __future__ import annotations

import hashlib
import mimetypes

from nicegui import app
from starlette.requests import Request
from starlette.responses import Response

from somrs.gui.cache import OWN_FILES

HEADERS = {"Cache-Control": "public, max-age=31536000, immutable"}
"""A year; `immutable` (RFC 8246): browsers do not ask whether it has changed, also when a page is reloaded."""


def publish(name: str, content: str) -> str:
    """Serve a text, and return the path of its address."""
    path = f"{OWN_FILES}{hashlib.sha256(content.encode()).hexdigest()[:16]}/{name}"
    media_type = mimetypes.guess_type(name)[0]

    async def answer(_: Request) -> Response:
        return Response(content, media_type=media_type, headers=HEADERS)

    app.add_route(path, answer)
    return path
