"""Who one is, in the header of every page, with the way out."""

from __future__ import annotations

from nicegui import app, ui

from somrs.access.identity import Identity, sender
from somrs.access.rights import Right

ACCESS_PAGE = "/access"

_SIGN_OUT = (
    "(() => { const form = document.createElement('form'); form.method = 'post'; form.action = '/sign-out';"
    " document.body.append(form); form.submit(); })()"
)

INSECURE_TEXT = "Insecure: whoever reaches this address may do everything. Without `--insecure`, people sign in."
OPEN_PORTS_TEXT = (
    "Programs have no certificates: whoever reaches the ports of components and devices may send messages in any name. "
    "`somrs up --certificates` gives them some."
)


def who() -> Identity | None:
    """Who has opened the page; None if anybody may, without saying who they are."""
    identity = sender.get()
    return identity if identity is not None and identity.name else None


def add_account_menu() -> None:
    """The menu of who is signed in, or a sign that nobody has to; and another one if programs need not say who they are."""
    identity = who()
    if not app.state.has_certificates:
        _add_warning("no_encryption", OPEN_PORTS_TEXT)
    if identity is None:
        _add_warning("lock_open", INSECURE_TEXT)
        return
    with ui.button(icon="person").props("flat dense no-caps").classes("somrs-account") as button:
        button.props(f'aria-label="{identity.name}: account"')
        ui.label(identity.name).classes("somrs-account-name")
        with ui.menu().props("auto-close"):
            ui.item(identity.name).props("header").classes("somrs-account-head")
            text = "People and access" if Right.ADMINISTER in identity.rights else "My account"
            ui.menu_item(text, lambda: ui.navigate.to(ACCESS_PAGE))
            ui.menu_item("Sign out", lambda: ui.run_javascript(_SIGN_OUT))


def _add_warning(icon: str, text: str) -> None:
    with ui.element("span").props(f'role="img" aria-label="{text}"').tooltip(text):  # icons are hidden from screen readers
        ui.icon(icon).classes("somrs-insecure")


def only_with(required_right: Right, *controls: ui.element) -> None:
    """Disable controls for who does not have a right, and say why."""
    identity = sender.get()
    if identity is not None and (problem := identity.lacks(required_right)) is not None:
        for control in controls:
            control.props("disable")
            control.tooltip(problem)


def may(required_right: Right) -> bool:
    """Whether who has opened the page has a right."""
    identity = sender.get()
    return identity is None or required_right in identity.rights
