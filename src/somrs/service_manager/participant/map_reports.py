"""What a device has the Repository know outside of its contracts: what it noticed, and what its work left when nobody waited to hear of it.

One report is on its way at a time, under its own id, again and again until the Repository answers; so they come in the order in which
they were made.
"""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.component import Effects, EffectsReturning, Send, SetTimer
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Rejected, UpdateMap
from somrs.service_manager.participant.timers import ReportDue

PATIENCE = 10.0
"""Seconds after which a report without an answer is sent again."""

LEFTOVER_REPORT_TIME = 60.0
"""Seconds for which the Repository is told what a service left; later than that, others may know better."""

OBSERVATION_REPORT_TIME = 86_400.0
"""Seconds for which it is told what a device noticed: nobody else may know."""


class MapReport(Struct, frozen=True, kw_only=True):
    """`author` is a device or a service; given up after `expires_at`."""

    id: str
    author: str
    situation: str
    expires_at: float = field(name="until")


class MapReports(Struct, kw_only=True):
    """`ready`: the device is on the map, so that reports make sense. The first of `pending` is on its way then."""

    address: str = ""
    repository: str = ""
    count: int = 0
    ready: bool = False
    pending: list[MapReport] = []

    def add(self, author: str, situation: str, now: float, seconds: float) -> Effects:
        """Have it on the map that the situation holds."""
        self.count += 1
        id = message_id(self.address, author, "report", self.count, now)
        self.pending.append(MapReport(id=id, author=author, situation=situation, expires_at=now + seconds))
        if self.ready and len(self.pending) == 1:
            yield from self._send(now)

    def start(self, now: float) -> Effects:
        """The device is on the map."""
        if not self.ready:
            self.ready = True
            yield from self._send(now)

    def is_pending(self, id: str | None) -> bool:
        """Whether it is the report on its way."""
        return self.ready and bool(self.pending) and self.pending[0].id == id

    def answered(self, answer: Message, now: float) -> EffectsReturning[str]:
        """The Repository answered the report on its way. What is wrong with it, in words."""
        report = self.pending.pop(0)
        yield SetTimer(ReportDue(), None)
        yield from self._send(now)
        match answer.body:
            case Rejected(problems=problems):
                return f"the Repository does not take {report.situation} from {report.author}: {'; '.join(problems)}"
            case Fault(text=text):
                return f"the Repository does not take {report.situation} from {report.author}: {text}"
        return ""

    def resend(self, now: float) -> Effects:
        """No answer came, or nobody could be reached."""
        yield from self._send(now)

    def _send(self, now: float) -> Effects:
        self.pending = [report for report in self.pending if report.expires_at > now]
        if not self.pending:
            return
        report = self.pending[0]
        header = Header(sender=self.address, recipient=self.repository, message_id=report.id, reply_to=self.address)
        expires_at = min(now + PATIENCE, report.expires_at)
        yield Send(Message(header=header, body=UpdateMap(situation=report.situation, author=report.author)), expires_at)
        yield SetTimer(ReportDue(), expires_at + PATIENCE / 2)
