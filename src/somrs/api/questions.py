"""Questions of services to people, and their answers."""

from __future__ import annotations

import asyncio

import msgspec

from somrs.access.rights import Right
from somrs.api.context import Context
from somrs.client.operations import operation
from somrs.client.questions import open_questions, put_answer
from somrs.devices.person.questions import Question

TICK = 0.5
"""Seconds between two checks for questions while a client follows them."""


class OpenQuestions(msgspec.Struct, frozen=True, kw_only=True):
    """The questions that wait for an answer, the oldest first."""

    questions: tuple[Question, ...]


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """The answer as a formula, such as `Jar002 isOn Table001`; None if the person does not know."""

    formula: str | None = None


class QuestionService:
    def __init__(self, context: Context) -> None:
        self._data = context.data
        self._hub = context.hub
        context.hub.feed("questions", self._feed)

    @operation("GET", "/questions", Right.SEE)
    async def open(self) -> OpenQuestions:
        """List the questions that wait for an answer by a person, the oldest first.

        The topic `questions` publishes the same list whenever it changes.
        """
        return OpenQuestions(questions=tuple(await asyncio.to_thread(open_questions, self._data)))

    @operation("POST", "/questions/{number}/answer", Right.OPERATE)
    async def answer(self, number: int, body: Answer) -> None:
        """Answer a question. An unsuitable answer is refused, and the question stays open."""
        await asyncio.to_thread(put_answer, number, body.formula, self._data)

    async def _feed(self, topic: str) -> None:
        published_questions: OpenQuestions | None = None
        while True:
            if (questions := await self.open()) != published_questions:
                published_questions = questions
                self._hub.publish(topic, questions)
            await asyncio.sleep(TICK)
