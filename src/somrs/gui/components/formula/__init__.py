"""A field for a formula: completion while one types, mistakes underlined and said beneath, several lines, Ctrl+Enter submits.

    field = FormulaField("What is to be", value="Jar002 isOn Platform001", variables={"Self": "Room"},
                         on_change=changed, on_checked=checked, on_submit=submitted)

- `value` is what is written; set it to write something else. `on_change` hears of each change (`.value`), also of one that Python made.
- `variables`: types of variables, beside those in the text, as constraints (`Self`) and services (`Provider`) have them; `types` count
  as if they were in the ontology already: what somebody is writing.
- `on_checked` hears, a moment after the last change and whenever the map or the ontology changed, what is wrong: a `Report`, whose `text`
  is the text that was checked. `report` is the last one; `ok` says whether the text as it is now was checked and is right.
- `on_submit` hears Ctrl+Enter.
- `good`: what is said when nothing is wrong.
- `insert(text)` writes at the cursor, `focus()` goes there, `await recheck()` checks now.

It asks `/api/formulas` by itself; what is written in it does not wait for the page's own connection, and stays when that is lost.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import Any

import msgspec
from nicegui.elements.mixins.disableable_element import DisableableElement
from nicegui.elements.mixins.value_element import ValueElement
from nicegui.events import GenericEventArguments, Handler, ValueChangeEventArguments

from somrs.api.formulas import CheckResult
from somrs.gui.components import LIVE
from somrs.ontology.types import ObjectType


class Report(CheckResult, frozen=True, kw_only=True):
    """What was found in `text`."""

    text: str


class FormulaField(ValueElement[str], DisableableElement, component="formula.js", dependencies=[LIVE], esm={"somrs-formula": "modules"}):
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
        on_change: Handler[ValueChangeEventArguments[str]] | None = None,
        on_checked: Callable[[Report], Awaitable[None] | None] | None = None,
        on_submit: Callable[[str], Awaitable[None] | None] | None = None,
    ) -> None:
        super().__init__(value=value, on_value_change=on_change)
        self._props.update({"label": label, "placeholder": placeholder, "rows": rows, "variables": variables or {}, "good": good})
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
        super()._handle_value_change(value)
        if self._send_update_on_value_change:
            # What the browser has as its value may be this one already, while something else was typed.
            self.run_method("write", value)

    @property
    def ok(self) -> bool:
        """Whether what is written now was checked, and is right."""
        return self.report is not None and self.report.ok and self.report.text == self.value

    @property
    def variables(self) -> dict[str, str]:
        variable_types: dict[str, str] = self._props["variables"]
        return variable_types

    @variables.setter
    def variables(self, variables: dict[str, str]) -> None:
        self._props["variables"] = variables

    def insert(self, text: str) -> None:
        self.run_method("insert", text)

    def focus(self) -> None:
        self.run_method("focus")

    def recheck(self) -> Any:
        """Can be awaited: then what is wrong was heard."""
        return self.run_method("recheck")
