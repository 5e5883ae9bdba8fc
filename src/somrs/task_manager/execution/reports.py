"""The reports of the participants of one transaction, until they are on the map."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.component import Effects
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.requests import ForReport, answer_problems


class ProgressSubject(Struct, frozen=True, tag="OfProgress"):
    """An intermediate report, or a late report of a participant that was given up."""

    participant: str


class WorkSubject(Struct, frozen=True, tag="OfWork"):
    """The final report of a participant's work or compensation. `trouble`: what went wrong."""

    participant: str
    situation: str
    trouble: str | None = None


class UnobservedSubject(Struct, frozen=True, tag="OfNobody"):
    """No service could observe the object, whose state has been unknown since the work with the number `work`."""

    object: str
    work: int


ReportSubject = ProgressSubject | WorkSubject | UnobservedSubject


class Report(Struct, frozen=True, kw_only=True):
    update: UpdateMap
    subject: ReportSubject = field(name="about")


class Reports(Struct, kw_only=True):
    """Sends reports to the Repository one after the other, in order.

    Until all are settled, the transaction plans and arranges nothing (FRP, property 5).
    """

    waiting: list[Report] = field(default_factory=list)

    @property
    def pending(self) -> bool:
        return bool(self.waiting)

    def add_report(self, owner: str, report: Report, context: TaskManagerContext, now: float) -> Effects:
        """Send the report when those before it are settled. The owner receives the result as `ReportAnswered`."""
        self.waiting.append(report)
        if len(self.waiting) == 1:
            yield from self.send_next(owner, context, now)

    def send_next(self, owner: str, context: TaskManagerContext, now: float) -> Effects:
        """Send the first waiting report to the Repository."""
        yield from context.requests.update(self.waiting[0].update, ForReport(owner), now)

    def settle_first(self) -> bool:
        """Remove the first report, which is settled. Returns whether it was the last."""
        del self.waiting[0]
        return not self.waiting


def settlement(answer: Message) -> tuple[int | None, tuple[str, ...]]:
    """The map version that the replica must reach to reflect the answer, if there is one, and the problems of the report."""
    match answer.body:
        case Updated(version=version):
            return version, ()
        case Rejected(version=int(version)):  # the replica may not know yet what the report contradicts
            return version, answer_problems(answer)
        case _:
            return None, answer_problems(answer)
