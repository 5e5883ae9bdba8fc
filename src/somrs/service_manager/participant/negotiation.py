"""How a device answers an Arrange: it quotes the service, and offers terms for a time at which it is free, or refuses."""

from __future__ import annotations

from collections.abc import Iterable

from somrs.errors import FormulaError
from somrs.kernel.component import Ask, Effects
from somrs.protocol.frp.session import ParticipantBody, service_of
from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import State
from somrs.service_manager.participant.calendar import Commitment, first_free_time, resolve_overlaps
from somrs.service_manager.participant.job import Job
from somrs.service_manager.participant.messaging import send_message
from somrs.service_manager.participant.state import ServiceManagerState
from somrs.service_manager.participant.timers import Activity, TermsDue, WorkWanted
from somrs.service_manager.sdk.orders import Answer, Capability, Order, Quote, Quoted, Refused
from somrs.service_manager.sdk.values import fill_in


class Negotiation:
    """The terms that one device offers, and the calendar of its commitments."""

    def __init__(self, state: ServiceManagerState) -> None:
        self._state, self._jobs = state, state.jobs

    def calendar(self, now: float) -> list[Commitment]:
        """Return the commitments of the device. Overdue ones start, or end, at `now`."""
        return self._commitments(self._jobs, now)

    def _commitments(self, jobs: Iterable[Job], now: float) -> list[Commitment]:
        busy: list[Commitment] = []
        for job in jobs:
            if not job.has_contract or (terms := job.session.terms) is None or not self._state.occupies(job):
                continue
            start = job.started_at if job.started_at is not None else max(terms.start_from or now, now)
            busy.append((start, max(start + terms.duration, now)))
        return busy

    def arrange(self, job: Job, now: float) -> Effects:
        """Let the device quote the service, or refuse the order."""
        arrange = job.session.order
        assert arrange is not None, "a session becomes Arranging by an Arrange"
        capability = self._capability(job, arrange)
        if self._state.leaving or capability is None:
            offered = ", ".join(candidate.type_name for candidate in self._state.profile.capabilities)
            reason = "is leaving" if self._state.leaving else f"offers {offered}, and not {arrange.service_type}"
            refuse = frp.Refuse(reason=f"{self._state.profile.name} {reason}", not_now=self._state.leaving)
            yield from send_message(job, refuse, self._jobs, now)
            return
        job.order = Order(
            transaction=job.session.transaction,
            participant=job.session.participant,
            method=capability.method,
            inputs=arrange.inputs,
            effect=arrange.effect,
            precondition=arrange.precondition,
            earliest_start=arrange.earliest_start,
            latest_finish=arrange.latest_finish,
            situation=arrange.situation,
        )
        job.activity = Activity.QUOTE
        yield Ask(job.question_for(Activity.QUOTE), Quote(job.order))

    def _capability(self, job: Job, arrange: frp.Arrange) -> Capability | None:
        """Return the service that the participant's id names, or else one of the requested type."""
        named, profile = service_of(job.session.participant), self._state.profile
        of_type = [candidate for candidate in profile.capabilities if candidate.type_name == arrange.service_type]
        return next(
            (candidate for candidate in profile.capabilities if profile.service(candidate) == named), of_type[0] if of_type else None
        )

    def quoted(self, question: WorkWanted, value: Answer, now: float) -> Effects:
        """Offer terms for the device's quote, or refuse."""
        job = self._jobs.find_job(question.transaction, question.participant)
        if job is None or job.activity is not Activity.QUOTE:
            return
        job.activity = None
        self._jobs.store_job(job)
        if job.session.state is not State.ARRANGING:
            return
        answer: ParticipantBody
        try:
            answer = self._terms(job, value, now) if isinstance(value, Quoted) else _refusal(value)
        except FormulaError as error:
            answer = frp.Refuse(reason=str(error))
        yield from send_message(job, answer, self._jobs, now)
        if isinstance(answer, frp.Terms):
            job.offered_at = now
            yield from job.set_timer(TermsDue, answer.valid_until)

    def lapse(self, job: Job, body: Body, now: float) -> str:
        """Why the terms that the participant has offered do not hold any more when it receives a message; empty if they do.

        They have expired, or another Task Manager's contract has come first, of which the one that accepts them cannot know.
        """
        terms = job.session.terms
        if job.session.state is not State.OFFERED or terms is None:
            return ""
        if terms.valid_until is not None and terms.valid_until <= now:
            return "the terms expired"
        others = [other for other in self._jobs if other.session.peer != job.session.peer]
        is_new = any(
            other.accepted_at is not None and other.accepted_at >= (job.offered_at or now) for other in others if other.has_contract
        )
        if not is_new or not isinstance(body, frp.Accept | frp.Execute) or not self._state.occupies(job):
            return ""
        start, capacity = max(now, terms.start_from or now), self._state.profile.capacity
        first_free = first_free_time(resolve_overlaps(self._commitments(others, now), capacity), start, terms.duration, capacity)
        return f"another contract came first, and delays it by {first_free - start:.0f} s" if first_free > start else ""

    def _terms(self, job: Job, quoted: Quoted, now: float) -> frp.Terms | frp.Refuse:
        assert job.order is not None, "a quote follows an order"
        order = job.order
        capacity = self._state.profile.capacity
        start = max(now, order.earliest_start or now)
        if self._state.occupies(job):
            start = first_free_time(resolve_overlaps(self.calendar(now), capacity), start, quoted.duration, capacity)
        latest_start = None if order.latest_finish is None else order.latest_finish - quoted.duration
        if latest_start is not None and start > latest_start:
            return frp.Refuse(
                reason=f"{self._state.profile.name} would finish at least {start - latest_start:.0f} s after the latest finish",
                not_now=now <= latest_start,  # only its other commitments are in the way
            )
        return frp.Terms(
            effect=str(fill_in(order.effect, self._state.profile.name, order.inputs)),
            precondition=order.precondition,
            price=quoted.price,
            currency=quoted.currency,
            duration=quoted.duration,
            start_from=start,
            start_until=latest_start,
            valid_until=now + self._state.profile.valid_for,
            condition=quoted.condition,
            penalty=quoted.penalty,
            invariant=quoted.invariant,
        )


def _refusal(answer: Answer) -> frp.Refuse:
    if isinstance(answer, Refused):
        return frp.Refuse(reason=answer.reason, not_now=answer.not_now, condition=answer.condition)
    return frp.Refuse(reason=str(answer))
