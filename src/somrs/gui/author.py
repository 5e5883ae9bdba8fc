"""Who the user of a page is."""

from __future__ import annotations

from nicegui import app

from somrs.client.client import client_name
from somrs.gui.account_menu import who


def author() -> str:
    """The user's name as histories record it: that of the account; if nobody signs in, the one entered in this browser, or the user of this
    machine. `person_name` formats it."""
    identity = who()
    return identity.name if identity is not None else str(app.storage.user.get("author") or client_name())
