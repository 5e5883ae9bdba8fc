"""The Service Manager of one device: participants of the Failure Recovery Protocol with a common calendar.

The Service Manager decides; `negotiation.py` offers terms, `device_queue.py` gives the device its work, and `service_runner.py` runs the
author's coroutines. A `Job` holds the state of a participant; its `ParticipantSession` determines which messages it may send and what
received messages mean.
"""

from __future__ import annotations

from typing import Self

from msgspec import structs

from somrs.errors import WireError
from somrs.kernel.codec import Migration, Schema
from somrs.kernel.component import Answered, Ask, DeliveryFailed, Effect, Effects, Input, Notified, Received, Send, Started, TimerFired
from somrs.kernel.not_understood import refuse_request
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.frp.session import NOT_ALLOWED, ParticipantBody
from somrs.protocol.frp.states import TO_COORDINATOR, TO_PARTICIPANT, UNBEGUN, WORKING
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import ANONYMOUS, Message, reply
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.observations import observed_at
from somrs.service_manager.participant.calendar import Commitment
from somrs.service_manager.participant.device_queue import DeviceWork
from somrs.service_manager.participant.job import Job, interruption
from somrs.service_manager.participant.map_reports import OBSERVATION_REPORT_TIME
from somrs.service_manager.participant.messaging import REPORT_TIME, send_message
from somrs.service_manager.participant.negotiation import Negotiation
from somrs.service_manager.participant.state import ServiceManagerState
from somrs.service_manager.participant.timers import (
    Activity,
    DepartureRequested,
    Equipped,
    HeartbeatDue,
    JoiningDue,
    NodeTask,
    Notice,
    Observed,
    Question,
    ReportDue,
    ReportWanted,
    ServicesChanged,
    StartDue,
    TermsDue,
    Timer,
    WorkWanted,
)
from somrs.service_manager.sdk.orders import Advance, Answer, Perform, Profile, Report, Undo, answer_of

_PROTOCOL = frozenset((*TO_PARTICIPANT, *TO_COORDINATOR))


class ServiceManager:
    """The component of a device. It owns the participants; `calendar` has the device's commitments."""

    def __init__(self, profile: Profile, *, repository: str, registry: str) -> None:
        self._adopt(ServiceManagerState.new(profile, repository, registry))

    @classmethod
    def restored(cls, state: ServiceManagerState) -> Self:
        """Return the Service Manager with this state."""
        manager = cls.__new__(cls)
        manager._adopt(state)
        return manager

    def _adopt(self, state: ServiceManagerState) -> None:
        self.state = state
        self._jobs, self._joining, self._reports = state.jobs, state.joining, state.reports
        self._negotiation, self._work = Negotiation(state), DeviceWork(state)

    @property
    def profile(self) -> Profile:
        return self._joining.profile

    @property
    def address(self) -> str:
        return self._joining.address

    @property
    def open(self) -> list[str]:
        """The participants that have a contract."""
        return [f"{job.session.participant} in {job.session.transaction}" for job in self._jobs if job.has_contract]

    @property
    def idle(self) -> bool:
        """Whether the device has no work."""
        return self._work.idle

    def state_of(self, transaction: str, participant: str) -> State:
        job = self._jobs.find_job(transaction, participant)
        return job.session.state if job is not None else State.NEW

    def calendar(self, now: float) -> list[Commitment]:
        """Return the commitments of the device. Overdue ones start, or end, at `now`."""
        return self._negotiation.calendar(now)

    def handle(self, event: Input, now: float) -> list[Effect]:
        """Return the effects of the input."""
        return [*self._effects(event, now)]

    def _effects(self, event: Input, now: float) -> Effects:
        match event:
            case Started(address):
                yield from self._start(address, now)
            case Received(message):
                yield from self._received(message, now)
            case TimerFired(timer):
                yield from self._timer_fired(timer, now)  # type: ignore[arg-type]  # the component has no other timers
            case Answered(WorkWanted() as question, value):
                yield from self._answered(question, value, now)
            case DeliveryFailed(message):
                yield from self._delivery_failed(message, now)
            case Notified(notice):
                yield from self._notified(notice, now)  # type: ignore[arg-type]  # the program sends no other notices

    # Received messages

    def _received(self, message: Message, now: float) -> Effects:
        kind = type(message.body)
        if (kind is frp.Fault and message.header.participant is None) or kind not in _PROTOCOL:
            yield from self._directory_answered(message, now)
            return
        job = self._jobs.find_job(message.header.transaction, message.header.participant)
        if job is None:
            try:
                job = Job(session=ParticipantSession.from_message(message, self.address))
            except WireError as error:
                if kind is not frp.Fault:
                    yield Send(reply(message, frp.Fault(code=NOT_ALLOWED, text=error.text), self.address))
                return
        if job.session.is_foreign(message):
            for answer in job.session.receive(message).answers:
                yield Send(answer)
            return
        objection = job.session.objection(message, now)
        if lapse := self._negotiation.lapse(job, message.body, now):
            yield from self._send_message(job, frp.Refuse(reason=lapse, not_now=True, lapsed=True), now)
        elif objection and kind is frp.Execute and job.session.state in UNBEGUN:
            refuses = UNBEGUN[job.session.state] is frp.Refuse
            yield from self._send_message(
                job, frp.Refuse(reason=objection, not_now=True) if refuses else frp.Failed(description=objection, tried=False), now
            )
            return
        transition = job.session.receive(message)
        if transition.moved:
            if isinstance(message.body, frp.Execute) and job.order is not None:
                job.order = structs.replace(
                    job.order,
                    inputs={**job.order.inputs, **message.body.inputs},
                    precondition=message.body.precondition or job.order.precondition,
                )
            if isinstance(message.body, frp.Compensate):
                job.forget_situation()  # other services may have changed what it left
            self._jobs.store_job(job)
        for answer in transition.answers:
            yield Send(answer, now + REPORT_TIME if answer.header.recipient != ANONYMOUS else None)
        if transition.moved:
            yield from self._state_changed(job, message, transition.state_before, now)

    def _directory_answered(self, message: Message, now: float) -> Effects:
        """Handle an answer of the Repository or the Registry, or what is not for a device."""
        yield from refuse_request(message, "a device gives terms, carries out services, and says how far it is")
        if self._reports.is_pending(message.header.relates_to):
            trouble = yield from self._reports.answered(message, now)
            if trouble:
                yield Ask(ReportWanted(), Report(trouble))
            return
        yield from self._joining.receive(message, now)
        if self._joining.joined:
            yield from self._reports.start(now)

    def _state_changed(self, job: Job, message: Message, old_state: State, now: float) -> Effects:
        match job.session.state:
            case State.ARRANGING:
                yield from self._negotiation.arrange(job, now)
            case State.COMMITTED:
                job.accepted_at = now
                yield from job.set_timer(TermsDue, None)
                if job.session.terms is not None:
                    yield from job.set_timer(StartDue, job.session.terms.start_until)
            case State.EXECUTING:
                job.accepted_at = job.accepted_at if job.accepted_at is not None else now
                yield from job.set_timer(TermsDue, None)
                yield from job.set_timer(StartDue, None)
                yield from job.set_timer(HeartbeatDue, now + self.profile.heartbeat)
                yield from self._work.enqueue(job, now)
            case State.STOPPING:
                yield from self._work.interrupt(job, frp.Stopped(situation=job.situation, observation=job.observation), now)
            case State.COMPENSATING:
                yield from self._compensate(job, job.session.objection(message, now), now)
            case State.ENDED:
                for kind in (TermsDue, StartDue, HeartbeatDue):
                    yield from job.set_timer(kind, None)
                if old_state in WORKING:
                    yield from self._work.interrupt(job, None, now)

    def _compensate(self, job: Job, objection: str, now: float) -> Effects:
        capability = next(
            (candidate for candidate in self.profile.capabilities if job.order and candidate.method == job.order.method), None
        )
        if objection or capability is None or not capability.undoable:
            text = objection or f"{self.profile.name} cannot undo {capability.type_name if capability else 'an unknown service'}"
            yield from self._send_message(job, frp.Stranded(description=text, tried=False), now)
            return
        yield from job.set_timer(HeartbeatDue, now + self.profile.heartbeat)
        yield from self._work.enqueue(job, now)

    def _answered(self, question: WorkWanted, value: object, now: float) -> Effects:
        """Handle a partial or final answer of the device."""
        answer: Answer = answer_of(value) if isinstance(value, BaseException) else value  # type: ignore[assignment]  # as devices answer
        if question.activity is not Activity.QUOTE:
            yield from self._work.answered(question, answer, now)
        elif not isinstance(answer, Advance):  # no work is under way that could advance
            yield from self._negotiation.quoted(question, answer, now)

    def _send_message(self, job: Job, body: ParticipantBody, now: float) -> Effects:
        yield from send_message(job, body, self._jobs, now)

    # Other inputs

    def _timer_fired(self, timer: Timer, now: float) -> Effects:
        match timer:
            case JoiningDue():
                yield from self._joining.timer_fired(now)
            case ReportDue():
                yield from self._reports.resend(now)
            case TermsDue(transaction, participant) | StartDue(transaction, participant) | HeartbeatDue(transaction, participant):
                if (job := self._jobs.find_job(transaction, participant)) is not None:
                    job.timers.discard(timer)
                    yield from self._due(job, timer, now)

    def _due(self, job: Job, timer: TermsDue | StartDue | HeartbeatDue, now: float) -> Effects:
        state = job.session.state
        match timer:
            case HeartbeatDue() if state in WORKING:
                note = "waits for its turn" if job.waiting else ""
                yield from self._send_message(job, frp.Progress(fraction=job.fraction, note=note), now)
                yield from job.set_timer(HeartbeatDue, now + self.profile.heartbeat)
            case TermsDue() if state is State.OFFERED:
                yield from self._send_message(job, frp.Refuse(reason="the terms expired", not_now=True, lapsed=True), now)
            case StartDue() if state is State.COMMITTED:
                yield from self._send_message(job, frp.Failed(description="no order to start came in time", tried=False), now)

    def _delivery_failed(self, message: Message, now: float) -> Effects:
        """Stop the work when a heartbeat cannot be delivered."""
        if self._reports.is_pending(message.header.message_id):
            yield from self._reports.resend(now)
            return
        job = self._jobs.find_job(message.header.transaction, message.header.participant)
        if job is not None and isinstance(message.body, frp.Progress):
            yield from self._cut_off(job, "no heartbeat reached the coordinator, so the work was stopped", now)

    def _cut_off(self, job: Job, reason: str, now: float) -> Effects:
        if (state := job.session.state) in (State.EXECUTING, State.COMPENSATING):
            yield from self._work.interrupt(job, interruption(state, reason), now)

    def _notified(self, notice: Notice, now: float) -> Effects:
        match notice:
            case Equipped(profile, repository, registry, other_registries):
                joining = self._joining
                joining.profile, joining.repository, joining.registry = profile, repository, registry
                joining.other_registries = other_registries
            case Observed(situation, observation):
                yield from self._reports.add(self.profile.name, situation, now, OBSERVATION_REPORT_TIME, observed_at(observation, now))
            case ServicesChanged(profile):
                yield from self._joining.services_changed(profile, now)
            case DepartureRequested():
                yield from self._depart(now)

    # Joining and leaving

    def _start(self, address: str, now: float) -> Effects:
        """Join the system. After a restart, keep the contracts; the device has no work."""
        moved, self.state.leaving = address != self.address, False
        self._reports.address, self._reports.repository, self._reports.ready = address, self._joining.repository, False
        yield from self._joining.start(address, now)
        yield from self._work.restarted(now)
        for job in self._jobs.all_jobs() if moved else ():
            job.session.me = address
            for message in job.session.last_report():  # the report has the new address
                yield Send(message, now + REPORT_TIME)

    def _depart(self, now: float) -> Effects:
        """Withdraw the offers and commitments, and stop the work."""
        self.state.leaving = True
        yield from self._joining.depart(now)
        reason = f"{self.profile.name} is leaving"
        for job in self._jobs:
            match job.session.state:
                case State.ARRANGING | State.OFFERED:
                    yield from self._send_message(job, frp.Refuse(reason=reason, not_now=True), now)
                case State.COMMITTED:
                    yield from self._send_message(job, frp.Failed(description=reason, tried=False), now)
                case _:
                    yield from self._cut_off(job, reason, now)


SCHEMA = Schema(
    component="service-manager",
    version=2,
    state=ServiceManagerState,
    timers=Timer,
    questions=Question,
    tasks=NodeTask,
    answers=Answer,
    notices=Notice,
    restore=ServiceManager.restored,
    # An author's coroutine ends with its process. A quote can be made again, and the safe state must be reached in any case.
    volatile=(Perform, Undo, Report),
    error_to_answer=answer_of,
    relocatable=True,
    migrations={1: Migration()},  # version 2 adds the other Registries of the site
)
"""The data of its journal."""
