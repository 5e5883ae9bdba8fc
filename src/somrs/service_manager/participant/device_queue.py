"""The queue of a device: the work that waits for it, the work under way, its interruption and its result.

`participant.py` decides which participants begin and stop.
"""

from __future__ import annotations

from msgspec import structs

from somrs.kernel.component import AnswerLost, Ask, Effects, Withdraw
from somrs.protocol.frp.session import service_of
from somrs.protocol.frp.states import WORKING
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from somrs.service_manager.participant.job import Job, Verdict, failure, interruption
from somrs.service_manager.participant.map_reports import LEFTOVER_REPORT_TIME
from somrs.service_manager.participant.messaging import send_message
from somrs.service_manager.participant.state import ServiceManagerState
from somrs.service_manager.participant.timers import Activity, WorkWanted
from somrs.service_manager.sdk.orders import Advance, Answer, Failure, Halt, Perform, Undo, WorkDone


class DeviceWork:
    """The work of one device: as many services at a time as the profile's capacity."""

    def __init__(self, state: ServiceManagerState) -> None:
        self._state, self._jobs, self._queue = state, state.jobs, state.queue

    @property
    def idle(self) -> bool:
        """Whether the device has no work."""
        return not self._queue.waiting and not self._queue.at_work

    def enqueue(self, job: Job, now: float) -> Effects:
        """Queue a job to be done, or undone, as soon as the device has free capacity."""
        job.waiting = True
        self._queue.waiting.append(job.key)
        yield from self._begin(now)

    def _begin(self, now: float) -> Effects:
        """Begin waiting jobs in the order of their orders, as far as the device has free capacity."""
        for job in self._state.waiting():
            if self._state.occupies(job) and self._occupied >= self._state.profile.capacity:
                continue
            self._queue.waiting.remove(job.key)
            job.waiting, job.started_at = False, now
            assert job.order is not None, "only what was arranged is executed"
            compensate_message = job.session.received_messages.get("Compensate")
            if compensate_message is not None and isinstance(compensate_message.body, frp.Compensate):
                yield from self._start_activity(job, Activity.UNDO, Undo(job.order, compensate_message.body.situation))
            else:
                yield from self._start_activity(job, Activity.PERFORM, Perform(job.order))

    @property
    def _occupied(self) -> int:
        """How much of the device's capacity is taken."""
        jobs = (self._jobs.find_job(*key) for key in self._queue.at_work)
        return sum(job is not None and self._state.occupies(job) for job in jobs)

    def _start_activity(self, job: Job, activity: Activity, work: Perform | Halt | Undo) -> Effects:
        job.activity = activity
        self._queue.at_work.append(job.key)
        yield Ask(job.question_for(activity), work)

    def interrupt(self, job: Job, verdict: Verdict | None, now: float) -> Effects:
        """Stop the work for the job, and report the verdict when the device is in a safe state (None: without a report)."""
        if job.verdict is not None and job.activity is not None:
            return  # the job is being stopped for another reason
        job.verdict = verdict
        if job.waiting:
            job.waiting = False
            job.verdict = structs.replace(verdict, tried=False) if verdict is not None else None
            self._queue.waiting.remove(job.key)
            yield from self._conclude(job, now)
        elif job.activity in (Activity.PERFORM, Activity.UNDO):
            yield Withdraw(job.question_for(job.activity))
        elif job.activity is not Activity.HALT:
            yield from self._conclude(job, now)

    def restarted(self, now: float) -> Effects:
        """Interrupt the waiting jobs after a restart: their time may be over, and other services may have their steps."""
        for job in self._state.waiting():
            if job.session.state in WORKING:
                yield from self.interrupt(job, self._restart_verdict(job), now)

    def _restart_verdict(self, job: Job) -> Verdict:
        return interruption(job.session.state, f"the Service Manager of {self._state.profile.name} was restarted while it worked")

    def answered(self, question: WorkWanted, value: Answer, now: float) -> Effects:
        """Handle a partial or final answer of the device."""
        job = self._jobs.find_job(question.transaction, question.participant)
        if job is None or job.activity is not question.activity or job.key not in self._queue.at_work:
            return
        if isinstance(value, Advance):
            yield from self._advance(job, value, now)
            return
        job.activity = None
        self._queue.at_work.remove(job.key)
        if question.activity is Activity.HALT:
            if isinstance(value, WorkDone) and value.situation is not None:
                job.note_situation(value.situation, value.observation, now)
                if job.session.state is State.ENDED:
                    yield from self._report_to_map(job, value.situation, now)
            yield from self._conclude(job, now)
        else:
            yield from self._finish_activity(job, question.activity, value, now)
        self._jobs.store_job(job)
        yield from self._begin(now)

    def _report_to_map(self, job: Job, situation: str, now: float) -> Effects:
        """Report the situation in which the service was stopped to the Repository, because no coordinator waits for it."""
        observation = structs.replace(job.observation, caused=True) if job.observation is not None else None
        yield from self._state.reports.add(service_of(job.session.participant), situation, now, LEFTOVER_REPORT_TIME, observation)

    def _advance(self, job: Job, value: Advance, now: float) -> Effects:
        job.fraction = value.fraction
        job.note_situation(value.situation, value.observation, now)
        if job.session.state in WORKING:
            observation = job.observation if value.situation is not None else None
            progress = frp.Progress(
                fraction=value.fraction, situation=value.situation, note=value.note, observation=observation, waits=value.waits
            )
            yield from send_message(job, progress, self._jobs, now)

    def _finish_activity(self, job: Job, activity: Activity, value: Answer, now: float) -> Effects:
        """Handle the end of a service or of its undoing: it is done, it failed, it was interrupted, or its code raised an error."""
        if isinstance(value, WorkDone):
            job.fraction = 1.0
            job.note_situation(value.situation, value.observation, now)
            if job.session.state in WORKING:
                yield from send_message(job, _completion_report(job, activity, value), self._jobs, now)
            return
        if isinstance(value, Failure):
            job.note_situation(value.situation, value.observation, now)
            job.verdict = failure(activity, value.description, job.situation, tried=value.tried)
            yield from self._conclude(job, now)
            return
        if job.verdict is None and isinstance(value, AnswerLost) and job.session.state in WORKING:
            job.verdict = self._restart_verdict(job)
        elif job.verdict is None:
            job.verdict = failure(activity, str(value), job.situation)
        assert job.order is not None, "only what was arranged is executed"
        yield from self._start_activity(job, Activity.HALT, Halt(job.order))

    def _conclude(self, job: Job, now: float) -> Effects:
        """Report the verdict with the situation known at this time."""
        if job.verdict is not None and job.session.state in WORKING:
            verdict = structs.replace(job.verdict, situation=job.situation, observation=job.observation)
            yield from send_message(job, verdict, self._jobs, now)
        job.verdict = None


def _completion_report(job: Job, activity: Activity, value: WorkDone) -> frp.Completed | frp.Compensated:
    if activity is Activity.PERFORM:
        return frp.Completed(situation=job.situation or "", outputs=value.outputs, observation=job.observation)
    compensate = job.session.received_messages["Compensate"].body
    assert isinstance(compensate, frp.Compensate), "undoing follows a Compensate"
    return frp.Compensated(situation=job.situation or compensate.situation, observation=job.observation)
