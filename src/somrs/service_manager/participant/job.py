"""One participant as its Service Manager sees it: its session of the protocol, and the work of the device for it."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct, field

from somrs.kernel.component import Effects, SetTimer
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.frp.states import RESUMES, WORKING
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.observations import Observation, observed_at
from somrs.service_manager.participant.timers import Activity, ParticipantTimer, WorkWanted
from somrs.service_manager.sdk.orders import Order

Key = tuple[str, str]
"""The ids of the transaction and of the participant."""

Verdict = frp.Failed | frp.Stopped | frp.Stranded

_CONTRACT = WORKING | {State.COMMITTED}

REMEMBERED = 1000
"""The number of ended participants that are remembered, to answer their late messages."""


class Job(Struct, kw_only=True):
    """A participant and its work. `waiting`: it is to begin, or to be undone, when the device is free. `situation`: the last known."""

    session: ParticipantSession
    order: Order | None = None
    activity: Activity | None = None
    waiting: bool = False
    started_at: float | None = field(default=None, name="began")
    fraction: float = 0.0
    situation: str | None = None
    timers: set[ParticipantTimer] = field(default_factory=set)
    """The timers that are set."""
    verdict: Verdict | None = None
    """The report to send when the device is in a safe state, unless the work turns out to be done."""
    observation: Observation | None = None
    """When and how the last known situation was observed."""
    offered_at: float | None = None
    """When it offered its terms."""
    accepted_at: float | None = None
    """When its terms were accepted."""

    @property
    def key(self) -> Key:
        return self.session.transaction, self.session.participant

    @property
    def has_contract(self) -> bool:
        return self.session.state in _CONTRACT

    def note_situation(self, situation: str | None, observation: Observation | None, now: float) -> None:
        """Note a situation that the device reports (None: nothing new). It holds `now`, unless the observation gives another time."""
        if situation is not None:
            self.situation, self.observation = situation, observed_at(observation, now)

    def forget_situation(self) -> None:
        """The last known situation may have been changed by other services."""
        self.situation = self.observation = None

    def question_for(self, activity: Activity) -> WorkWanted:
        return WorkWanted(*self.key, activity)

    def set_timer(self, kind: type[ParticipantTimer], fire_time: float | None) -> Effects:
        """Set a timer of this kind; None removes it."""
        if fire_time is None and not self.timers:
            return
        timer = kind(*self.key)
        if fire_time is not None:
            self.timers.add(timer)
        elif timer in self.timers:
            self.timers.remove(timer)
        else:
            return
        yield SetTimer(timer, fire_time)


class Jobs(Struct):
    """Jobs by their ids. Iteration yields those under way; the latest ended jobs are kept to answer late messages."""

    live: dict[Key, Job] = field(default_factory=dict)
    ended: dict[Key, Job] = field(default_factory=dict, name="over")

    def __iter__(self) -> Iterator[Job]:
        return iter([*self.live.values()])

    def all_jobs(self) -> Iterator[Job]:
        """Iterate over all jobs, including ended ones."""
        return iter([*self.ended.values(), *self.live.values()])

    def find_job(self, transaction: str | None, participant: str | None) -> Job | None:
        key = (transaction or "", participant or "")
        return self.live.get(key) or self.ended.get(key)

    def store_job(self, job: Job) -> None:
        """Store the present state of the job."""
        key = job.key
        if job.session.state is not State.ENDED or job.activity is not None:
            self.live[key] = job
            return
        self.live.pop(key, None)
        self.ended[key] = job
        if len(self.ended) > REMEMBERED:
            del self.ended[next(iter(self.ended))]


def failure(activity: Activity, description: str, situation: str | None, *, tried: bool = True) -> frp.Failed | frp.Stranded:
    if activity is Activity.UNDO:
        return frp.Stranded(description=description, situation=situation, tried=tried)
    return frp.Failed(description=description, situation=situation, tried=tried)


def interruption(state: State, reason: str) -> Verdict:
    """Return the report on work that was stopped in this state, for this reason."""
    kind = RESUMES[state]
    if kind is frp.Stopped:
        return frp.Stopped()
    return frp.Stranded(description=reason) if kind is frp.Stranded else frp.Failed(description=reason)
