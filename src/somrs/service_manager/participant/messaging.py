"""Send the messages of a participant."""

from __future__ import annotations

from somrs.kernel.component import Effects, Send
from somrs.protocol.frp.session import ParticipantBody
from somrs.protocol.frp.states import WORKING
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from somrs.service_manager.participant.job import Job, Jobs
from somrs.service_manager.participant.timers import HeartbeatDue, StartDue

CUT_OFF = 15.0
"""Seconds for which a heartbeat is sent again.

When none gets through, the coordinator cannot stop the device and may soon give its step to another service, so the device stops by itself.
The coordinator waits for longer than this time plus the time of a stop.
"""

REPORT_TIME = 86_400.0
"""Seconds for which a report is sent again; a Task Manager that is down has this long to restart."""


def send_message(job: Job, body: ParticipantBody, jobs: Jobs, now: float) -> Effects:
    """Send a message that answers no other."""
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
