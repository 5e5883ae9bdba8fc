"""New task: enter a goal and execution options, preview the plan, and start the task."""

from __future__ import annotations

import uuid

from nicegui import app, ui

from somrs.access.rights import Right
from somrs.api.formulas import CheckFormula
from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.account_menu import only_with
from somrs.gui.pages.define.draft import NOW, Draft
from somrs.gui.pages.define.execution_options import ExecutionOptions
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.define.goal import GoalPanel
from somrs.gui.pages.define.orders import Orders, save_order
from somrs.gui.pages.define.preview import Preview
from somrs.gui.pages.define.templates import TemplateMenu
from somrs.gui.pages.task_text import task_path
from somrs.gui.shell import guarded, notify, page, page_at
from somrs.protocol.messages.submission import Submit


def register(api: LiveApi) -> None:
    @page_at("/define")
    async def show_page(effect: str = "") -> None:
        with page("New task", "/define", api, ("effect",)):
            _DefinePage(api, effect)


class _DefinePage:
    """The page. `effect`: the initial goal."""

    def __init__(self, api: LiveApi, effect: str) -> None:
        self._api = api
        self._form = form = Form(api, Draft(effect=effect, link=effect))
        self._last_attempt: tuple[Submit, str] | None = None
        with ui.element("div").classes("somrs-define-head"):
            ui.label("New task").classes("somrs-title").props('role="heading" aria-level="1"')
            self._templates = TemplateMenu(form)
            ui.button("Clear", icon="backspace", on_click=self._clear).props("flat dense no-caps")
            ui.space()
            preview = (
                ui.button("Preview", icon="preview", on_click=self._previewed).props("outline dense no-caps").classes("somrs-define-act")
            )
            self._start_button = ui.button("Start", icon="play_arrow", on_click=guarded(self._start)).props(
                "unelevated dense no-caps color=primary"
            )
            self._start_button.classes("somrs-define-act")
            only_with(Right.OPERATE, preview, self._start_button)
        with ui.element("div").classes("somrs-define-other somrs-define-earlier").props('role="status"') as self._earlier:
            ui.icon("history").props('aria-hidden="true"')
            ui.label("This is your earlier draft. Its task has not been started.")
            ui.button("Keep the draft", on_click=form.keep_earlier_goal).props("flat dense no-caps")
            ui.button("Start a new draft", on_click=self._clear).props("flat dense no-caps")
        with ui.element("div").classes("somrs-define"):
            with ui.element("div").classes("somrs-define-column"):
                self._goal_panel = GoalPanel(form, self._previewed)
            with ui.element("div").classes("somrs-define-column"):
                self._preview = Preview(form)
                ExecutionOptions(form)
                Orders(form)
        form.on_change(self._refresh)
        self._refresh()

    def _refresh(self) -> None:
        self._earlier.visible = self._form.has_earlier_goal
        repeat = self._form.draft.repeat
        self._start_button.set_text("Start" if repeat.recurrence == NOW else "Update the order" if repeat.order else "Create the order")

    def _clear(self) -> None:
        self._form.clear()
        self._goal_panel.field.focus()

    async def _previewed(self) -> None:
        self._preview.begin()

    async def _start(self) -> None:
        draft = self._form.draft
        if not draft.effect.strip():
            self._goal_panel.field.focus()
            notify("Enter a goal first.", bad=True)
            return
        checked = await self._api.formulas.check(CheckFormula(text=draft.effect))
        if not checked.ok:
            self._goal_panel.field.focus()
            problem = checked.problems[0]
            notify(f"The goal is not valid: {problem.problem}" + (f"; {problem.hint}" if problem.hint else ""), bad=True)
            return
        if draft.repeat.recurrence != NOW:
            await save_order(self._form)
            self._form.clear()
            return
        task = draft.task()
        if self._last_attempt is None or self._last_attempt[0] != task:
            self._last_attempt = task, uuid.uuid4().hex
        self._start_button.disable()
        try:
            # The same key for each retry: the task is submitted only once even if a reply is lost.
            submitted = await self._api.tasks.submit(task, once=self._last_attempt[1], by=app.storage.user.get("author"))
        except SomrsError:
            self._start_button.enable()
            raise
        self._form.end()
        ui.navigate.to(task_path(submitted.task))
