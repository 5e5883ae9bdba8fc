"""A plan that is being made: first the services on offer are discovered, then the planner is asked."""

from __future__ import annotations

from collections.abc import Callable

from somrs.errors import FormulaError
from somrs.protocol.clients import Submit
from somrs.protocol.component import Ask, Withdraw
from somrs.protocol.directory import Offer
from somrs.task_manager.offered import Offered
from somrs.task_manager.setting import Setting, problem

Made = Callable[[object, float], None]
"""Called with what the planner answered, or with a text that says why it could not be asked."""


class Draft:
    """`question` is the one that the planner is asked. A draft that is withdrawn calls nobody."""

    def __init__(self, question: str, task: Submit, offered: Offered, setting: Setting, made: Made) -> None:
        self.question = question
        self._task, self._offered, self._setting = task, offered, setting
        self._made: Made | None = made

    def begin(self, now: float) -> None:
        self._setting.questions.discover(self._discovered, now)

    def _discovered(self, offers: tuple[Offer, ...] | str, now: float) -> None:
        if self._made is None:
            return
        if isinstance(offers, str):
            self._made(offers, now)
            return
        self._offered.discovered(offers)
        try:
            task = problem(self._task, self._setting.replica, self._offered.usable)
        except FormulaError as error:
            self._made(f"the task does not fit the map any more: {error}", now)
        else:
            self._setting.effects.append(Ask(self.question, task))

    def answered(self, value: object, now: float) -> None:
        """What the planner found."""
        if self._made is not None:
            self._made(value, now)

    def withdraw(self) -> None:
        """It is out of date, or not wanted any more."""
        self._made = None
        self._setting.effects.append(Withdraw(self.question))
