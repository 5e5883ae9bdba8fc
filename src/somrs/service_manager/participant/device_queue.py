"""What a device does for its participants, each in its turn: what it is asked to do, interrupted in, and what that came to.

Whether somebody is to begin, or to stop, is `participant.py`'s to decide; what is said of how it went goes back there.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import structs

from somrs.kernel.component import Ask, Effect, Withdraw
from somrs.protocol.frp.session import ParticipantBody
from somrs.protocol.frp.states import WORKING
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from somrs.service_manager.participant.job import Job, Jobs, Verdict, failure, in_words
from somrs.service_manager.sdk.orders import Advance, Done, Halt, Perform, ServiceFailed, Undo

Say = Callable[[Job, ParticipantBody, float], None]
"""Has a participant say how its work goes, or went."""

Leave = Callable[[Job, str, float], None]
"""Has others know what holds now, where the participant is over and has nobody to report it to."""


class Turns:
    """The work of one device, `capacity` of them at a time. What it wants done is added to `effects`."""

    def __init__(self, capacity: int, jobs: Jobs, effects: list[Effect], say: Say, leave: Leave) -> None:
        self._capacity, self._jobs, self._effects, self._say, self._leave = capacity, jobs, effects, say, leave
        self._queue: list[Job] = []
        self._asked: dict[str, Job] = {}

    @property
    def idle(self) -> bool:
        """Whether the device does nothing for anybody."""
        return not self._queue and not self._asked

    def enqueue(self, job: Job, now: float) -> None:
        """It is to be done, or undone, as soon as there is room."""
        job.waiting = True
        self._queue.append(job)
        self._begin(now)

    def _begin(self, now: float) -> None:
        """Let those that wait begin, as far as the device has room, in the order in which they were told to."""
        while self._queue and len(self._asked) < self._capacity:
            job = self._queue.pop(0)
            job.waiting, job.began = False, now
            assert job.order is not None, "only what was arranged is executed"
            undone = job.session.heard.get("Compensate")
            if undone is not None and isinstance(undone.body, frp.Compensate):
                self._do(job, Undo(job.order, undone.body.situation))
            else:
                self._do(job, Perform(job.order))

    def _do(self, job: Job, work: Perform | Halt | Undo) -> None:
        job.doing = type(work).__name__
        self._asked[job.question] = job
        self._effects.append(Ask(job.question, work))

    def interrupt(self, job: Job, verdict: Verdict | None, now: float) -> None:
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

    def halt(self, job: Job, verdict: Verdict, now: float) -> None:
        """Bring to a safe state what was under way when its program died, and report the verdict then."""
        job.verdict = verdict
        if job.order is not None:
            self._do(job, Halt(job.order))
        else:
            self._conclude(job, now)

    def answered(self, question: str, value: object, now: float) -> None:
        """The device got further with what it was asked to do, or came to an end of it."""
        job = self._asked.get(question)
        if job is None:
            return
        if isinstance(value, Advance):
            self._advance(job, value, now)
            return
        doing, job.doing = job.doing, ""
        del self._asked[question]
        if doing == "Halt":
            if isinstance(value, Done) and value.situation is not None:
                job.situation = value.situation
                if job.session.state is State.ENDED:
                    self._leave(job, value.situation, now)
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

    def _came_to(self, job: Job, doing: str, value: object, now: float) -> None:
        """The service, or its undoing, came to an end: it is done, it failed, it was interrupted, or its code is broken."""
        if isinstance(value, Done):
            job.fraction, job.situation = 1.0, value.situation or job.situation
            if job.session.state in WORKING:
                self._say(job, _done(job, doing, value), now)
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


def _done(job: Job, doing: str, value: Done) -> frp.Completed | frp.Compensated:
    if doing == "Perform":
        return frp.Completed(situation=job.situation or "", outputs=value.outputs)
    wanted = job.session.heard["Compensate"].body
    assert isinstance(wanted, frp.Compensate), "only what was told to is undone"
    return frp.Compensated(situation=job.situation or wanted.situation)
