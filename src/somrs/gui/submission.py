"""Forms that do what they are for once, however often their button is pressed before the answer comes."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from nicegui import ui

from somrs.gui.shell import guarded


def submit_once(form: ui.element, button: ui.button, action: Callable[[], Awaitable[bool]]) -> None:
    """Call the action when the form is submitted, and show at the button that it is under way. It returns whether it was done: only until
    then can the form be submitted again, not while it is under way. SomrsErrors are shown; the input stays."""
    is_closed = False

    async def submit() -> None:
        nonlocal is_closed
        if is_closed:
            return
        is_closed = True
        button.props("loading")
        try:
            is_closed = await guarded(action)() is True
        except BaseException:  # whatever ended the action, also that it was cancelled: the form can be submitted again
            is_closed = False
            raise
        finally:
            if not is_closed and not button.is_deleted:
                button.props(remove="loading")

    form.on("submit.prevent", submit)
