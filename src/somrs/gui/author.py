"""Who the user of a page is."""

from __future__ import annotations

from nicegui import app

from somrs.client.client import client_name


def author() -> str:
    """The user's name as histories record it: the one entered in this browser, or the user of this machine. `person_name` formats it."""
    return str(app.storage.user.get("author") or client_name())
