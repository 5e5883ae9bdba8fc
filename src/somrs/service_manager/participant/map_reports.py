"""Reports to the Repository outside of contracts: observations of the device, and what work left when no coordinator waits for it.

One report is under way at a time. It is repeated with the same id until the Repository answers, so reports arrive in their order.
"""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.component import Effects, EffectsReturning, Send, SetTimer
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Rejected, UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.service_manager.participant.timers import ReportDue

PATIENCE = 10.0
"""Seconds after which a report without an answer is sent again."""

LEFTOVER_REPORT_TIME = 60.0
"""Seconds for which a report on what a service left is sent; after that, others may have changed it."""

OBSERVATION_REPORT_TIME = 86_400.0
"""Seconds for which an observation is sent; the device may be the only one that knows it."""


class MapReport(Struct, frozen=True, kw_only=True):
    """A report. `author` is a device or a service; after `expires_at` the report is given up."""

    id: str
    author: str
    situation: str | None
    expires_at: float = field(name="until")
    observation: Observation | None = None

    def __str__(self) -> str:
        gone = self.observation.gone if self.observation is not None else ()
        return " AND ".join(filter(None, (self.situation, *(f"{name} is gone" for name in gone)))) or "what it searched"


class MapReports(Struct, kw_only=True):
    """The queue of reports. `ready`: the device is on the map; the first of `pending` is under way."""

    address: str = ""
    repository: str = ""
    count: int = 0
    ready: bool = False
    pending: list[MapReport] = []

    def add(self, author: str, situation: str | None, now: float, seconds: float, observation: Observation | None = None) -> Effects:
        """Queue a report that the situation holds, or held when it was observed."""
        self.count += 1
        id = message_id(self.address, author, "report", self.count, now)
        self.pending.append(MapReport(id=id, author=author, situation=situation, expires_at=now + seconds, observation=observation))
        if self.ready and len(self.pending) == 1:
            yield from self._send(now)

    def start(self, now: float) -> Effects:
        """Begin to send: the device is on the map."""
        if not self.ready:
            self.ready = True
            yield from self._send(now)

    def is_pending(self, id: str | None) -> bool:
        """Whether this is the id of the report under way."""
        return self.ready and bool(self.pending) and self.pending[0].id == id

    def answered(self, answer: Message, now: float) -> EffectsReturning[str]:
        """Handle the answer to the report under way. Return why the Repository rejected it; empty when it did not."""
        report = self.pending.pop(0)
        yield SetTimer(ReportDue(), None)
        yield from self._send(now)
        match answer.body:
            case Rejected(problems=problems):
                return f"the Repository rejects {report} from {report.author}: {'; '.join(problems)}"
            case Fault(text=text):
                return f"the Repository rejects {report} from {report.author}: {text}"
        return ""

    def resend(self, now: float) -> Effects:
        """Send the report again, because no answer came or it was not delivered."""
        yield from self._send(now)

    def _send(self, now: float) -> Effects:
        self.pending = [report for report in self.pending if report.expires_at > now]
        if not self.pending:
            return
        report = self.pending[0]
        header = Header(sender=self.address, recipient=self.repository, message_id=report.id, reply_to=self.address)
        expires_at = min(now + PATIENCE, report.expires_at)
        body = UpdateMap(situation=report.situation, author=report.author, observation=report.observation)
        yield Send(Message(header=header, body=body), expires_at)
        yield SetTimer(ReportDue(), expires_at + PATIENCE / 2)
