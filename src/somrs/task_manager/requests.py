"""The pending requests of a Task Manager to the Repository and the Registry, and their purposes.

A request is sent again under the same id until it is answered or its time is over. The recipient recognizes a repetition by the id.
"""

from __future__ import annotations

from msgspec import Struct, field

from somrs.kernel.component import DeliveryFailed, Effects, EffectsReturning, Input, Received, Send, SetTimer
from somrs.kernel.offers import Offers
from somrs.ontology.agreement import disagreements
from somrs.ontology.types import Ontology
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Discover, Discovered, Offer, SubscribeServices
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.event_text import join_reasons
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Rejected, UpdateMap
from somrs.protocol.messages.reservations import (
    AssignTask,
    Claim,
    ClaimReservations,
    Release,
    ReservationDenied,
    Reserve,
    Reserved,
    TaskAssigned,
)
from somrs.task_manager.timers import AnswerDue

PATIENCE = 10.0
"""Seconds after which a request without an answer is sent again."""

DISCOVERY_TIME = 30.0
"""Seconds for which a task waits for the services on offer. Planning is impossible without them."""

SETTLING_TIME = 5.0
"""Seconds for which a request waits until providers and Registry have the service types as the Repository defines them now."""

PAUSE = 0.3
"""Seconds between two requests meanwhile."""

ARRIVALS_LEASE = 180.0
"""Seconds for which the Registry reports arrivals of services. A task that waits asks for more well before they are over."""

UPDATE_TIME = 86_400.0
"""Seconds for which a report is sent to the Repository, which has to receive it even after a long outage."""


class ForPlan(Struct, frozen=True, tag=True):
    """The services on offer, for a plan of the goal with the number `goal`; `serial` counts the plans of the goal."""

    owner: str
    goal: int
    serial: int


class ForLook(Struct, frozen=True, tag=True):
    """The services on offer, for an observation; `serial` counts the observations of the task."""

    owner: str
    serial: int


class ForReport(Struct, frozen=True, tag=True):
    """A report for the map."""

    owner: str


class ForPause(Struct, frozen=True, tag=True):
    """Devices stand still because the task is paused, or go on. Nothing depends on the answer."""

    owner: str


class ForReservation(Struct, frozen=True, tag=True):
    """Objects for a plan of the goal with the number `goal`, or to undo work (0). `serial`: the number of the request."""

    owner: str
    goal: int
    serial: int


class ForAssignment(Struct, frozen=True, tag=True):
    """Whose task it is."""

    owner: str


RequestPurpose = ForPlan | ForLook | ForReport | ForPause | ForReservation | ForAssignment


DiscoveredOffers = tuple[Offer, ...] | str | None
"""All services on offer: None for those of the Task Manager's copy. Or the reason why they are not known."""


class ServicesKnown(Struct, frozen=True):
    """The services on offer are known, or why they are not."""

    purpose: ForPlan | ForLook
    offers: DiscoveredOffers


class ReportAnswered(Struct, frozen=True):
    """The Repository's answer to a report."""

    purpose: ForReport
    answer: Message


ReservationAnswer = Reserved | ReservationDenied | str
"""The Repository's answer to a request for a reservation; or why there is none."""


class ReservationAnswered(Struct, frozen=True):
    """The answer to a request for a reservation."""

    purpose: ForReservation
    answer: ReservationAnswer


class AssignmentAnswered(Struct, frozen=True):
    """The answer to the question whose task it is."""

    purpose: ForAssignment
    answer: TaskAssigned | Fault


RequestResult = ServicesKnown | ReportAnswered | ReservationAnswered | AssignmentAnswered


class Request(Struct, frozen=True, kw_only=True):
    """A pending request. `offers`: those of the earlier pages. `settles_by`: until when it is repeated if the offers are not settled."""

    message: Message
    purpose: RequestPurpose
    expires_at: float = field(name="until")
    offers: tuple[Offer, ...] = field(default=(), name="found")
    settles_by: float | None = None


class Requests(Struct, kw_only=True):
    """All pending requests. Each results in an answer with its purpose; if none comes in time, in a Fault."""

    address: str
    repository: str
    registry: str
    pending: dict[str, Request] = field(default_factory=dict)
    incarnation: float = 0.0
    request_count: int = field(default=0, name="asked")
    follows_until: float = 0.0
    """Until when the Registry reports arrivals of services."""
    serial: int = 0
    """The number of the latest message about reservations."""

    def start(self, now: float) -> None:
        """Make the time part of all request ids, so that a Task Manager that lost its state does not use earlier ids again."""
        self.incarnation = self.incarnation or now

    def update(self, body: UpdateMap, purpose: ForReport | ForPause, now: float) -> Effects:
        """Request a change of the map from the Repository."""
        yield from self._send_request(self._new_request(self.repository, body, purpose, now + UPDATE_TIME), now)

    def reserve(self, body: Reserve, purpose: ForReservation, now: float) -> Effects:
        """Request a reservation from the Repository."""
        yield from self._send_request(self._new_request(self.repository, body, purpose, now + UPDATE_TIME), now)

    def assign(self, task: str, now: float) -> Effects:
        """Ask the Repository whose task it is."""
        request = self._new_request(
            self.repository, AssignTask(task=task), ForAssignment(task), now + UPDATE_TIME, id=message_id("assign", task)
        )
        yield from self._send_request(request, now)

    def notify(self, body: Release | ClaimReservations, now: float) -> Effects:
        """Tell the Repository about reservations."""
        yield Send(self._message(self.repository, body), now + UPDATE_TIME)

    def release_ended(self, task: str, now: float) -> Effects:
        """Tell the Repository that a task has ended, if it does not seem to know."""
        yield from self.notify(Release(task=task, serial=self.next_serial(now), ended=True), now)

    def claim(self, claims: tuple[Claim, ...], now: float) -> Effects:
        """Tell the Repository what all tasks have. It may be another one, or may not have received what was sent last."""
        yield from self.notify(ClaimReservations(serial=self.next_serial(now), claims=claims), now)

    def next_serial(self, now: float) -> int:
        """A number for a message about reservations. The time is part of it, so that it is new even if the state was lost."""
        self.serial = max(self.serial + 1, int(now * 1000))
        return self.serial

    def discover(self, purpose: ForPlan | ForLook, now: float) -> Effects:
        """Read all offers from the Registry, page by page, as in journals of programs that did so for each task."""
        yield from self._send_request(self._discovery(purpose, now, now + SETTLING_TIME), now)

    def _discovery(self, purpose: RequestPurpose, now: float, settles_by: float | None, offers: tuple[Offer, ...] = ()) -> Request:
        discover = Discover(after=offers[-1].service if offers else "")
        return self._new_request(self.registry, discover, purpose, now + DISCOVERY_TIME, offers, settles_by)

    def follow_arrivals(self, now: float) -> Effects:
        """Subscribe to the arrivals of services for a while, unless the last subscription has just begun, as in such journals."""
        if now < self.follows_until - ARRIVALS_LEASE / 2:
            return
        self.follows_until = now + ARRIVALS_LEASE
        yield Send(self._message(self.registry, SubscribeServices(lease=ARRIVALS_LEASE)), now + PATIENCE)

    def is_answer(self, message: Message) -> bool:
        return message.header.relates_to in self.pending

    def concerns(self, event: Input) -> bool:
        """Whether the input is the answer to a pending request, or the news that it could not be delivered."""
        match event:
            case Received(message):
                return self.is_answer(message)
            case DeliveryFailed(message):
                return message.header.message_id in self.pending
            case _:
                return False

    def answered(self, message: Message, ontology: Ontology, now: float) -> EffectsReturning[RequestResult | None]:
        """Handle an answer. `ontology` is the one by which offers are judged.

        Returns None if the answer has further pages, or if the offers are not settled: the request is then repeated after a moment.
        """
        request = self.pending.pop(message.header.relates_to or "")
        yield SetTimer(AnswerDue(request.message.header.message_id), None)
        return (yield from self._interpret_answer(request, message, now, ontology))

    def delivery_failed(self, message: Message, reason: str, now: float) -> EffectsReturning[RequestResult | None]:
        """Handle a request that could not be delivered."""
        request = self.pending[message.header.message_id]
        return (yield from self._retry(request, f"{message.header.recipient} could not be reached: {reason}", now))

    def timer_fired(self, timer: AnswerDue, now: float) -> EffectsReturning[RequestResult | None]:
        """Handle a request whose answer is overdue."""
        request = self.pending.get(timer.request)
        if request is None:
            return None
        return (yield from self._retry(request, f"{request.message.header.recipient} does not answer", now))

    def overdue(self, id: str) -> tuple[str, float] | None:
        """The task whose request to the Repository has not been answered in time, and when it was sent; None for another request."""
        request = self.pending.get(id)
        if request is None or not isinstance(request.purpose, ForReport | ForReservation):
            return None
        return request.purpose.owner, request.expires_at - UPDATE_TIME

    def _interpret_answer(
        self, request: Request, answer: Message, now: float, ontology: Ontology = Ontology()
    ) -> EffectsReturning[RequestResult | None]:
        purpose, body = request.purpose, answer.body
        if isinstance(purpose, ForPause):
            return None
        if isinstance(purpose, ForReport):
            return ReportAnswered(purpose, answer)
        if isinstance(purpose, ForReservation):
            reply = body if isinstance(body, Reserved | ReservationDenied) else join_reasons(answer_problems(answer))
            return ReservationAnswered(purpose, reply)
        if isinstance(purpose, ForAssignment):
            problem = Fault(code="env:Receiver", text=f"the Repository answered: {join_reasons(answer_problems(answer))}")
            return AssignmentAnswered(purpose, body if isinstance(body, TaskAssigned) else problem)
        if not isinstance(body, Discovered):
            return ServicesKnown(purpose, f"the Service Registry answered: {join_reasons(answer_problems(answer))}")
        offers = request.offers + body.offers
        if body.more and body.offers:
            yield from self._send_request(self._discovery(purpose, now, request.settles_by, offers), now)
            return None
        if request.settles_by is not None and now < request.settles_by and (body.unsettled or is_out_of_date(Offers(offers), ontology)):
            later_request = self._discovery(purpose, now, request.settles_by)
            yield SetTimer(AnswerDue(later_request.message.header.message_id), now + PAUSE)
            return None
        return ServicesKnown(purpose, offers)

    def _new_request(
        self,
        recipient: str,
        body: Body,
        purpose: RequestPurpose,
        expires_at: float,
        offers: tuple[Offer, ...] = (),
        settles_by: float | None = None,
        id: str | None = None,
    ) -> Request:
        message = self._message(recipient, body, id)
        request = Request(message=message, purpose=purpose, expires_at=expires_at, offers=offers, settles_by=settles_by)
        self.pending[message.header.message_id] = request
        return request

    def _message(self, recipient: str, body: Body, id: str | None = None) -> Message:
        self.request_count += 1
        id = id or message_id(self.address, self.incarnation, self.request_count)
        return Message(header=Header(sender=self.address, recipient=recipient, message_id=id, reply_to=self.address), body=body)

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


def is_out_of_date(offers: Offers, ontology: Ontology) -> bool:
    """Whether an offer and the ontology disagree about a service type: a change has reached only one of Registry and Task Manager."""
    services = ontology.services
    return any(type.name in services and disagreements(type, services[type.name]) for type in offers.definitions)


def answer_problems(answer: Message) -> tuple[str, ...]:
    """The problems that a negative or unexpected answer states."""
    match answer.body:
        case Rejected(problems=problems):
            return tuple(problems)
        case Fault(text=text):
            return (text,)
        case body:
            return (type(body).__name__,)
