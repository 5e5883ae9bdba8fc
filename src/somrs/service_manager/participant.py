"""The Service Manager of one device: any number of participants of the Failure Recovery Protocol, on one calendar.

It decides; `work.py` runs the author's coroutines. What it knows of each participant is in a `Job`; which messages it may send and
what it makes of those that come is `protocol.session`'s.
"""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import structs

from somrs.errors import FormulaError, WireError
from somrs.protocol import frp
from somrs.protocol.component import Answered, Ask, Effect, Input, Rang, Received, Record, Send, Started, Undelivered, Wake, Withdraw
from somrs.protocol.envelope import ANONYMOUS, Message, reply
from somrs.protocol.frp import State
from somrs.protocol.session import NOT_ALLOWED, ParticipantBody, ParticipantSession, service_of
from somrs.protocol.states import RESUMES, TO_COORDINATOR, TO_PARTICIPANT, WORKING
from somrs.service_manager.calendar import Commitment, free_from, laid_out
from somrs.service_manager.job import Job, Jobs, Verdict, failure, in_words, interrupted
from somrs.service_manager.joining import TIMER, Joining
from somrs.service_manager.orders import (
    Advance,
    Capability,
    Done,
    Halt,
    Kept,
    Order,
    Perform,
    Profile,
    Quote,
    Quoted,
    ServiceFailed,
    Undo,
    Work,
)
from somrs.service_manager.values import filled_in

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
        self._queue: list[Job] = []
        self._asked: dict[str, Job] = {}
        self._effects: list[Effect] = []
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
                self._ring(timer, now)
            case Answered(question, value) if (job := self._asked.get(question)) is not None:
                self._answered(job, question, value, now)
            case Undelivered(message):
                self._undelivered(message, now)
        effects, self._effects = self._effects, []
        return effects

    @property
    def idle(self) -> bool:
        """Whether the device does nothing for anybody."""
        return not self._queue and not any(job.doing in ("Perform", "Halt", "Undo") for job in self._asked.values())

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
        terms = job.session.terms
        if job.session.state is State.OFFERED and terms and terms.valid_until is not None and terms.valid_until <= now:
            self._say(job, frp.Refuse(reason="the terms expired"), now)
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
                self._enqueue(job, now)
            case State.STOPPING:
                self._interrupt(job, frp.Stopped(situation=job.situation), now)
            case State.COMPENSATING:
                assert isinstance(message.body, frp.Compensate)
                self._compensate(job, now)
            case State.ENDED:
                for name in ("expire", "start", "heartbeat"):
                    self._timer(job, name, None)
                if before in WORKING:
                    self._interrupt(job, None, now)

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
        self._do(job, Quote(job.order))

    def _capability(self, job: Job, arrange: frp.Arrange) -> Capability | None:
        """The service that the participant is one of, or else one of the type."""
        named = service_of(job.session.participant)
        of_type = [one for one in self.profile.capabilities if one.type_name == arrange.service_type]
        return next((one for one in self.profile.capabilities if self.profile.service(one) == named), of_type[0] if of_type else None)

    def _compensate(self, job: Job, now: float) -> None:
        capability = next((one for one in self.profile.capabilities if job.order and one.method == job.order.method), None)
        if capability is None or not capability.undoable:
            text = f"{self.profile.name} cannot undo {capability.type_name if capability else 'what it does not know'}"
            self._say(job, frp.Stranded(description=text, tried=False), now)
            return
        self._timer(job, "heartbeat", now + self.profile.heartbeat)
        self._enqueue(job, now)

    # What the device does

    def _do(self, job: Job, work: Work) -> None:
        job.doing = type(work).__name__
        self._asked[job.question] = job
        self._effects.append(Ask(job.question, work))

    def _enqueue(self, job: Job, now: float) -> None:
        job.waiting = True
        self._queue.append(job)
        self._begin(now)

    def _begin(self, now: float) -> None:
        """Let those that wait begin, as far as the device has room, in the order in which they were told to."""
        while self._queue and sum(job.doing in ("Perform", "Halt", "Undo") for job in self._asked.values()) < self.profile.capacity:
            job = self._queue.pop(0)
            job.waiting, job.began = False, now
            assert job.order is not None, "only what was arranged is executed"
            undone = job.session.heard.get("Compensate")
            if undone is not None and isinstance(undone.body, frp.Compensate):
                self._do(job, Undo(job.order, undone.body.situation))
            else:
                self._do(job, Perform(job.order))

    def _interrupt(self, job: Job, verdict: Verdict | None, now: float) -> None:
        """Have the device stop what it does for the job, and report the verdict then (None: there is nobody to report to)."""
        if job.verdict is not None and job.doing:
            return  # it is being stopped for another reason
        job.verdict = verdict
        if job.waiting:
            job.waiting = False
            self._queue.remove(job)
            self._conclude(job, now)
        elif job.doing in ("Perform", "Undo"):
            self._effects.append(Withdraw(job.question))
        elif job.doing != "Halt":
            self._conclude(job, now)

    def _answered(self, job: Job, question: str, value: object, now: float) -> None:
        if isinstance(value, Advance):
            self._advance(job, value, now)
            return
        doing, job.doing = job.doing, ""
        del self._asked[question]
        if doing == "Quote":
            self._quoted(job, value, now)
        elif doing == "Halt":
            if isinstance(value, Done) and value.situation is not None:
                job.situation = value.situation
                if job.session.state is State.ENDED:
                    self._effects.append(self._joining.tell(value.situation, service_of(job.session.participant), now))
            self._conclude(job, now)
        else:
            self._came_to(job, doing, value, now)
        self._jobs.put(job)
        self._begin(now)

    def _advance(self, job: Job, value: Advance, now: float) -> None:
        job.fraction = value.fraction
        job.situation = value.situation or job.situation
        if job.session.state in WORKING:
            self._say(job, frp.Progress(fraction=value.fraction, situation=value.situation, note=value.note), now)

    def _quoted(self, job: Job, value: object, now: float) -> None:
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

    def _done(self, job: Job, doing: str, value: Done) -> frp.Completed | frp.Compensated:
        if doing == "Perform":
            return frp.Completed(situation=job.situation or "", outputs=value.outputs)
        wanted = job.session.heard["Compensate"].body
        assert isinstance(wanted, frp.Compensate), "only what was told to is undone"
        return frp.Compensated(situation=job.situation or wanted.situation)

    def _came_to(self, job: Job, doing: str, value: object, now: float) -> None:
        """The service, or its undoing, came to an end: it is done, it failed, it was interrupted, or its code is broken."""
        if isinstance(value, Done):
            job.fraction, job.situation = 1.0, value.situation or job.situation
            if job.session.state in WORKING:
                self._say(job, self._done(job, doing, value), now)
            return
        if isinstance(value, ServiceFailed):
            job.situation = value.situation or job.situation
            job.verdict = failure(doing, value.description, job.situation)
            self._conclude(job, now)
            return
        if job.verdict is None:
            job.verdict = failure(doing, in_words(value), job.situation)
        assert job.order is not None, "only what was arranged is executed"
        self._do(job, Halt(job.order))

    def _conclude(self, job: Job, now: float) -> None:
        """Report the verdict, with what is known by now."""
        if job.verdict is not None and job.session.state in WORKING:
            self._say(job, structs.replace(job.verdict, situation=job.situation), now)
        job.verdict = None

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
            self._say(job, frp.Failed(description="it was not told to start in time", situation=None), now)

    def _undelivered(self, message: Message, now: float) -> None:
        """Signs of life do not get through: stop."""
        job = self._jobs.get(message.header.transaction, message.header.participant)
        if job is None or not isinstance(message.body, frp.Progress):
            return
        self._cut_off(job, "nobody could be told how the work goes, so it was stopped", now)

    def _cut_off(self, job: Job, reason: str, now: float) -> None:
        if (state := job.session.state) in (State.EXECUTING, State.COMPENSATING):
            self._interrupt(job, interrupted(state, reason), now)

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
                    self._say(job, frp.Failed(description=reason), now)
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
                job.verdict = interrupted(state, reason)
            case State.OFFERED:
                self._timer(job, "expire", session.terms.valid_until if session.terms else now)
            case State.COMMITTED:
                self._timer(job, "start", session.terms.start_until if session.terms else None)
        if job.verdict is not None:
            self._timer(job, "heartbeat", now + self.profile.heartbeat)
            if job.order is not None:
                self._do(job, Halt(job.order))
            else:
                self._conclude(job, now)
        self._effects += [Send(message, now + REPORT_TIME) for message in session.last_report()]
