"""Confirmation of actions that affect other users."""

from __future__ import annotations

from nicegui import ui


async def confirm(text: str, label: str) -> bool:
    """Ask the user to confirm. `text` describes the consequences; `label` names the confirming button. Returns whether the user
    confirmed."""
    with ui.dialog().props(f'role="alertdialog" aria-label="{label}"') as dialog, ui.card().classes("somrs-dialog"):
        ui.label(text)
        with ui.element("div").classes("somrs-dialog-ways"):
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("flat no-caps")
            ui.button(label, on_click=lambda: dialog.submit(True)).props("unelevated no-caps color=negative")
    agreed = await dialog
    dialog.delete()
    return bool(agreed)
