"""Handlers of the task: formulas to make true first when a step fails or is to be undone."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from somrs.gui.components.fields.picker import Choice, Picker
from somrs.gui.components.formula import FormulaField
from somrs.gui.examples import with_variables
from somrs.gui.pages.define.draft import Procedure
from somrs.gui.pages.define.form import Form
from somrs.ontology.services import PROVIDER, PROVIDER_TYPE, Occasion

_OCCASIONS = {Occasion.FAILURE: "When a step fails", Occasion.COMPENSATION: "To undo a step"}


class Procedures:
    def __init__(self, form: Form) -> None:
        self._form = form
        self._shown_procedures: list[Procedure] = []
        self._list = ui.element("div").classes("somrs-define-procedures")
        ui.button("Add a handler", icon="add", on_click=self._add).props("flat dense no-caps")
        form.on_change(self._refresh)
        self._refresh()

    def _add(self) -> None:
        self._form.draft.procedures.append(Procedure())
        self._form.changed()

    def _remove(self, procedure: Procedure) -> None:
        self._form.draft.procedures = [candidate for candidate in self._form.draft.procedures if candidate is not procedure]
        self._form.changed()

    def _refresh(self) -> None:
        procedures = self._form.draft.procedures
        if len(procedures) == len(self._shown_procedures) and all(
            procedure is shown_procedure for procedure, shown_procedure in zip(procedures, self._shown_procedures, strict=True)
        ):
            return
        self._shown_procedures = [*procedures]
        self._list.clear()
        with self._list:
            for number, procedure in enumerate(procedures):
                self._add_fieldset(number, procedure)

    def _add_fieldset(self, number: int, procedure: Procedure) -> None:
        services = self._form.api.context.ontology.services
        with ui.element("fieldset").classes("somrs-define-procedure"):
            with ui.element("div").classes("somrs-define-inline"):
                occasions = [Choice(value=occasion.value, text=text) for occasion, text in _OCCASIONS.items()]
                Picker("Event", value=procedure.on.value, options=occasions, on_pick=partial(self._set_occasion, procedure))
                ui.label("of").classes("somrs-soft")
                types = [Choice(value="", text="any step"), *(Choice(value=name, detail=service.doc) for name, service in services.items())]
                Picker(
                    "Step type",
                    value=procedure.service_type,
                    options=types,
                    on_pick=lambda name: self._set_service_type(procedure, name, fields),
                )
                remove_button = ui.button(icon="close", on_click=lambda: self._remove(procedure)).props("flat dense round size=sm")
                remove_button.props('aria-label="Remove this handler"')
            fields = [
                FormulaField(label, value=getattr(procedure, name), on_change=partial(self._typed, procedure, name))
                for label, name in (("Make true", "effect"), ("Only if (optional)", "when"))
            ]
            self._show_step_type(procedure, fields)
            for field, name in zip(fields, ("effect", "when"), strict=True):
                self._form.mirror(field, f"procedures.{number}.{name}")

    def _variables(self, procedure: Procedure) -> dict[str, str]:
        service = self._form.api.context.ontology.services.get(procedure.service_type)
        inputs = {parameter.name: parameter.type for parameter in service.inputs} if service is not None else {}
        return {**inputs, PROVIDER: PROVIDER_TYPE}

    def _set_occasion(self, procedure: Procedure, occasion: str) -> None:
        procedure.on = Occasion(occasion)
        self._form.changed()

    def _set_service_type(self, procedure: Procedure, service_type: str, fields: list[FormulaField]) -> None:
        procedure.service_type = service_type
        self._show_step_type(procedure, fields)
        self._form.changed()

    def _show_step_type(self, procedure: Procedure, fields: list[FormulaField]) -> None:
        """Show the variables that the formulas can use, and examples with them."""
        variables, shown = self._variables(procedure), self._form.examples
        context = self._form.api.context
        for field, example in zip(fields, (shown.goal, shown.condition), strict=True):
            field.variables = variables
            field.placeholder = with_variables(example, variables, context.map, context.ontology)

    def _typed(self, procedure: Procedure, name: str, event: object) -> None:
        setattr(procedure, name, getattr(event, "value", "") or "")
        self._form.changed()
