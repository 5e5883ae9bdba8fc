"""Form fields for the attributes of an object, one input per attribute."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from nicegui import ui
from nicegui.element import Element
from nicegui.events import ValueChangeEventArguments

from somrs.errors import InputError
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.pages.map.value_input import in_limits, limits, read, text_of, unit
from somrs.gui.shell import focus
from somrs.ontology.types import AttributeType, Kind, Ontology, Value

_ANSWERED = 60.0
"""Seconds within which a browser answers, or is gone."""
Raw = str | bool | None
"""The content of a field: typed text, a switch's state, or None for the type's default."""


@dataclass(frozen=True, slots=True)
class Spot:
    """An attribute of a type: its path and definition."""

    path: str
    attribute: AttributeType
    type: str
    ontology: Ontology

    @property
    def default(self) -> Value | None:
        return self.ontology.default(self.type, self.path)

    @property
    def required(self) -> bool:
        first = self.path.partition(".")[0]
        return first == self.path and any(
            first in self.ontology.types[ancestor].required for ancestor in self.ontology.ancestors(self.type)
        )

    def label(self) -> str:
        return self.attribute.name + (" *" if self.required else "")

    def raw(self, value: Value | None) -> Raw:
        """The field content for a value."""
        if value is None or isinstance(value, bool):
            return value
        return text_of(value, self.attribute)

    def read(self, raw: Raw) -> Value | None:
        """The value of a field content. Raises InputError."""
        if raw is None or isinstance(raw, bool):
            return raw
        text = raw.strip()
        if not text:
            if self.required and self.default is None:
                raise InputError(f"a {self.type} must have {self.attribute.name}")
            return None
        value = read(text, self.attribute)
        if problem := in_limits(self.path, value, self.type, self.ontology):
            raise InputError(f"{self.attribute.name} is {problem}")
        return value


class Field:
    """`changed` is called after the user edits the field, not by `show_value`. `mirror` stores typed text in the browser."""

    def __init__(self, spot: Spot, changed: Callable[[str, Raw], None], mirror: Callable[[Element, str], None] | None = None) -> None:
        self.spot = spot
        self._changed = changed
        self._raw: Raw = None
        match spot.attribute.kind:
            case Kind.TRUTH:
                self._switch()
            case Kind.ENUMERATION:
                self._choice()
            case _:
                self._text()
                if mirror is not None:
                    mirror(self._input, spot.path)

    def show_value(self, value: Value | None, *, edited: Raw = None, is_edited: bool = False) -> None:
        """Show the object's value, or an edited one."""
        self._raw = edited if is_edited else self.spot.raw(value)
        self._fill(self._raw)
        self.mark(is_edited)
        self.show_problem("")

    async def retype(self, shown: Raw, typed: Raw) -> bool:
        """Show typed text again if the browser shows `shown`, which replaced it on its way to the server. Returns whether it did."""
        script = (
            f"const field = getHtmlElement({self._input.id}), input = field?.querySelector('input') ?? field;"
            f"if (input?.value !== {json.dumps(shown or '')}) return false;"
            f"input.value = {json.dumps(typed or '')}; input.dispatchEvent(new Event('input')); return true;"
        )
        return bool(await self._input.client.run_javascript(f"(() => {{ {script} }})()", timeout=_ANSWERED))

    def mark(self, edited: bool) -> None:
        """Show whether the content differs from the map."""
        self.element.classes(add="somrs-map-edited" if edited else "", remove="" if edited else "somrs-map-edited")

    def show_problem(self, text: str) -> None:
        if isinstance(self._input, ui.switch):
            self._problem_label.text, self._problem_label.visible = text, bool(text)
        else:
            self._input.error = text or None

    def check(self) -> bool:
        """Show an error if the content is invalid. Returns whether it is valid."""
        try:
            self.spot.read(self._raw)
        except InputError as error:
            self.show_problem(str(error))
            return False
        self.show_problem("")
        return True

    def focus(self) -> None:
        focus(self._input)

    def enable(self, is_enabled: bool) -> None:
        self._input.set_enabled(is_enabled)

    # Inputs by kind of attribute

    def _text(self) -> None:
        spot = self.spot
        default = text_of(spot.default, spot.attribute)
        number = spot.attribute.kind is Kind.NUMBER
        self._input: ui.input | ui.select | ui.switch = ui.input(spot.label(), placeholder=default, on_change=self._typed)
        self._input.props(f"outlined dense hide-bottom-space {'stack-label' if default else ''} autocomplete=off")
        if unit_text := unit(spot.attribute):
            self._input.props(f'suffix="{unit_text}"')
        if number:
            self._input.props("inputmode=decimal").classes("somrs-map-number")
        self._input.on("blur", self.check)
        self.element: ui.element = self._input
        self._help(f"default {default} {unit(spot.attribute)}".rstrip() if default else "")

    def _choice(self) -> None:
        spot = self.spot
        options = [*spot.attribute.values]
        self._input = ui.select(options, label=spot.label(), on_change=self._typed, clearable=True)
        self._input.props("outlined dense options-dense hide-bottom-space")
        if spot.default is not None:
            self._input.props("stack-label")
        self.element = self._input
        self._help(f"default {spot.default}" if spot.default is not None else "")

    def _switch(self) -> None:
        spot = self.spot
        with ui.element("div").classes("somrs-map-truth") as self.element:
            self._input = shown_at_once(ui.switch(spot.label(), on_change=self._typed)).props("dense")
            self._by_default = ui.label("default").classes("somrs-soft")
            self._clear = ui.button(icon="backspace", on_click=lambda: self._set(None)).props(
                f'flat round dense size=sm aria-label="Reset {spot.attribute.name} to its default"'
            )
            self._problem_label = ui.label().classes("somrs-map-wrong")
            self._problem_label.visible = False
        self._help("")

    def _help(self, default: str) -> None:
        spot = self.spot
        hints = [spot.attribute.doc, limits(spot.path, spot.attribute, spot.type, spot.ontology), default]
        if text := "; ".join(hint for hint in hints if hint):
            with self._input:
                ui.tooltip(text).props("delay=600")

    # Content

    def _fill(self, raw: Raw) -> None:
        if isinstance(self._input, ui.switch):
            default = self.spot.default
            self._input.set_value(bool(raw if raw is not None else default))
            self._by_default.visible = raw is None
            self._clear.visible = raw is not None
        elif isinstance(self._input, ui.select):
            self._input.set_value(raw or None)
            default = self.spot.default
            shows_default = default is not None and not raw
            self._input.props(f'display-value="{default}"' if shows_default else "", remove="" if shows_default else "display-value")
            self._input.classes(add="somrs-map-default" if shows_default else "", remove="" if shows_default else "somrs-map-default")
        else:
            self._input.set_value("" if raw is None else str(raw))

    def _typed(self, event: ValueChangeEventArguments[Any]) -> None:
        value = event.value
        if isinstance(self._input, ui.switch):
            now = bool(self._raw if self._raw is not None else self.spot.default)
            if bool(value) != now:
                self._set(bool(value))
            return
        raw: Raw = None if value is None else str(value)
        if (raw or "") != (self._raw or ""):
            self._set(raw or "")

    def _set(self, raw: Raw) -> None:
        self._raw = raw
        if not isinstance(self._input, ui.input):
            self._fill(raw)
        self.show_problem("")
        self._changed(self.spot.path, raw)
