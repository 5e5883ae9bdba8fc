"""New task: state a wish, say how it is to be done, see what that would mean, and start it."""

from __future__ import annotations

import asyncio
import uuid

from nicegui import app, background_tasks, ui

from somrs.api.formulas import CheckFormula
from somrs.api.remote import LiveApi
from somrs.errors import SomrsError
from somrs.gui.pages.define.draft import NOW, Draft
from somrs.gui.pages.define.execution_options import How
from somrs.gui.pages.define.form import Form
from somrs.gui.pages.define.goal import Wish
from somrs.gui.pages.define.orders import Orders, give
from somrs.gui.pages.define.preview import Preview
from somrs.gui.pages.define.templates import TemplateMenu
from somrs.gui.pages.task_words import path
from somrs.gui.shell import guarded, page, tell
from somrs.protocol.messages.clients import Submit

SETTLED = 0.4
"""Seconds within which the browser says what it kept."""


def register(desk: LiveApi) -> None:
    @ui.page("/define")
    async def show(effect: str = "") -> None:
        with page("New task", "/define", desk):
            made = _Define(desk, effect)
        background_tasks.create(made.begin(), context=ui.context.client)


class _Define:
    """The page. `effect`: the wish that it is opened with."""

    def __init__(self, desk: LiveApi, effect: str) -> None:
        self._desk = desk
        self._client = ui.context.client
        self._form = form = Form(desk, Draft(effect=effect, link=effect))
        self._tried: tuple[Submit, str] | None = None
        with ui.element("div").classes("somrs-define-head"):
            ui.label("New task").classes("somrs-title").props('role="heading" aria-level="1"')
            self._templates = TemplateMenu(form)
            ui.button("Clear", icon="backspace", on_click=self._clear).props("flat dense no-caps")
            ui.space()
            ui.button("Preview", icon="preview", on_click=self._previewed).props("outline dense no-caps").classes("somrs-define-act")
            self._start_button = ui.button("Start", icon="play_arrow", on_click=guarded(self._start)).props(
                "unelevated dense no-caps color=primary"
            )
            self._start_button.classes("somrs-define-act")
        with ui.element("div").classes("somrs-define"):
            with ui.element("div").classes("somrs-define-column"):
                self._wish = Wish(form, self._previewed)
            with ui.element("div").classes("somrs-define-column"):
                self._preview = Preview(form)
                How(form)
                Orders(form)
        form.on_change(self._show)

    async def begin(self) -> None:
        await self._client.connected()
        await asyncio.sleep(SETTLED)
        self._form.begin()

    def _show(self) -> None:
        repeat = self._form.draft.repeat
        self._start_button.set_text("Start" if repeat.how == NOW else "Change the order" if repeat.order else "Give the order")

    def _clear(self) -> None:
        self._form.clear()
        self._wish.field.focus()

    async def _previewed(self) -> None:
        self._preview.begin()

    async def _start(self) -> None:
        draft = self._form.draft
        if not draft.effect.strip():
            self._wish.field.focus()
            tell("Say first what is to be.", bad=True)
            return
        checked = await self._desk.formulas.check(CheckFormula(text=draft.effect))
        if not checked.ok:
            self._wish.field.focus()
            problem = checked.problems[0]
            tell(f"This is no wish yet: {problem.problem}" + (f"; {problem.hint}" if problem.hint else ""), bad=True)
            return
        if draft.repeat.how != NOW:
            await give(self._form)
            self._form.clear()
            return
        task = draft.task()
        if self._tried is None or self._tried[0] != task:
            self._tried = task, uuid.uuid4().hex
        self._start_button.disable()
        try:
            # With the same word until it was taken: then it is not stated twice when an answer is lost.
            submitted = await self._desk.tasks.submit(task, once=self._tried[1], by=app.storage.user.get("author"))
        except SomrsError:
            self._start_button.enable()
            raise
        self._form.end()
        ui.navigate.to(path(submitted.task))
