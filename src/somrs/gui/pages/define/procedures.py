"""What is laid down for failures and for undoing: brought about before the task is recovered in other ways."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from somrs.gui.components.fields.picker import Choice, Picker
from somrs.gui.components.formula import FormulaField
from somrs.gui.pages.define.draft import Procedure
from somrs.gui.pages.define.form import Form
from somrs.ontology.services import PROVIDER, Occasion

OCCASIONS = {Occasion.FAILURE: "When a step fails", Occasion.COMPENSATION: "To undo a step"}


class Procedures:
    def __init__(self, form: Form) -> None:
        self._form = form
        self._shown: list[Procedure] = []
        self._list = ui.element("div").classes("somrs-define-procedures")
        ui.button("Add a procedure", icon="add", on_click=self._add).props("flat dense no-caps")
        form.on_change(self._show)
        self._show()

    def _add(self) -> None:
        self._form.draft.procedures.append(Procedure())
        self._form.changed()

    def _remove(self, one: Procedure) -> None:
        self._form.draft.procedures = [other for other in self._form.draft.procedures if other is not one]
        self._form.changed()

    def _show(self) -> None:
        wanted = self._form.draft.procedures
        if len(wanted) == len(self._shown) and all(one is other for one, other in zip(wanted, self._shown, strict=True)):
            return
        self._shown = [*wanted]
        self._list.clear()
        with self._list:
            for number, one in enumerate(wanted):
                self._put(number, one)

    def _put(self, number: int, one: Procedure) -> None:
        services = self._form.desk.context.ontology.services
        with ui.element("fieldset").classes("somrs-define-procedure"):
            with ui.element("div").classes("somrs-define-inline"):
                occasions = [Choice(value=occasion.value, text=text) for occasion, text in OCCASIONS.items()]
                Picker("When it is called for", value=one.on.value, options=occasions, on_pick=partial(self._occasion, one))
                ui.label("of").classes("somrs-soft")
                types = [Choice(value="", text="any step"), *(Choice(value=name, detail=each.doc) for name, each in services.items())]
                Picker("Of which step", value=one.service_type, options=types, on_pick=lambda name: self._of(one, name, fields))
                away = ui.button(icon="close", on_click=lambda: self._remove(one)).props("flat dense round size=sm")
                away.props('aria-label="Remove this procedure"')
            fields = [
                FormulaField(label, value=getattr(one, name), placeholder=example, variables=self._variables(one), on_change=put)
                for label, name, example in (
                    ("Bring about", "effect", "?Object isOn Table001"),
                    ("If this is so (else always)", "when", "?Object isOn Floor001"),
                )
                for put in (partial(self._typed, one, name),)
            ]
            for field, name in zip(fields, ("effect", "when"), strict=True):
                self._form.mirror(field, f"procedures.{number}.{name}")

    def _variables(self, one: Procedure) -> dict[str, str]:
        service = self._form.desk.context.ontology.services.get(one.service_type)
        inputs = {parameter.name: parameter.type for parameter in service.inputs} if service is not None else {}
        return {**inputs, PROVIDER: "Device"}

    def _occasion(self, one: Procedure, occasion: str) -> None:
        one.on = Occasion(occasion)
        self._form.changed()

    def _of(self, one: Procedure, service_type: str, fields: list[FormulaField]) -> None:
        one.service_type = service_type
        for field in fields:
            field.variables = self._variables(one)
        self._form.changed()

    def _typed(self, one: Procedure, name: str, event: object) -> None:
        setattr(one, name, getattr(event, "value", "") or "")
        self._form.changed()
