"""Checkboxes, switches, toggles and radio buttons that show a click at once, and not only when the server has answered."""

from __future__ import annotations

from typing import Any, TypeVar

from nicegui.elements.mixins.value_element import ValueElement

Choice = TypeVar("Choice", bound=ValueElement[Any])

_SHOW = "(value) => { element.props['model-value'] = value; }"
"""NiceGUI evaluates it where `element` is what the browser knows of the element."""


def shown_at_once(choice: Choice) -> Choice:
    """Let the browser show what the user chooses. The server answers with the value that it has then: another one, if it has refused the
    choice, or if another user has changed it."""
    return choice.on("update:model-value", js_handler=_SHOW)
