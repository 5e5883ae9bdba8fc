"""What a Service Manager says as a participant."""

from __future__ import annotations

from somrs.kernel.component import Effects, Send
from somrs.protocol.frp.session import ParticipantBody
from somrs.protocol.frp.states import WORKING
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from somrs.service_manager.participant.job import Job, Jobs
from somrs.service_manager.participant.timers import HeartbeatDue, StartDue

CUT_OFF = 15.0
"""Seconds for which a sign of life is sent again. When none gets through, nobody can call the device back, and its step may
soon be given to another: it stops by itself. A coordinator waits for longer than this, and for a stop, before it does that."""

REPORT_TIME = 86_400.0
"""Seconds for which a report is sent again; a Task Manager that is down has this long to come back."""


def send_message(job: Job, body: ParticipantBody, jobs: Jobs, now: float) -> Effects:
    """Send a message of the job's own accord."""
    message = job.session.send(body)
    if isinstance(body, frp.Progress):
        yield Send(message, now + CUT_OFF)
        return
    if job.session.state not in WORKING:
        yield from job.set_timer(HeartbeatDue, None)
    if job.session.state is State.FAILED:
        yield from job.set_timer(StartDue, None)
    jobs.store_job(job)
    yield Send(message, now + REPORT_TIME)
