"""Dialogs for decisions: confirmation of actions that affect other users, and choices."""

from __future__ import annotations

from nicegui import ui


async def confirm(text: str, label: str) -> bool:
    """Ask the user to confirm. `text` describes the consequences; `label` names the confirming button. Returns whether the user
    confirmed."""
    return await choose(text, label, color="negative") == label


async def choose(text: str, *labels: str, color: str = "primary") -> str | None:
    """Ask the user to choose one of the actions, each a button with its label. Returns the label; None if the user cancelled."""
    with ui.dialog().props(f'role="alertdialog" aria-label="{" or ".join(labels)}"') as dialog, ui.card().classes("somrs-dialog"):
        ui.label(text)
        with ui.element("div").classes("somrs-dialog-ways"):
            ui.button("Cancel", on_click=lambda: dialog.submit(None)).props("flat no-caps")
            for label in labels:
                ui.button(label, on_click=lambda label=label: dialog.submit(label)).props(f"unelevated no-caps color={color}")
    choice = await dialog
    dialog.delete()
    return str(choice) if choice is not None else None
