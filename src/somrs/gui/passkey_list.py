"""One's own passkeys, on the page People and access."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from functools import partial
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

from nicegui import ui

from somrs.api.access import PasskeyAccess
from somrs.api.remote import LiveApi
from somrs.gui.assets import publish
from somrs.gui.components.confirm_dialog import confirm
from somrs.gui.icons import format_time
from somrs.gui.passkeys import passkey_problem
from somrs.gui.shell import notify

SCRIPT = publish("passkeys.js", resources.files("somrs.gui").joinpath("passkeys.js").read_text(encoding="utf-8"))
"""The address of the script of passkeys."""

PURPOSE = "With a passkey you sign in without a password: by fingerprint, face or PIN of this device, or with a security key."


class PasskeyList:
    """The list, with a form to add one. `change`: makes a change, and shows the page again, as `rebuild` does without a change."""

    def __init__(self, api: LiveApi, change: Callable[[Awaitable[None]], Awaitable[None]], rebuild: Callable[[], Awaitable[None]]) -> None:
        self._api, self._change, self._rebuild = api, change, rebuild

    def build(self, passkeys: tuple[PasskeyAccess, ...]) -> None:
        ui.label("Passkeys").classes("somrs-access-section").props('role="heading" aria-level="3"')
        for passkey in passkeys:
            with ui.element("div").classes("somrs-access-row").props(f'role="group" aria-label="{_quoted(f"Passkey {passkey.name}")}"'):
                ui.label(passkey.name).classes("somrs-access-name")
                usage = f"used {format_time(passkey.used_at)}" if passkey.used_at is not None else "never used"
                ui.label(f"at {passkey.host}, since {format_time(passkey.created_at)}, {usage}").classes("somrs-soft")
                ui.button("Remove", on_click=partial(self._remove, passkey)).props("flat dense no-caps")
        ui.label(PURPOSE).classes("somrs-soft")
        host = urlsplit(str(ui.context.client.request.base_url)).hostname or ""
        if problem := passkey_problem(host):
            ui.label(problem).classes("somrs-soft")
        else:
            self._build_form(len(passkeys) + 1)

    def _build_form(self, number: int) -> None:
        with ui.element("div").classes("somrs-access-form") as form:
            ui.input("Name of the passkey", value=f"Passkey {number}").props("dense outlined maxlength=80")
            button = ui.button("Add passkey", icon="fingerprint").props("unelevated no-caps")
            # In the browser itself: it asks for a passkey only where somebody has just clicked.
            button.on("click", js_handler=f"() => addPasskey(getHtmlElement({form.id}))")
        form.on("added", self._show_added, ["detail"])

    async def _show_added(self, event: Any) -> None:
        if problem := event.args["detail"]:
            notify(problem, bad=True)
        else:
            notify("The passkey is added")
            await self._rebuild()

    async def _remove(self, passkey: PasskeyAccess) -> None:
        if await confirm(f"You can no longer sign in with {passkey.name}. Delete it on the device, too.", f"Remove {passkey.name}"):
            await self._change(self._api.access.remove_own_passkey(passkey.id))


def _quoted(text: str) -> str:
    """A text within a property in quotation marks."""
    return json.dumps(text)[1:-1]
