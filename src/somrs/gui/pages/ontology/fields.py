"""The fields of a form: each edits one value of a draft, at a path, and shows its errors."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

import msgspec
from nicegui import ui
from nicegui.element import Element
from nicegui.events import ValueChangeEventArguments

from somrs.gui.components.draft_storage import DraftStorage
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.components.formula import FormulaField
from somrs.gui.pages.ontology.drafts import Draft
from somrs.gui.pages.ontology.elements import TextTag, icon_button
from somrs.gui.shell import focus
from somrs.ontology.types import ObjectType

F = TypeVar("F", ui.input, ui.textarea, ui.select)

CHOSEN = "value && typeof value === 'object' ? value.label : value"
"""JavaScript for the value chosen in a select."""
_ALL_CHOSEN = "(value ?? []).map((one) => typeof one === 'object' ? one.label : one)"


class _ErrorField(Protocol):
    """A field that can show an error."""

    error: str | None

    @property
    def id(self) -> int: ...

    @property
    def is_deleted(self) -> bool: ...


class Formula:
    """A formula field that also shows errors found by the server when saving."""

    def __init__(self, field: FormulaField, hint: str) -> None:
        self.field = field
        if hint:
            ui.label(hint).classes("somrs-onto-hint")
        self._error_label = ui.label().classes("somrs-onto-pre somrs-onto-wrong").props('role="alert"')
        self.error = None

    @property
    def error(self) -> str | None:
        return self._error_label.text or None

    @error.setter
    def error(self, error: str | None) -> None:
        self._error_label.text = error or ""
        self._error_label.visible = error is not None

    @property
    def id(self) -> int:
        return self.field.id

    @property
    def is_deleted(self) -> bool:
        return self.field.is_deleted


class Fields:
    """`on_change` is called after each edit."""

    def __init__(self, draft: Draft, draft_storage: DraftStorage, on_change: Callable[[], None]) -> None:
        self.draft, self._draft_storage, self._on_change = draft, draft_storage, on_change
        self._elements: dict[str, _ErrorField] = {}
        self._callbacks: dict[str, Callable[[], None]] = {}

    def value_at(self, path: str) -> Any:
        value: Any = self.draft.form
        for step in path.split("."):
            value = value[int(step)] if isinstance(value, list) else value[step]
        return value

    def set_value(self, path: str, value: Any) -> None:
        outer, _, last_key = path.rpartition(".")
        holder: Any = self.value_at(outer) if outer else self.draft.form
        holder[int(last_key) if isinstance(holder, list) else last_key] = value
        if path in self._callbacks:
            self._callbacks[path]()
        self._on_change()

    def add_callback(self, path: str, callback: Callable[[], None]) -> None:
        """Call `callback` when the value at the path changes."""
        self._callbacks[path] = callback

    def store_draft(self) -> None:
        """Store the whole draft, after rows were added or removed."""
        self._draft_storage.save(self.draft.key, msgspec.to_builtins(self.draft))

    # Errors

    def show_problem(self, path: str, message: str) -> bool:
        """Show an error at the field of the path, the first field of its row, or the nearest ancestor. Returns False if there is no such
        field."""
        while path:
            for field_path, element in self._elements.items():
                if (field_path == path or field_path.startswith(f"{path}.")) and not element.is_deleted:
                    element.error = message if not element.error else f"{element.error}\n{message}"
                    return True
            path = path.rpartition(".")[0]
        return False

    def clear_problems(self) -> None:
        for element in self._elements.values():
            if not element.is_deleted:
                element.error = None

    def focus_problem(self) -> None:
        """Focus the first field with an error."""
        for element in self._elements.values():
            if not element.is_deleted and element.error:
                focus(element)
                return

    # Fields

    def text(
        self, path: str, label: str, *, hint: str = "", width: str = "wide", suffix: str = "", callback: Callable[[], None] | None = None
    ) -> ui.input:
        field = ui.input(label, value=self.value_at(path), on_change=self._change_handler(path, callback)).props(
            'outlined dense autocomplete="off"'
        )
        if suffix:
            field.props["suffix"] = suffix
        return self._register_field(field, path, hint, width, "update:value")

    def lines(self, path: str, label: str) -> ui.textarea:
        field = ui.textarea(label, value=self.value_at(path), on_change=self._change_handler(path)).props("outlined dense autogrow rows=1")
        return self._register_field(field, path, "", "full", "update:value")

    def formula(self, path: str, label: str, variables: Mapping[str, str], *, hint: str = "", types: Sequence[ObjectType] = ()) -> Formula:
        """`variables`: types of variables, by name. `types`: types that the user is editing."""
        with ui.element("div").classes("somrs-onto-full"):
            inner = FormulaField(
                label, value=self.value_at(path), variables=dict(variables), types=types, on_change=self._change_handler(path)
            )
            field = Formula(inner, hint)
        self._draft_storage.mirror(field.field, "update:value", self.draft.key, path)
        self._elements[path] = field
        return field

    def choice(
        self, path: str, label: str, options: Sequence[str] | Mapping[str | None, str], *, hint: str = "", width: str = "wide",
        callback: Callable[[], None] | None = None,
    ) -> ui.select:  # fmt: skip
        """A field to choose one option; a mapping gives the labels."""
        value = self.value_at(path)
        choices: Any = dict(options) if isinstance(options, Mapping) else [*options]
        if value not in choices and value not in (None, ""):
            # Keep a chosen value that no longer exists visible.
            choices = {**choices, value: str(value)} if isinstance(choices, dict) else [*choices, value]
        field = ui.select(
            choices,
            label=label,
            value=value if value in choices else None,
            with_input=len(choices) > 8,
            on_change=self._change_handler(path, callback),
        )
        field.props("outlined dense options-dense")
        mirror = CHOSEN if not isinstance(options, Mapping) else f"{json.dumps([*choices])}[value?.value] ?? null"
        return self._register_field(field, path, hint, width, "update:model-value", mirror)

    def multiple_choice(self, path: str, label: str, options: Iterable[str]) -> ui.select:
        """A field to choose any number of options."""
        value = self.value_at(path)
        choices = [*dict.fromkeys([*options, *value])]
        field = ui.select(choices, label=label, value=value, multiple=True, with_input=True, on_change=self._change_handler(path))
        field.props("outlined dense options-dense use-chips")
        return self._register_field(field, path, "", "full", "update:model-value", _ALL_CHOSEN)

    def flag(self, path: str, label: str) -> ui.checkbox:
        field = shown_at_once(ui.checkbox(label, value=self.value_at(path), on_change=self._change_handler(path))).props("dense")
        self._draft_storage.mirror(field, "update:model-value", self.draft.key, path)
        return field.classes("somrs-onto-flag")

    def _change_handler(self, path: str, callback: Callable[[], None] | None = None) -> Callable[[ValueChangeEventArguments[Any]], None]:
        def handle_change(event: ValueChangeEventArguments[Any]) -> None:
            self.set_value(path, event.value)
            if callback is not None:
                callback()

        return handle_change

    def _register_field(self, field: F, path: str, hint: str, width: str, event: str, value: str = "value") -> F:
        self._draft_storage.mirror(field, event, self.draft.key, path, value)
        field.without_auto_validation().classes(f"somrs-onto-field somrs-onto-{width}").mark(path)
        if hint:
            field.props["hint"] = hint
        self._elements[path] = field
        return field

    # Rows

    def rows(
        self,
        path: str,
        title: str,
        noun: str,
        make_row: Callable[[str], None],
        blank: Callable[[], Any],
        hint: str = "",
        make_buttons: Callable[[], object] | None = None,
    ) -> Callable[[], None]:
        """A list of rows that can be added and removed. `make_row` makes the fields of the row at a path, `make_buttons` additional
        buttons. Returns a function that rebuilds the rows."""
        with ui.element("fieldset").classes("somrs-onto-rows"):
            with TextTag("legend", title):
                pass
            if hint:
                ui.label(hint).classes("somrs-soft")
            body = ui.element("div").classes("somrs-onto-rows-body")

            def rebuild() -> None:
                body.clear()
                for field_path in [field_path for field_path in self._elements if field_path.startswith(f"{path}.")]:
                    del self._elements[field_path]
                for index in range(len(self.value_at(path))):
                    show_row(index)

            def show_row(index: int) -> None:
                with body, ui.element("div").classes("somrs-onto-row").props(f'role="group" aria-label="{noun} {index + 1}"'):
                    with line():
                        make_row(f"{path}.{index}")
                    icon_button("close", f"Remove {noun} {index + 1}", lambda: remove(index))

            def remove(index: int) -> None:
                del self.value_at(path)[index]
                rebuild()
                self._on_change()
                self.store_draft()

            def add() -> None:
                self.value_at(path).append(blank())
                last_index = len(self.value_at(path)) - 1
                show_row(last_index)
                self._on_change()
                self.store_draft()
                first = next(
                    (field for field_path, field in self._elements.items() if f"{field_path}.".startswith(f"{path}.{last_index}.")), None
                )
                if first is not None:
                    focus(first, unless_left=button)

            rebuild()
            with ui.element("div"):
                button = ui.button(f"Add {noun}", icon="add", on_click=add).props("flat dense no-caps")
                if make_buttons is not None:
                    make_buttons()
        return rebuild


def line(*, classes: str = "") -> Element:
    """A container for fields side by side."""
    return ui.element("div").classes(f"somrs-onto-line {classes}")
