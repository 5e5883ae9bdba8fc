"""The reports of the participants of one transaction, until they are on the map."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct, field

from somrs.entish.formula import Name, conjunction, conjuncts, substitute, variables
from somrs.entish.parse import parse
from somrs.kernel.component import Effects
from somrs.protocol.messages import events
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.knowledge import Rejected, Updated, UpdateMap
from somrs.protocol.messages.observations import Reception
from somrs.protocol.messages.reservations import RESERVED
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
    """No service could observe the object, whose state has been unknown since the work with the number `work`.

    `repeated`: this was reported again, because the object had been seen before the work ended."""

    object: str
    work: int
    repeated: bool = False


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


class ReportResult(Struct, frozen=True, kw_only=True):
    """What became of a report: why the Repository rejected it, or else which objects it sighted and which of its parts were old news.

    `has_lost_reservation`: it was rejected because other tasks have reserved its objects since.
    """

    problems: tuple[str, ...] = ()
    reception: Reception = Reception()
    has_lost_reservation: bool = False

    def named(self, situation: str) -> str:
        """The situation with the names of the objects that it sighted, without parts about objects that could not be identified."""
        bindings = {variable: Name(name) for variable, name in self.reception.names.items()}
        if not bindings:
            return situation
        parts = [substitute(part, bindings) for part in conjuncts(parse(situation))]
        return str(conjunction(*(part for part in parts if not variables(part))))

    def events(self, service: str) -> Iterator[Event]:
        """The events that a report of this service leads to."""
        if self.problems:
            yield events.ReportRejected(service=service, problems=self.problems)
        if self.reception.added:
            yield events.ObjectsDiscovered(service=service, objects=self.reception.added)
        if self.reception.superseded:
            yield events.ReportSuperseded(service=service, parts=self.reception.superseded)


def settlement(answer: Message) -> tuple[int | None, ReportResult]:
    """The map version that the replica must reach to reflect the answer, if there is one, and what became of the report."""
    match answer.body:
        case Updated(version=version, reception=reception):
            return version, ReportResult(reception=reception or Reception())
        case Rejected(version=int(version), broken=broken):  # the replica may not know yet what the report contradicts
            has_lost_reservation = any(rule.rule == RESERVED for rule in broken)
            return version, ReportResult(problems=answer_problems(answer), has_lost_reservation=has_lost_reservation)
        case _:
            return None, ReportResult(problems=answer_problems(answer))
