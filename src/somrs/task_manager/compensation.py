"""Undoing what was done, last things first (FRP, "Recovery": give up, and compensate and retry).

Each piece of work goes through the same attempts, the cheapest first: it may be as it was already; a procedure may have been laid down
for it; the service that did it may undo it; others may restore what was before. What none of them achieves is stranded: it is reported
to the client with its situation.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from enum import Enum
from typing import Protocol

from somrs.ontology.services import Handler, Occasion
from somrs.protocol.messages.clients import EventKind
from somrs.protocol.messages.frp import State
from somrs.task_manager.participants import Participants
from somrs.task_manager.setting import Setting, known_to_hold
from somrs.task_manager.work import Work


class _Attempt(Enum):
    """In this order."""

    HANDLER = "a procedure that was laid down"
    PARTICIPANT = "the service that did it"
    OTHERS = "other services"
    NONE = "nobody"


class Owner(Protocol):
    """The transaction whose work is undone."""

    setting: Setting
    participants: Participants

    def tell_of(self, work: Work, text: str, now: float, kind: EventKind) -> None: ...

    def handlers(self, work: Work, on: Occasion) -> Iterable[Handler]:
        """The procedures that were laid down for it and fit the situation."""

    def taken_over(self, work: Work) -> bool:
        """Whether another task has the objects of the work by now."""

    def restore(self, goal: str, work: Work, now: float) -> None:
        """Pursue the formula; `achieved` or `tried` is called then."""


class Undoing:
    """`proceed` is called whenever something may have moved. `by_others`: other services may restore what was."""

    def __init__(self, works: Iterable[Work], owner: Owner, *, by_others: bool) -> None:
        self.restored = 0
        self._left = deque(works)
        self._owner, self._by_others = owner, by_others
        self._work: Work | None = None
        self._attempts: deque[_Attempt] = deque()
        self._pursued = False

    def proceed(self, now: float) -> bool:
        """Go on; whether everything was gone through."""
        while not self._pursued:
            if self._work is None:
                if not self._left:
                    return True
                self._work = self._left.popleft()
                self._attempts = deque(_Attempt)
            elif self._work.member.state is State.COMPENSATING or self._work.member.halting:
                return False
            elif self._work.state is State.COMPENSATED or self._is_as_it_was(self._work):
                self._settle(self._work, State.COMPENSATED, "is undone", now)
            elif self._owner.taken_over(self._work):
                self._settle(self._work, State.STRANDED, "is not undone: another task has what it left", now)
            else:
                self._attempt(self._attempts.popleft(), self._work, now)
        return False

    def achieved(self, now: float) -> None:
        """What was pursued is so."""
        self._pursued = False
        if self._work is not None:
            self._settle(self._work, State.COMPENSATED, "is undone", now)

    def tried(self) -> None:
        """What was pursued could not be had."""
        self._pursued = False

    def _attempt(self, attempt: _Attempt, work: Work, now: float) -> None:
        owner = self._owner
        match attempt:
            case _Attempt.HANDLER:
                for handler in owner.handlers(work, Occasion.COMPENSATION):
                    owner.tell_of(work, f"undoing it by what was laid down: {handler.effect}", now, EventKind.UNDO)
                    self._pursue(handler.effect, work, now)
                    return
            case _Attempt.PARTICIPANT:
                if owner.participants.compensate(work.member, str(work.before), now):
                    owner.tell_of(work, f"{work.service} is to restore {work.before}", now, EventKind.UNDO)
            case _Attempt.OTHERS:
                if self._by_others:
                    owner.tell_of(work, f"others are to restore {work.before}", now, EventKind.UNDO)
                    self._pursue(str(work.before), work, now)
            case _Attempt.NONE:
                if self._by_others:
                    self._settle(work, State.STRANDED, f"could not be undone: {work.note or 'nobody restores it'}", now)
                else:
                    self._work = None

    def _pursue(self, goal: str, work: Work, now: float) -> None:
        self._pursued = True
        self._owner.restore(goal, work, now)

    def _settle(self, work: Work, state: State, text: str, now: float) -> None:
        if work.state is not state:
            work.state = state
        self.restored += state is State.COMPENSATED
        self._owner.tell_of(work, text, now, EventKind.UNDO if state is State.COMPENSATED else EventKind.SETBACK)
        self._work = None

    def _is_as_it_was(self, work: Work) -> bool:
        return work.before is not None and known_to_hold(work.before, self._owner.setting.replica)
