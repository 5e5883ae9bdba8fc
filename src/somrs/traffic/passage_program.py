"""The program of a lift or an automatic door, without its hardware: it takes part in traffic, has the passage opened and released, and
reports how it is."""

from __future__ import annotations

from msgspec import Struct

from somrs.kernel.component import (
    Answered,
    Ask,
    DeliveryFailed,
    Effect,
    Effects,
    Input,
    Notified,
    Received,
    Send,
    SetTimer,
    Started,
    TimerFired,
    Withdraw,
)
from somrs.kernel.not_understood import refuse_request
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.traffic import CallPassage, EnterPassage, PassageEntered, ReleasePassage, ReportPassage
from somrs.traffic.participant import PassageParticipant
from somrs.traffic.passage_call import PassageCall, PassageStatus

LEASE = 30.0
"""The lease of a passage, in seconds."""
PAUSE = 2.0
"""The time after which something is tried again that was refused or failed, in seconds."""


class ReportDue(Struct, frozen=True, tag=True):
    """The lease is to be renewed, or the program is to enter again."""


class WorkDue(Struct, frozen=True, tag=True):
    """What the hardware did not do is to be tried again."""


class Work(Struct, frozen=True, tag=True):
    """The passage is to be opened or released. The numbers tell one work from another."""

    number: int


class Release(Struct, frozen=True):
    """The work for the hardware: nobody needs the passage any more."""


class Complaint(Struct, frozen=True, tag=True):
    """The work for people: traffic does not take the program, for this reason."""

    text: str


class PassageProgram:
    """The program of one passage. It is notified of a PassageStatus whenever that changes, and asks for the work of the hardware: a
    PassageCall is done when robots can come. `life`: another one for each start."""

    def __init__(self, passage: str, address: str, traffic: str, life: str) -> None:
        self._address, self._traffic, self._life = address, traffic, life
        self._participant = PassageParticipant(passage)
        self._status = PassageStatus(working=False)
        """Before the first notice, nobody knows."""
        self._is_open = False
        self._work: Work | None = None
        self._message_count = self._work_count = 0
        self._refusal = ""
        """Why it does not take part, as traffic says; empty if it does."""

    def handle(self, event: Input, now: float) -> list[Effect]:
        return [*self._effects(event, now)]

    def _effects(self, event: Input, now: float) -> Effects:
        participant = self._participant
        match event:
            case Started() | TimerFired(ReportDue()):
                yield self._report() if participant.fence else self._send(participant.enter(LEASE))
                yield SetTimer(ReportDue(), now + (LEASE / 3 if participant.fence else PAUSE))
            case Received(Message(body=PassageEntered() as answer, header=header)) if self._is_mine(header):
                self._refusal = ""
                if participant.entered(answer):
                    yield self._report()
                yield SetTimer(ReportDue(), now + answer.renew_within)
            case Received(Message(body=Fault() as fault, header=header)) if self._is_mine(header):
                if fault.text != self._refusal:
                    yield Ask(Complaint(fault.text), Complaint(fault.text))
                self._refusal, participant.fence = fault.text, 0
                yield SetTimer(ReportDue(), now + PAUSE)
            case Received(Message(body=CallPassage() | ReleasePassage() as body)) if participant.called(body):
                yield from self._work_on()
            case TimerFired(WorkDue()):
                yield from self._work_on()
            case Answered(question=question, value=value) if question == self._work:
                self._work = None
                self._is_open = participant.call is not None and not isinstance(value, Exception)
                if isinstance(value, Exception):
                    yield SetTimer(WorkDue(), now + PAUSE)
                yield self._report()
            case Notified(PassageStatus() as status) if status != self._status:
                self._status = status
                if participant.fence:
                    yield self._report()
            case DeliveryFailed(message=Message(body=EnterPassage() | ReportPassage())):
                yield SetTimer(ReportDue(), now + PAUSE)
            case Received(message):
                yield from refuse_request(message, "traffic calls and releases a passage")

    def _work_on(self) -> Effects:
        """Have the hardware do what the last call or release says."""
        if self._work is not None:
            yield Withdraw(self._work)
        call, self._is_open = self._participant.call, False
        self._work_count += 1
        self._work = Work(self._work_count)
        yield Ask(
            self._work, PassageCall(level=call.level, destination=call.destination, robots=call.robots) if call is not None else Release()
        )

    def _report(self) -> Send:
        status = self._status
        return self._send(self._participant.report(is_open=self._is_open, level=status.level, working=status.working, shared=status.shared))

    def _is_mine(self, header: Header) -> bool:
        """Whether it answers a message of this program, and not one of a program that has ended."""
        return header.relates_to is not None and header.relates_to.startswith(self._prefix)

    @property
    def _prefix(self) -> str:
        return f"urn:passage:{self._life}:"

    def _send(self, body: Body) -> Send:
        self._message_count += 1
        header = Header(
            sender=self._address,
            recipient=self._traffic,
            message_id=f"{self._prefix}{self._message_count}",
            reply_to=self._address,
        )
        return Send(Message(header=header, body=body))
