"""One participant as its Service Manager sees it: its part in the protocol, and what the device does for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from somrs.errors import InputError
from somrs.protocol.frp.session import ParticipantSession
from somrs.protocol.frp.states import RESUMES
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from somrs.service_manager.sdk.orders import Order, Refusal

Key = tuple[str, str]
"""The ids of the transaction and of the participant."""

Verdict = frp.Failed | frp.Stopped | frp.Stranded


@dataclass(slots=True)
class Job:
    """One participant: its part in the protocol, and what its device does for it."""

    session: ParticipantSession
    order: Order | None = None
    doing: str = ""
    """The kind of `Work` that the device does for it now."""
    waiting: bool = False
    """It is to begin, or to be undone, as soon as the device is free."""
    began: float | None = None
    fraction: float = 0.0
    situation: str | None = None
    """The latest that is known to hold."""
    timers: set[str] = field(default_factory=set)
    """Those that were set and have not rung."""
    verdict: Verdict | None = None
    """What to report once the device is in a safe state, unless the work turns out to be done."""

    @property
    def key(self) -> Key:
        return self.session.transaction, self.session.participant

    @property
    def question(self) -> str:
        return f"{self.doing} {self.session.participant} {self.session.transaction}"


class Jobs:
    """Jobs by their ids. Iterating gives those under way; of those that are over, the latest are known still, for their late
    messages."""

    def __init__(self, remembered: int) -> None:
        self._live: dict[Key, Job] = {}
        self._over: dict[Key, Job] = {}
        self._remembered = remembered

    def __iter__(self) -> Iterator[Job]:
        return iter([*self._live.values()])

    def all(self) -> Iterator[Job]:
        """Those that are over, too."""
        return iter([*self._over.values(), *self._live.values()])

    def get(self, transaction: str | None, participant: str | None) -> Job | None:
        key = (transaction or "", participant or "")
        return self._live.get(key) or self._over.get(key)

    def put(self, job: Job) -> None:
        """Know the job as it is now."""
        if job.session.state is not State.ENDED or job.doing:
            self._live[job.key] = job
            return
        self._live.pop(job.key, None)
        self._over[job.key] = job
        if len(self._over) > self._remembered:
            del self._over[next(iter(self._over))]


def failure(doing: str, description: str, situation: str | None) -> frp.Failed | frp.Stranded:
    if doing == "Undo":
        return frp.Stranded(description=description, situation=situation)
    return frp.Failed(description=description, situation=situation)


def interrupted(state: State, reason: str) -> Verdict:
    """What is reported of work that was brought to a stop in this state, for this reason."""
    kind = RESUMES[state]
    if kind is frp.Stopped:
        return frp.Stopped()
    return frp.Stranded(description=reason) if kind is frp.Stranded else frp.Failed(description=reason)


def in_words(value: object) -> str:
    """What an exception says, with its class unless it is one that is meant to be read."""
    if isinstance(value, Refusal | InputError):
        return str(value)
    return f"{type(value).__name__}: {value}"
