"""The Service Manager of one device: any number of participants of the Failure Recovery Protocol, on one calendar.

It decides; `device_queue.py` has the device do it, and `work.py` runs the author's coroutines. What it knows of each participant is in a
`Job`; which messages it may send and what it makes of those that come is `protocol.frp.session`'s.
"""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import structs

from somrs.errors import FormulaError, WireError
from somrs.kernel.component import Answered, Ask, Effect, Input, Rang, Received, Record, Send, Started, Undelivered, Wake
from somrs.protocol.frp.session import NOT_ALLOWED, ParticipantBody, ParticipantSession, service_of
from somrs.protocol.frp.states import RESUMES, TO_COORDINATOR, TO_PARTICIPANT, WORKING
from somrs.protocol.messages import frp
from somrs.protocol.messages.envelope import ANONYMOUS, Message, reply
from somrs.protocol.messages.frp import State
from somrs.service_manager.participant.calendar import Commitment, free_from, laid_out
from somrs.service_manager.participant.device_queue import Turns
from somrs.service_manager.participant.job import Job, Jobs, in_words, interrupted
from somrs.service_manager.participant.joining import TIMER, Joining
from somrs.service_manager.sdk.orders import Advance, Capability, Kept, Order, Profile, Quote, Quoted
from somrs.service_manager.sdk.values import filled_in

LEAVE = "leave"
"""The timer whose ringing makes the device take its leave; whoever runs the Service Manager rings it."""

CUT_OFF = 15.0
"""Seconds for which a sign of life is sent again. When none gets through, nobody can call the device back, and its step may
soon be given to another: it stops by itself. A coordinator waits for longer than this, and for a stop, before it does that."""

REPORT_TIME = 86_400.0
"""Seconds for which a report is sent again; a Task Manager that is down has this long to come back."""

_COMMITTED = WORKING | {State.COMMITTED}
_PROTOCOL = frozenset((*TO_PARTICIPANT, *TO_COORDINATOR))

REMEMBERED = 1000
"""So many participants that are over are remembered, to know their late messages."""


class ServiceManager:
    """`kept` are the records of an earlier run. Owns its participants; `calendar` is what the device is committed to."""

    def __init__(self, profile: Profile, *, repository: str, registry: str, kept: Iterable[Kept] = ()) -> None:
        self.profile = profile
        self.address = ""
        self._joining = Joining(profile, repository, registry)
        self._jobs = Jobs(REMEMBERED)
        for one in kept:
            self._jobs.put(Job(one.session.kept(), one.order, situation=one.situation))
        self._quoting: dict[str, Job] = {}
        self._effects: list[Effect] = []
        self._turns = Turns(profile.capacity, self._jobs, self._effects, self._say, self._tell)
        self._leaving = False

    def handle(self, event: Input, now: float) -> list[Effect]:
        """What to do about the input."""
        match event:
            case Started(address):
                self.address = address
                self._effects += self._joining.start(address, now)
                for kept in self._jobs.all():
                    self._resume(kept, now)
            case Received(message):
                self._received(message, now)
            case Rang(timer):
                self._ring(str(timer), now)
            case Answered(str(question), value) if question in self._quoting:
                self._quoted(question, value, now)
            case Answered(question, value):
                self._turns.answered(str(question), value, now)
            case Undelivered(message):
                self._undelivered(message, now)
        effects = [*self._effects]
        self._effects.clear()
        return effects

    @property
    def idle(self) -> bool:
        """Whether the device does nothing for anybody."""
        return self._turns.idle

    def state(self, transaction: str, participant: str) -> State:
        job = self._jobs.get(transaction, participant)
        return job.session.state if job is not None else State.NEW

    def calendar(self, now: float) -> list[Commitment]:
        """From when until when the device is committed, as far as can be told; what is overdue starts, or ends, now."""
        busy: list[Commitment] = []
        for job in self._jobs:
            if job.session.state not in _COMMITTED or (terms := job.session.terms) is None:
                continue
            start = job.began if job.began is not None else max(terms.start_from or now, now)
            busy.append((start, max(start + terms.duration, now)))
        return busy

    # What comes

    def _received(self, message: Message, now: float) -> None:
        kind = type(message.body)
        if (kind is frp.Fault and message.header.participant is None) or kind not in _PROTOCOL:
            self._effects += self._joining.receive(message, now)
            return
        job = self._jobs.get(message.header.transaction, message.header.participant)
        if job is None:
            try:
                job = Job(ParticipantSession.opened_by(message, self.address))
            except WireError as error:
                if kind is not frp.Fault:
                    self._effects.append(Send(reply(message, frp.Fault(code=NOT_ALLOWED, text=error.text), self.address)))
                return
        terms, late = job.session.terms, _late(message, now)
        if job.session.state is State.OFFERED and terms and terms.valid_until is not None and terms.valid_until <= now:
            self._say(job, frp.Refuse(reason="the terms expired"), now)
        elif late and kind is frp.Execute and job.session.state in (State.OFFERED, State.COMMITTED):
            offered = job.session.state is State.OFFERED
            self._say(job, frp.Refuse(reason=late) if offered else frp.Failed(description=late, tried=False), now)
            return
        heard = job.session.receive(message)
        if heard.moved:
            if isinstance(message.body, frp.Execute) and job.order is not None:
                job.order = structs.replace(
                    job.order,
                    inputs={**job.order.inputs, **message.body.inputs},
                    precondition=message.body.precondition or job.order.precondition,
                )
            if isinstance(message.body, frp.Compensate):
                job.situation = None  # others may have gone on from what it left
            self._keep(job)
        self._effects += [Send(answer, now + REPORT_TIME if answer.header.recipient != ANONYMOUS else None) for answer in heard.answers]
        if heard.moved:
            self._moved(job, message, heard.before, now)

    def _moved(self, job: Job, message: Message, before: State, now: float) -> None:
        match job.session.state:
            case State.ARRANGING:
                self._arrange(job, now)
            case State.COMMITTED:
                self._timer(job, "expire", None)
                if job.session.terms is not None:
                    self._timer(job, "start", job.session.terms.start_until)
            case State.EXECUTING:
                self._timer(job, "expire", None)
                self._timer(job, "start", None)
                self._timer(job, "heartbeat", now + self.profile.heartbeat)
                self._turns.enqueue(job, now)
            case State.STOPPING:
                self._turns.interrupt(job, frp.Stopped(situation=job.situation), now)
            case State.COMPENSATING:
                self._compensate(job, _late(message, now), now)
            case State.ENDED:
                for name in ("expire", "start", "heartbeat"):
                    self._timer(job, name, None)
                if before in WORKING:
                    self._turns.interrupt(job, None, now)

    def _arrange(self, job: Job, now: float) -> None:
        arrange = job.session.order
        assert arrange is not None, "a session becomes Arranging by an Arrange"
        capability = self._capability(job, arrange)
        if self._leaving or capability is None:
            offered = ", ".join(one.type_name for one in self.profile.capabilities)
            reason = "is leaving" if self._leaving else f"offers {offered}, and not {arrange.service_type}"
            self._say(job, frp.Refuse(reason=f"{self.profile.name} {reason}"), now)
            return
        job.order = Order(
            participant=job.session.participant,
            method=capability.method,
            inputs=arrange.inputs,
            effect=arrange.effect,
            precondition=arrange.precondition,
            earliest_start=arrange.earliest_start,
            latest_finish=arrange.latest_finish,
        )
        job.doing = Quote.__name__
        self._quoting[job.question] = job
        self._effects.append(Ask(job.question, Quote(job.order)))

    def _capability(self, job: Job, arrange: frp.Arrange) -> Capability | None:
        """The service that the participant is one of, or else one of the type."""
        named = service_of(job.session.participant)
        of_type = [one for one in self.profile.capabilities if one.type_name == arrange.service_type]
        return next((one for one in self.profile.capabilities if self.profile.service(one) == named), of_type[0] if of_type else None)

    def _compensate(self, job: Job, late: str, now: float) -> None:
        capability = next((one for one in self.profile.capabilities if job.order and one.method == job.order.method), None)
        if late or capability is None or not capability.undoable:
            text = late or f"{self.profile.name} cannot undo {capability.type_name if capability else 'what it does not know'}"
            self._say(job, frp.Stranded(description=text, tried=False), now)
            return
        self._timer(job, "heartbeat", now + self.profile.heartbeat)
        self._turns.enqueue(job, now)

    def _quoted(self, question: str, value: object, now: float) -> None:
        if isinstance(value, Advance):
            return  # nothing is under way that could advance
        job = self._quoting.pop(question)
        job.doing = ""
        self._jobs.put(job)
        if job.session.state is not State.ARRANGING:
            return
        answer: ParticipantBody
        try:
            answer = self._terms(job, value, now) if isinstance(value, Quoted) else frp.Refuse(reason=in_words(value))
        except FormulaError as error:
            answer = frp.Refuse(reason=str(error))
        self._say(job, answer, now)
        if isinstance(answer, frp.Terms):
            self._timer(job, "expire", answer.valid_until)

    def _terms(self, job: Job, quoted: Quoted, now: float) -> frp.Terms | frp.Refuse:
        assert job.order is not None, "a quote is for an order"
        order = job.order
        capacity = self.profile.capacity
        start = free_from(laid_out(self.calendar(now), capacity), max(now, order.earliest_start or now), quoted.duration, capacity)
        until = None if order.latest_finish is None else order.latest_finish - quoted.duration
        if until is not None and start > until:
            return frp.Refuse(reason=f"{self.profile.name} could be done {start - until:.0f} s after the latest finish at the earliest")
        return frp.Terms(
            effect=str(filled_in(order.effect, self.profile.name, order.inputs)),
            precondition=order.precondition,
            price=quoted.price,
            currency=quoted.currency,
            duration=quoted.duration,
            start_from=start,
            start_until=until,
            valid_until=now + self.profile.valid_for,
        )

    # What is said

    def _say(self, job: Job, body: ParticipantBody, now: float) -> None:
        """Send a message of the job's own accord; what it promises is on disk before it leaves."""
        message = job.session.send(body)
        if isinstance(body, frp.Progress):
            self._effects.append(Send(message, now + CUT_OFF))
            return
        if job.session.state not in WORKING:
            self._timer(job, "heartbeat", None)
        if job.session.state is State.FAILED:
            self._timer(job, "start", None)
        self._keep(job)
        self._effects.append(Send(message, now + REPORT_TIME))

    def _tell(self, job: Job, situation: str, now: float) -> None:
        self._effects.append(self._joining.tell(situation, service_of(job.session.participant), now))

    def _keep(self, job: Job) -> None:
        self._jobs.put(job)
        self._effects.append(Record(Kept(session=job.session.kept(), order=job.order, situation=job.situation)))

    def _timer(self, job: Job, name: str, at: float | None) -> None:
        if at is not None:
            job.timers.add(name)
        elif name in job.timers:
            job.timers.remove(name)
        else:
            return
        self._effects.append(Wake(f"{name} {job.session.participant} {job.session.transaction}", at))

    def _ring(self, timer: str, now: float) -> None:
        if timer == TIMER:
            self._effects += self._joining.ring(now)
        elif timer == LEAVE:
            self._leave(now)
        else:
            name, participant, transaction = timer.split(" ", 2)
            if (due := self._jobs.get(transaction, participant)) is not None:
                due.timers.discard(name)
                self._due(due, name, now)

    def _due(self, job: Job, name: str, now: float) -> None:
        state = job.session.state
        if name == "heartbeat" and state in WORKING:
            self._say(job, frp.Progress(fraction=job.fraction, note="waits for its turn" if job.waiting else ""), now)
            self._timer(job, "heartbeat", now + self.profile.heartbeat)
        elif name == "expire" and state is State.OFFERED:
            self._say(job, frp.Refuse(reason="the terms expired"), now)
        elif name == "start" and state is State.COMMITTED:
            self._say(job, frp.Failed(description="it was not told to start in time", tried=False), now)

    def _undelivered(self, message: Message, now: float) -> None:
        """Signs of life do not get through: stop."""
        job = self._jobs.get(message.header.transaction, message.header.participant)
        if job is None or not isinstance(message.body, frp.Progress):
            return
        self._cut_off(job, "nobody could be told how the work goes, so it was stopped", now)

    def _cut_off(self, job: Job, reason: str, now: float) -> None:
        if (state := job.session.state) in (State.EXECUTING, State.COMPENSATING):
            self._turns.interrupt(job, interrupted(state, reason), now)

    # Coming and going

    def _leave(self, now: float) -> None:
        """Withdraw offers and commitments, and stop what runs."""
        self._leaving = True
        self._effects += self._joining.leave(now)
        reason = f"{self.profile.name} is leaving"
        for job in self._jobs:
            match job.session.state:
                case State.ARRANGING | State.OFFERED:
                    self._say(job, frp.Refuse(reason=reason), now)
                case State.COMMITTED:
                    self._say(job, frp.Failed(description=reason, tried=False), now)
                case _:
                    self._cut_off(job, reason, now)

    def _resume(self, job: Job, now: float) -> None:
        """Go on after a restart. A coroutine does not survive it: what was under way is brought to a safe state and reported."""
        session, reason = job.session, f"the Service Manager of {self.profile.name} was restarted while it worked"
        session.me = self.address
        match session.state:
            case State.ARRANGING:
                self._arrange(job, now)
            case state if state in RESUMES:
                self._timer(job, "heartbeat", now + self.profile.heartbeat)
                self._turns.halt(job, interrupted(state, reason), now)
            case State.OFFERED:
                self._timer(job, "expire", session.terms.valid_until if session.terms else now)
            case State.COMMITTED:
                self._timer(job, "start", session.terms.start_until if session.terms else None)
        self._effects += [Send(message, now + REPORT_TIME) for message in session.last_report()]


def _late(message: Message, now: float) -> str:
    """Why an order must not be obeyed any more, in words; empty when it came in time."""
    body = message.body
    if not isinstance(body, frp.Execute | frp.Compensate) or body.begin_by is None or now <= body.begin_by:
        return ""
    return (
        f"{type(body).__name__} came {now - body.begin_by:.1f} s too late to begin, and nothing was moved: "
        "a slow network, or the clocks of the two hosts do not agree"
    )
