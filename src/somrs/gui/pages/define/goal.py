"""The goal: as a formula, as lines, or by dragging things on the plan. All three show the same goal."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.components.formula import FormulaField
from somrs.gui.pages.define.builder import Builder
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.define.goal_floor_plan import GoalFloorPlan
from somrs.gui.panel import panel

_PURPOSES = {False: "Make it so", True: "Find out"}
_PURPOSE_LINES = {
    False: "Services make the formula true.",
    True: "Cognitive services find out whether, and for which objects and values, the formula holds. Nothing is moved.",
}


class GoalPanel:
    """`submit` is called on Ctrl+Enter in the formula."""

    def __init__(self, form: Form, submit: Callable[[], Awaitable[None]]) -> None:
        self._form = form
        with panel("Goal", "flag", "define goal", "somrs-define-goal") as formula_panel:
            formula_panel.note.set_text("Ctrl+Space: completion. Ctrl+Enter: preview.")
            self._purpose = shown_at_once(ui.toggle(_PURPOSES, value=form.draft.recognise, on_change=self._choose_purpose))
            self._purpose.props('dense no-caps unelevated role="group" aria-label="Purpose"').classes("somrs-define-toggle")
            self._purpose_line = ui.label(_PURPOSE_LINES[form.draft.recognise]).classes("somrs-soft")
            self.field = FormulaField(
                "Formula",
                value=form.draft.effect,
                placeholder=form.examples.goal,
                rows=2,
                good="The formula is valid.",
                goal=True,
                on_change=self._typed,
                on_submit=lambda _: submit(),
            )
            form.mirror(self.field, "effect")
            ui.label("Or by choosing").classes("somrs-define-label somrs-define-or")
            self._builder = Builder(form)
        with panel("Floor plan", "map", "define plan", "somrs-define-where"):
            ui.label("Drag a thing to its destination, or click the thing and then the destination.").classes("somrs-soft")
            self._plan = GoalFloorPlan(form, self._builder)
        form.on_change(self._refresh)

    def _choose_purpose(self, event: ValueChangeEventArguments[bool]) -> None:
        if event.value != self._form.draft.recognise:
            self._form.draft.recognise = event.value
            self._form.changed()

    def _typed(self, event: ValueChangeEventArguments[str]) -> None:
        if event.value != self._form.draft.effect:
            self._form.draft.effect = event.value or ""
            self._form.changed()

    def _refresh(self) -> None:
        recognise = self._form.draft.recognise
        if self._purpose.value != recognise:
            self._purpose.value = recognise
        self._purpose_line.set_text(_PURPOSE_LINES[recognise])
        if self.field.value != self._form.draft.effect:
            self.field.value = self._form.draft.effect
