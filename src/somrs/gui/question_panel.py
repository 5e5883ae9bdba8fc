"""Open questions to people, with a place for the answer."""

from __future__ import annotations

import time

from nicegui import ui

from somrs.api.questions import Answer, OpenQuestions
from somrs.api.remote import LiveApi
from somrs.client.hub import News
from somrs.devices.person.questions import Question
from somrs.gui.news import follow
from somrs.gui.shell import guarded, tell


class Asked:
    """The open questions, while the page is open; `about`: only those about one of these objects. What was typed stays while other
    questions come and go."""

    def __init__(self, desk: LiveApi, about: frozenset[str] | None = None, nobody: str = "") -> None:
        self._desk, self._about = desk, about
        self._asked: dict[int, _Asked] = {}
        self._found = OpenQuestions(questions=())
        with ui.element("div").classes("somrs-asked").props('aria-live="polite"') as self.element:
            self._nobody = ui.label(nobody).classes("somrs-soft")
        self._nobody.visible = bool(nobody)
        self._said = bool(nobody)
        ui.timer(1.0, self._tick)
        follow(desk.context.hub, "questions", self._read, self._hear)

    def ask_about(self, about: frozenset[str]) -> None:
        """Those about one of these objects from now on."""
        if about != self._about:
            self._about = about
            self._show(self._found)

    async def _read(self) -> None:
        self._show(await self._desk.questions.open())

    async def _hear(self, news: News) -> None:
        if isinstance(news.value, OpenQuestions):
            self._show(news.value)
        else:
            await self._read()

    def _show(self, found: OpenQuestions) -> None:
        self._found = found
        wanted = {one.number: one for one in found.questions if self._about is None or one.about in self._about}
        for number in [number for number in self._asked if number not in wanted]:
            self._asked.pop(number).element.delete()
        with self.element:
            for number, question in wanted.items():
                if number not in self._asked:
                    self._asked[number] = _Asked(self._desk, question)
        self._nobody.visible = self._said and not wanted

    def _tick(self) -> None:
        for one in self._asked.values():
            one.tick()


class _Asked:
    """One question."""

    def __init__(self, desk: LiveApi, question: Question) -> None:
        self._desk, self._question = desk, question
        with ui.element("section").classes("somrs-question").props(f'aria-label="Question {question.number}"') as self.element:
            with ui.element("div").classes("somrs-question-head"):
                ui.icon("help").props('aria-hidden="true"')
                ui.label(f"{question.person} is asked")
                self._left = ui.label().classes("somrs-soft")
            ui.label(question.text)
            self._formula = ui.input("What is so", placeholder=f"such as {question.about} isOn Table001").props("outlined dense")
            self._formula.classes("somrs-formula").on("keydown.enter", guarded(self._answer))
            with ui.element("div").classes("somrs-question-ways"):
                ui.button("Answer", on_click=guarded(self._answer)).props("unelevated dense no-caps color=primary")
                ui.button("I cannot tell", on_click=guarded(self._cannot_tell)).props("flat dense no-caps")
        self.tick()

    def tick(self) -> None:
        self._left.set_text(f"{max(0.0, self._question.until - time.time()):.0f} s left")

    async def _answer(self) -> None:
        if not str(self._formula.value or "").strip():
            self._formula.run_method("focus")
            tell("Say what is so as a formula, or that you cannot tell.", bad=True)
            return
        await self._put(str(self._formula.value))

    async def _cannot_tell(self) -> None:
        await self._put(None)

    async def _put(self, formula: str | None) -> None:
        page = ui.context.client
        await self._desk.questions.answer(self._question.number, Answer(formula=formula))
        with page:  # this panel may be gone by now: the question is open no more
            tell("Thank you: the answer was taken.")
