"""A field for a formula of one or several lines, with completion, checking and submission by Ctrl+Enter.

    field = FormulaField("Goal", value="Jar002 isOn Platform001", variables={"Self": "Room"},
                         on_change=changed, on_checked=checked, on_submit=submitted)

- `value` is the text; it can be set. `on_change` is called after each change, including changes made by Python.
- `variables`: types of variables that the text does not declare, as constraints (`Self`) and services (`Provider`) have them. `types`:
  types that the user is editing; they count as part of the ontology.
- `on_checked` receives a `Report` shortly after the last change, and whenever the map or the ontology changes. `Report.text` is the text
  that was checked. `report` is the last one; `ok` is True if the current text was checked and is valid.
- `on_submit` is called on Ctrl+Enter.
- `good`: the message shown for a valid text. `goal`: also say what no service on offer could bring about.
- `insert(text)` inserts at the cursor, `focus()` focuses the field, `await recheck()` checks now.

The element calls `/api/formulas` itself, so that it works, and keeps its text, while the page's own connection is lost.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
from nicegui.elements.mixins.disableable_element import DisableableElement
from nicegui.elements.mixins.value_element import ValueElement
from nicegui.events import GenericEventArguments, Handler, ValueChangeEventArguments

from somrs.api.formulas import CheckResult
from somrs.gui.components import LIVE, publish_modules
from somrs.ontology.types import ObjectType

publish_modules(Path(__file__).parent / "modules")


class Report(CheckResult, frozen=True, kw_only=True):
    """The result of checking `text`."""

    text: str


class FormulaField(ValueElement[str], DisableableElement, component="formula.js", dependencies=[LIVE]):
    VALUE_PROP = "value"
    LOOPBACK = False

    def __init__(
        self,
        label: str | None = None,
        *,
        value: str = "",
        placeholder: str = "",
        rows: int = 1,
        variables: dict[str, str] | None = None,
        types: Sequence[ObjectType] = (),
        good: str = "",
        goal: bool = False,
        on_change: Handler[ValueChangeEventArguments[str]] | None = None,
        on_checked: Callable[[Report], Awaitable[None] | None] | None = None,
        on_submit: Callable[[str], Awaitable[None] | None] | None = None,
    ) -> None:
        super().__init__(value=value, on_value_change=on_change)
        self._props.update(
            {"label": label, "placeholder": placeholder, "rows": rows, "variables": variables or {}, "good": good, "goal": goal}
        )
        self._props["types"] = [msgspec.to_builtins(object_type) for object_type in types]
        self.report: Report | None = None

        def checked(event: GenericEventArguments) -> Awaitable[None] | None:
            self.report = msgspec.convert(event.args, Report)
            return on_checked(self.report) if on_checked is not None else None

        def submitted(event: GenericEventArguments) -> Awaitable[None] | None:
            return on_submit(str(event.args)) if on_submit is not None else None

        self.on("checked", checked)
        self.on("submit", submitted)

    def _handle_value_change(self, value: Any) -> None:
        previous = self._props["value"]
        super()._handle_value_change(value)
        if self._send_update_on_value_change:
            self.run_method("write", value, previous)

    @property
    def ok(self) -> bool:
        """Whether the current text was checked and is valid."""
        return self.report is not None and self.report.ok and self.report.text == self.value

    @property
    def variables(self) -> dict[str, str]:
        variable_types: dict[str, str] = self._props["variables"]
        return variable_types

    @variables.setter
    def variables(self, variables: dict[str, str]) -> None:
        self._props["variables"] = variables

    @property
    def placeholder(self) -> str:
        return str(self._props["placeholder"])

    @placeholder.setter
    def placeholder(self, placeholder: str) -> None:
        self._props["placeholder"] = placeholder

    def insert(self, text: str) -> None:
        self.run_method("insert", text)

    def focus(self) -> None:
        self.run_method("focus")

    def recheck(self) -> Any:
        """Check now. Can be awaited; `report` is up to date afterwards."""
        return self.run_method("recheck")
