"""Execution options of a task: choice of services, priority, deadline and schedule."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from somrs.client.state_labels import PRIORITIES, priority_text
from somrs.gui.components.fields.picker import Choice, Picker
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.components.formula import FormulaField
from somrs.gui.pages.define.draft import DAILY, INTERVAL, NOW, ONE_TIME, UNITS, Draft, Repeat
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.define.procedures import Procedures
from somrs.gui.panel import panel
from somrs.protocol.messages.submission import Policy

_POLICIES = {
    Policy.PRICE: ("Cheapest", "The lowest price; at equal prices, the earliest completion."),
    Policy.TIME: ("Soonest", "The earliest completion; at equal times, the lowest price."),
    Policy.WEIGHTED: ("Weighted", "The lowest sum of the price and a cost for each second until completion:"),
}
_UNAVAILABLE = {True: "Wait", False: "Fail"}
_REPEATS = {NOW: "Now", ONE_TIME: "Once, later", INTERVAL: "At intervals", DAILY: "On days of the week"}
_DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")


class ExecutionOptions:
    def __init__(self, form: Form) -> None:
        self._form = form
        with panel("Execution options", "tune", "define how", "somrs-define-how") as self._panel:
            with _field("Services"):
                self._policy = _toggle({policy: word for policy, (word, _) in _POLICIES.items()}, "Choice of services")
            self._policy_line = ui.label().classes("somrs-soft")
            with ui.element("div").classes("somrs-define-inline") as self._time_value_row:
                self._time_value = _input("Cost per second", "0.01").classes("somrs-define-short")
                ui.label("EUR per second").classes("somrs-soft")
            with _field("Priority"):
                self._priority = _toggle(dict(PRIORITIES), "Priority")
            ui.label("Among tasks waiting for the same thing or device, the highest priority goes first. No step is interrupted.").classes(
                "somrs-soft"
            )
            with _field("Deadline"):
                self._deadline = _input("Deadline", "none").classes("somrs-define-short")
                units = [Choice(value=unit) for unit in UNITS]
                self._unit = Picker("Unit of the deadline", options=units, on_pick=self._make_setter("deadline_unit")).classes(
                    "somrs-define-unit"
                )
            ui.label("In the world's time, from submission. A task that misses its deadline fails and is undone.").classes("somrs-soft")
            with _field("If no service is free"):
                self._waits = _toggle(dict(_UNAVAILABLE), "If no service is free")
            ui.label("A task that waits tries again, and goes on when a device joins or is mended.").classes("somrs-soft")
            self._repeat = _Repeating(form)
            with _fold("Precondition", "The task starts only if this formula holds. Leave it empty to start it in any situation."):
                self._precondition = FormulaField(
                    "Precondition",
                    placeholder=form.examples.condition,
                    on_change=lambda event: self._set_value("precondition", event.value),
                )
            with _fold("Handlers", "Formulas to make true first when a step fails or is to be undone."):
                self._procedures = Procedures(form)
        self._policy.on_value_change(lambda event: self._set_value("policy", event.value))
        self._priority.on_value_change(lambda event: self._set_value("priority", event.value))
        self._waits.on_value_change(lambda event: self._set_value("waits", event.value))
        for field, path in ((self._time_value, "time_value"), (self._deadline, "deadline")):
            field.on_value_change(self._typed(path))
            form.mirror(field, path)
        form.mirror(self._precondition, "precondition")
        form.on_change(self._refresh)
        self._refresh()

    def _set_value(self, name: str, value: object) -> None:
        if getattr(self._form.draft, name) != value:
            setattr(self._form.draft, name, value)
            self._form.changed()

    def _make_setter(self, name: str) -> Callable[[str], None]:
        return lambda value: self._set_value(name, value)

    def _typed(self, name: str) -> Callable[[ValueChangeEventArguments[str | None]], None]:
        return lambda event: self._set_value(name, event.value or "")

    def _refresh(self) -> None:
        draft = self._form.draft
        if draft.priority not in self._priority.options:  # templates may have priorities without a name of their own
            self._priority.set_options({**PRIORITIES, draft.priority: priority_text(draft.priority)})
        for field, value in ((self._policy, draft.policy), (self._priority, draft.priority), (self._waits, draft.waits)):
            if field.value != value:
                field.value = value
        for typed, text in (
            (self._time_value, draft.time_value),
            (self._deadline, draft.deadline),
            (self._precondition, draft.precondition),
        ):
            if typed.value != text:
                typed.value = text
        if self._unit.value != draft.deadline_unit:
            self._unit.choose(draft.deadline_unit)
        self._policy_line.set_text(_POLICIES[draft.policy][1])
        self._time_value_row.visible = draft.policy is Policy.WEIGHTED
        self._panel.note.set_text(_summary(draft))


class _Repeating:
    """When the task is submitted: now, or by a standing order."""

    def __init__(self, form: Form) -> None:
        self._form = form
        with _field("When"):
            options = [Choice(value=recurrence, text=text) for recurrence, text in _REPEATS.items()]
            self._recurrence_picker = Picker("When", options=options, on_pick=self._pick).classes("somrs-define-when")
        self._details = ui.element("div").classes("somrs-define-repeat")
        self._shown_recurrence: str | None = None
        form.on_change(self._refresh)
        self._refresh()

    @property
    def _repeat(self) -> Repeat:
        return self._form.draft.repeat

    def _pick(self, recurrence: str) -> None:
        self._repeat.recurrence = recurrence
        if recurrence == ONE_TIME and not self._repeat.date:
            start_time = datetime.now() + timedelta(hours=1)
            self._repeat.date, self._repeat.time = f"{start_time:%Y-%m-%d}", f"{start_time:%H}:00"
        self._form.changed()

    def _refresh(self) -> None:
        if self._recurrence_picker.value != self._repeat.recurrence:
            self._recurrence_picker.choose(self._repeat.recurrence)
        if self._shown_recurrence != self._repeat.recurrence:
            self._shown_recurrence = self._repeat.recurrence
            self._details.clear()
            with self._details:
                self._fill()

    def _fill(self) -> None:
        repeat = self._repeat
        if repeat.recurrence == NOW:
            return
        with ui.element("div").classes("somrs-define-inline"):
            match repeat.recurrence:
                case "once":
                    self._field("Date", "date", 'type="date"')
                    self._field("Time", "time", 'type="time"')
                case "every":
                    ui.label("every").classes("somrs-soft")
                    self._field("Minutes", "minutes", "").classes("somrs-define-short")
                    ui.label("minutes").classes("somrs-soft")
                case _:
                    ui.label("at").classes("somrs-soft")
                    self._field("Time", "time", 'type="time"')
        if repeat.recurrence == DAILY:
            with ui.element("div").classes("somrs-define-days").props('role="group" aria-label="Days"'):
                for day, name in enumerate(_DAYS):
                    shown_at_once(ui.checkbox(name, value=day in repeat.days, on_change=self._day(day))).props("dense")
            ui.label("No day selected: every day.").classes("somrs-soft")
        with ui.element("div").classes("somrs-define-inline"):
            ui.label("Name").classes("somrs-soft")
            self._field("Name of the order", "name", 'placeholder="name of the standing order"').classes("somrs-define-name")
        if repeat.recurrence != ONE_TIME:
            skip = shown_at_once(ui.checkbox("Skip a run while the previous task is running", value=repeat.skip)).props("dense")
            skip.on_value_change(lambda event: self._set_value("skip", event.value))

    def _field(self, label: str, name: str, props: str) -> ui.input:
        field = _input(label, "").props(props)
        field.value = getattr(self._repeat, name)
        field.on_value_change(lambda event: self._set_value(name, event.value or ""))
        self._form.mirror(field, f"repeat.{name}")
        return field

    def _set_value(self, name: str, value: object) -> None:
        setattr(self._repeat, name, value)
        self._form.changed()

    def _day(self, day: int) -> Callable[[ValueChangeEventArguments[bool | None]], None]:
        def turned(event: ValueChangeEventArguments[bool | None]) -> None:
            days = {*self._repeat.days} | {day} if event.value else {*self._repeat.days} - {day}
            self._set_value("days", sorted(days))

        return turned


def _summary(draft: Draft) -> str:
    """The options in a few words, shown while the panel is collapsed."""
    parts = [_POLICIES[draft.policy][0].lower()]
    parts += [f"{priority_text(draft.priority)} priority".lower()] if draft.priority else []
    parts += [f"within {draft.deadline} {draft.deadline_unit}"] if draft.deadline.strip() else []
    parts += [] if draft.waits else ["fails if no service is free"]
    parts += [_REPEATS[draft.repeat.recurrence].lower()] if draft.repeat.recurrence != NOW else []
    return ", ".join(parts)


def _field(label: str) -> ui.element:
    with ui.element("div").classes("somrs-define-field") as element:
        ui.label(label).classes("somrs-define-label")
    return element


def _toggle(options: dict[Any, str], label: str) -> ui.toggle:
    toggle = shown_at_once(ui.toggle(options)).classes("somrs-define-toggle")
    return toggle.props(f'dense no-caps unelevated role="group" aria-label="{label}"')


def _input(label: str, placeholder: str) -> ui.input:
    return ui.input(placeholder=placeholder).props(f'outlined dense aria-label="{label}"')


def _fold(title: str, line: str) -> ui.expansion:
    with ui.expansion(title).classes("somrs-define-fold").props("dense switch-toggle-side") as expansion:
        ui.label(line).classes("somrs-soft")
    return expansion
