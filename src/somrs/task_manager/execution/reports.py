"""What the participants of one transaction report, on its way to the map."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.component import Effects
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.requests import ForReport, answer_problems


class ProgressSubject(Struct, frozen=True, tag="OfProgress"):
    """The participant goes on with its work, or was given up long ago."""

    participant: str


class WorkSubject(Struct, frozen=True, tag="OfWork"):
    """The participant's work, or its undoing, is over. `trouble`: what went wrong."""

    participant: str
    situation: str
    trouble: str | None = None


class UnobservedSubject(Struct, frozen=True, tag="OfNobody"):
    """Nobody could look at the object, of which nothing is known since that work."""

    object: str
    work: int


ReportSubject = ProgressSubject | WorkSubject | UnobservedSubject


class Report(Struct, frozen=True, kw_only=True):
    update: UpdateMap
    subject: ReportSubject = field(name="about")


class Reports(Struct, kw_only=True):
    """One report after the other, so that none overtakes a later one. Until all are settled, nothing is planned or arranged (FRP, property
    5)."""

    waiting: list[Report] = field(default_factory=list)

    @property
    def pending(self) -> bool:
        return bool(self.waiting)

    def add_report(self, owner: str, report: Report, context: TaskManagerContext, now: float) -> Effects:
        """Put it on the map, when those before it are there. The owner hears of it by `answered`."""
        self.waiting.append(report)
        if len(self.waiting) == 1:
            yield from self.send_next(owner, context, now)

    def send_next(self, owner: str, context: TaskManagerContext, now: float) -> Effects:
        """Tell the Repository the first that waits."""
        yield from context.requests.update(self.waiting[0].update, ForReport(owner), now)

    def settle_first(self) -> bool:
        """The first is settled; whether it was the last."""
        del self.waiting[0]
        return not self.waiting


def settlement(answer: Message) -> tuple[int | None, tuple[str, ...]]:
    """The version of the map that shows what the Repository answered to a report, if any does, and what is wrong with the report."""
    match answer.body:
        case Updated(version=version):
            return version, ()
        case Rejected(version=int(version)):  # what it contradicts may not be known here yet
            return version, answer_problems(answer)
        case _:
            return None, answer_problems(answer)
