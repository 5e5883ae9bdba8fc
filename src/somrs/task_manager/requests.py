"""What a Task Manager has asked of the Repository and the Registry, and what for.

A request is sent again under its own id until it is answered or out of time; whoever is asked knows it by its id.
"""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.component import Effects, EffectsReturning, Send, SetTimer
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Discover, Discovered, Offer
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.event_text import join_reasons
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Rejected, UpdateMap
from somrs.task_manager.timers import AnswerDue

PATIENCE = 10.0
"""Seconds after which a request without an answer is sent again."""

DISCOVERY_TIME = 30.0
"""Seconds that the Registry has to answer: without services there is nothing to plan with."""

UPDATE_TIME = 86_400.0
"""Seconds for which the Repository is told what was reported: it may be down for a while, and has to know."""


class ForPlan(Struct, frozen=True, tag=True):
    """The services on offer, for the plan of the goal of that number, as it was asked for the so-manieth time."""

    owner: str
    goal: int
    serial: int


class ForLook(Struct, frozen=True, tag=True):
    """The services on offer, to find one that can look; `serial` counts the task's looks."""

    owner: str
    serial: int


class ForReport(Struct, frozen=True, tag=True):
    """A report to be put on the map."""

    owner: str


RequestPurpose = ForPlan | ForLook | ForReport


class ServicesKnown(Struct, frozen=True):
    """All that is on offer; or why that cannot be had."""

    purpose: ForPlan | ForLook
    offers: tuple[Offer, ...] | str


class ReportAnswered(Struct, frozen=True):
    """What the Repository said of a report."""

    purpose: ForReport
    answer: Message


RequestResult = ServicesKnown | ReportAnswered


class Request(Struct, frozen=True, kw_only=True):
    """`offers`: what the pages before said."""

    message: Message
    purpose: RequestPurpose
    expires_at: float = field(name="until")
    offers: tuple[Offer, ...] = field(default=(), name="found")


class Requests(Struct, kw_only=True):
    """Every answer comes with what it was asked for; when none comes in time, a Fault."""

    address: str
    repository: str
    registry: str
    pending: dict[str, Request] = field(default_factory=dict)
    incarnation: float = 0.0
    request_count: int = field(default=0, name="asked")

    def start(self, now: float) -> None:
        """The time is part of the ids: what was asked in an earlier life that is forgotten is another question."""
        self.incarnation = self.incarnation or now

    def update(self, body: UpdateMap, purpose: ForReport, now: float) -> Effects:
        """Have the Repository change its map."""
        yield from self._ask(self.repository, body, purpose, now, UPDATE_TIME)

    def discover(self, purpose: ForPlan | ForLook, now: float, offers: tuple[Offer, ...] = ()) -> Effects:
        """Read from the Registry, page by page, all that is on offer."""
        discover = Discover(after=offers[-1].service if offers else "")
        yield from self._ask(self.registry, discover, purpose, now, DISCOVERY_TIME, offers)

    def is_answer(self, message: Message) -> bool:
        return message.header.relates_to in self.pending

    def answered(self, message: Message, now: float) -> EffectsReturning[RequestResult | None]:
        """An answer came. What it means, unless more is to come."""
        request = self.pending.pop(message.header.relates_to or "")
        yield SetTimer(AnswerDue(request.message.header.message_id), None)
        return (yield from self._interpret_answer(request, message, now))

    def delivery_failed(self, message: Message, reason: str, now: float) -> EffectsReturning[RequestResult | None]:
        """A request never arrived."""
        request = self.pending[message.header.message_id]
        return (yield from self._retry(request, f"{message.header.recipient} could not be reached: {reason}", now))

    def timer_fired(self, timer: AnswerDue, now: float) -> EffectsReturning[RequestResult | None]:
        """The answer to a request is overdue."""
        request = self.pending.get(timer.request)
        if request is None:
            return None
        return (yield from self._retry(request, f"{request.message.header.recipient} does not answer", now))

    def _interpret_answer(self, request: Request, answer: Message, now: float) -> EffectsReturning[RequestResult | None]:
        purpose = request.purpose
        if isinstance(purpose, ForReport):
            return ReportAnswered(purpose, answer)
        if not isinstance(answer.body, Discovered):
            return ServicesKnown(purpose, f"the Service Registry answered: {join_reasons(answer_problems(answer))}")
        offers = request.offers + answer.body.offers
        if answer.body.more and answer.body.offers:
            yield from self.discover(purpose, now, offers)
            return None
        return ServicesKnown(purpose, offers)

    def _ask(
        self, recipient: str, body: Body, purpose: RequestPurpose, now: float, seconds: float, offers: tuple[Offer, ...] = ()
    ) -> Effects:
        self.request_count += 1
        id = message_id(self.address, self.incarnation, self.request_count)
        header = Header(sender=self.address, recipient=recipient, message_id=id, reply_to=self.address)
        request = Request(message=Message(header=header, body=body), purpose=purpose, expires_at=now + seconds, offers=offers)
        self.pending[id] = request
        yield from self._send_request(request, now)

    def _send_request(self, request: Request, now: float) -> Effects:
        expires_at = min(now + PATIENCE, request.expires_at)
        yield Send(request.message, expires_at)
        yield SetTimer(AnswerDue(request.message.header.message_id), expires_at + PATIENCE / 2)

    def _retry(self, request: Request, trouble: str, now: float) -> EffectsReturning[RequestResult | None]:
        if now < request.expires_at:
            yield from self._send_request(request, now)
            return None
        id = request.message.header.message_id
        del self.pending[id]
        yield SetTimer(AnswerDue(id), None)
        fault = Message(header=request.message.header, body=Fault(code="env:Receiver", text=trouble))
        return (yield from self._interpret_answer(request, fault, now))


def answer_problems(answer: Message) -> tuple[str, ...]:
    """What an answer that is not the wanted one says."""
    match answer.body:
        case Rejected(problems=problems):
            return tuple(problems)
        case Fault(text=text):
            return (text,)
        case body:
            return (type(body).__name__,)
