"""Open questions to people, with fields for the answers."""

from __future__ import annotations

import time
from collections.abc import Callable

from nicegui import ui

from somrs.access.rights import Right
from somrs.api.questions import Answer, OpenQuestions
from somrs.api.remote import LiveApi
from somrs.client.durations import format_duration
from somrs.client.hub import News
from somrs.devices.person.questions import Question
from somrs.gui.account_menu import only_with
from somrs.gui.examples import examples
from somrs.gui.news import follow
from somrs.gui.places import PlacePicker
from somrs.gui.shell import guarded, notify


class QuestionPanel:
    """The open questions, kept up to date. `object_names`: show only questions about these objects; `person`: only those to this
    person. `on_change` receives the questions that are shown. A typed answer stays while other questions are added and removed."""

    def __init__(
        self,
        api: LiveApi,
        object_names: frozenset[str] | None = None,
        empty_text: str = "",
        person: str | None = None,
        on_change: Callable[[list[Question]], None] | None = None,
    ) -> None:
        self._api, self._object_names, self._person, self._on_change = api, object_names, person, on_change
        self._cards: dict[int, _QuestionCard] = {}
        self._open_questions = OpenQuestions(questions=())
        with ui.element("div").classes("somrs-asked").props('aria-live="polite"') as self.element:
            self._empty_label = ui.label(empty_text).classes("somrs-soft")
        self._empty_label.visible = bool(empty_text)
        self._has_empty_text = bool(empty_text)
        ui.timer(1.0, self._tick)
        follow(api.context.hub, "questions", self._read, self._handle_news)

    def set_objects(self, object_names: frozenset[str]) -> None:
        """Show only questions about these objects."""
        if object_names != self._object_names:
            self._object_names = object_names
            self._render(self._open_questions)

    async def _read(self) -> None:
        self._render(await self._api.questions.open())

    async def _handle_news(self, news: News) -> None:
        if isinstance(news.value, OpenQuestions):
            self._render(news.value)
        else:
            await self._read()

    def _render(self, open_questions: OpenQuestions) -> None:
        self._open_questions = open_questions
        questions = {
            question.number: question
            for question in open_questions.questions
            if (self._object_names is None or question.about in self._object_names) and self._person in (None, question.person)
        }
        for number in [number for number in self._cards if number not in questions]:
            self._cards.pop(number).element.delete()
        with self.element:
            for number, question in questions.items():
                if number not in self._cards:
                    self._cards[number] = _QuestionCard(self._api, question)
        self._empty_label.visible = self._has_empty_text and not questions
        if self._on_change is not None:
            self._on_change([*questions.values()])

    def _tick(self) -> None:
        for card in self._cards.values():
            card.tick()


class _QuestionCard:
    """One question."""

    def __init__(self, api: LiveApi, question: Question) -> None:
        self._api, self._question = api, question
        with ui.element("section").classes("somrs-question").props(f'aria-label="Question {question.number}"') as self.element:
            with ui.element("div").classes("somrs-question-head"):
                ui.icon("help").props('aria-hidden="true"')
                ui.label(f"{question.person} is asked")
                self._time_left = ui.label().classes("somrs-soft")
            ui.label(question.text)
            PlacePicker(question.about, api.context.map, api.context.ontology, self._choose_place)
            example = examples(api.context.map, api.context.ontology, question.about).goal
            self._formula = ui.input("Situation (formula)", placeholder=f"e.g. {example}").props("outlined dense")
            self._formula.classes("somrs-formula").on("keydown.enter", guarded(self._answer))
            with ui.element("div").classes("somrs-question-ways"):
                answer = ui.button("Answer", on_click=guarded(self._answer)).props("unelevated dense no-caps color=primary")
                no_answer = ui.button("I don't know", on_click=guarded(self._answer_unknown)).props("flat dense no-caps")
                only_with(Right.OPERATE, answer, no_answer)
        self.tick()

    def tick(self) -> None:
        self._time_left.set_text(f"{format_duration(max(0.0, self._question.until - time.time()))} left")

    def _choose_place(self, formula: str) -> None:
        self._formula.set_value(formula)

    async def _answer(self) -> None:
        if not str(self._formula.value or "").strip():
            self._formula.run_method("focus")
            notify("Choose the place, enter the situation as a formula, or choose “I don't know”.", bad=True)
            return
        await self._send_answer(str(self._formula.value))

    async def _answer_unknown(self) -> None:
        await self._send_answer(None)

    async def _send_answer(self, formula: str | None) -> None:
        page = ui.context.client
        await self._api.questions.answer(self._question.number, Answer(formula=formula))
        with page:  # the question may be closed and this panel removed by now
            notify("Answer sent.")
