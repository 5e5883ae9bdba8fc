"""The fields of a form: each shows and changes one value of a draft, at a path, and shows what is wrong with it where it is."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

import msgspec
from nicegui import ui
from nicegui.element import Element
from nicegui.events import ValueChangeEventArguments

from somrs.gui.components.draft_storage import Keeper
from somrs.gui.components.formula import FormulaField
from somrs.gui.pages.ontology.drafts import Draft
from somrs.gui.pages.ontology.pieces import Word, icon_button
from somrs.gui.shell import focus
from somrs.ontology.types import ObjectType

F = TypeVar("F", ui.input, ui.textarea, ui.select)

CHOSEN = "value && typeof value === 'object' ? value.label : value"
"""The name that was chosen of several."""
ALL_CHOSEN = "(value ?? []).map((one) => typeof one === 'object' ? one.label : one)"


class Shown(Protocol):
    """A field that can say what is wrong with it."""

    error: str | None

    @property
    def id(self) -> int: ...

    @property
    def is_deleted(self) -> bool: ...


class Formula:
    """A formula, with what the server found wrong in it when it was to be saved."""

    def __init__(self, field: FormulaField, hint: str) -> None:
        self.field = field
        if hint:
            ui.label(hint).classes("somrs-onto-hint")
        self._said = ui.label().classes("somrs-onto-pre somrs-onto-wrong").props('role="alert"')
        self.error = None

    @property
    def error(self) -> str | None:
        return self._said.text or None

    @error.setter
    def error(self, error: str | None) -> None:
        self._said.text = error or ""
        self._said.visible = error is not None

    @property
    def id(self) -> int:
        return self.field.id

    @property
    def is_deleted(self) -> bool:
        return self.field.is_deleted


class Fields:
    """`changed` hears of every change."""

    def __init__(self, draft: Draft, keeper: Keeper, changed: Callable[[], None]) -> None:
        self.draft, self._keeper, self._changed = draft, keeper, changed
        self._at: dict[str, Shown] = {}
        self._then: dict[str, Callable[[], None]] = {}

    def get(self, path: str) -> Any:
        found: Any = self.draft.form
        for step in path.split("."):
            found = found[int(step)] if isinstance(found, list) else found[step]
        return found

    def put(self, path: str, value: Any) -> None:
        outer, _, last = path.rpartition(".")
        holder: Any = self.get(outer) if outer else self.draft.form
        holder[int(last) if isinstance(holder, list) else last] = value
        if path in self._then:
            self._then[path]()
        self._changed()

    def when(self, path: str, then: Callable[[], None]) -> None:
        """Do this, too, when what is at the path changes."""
        self._then[path] = then

    def keep(self) -> None:
        """All of the draft, after rows came or went."""
        self._keeper.keep(self.draft.key, msgspec.to_builtins(self.draft))

    # What is shown where

    def problem(self, path: str, message: str) -> bool:
        """Show what is wrong in the field at the path, the first of its row, or the nearest one above it. False if there is none."""
        while path:
            for known, element in self._at.items():
                if (known == path or known.startswith(f"{path}.")) and not element.is_deleted:
                    element.error = message if not element.error else f"{element.error}\n{message}"
                    return True
            path = path.rpartition(".")[0]
        return False

    def no_problems(self) -> None:
        for element in self._at.values():
            if not element.is_deleted:
                element.error = None

    def focus_problem(self) -> None:
        """Go to the first field that something is wrong with."""
        for element in self._at.values():
            if not element.is_deleted and element.error:
                focus(element)
                return

    # Fields

    def text(
        self, path: str, label: str, *, hint: str = "", width: str = "wide", suffix: str = "", then: Callable[[], None] | None = None
    ) -> ui.input:
        field = ui.input(label, value=self.get(path), on_change=self._hear(path, then)).props('outlined dense autocomplete="off"')
        if suffix:
            field.props["suffix"] = suffix
        return self._made(field, path, hint, width, "update:value")

    def lines(self, path: str, label: str) -> ui.textarea:
        field = ui.textarea(label, value=self.get(path), on_change=self._hear(path)).props("outlined dense autogrow rows=1")
        return self._made(field, path, "", "full", "update:value")

    def formula(self, path: str, label: str, variables: Mapping[str, str], *, hint: str = "", types: Sequence[ObjectType] = ()) -> Formula:
        """`variables` are of these types; `types` are being written here."""
        with ui.element("div").classes("somrs-onto-full"):
            inner = FormulaField(label, value=self.get(path), variables=dict(variables), types=types, on_change=self._hear(path))
            field = Formula(inner, hint)
        self._keeper.mirror(field.field, "update:value", self.draft.key, path)
        self._at[path] = field
        return field

    def choice(
        self, path: str, label: str, options: Sequence[str] | Mapping[str | None, str], *, hint: str = "", width: str = "wide",
        then: Callable[[], None] | None = None,
    ) -> ui.select:  # fmt: skip
        """One of the options; a mapping says what each is called."""
        value = self.get(path)
        known: Any = dict(options) if isinstance(options, Mapping) else [*options]
        if value not in known and value not in (None, ""):
            # What is chosen and is not there any more is to be seen all the same.
            known = {**known, value: str(value)} if isinstance(known, dict) else [*known, value]
        field = ui.select(
            known, label=label, value=value if value in known else None, with_input=len(known) > 8, on_change=self._hear(path, then)
        )
        field.props("outlined dense options-dense")
        mirror = CHOSEN if not isinstance(options, Mapping) else f"{json.dumps([*known])}[value?.value] ?? null"
        return self._made(field, path, hint, width, "update:model-value", mirror)

    def several(self, path: str, label: str, options: Iterable[str]) -> ui.select:
        """Any number of the options."""
        value = self.get(path)
        known = [*dict.fromkeys([*options, *value])]
        field = ui.select(known, label=label, value=value, multiple=True, with_input=True, on_change=self._hear(path))
        field.props("outlined dense options-dense use-chips")
        return self._made(field, path, "", "full", "update:model-value", ALL_CHOSEN)

    def flag(self, path: str, label: str) -> ui.checkbox:
        field = ui.checkbox(label, value=self.get(path), on_change=self._hear(path)).props("dense")
        self._keeper.mirror(field, "update:model-value", self.draft.key, path)
        return field.classes("somrs-onto-flag")

    def _hear(self, path: str, then: Callable[[], None] | None = None) -> Callable[[ValueChangeEventArguments[Any]], None]:
        def hear(event: ValueChangeEventArguments[Any]) -> None:
            self.put(path, event.value)
            if then is not None:
                then()

        return hear

    def _made(self, field: F, path: str, hint: str, width: str, event: str, value: str = "value") -> F:
        self._keeper.mirror(field, event, self.draft.key, path, value)
        field.without_auto_validation().classes(f"somrs-onto-field somrs-onto-{width}").mark(path)
        if hint:
            field.props["hint"] = hint
        self._at[path] = field
        return field

    # Rows

    def rows(
        self,
        path: str,
        title: str,
        one: str,
        make: Callable[[str], None],
        blank: Callable[[], Any],
        hint: str = "",
        more: Callable[[], object] | None = None,
    ) -> Callable[[], None]:
        """A list of rows that can be added and removed; `make` makes the fields of the row at a path, `more` other
        buttons. Returns what makes them anew."""
        with ui.element("fieldset").classes("somrs-onto-rows"):
            with Word("legend", title):
                pass
            if hint:
                ui.label(hint).classes("somrs-soft")
            body = ui.element("div").classes("somrs-onto-rows-body")

            def again() -> None:
                body.clear()
                for known in [known for known in self._at if known.startswith(f"{path}.")]:
                    del self._at[known]
                for index in range(len(self.get(path))):
                    show(index)

            def show(index: int) -> None:
                with body, ui.element("div").classes("somrs-onto-row").props(f'role="group" aria-label="{one} {index + 1}"'):
                    with line():
                        make(f"{path}.{index}")
                    icon_button("close", f"Remove {one} {index + 1}", lambda: remove(index))

            def remove(index: int) -> None:
                del self.get(path)[index]
                again()
                self._changed()
                self.keep()

            def add() -> None:
                self.get(path).append(blank())
                last = len(self.get(path)) - 1
                show(last)
                self._changed()
                self.keep()
                first = next((field for known, field in self._at.items() if f"{known}.".startswith(f"{path}.{last}.")), None)
                if first is not None:
                    focus(first, unless_left=button)

            again()
            with ui.element("div"):
                button = ui.button(f"Add {one}", icon="add", on_click=add).props("flat dense no-caps")
                if more is not None:
                    more()
        return again


def line(*, classes: str = "") -> Element:
    """Fields beside each other."""
    return ui.element("div").classes(f"somrs-onto-line {classes}")
