"""Asking once more before something goes that others may want."""

from __future__ import annotations

from nicegui import ui


async def confirm(text: str, label: str) -> bool:
    """Whether whoever sits there wants it, after they read what it means; the button that says so is called `label`."""
    with ui.dialog() as dialog, ui.card().classes("somrs-dialog"):
        ui.label(text)
        with ui.element("div").classes("somrs-dialog-ways"):
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("flat no-caps")
            ui.button(label, on_click=lambda: dialog.submit(True)).props("unelevated no-caps color=negative")
    agreed = await dialog
    dialog.delete()
    return bool(agreed)
