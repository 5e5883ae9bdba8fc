"""What the participants of one transaction report, on its way to the map."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.task_manager.questions import said
from somrs.task_manager.setting import Setting

Then = Callable[[str | None, float], None]
"""Called with what was wrong with the report, or None when it is on the map."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Report:
    update: UpdateMap
    then: Then


class Reports:
    """One report after the other, so that none overtakes a later one; a report is over when it is on the Task Manager's own
    copy of the map. `settled` is called when all are over: until then nothing is planned or arranged (FRP, property 5)."""

    def __init__(self, setting: Setting, settled: Callable[[float], None]) -> None:
        self._setting, self._settled = setting, settled
        self._waiting: deque[_Report] = deque()

    @property
    def pending(self) -> bool:
        return bool(self._waiting)

    def put(self, update: UpdateMap, then: Then, now: float) -> None:
        """Put it on the map."""
        self._waiting.append(_Report(update=update, then=then))
        if len(self._waiting) == 1:
            self._next(now)

    def _next(self, now: float) -> None:
        self._setting.questions.update(self._waiting[0].update, self._answered, now)

    def _answered(self, answer: Message, now: float) -> None:
        match answer.body:
            case Updated(version=version):
                self._setting.when_known(version, partial(self._over, None), now)
            case Rejected(version=int(version)):  # what it contradicts may not be known here yet
                self._setting.when_known(version, partial(self._over, said(answer)), now)
            case _:
                self._over(said(answer), now)

    def _over(self, problem: str | None, now: float) -> None:
        report = self._waiting[0]
        report.then(problem, now)
        self._waiting.popleft()
        if self._waiting:
            self._next(now)
        else:
            self._settled(now)
