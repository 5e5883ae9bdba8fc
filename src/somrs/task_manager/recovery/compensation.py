"""Compensation of work, the latest first (FRP, "Recovery": give up, and compensate and retry).

Work that changed nothing, or whose prior situation holds again, counts as undone. Otherwise there are up to three attempts, the cheapest
first: a handler; compensation by the service that did the work; restoration of the prior situation by other services. Work that no attempt
undoes is stranded, and is reported to the client with its situation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import StrEnum

from msgspec import Struct, field, structs

from somrs.kernel.component import Effects, EffectsReturning
from somrs.kernel.reservations import Reservation
from somrs.ontology.services import Occasion
from somrs.protocol.messages import events
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.reservations import ReservationMode, Reserved
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.waits import Holder
from somrs.task_manager.context import TaskManagerContext, known_to_hold
from somrs.task_manager.execution.execution_log import ExecutionLog, Work
from somrs.task_manager.execution.member import Members
from somrs.task_manager.execution.participants import Participants
from somrs.task_manager.recovery.handlers import fitting_handlers
from somrs.task_manager.requests import ReservationAnswer
from somrs.task_manager.reservations import ReservationRequester

UNDOING = 0
"""The number of the goal in requests for the objects of work that is to be undone."""


class Attempt(StrEnum):
    """The attempts to undo work, in this order."""

    HANDLER = "a procedure that was laid down"
    PARTICIPANT = "the service that did it"
    OTHER_SERVICES = "other services"
    NO_SERVICE = "nobody"


class Undoing(Struct, kw_only=True):
    """The state of a compensation.

    `remaining_numbers` are the numbers of the work still to undo. `work` is the number of the work that is being undone, and `attempts` are
    left for it. `by_other_services`: other services may restore prior situations. `pursued`: a goal of the task is to undo the work.
    `requested`: the objects of the work are being reserved; `reserved`: they are, except those that the `holders` have.
    """

    remaining_numbers: list[int] = field(name="left")
    by_other_services: bool = field(name="by_others")
    restored: int = 0
    work: int | None = None
    attempts: list[Attempt] = []
    pursued: bool = False
    requested: bool = False
    reserved: bool = False
    holders: tuple[Holder, ...] = ()

    @classmethod
    def from_works(cls, works: Iterable[Work], *, by_other_services: bool) -> Undoing:
        return cls(remaining_numbers=[work.number for work in works], by_other_services=by_other_services)


class RestorationGoal(Struct, frozen=True):
    """A formula that has to be made true to undo the work."""

    goal: str
    work: Work


class Compensation:
    """Continues the compensation of a task's work. `log_event` logs an event of the work."""

    def __init__(
        self,
        state: Undoing,
        *,
        task: Submit,
        log: ExecutionLog,
        members: Members,
        participants: Participants,
        reserving: ReservationRequester,
        context: TaskManagerContext,
        log_event: Callable[[Event, float, Work], None],
    ) -> None:
        self._state, self._task, self._log = state, task, log
        self._members, self._participants, self._context, self._log_event = members, participants, context, log_event
        self._reserving = reserving

    def proceed(self, now: float) -> EffectsReturning[bool | RestorationGoal]:
        """Continue. Returns True when no work is left, False when a participant is still busy or the objects of the work are still being
        reserved, or a goal for the transaction.

        After a goal, the transaction calls `goal_reached` or `goal_failed`.
        """
        state = self._state
        if not state.reserved:
            yield from self._reserve(now)
        if not state.reserved:
            return False
        while not state.pursued:
            if state.work is None:
                if not state.remaining_numbers:
                    return True
                state.work, state.attempts = state.remaining_numbers.pop(0), [*Attempt]
                continue
            work = self._log.work_by_number(state.work)
            member = self._members.find_member(work.participant)
            if member is not None and (member.state is State.COMPENSATING or member.halting):
                return False
            work.untouched = work.untouched or work.changed_nothing
            if work.state is State.COMPENSATED or work.untouched or self._is_restored(work):
                self._mark_restored(work, now)
            elif holders := self._other_holders(work):
                self._strand(work, events.WorkStranded(taken=True, holders=holders), now)
            elif (goal := (yield from self._attempt(state.attempts.pop(0), work, now))) is not None:
                state.pursued = True
                return RestorationGoal(goal, work)
        return False

    def _reserve(self, now: float) -> Effects:
        """Reserve the objects of the work, which other tasks may have by now."""
        if self._state.requested:
            return
        self._state.requested = True
        works = map(self._log.work_by_number, self._state.remaining_numbers)
        needed = Reservation(changes=frozenset(name for work in works for name in work.concerned))
        answer = yield from self._reserving.request(needed, ReservationMode.UNDO, UNDOING, now)
        if answer is not None:
            self.reserved(answer)

    def reserved(self, answer: ReservationAnswer) -> None:
        """Handle the answer to the request for the objects; without an answer, they are requested again."""
        state = self._state
        state.requested = False
        if isinstance(answer, Reserved):
            state.reserved, state.holders = True, answer.holders
            works = map(self._log.work_by_number, state.remaining_numbers)
            state.remaining_numbers = [work.number for work in works if not work.overtaken]

    def goal_reached(self, now: float) -> None:
        """The goal holds, and its work is undone."""
        self._state.pursued = False
        if self._state.work is not None:
            self._mark_restored(self._log.work_by_number(self._state.work), now)

    def goal_failed(self) -> None:
        """The goal cannot be reached; `proceed` makes the next attempt."""
        self._state.pursued = False

    def _attempt(self, attempt: Attempt, work: Work, now: float) -> EffectsReturning[str | None]:
        """Make one attempt. Returns the formula that has to be made true for it, if any."""
        match attempt:
            case Attempt.HANDLER:
                for handler in fitting_handlers(self._task.handlers, work, Occasion.COMPENSATION, self._context.replica):
                    self._log_event(events.UndoneByHandler(effect=handler.effect), now, work)
                    return handler.effect
            case Attempt.PARTICIPANT:
                member = self._members.find_member(work.participant)
                if member is not None and (yield from self._participants.compensate(member, str(work.prior_situation), now)):
                    self._log_event(events.UndoneByService(service=work.service, situation=str(work.prior_situation)), now, work)
            case Attempt.OTHER_SERVICES if self._state.by_other_services:
                self._log_event(events.UndoneByOthers(situation=str(work.prior_situation)), now, work)
                return str(work.prior_situation)
            case Attempt.NO_SERVICE if self._state.by_other_services:
                self._strand(work, events.WorkStranded(reason=work.note), now)
            case Attempt.NO_SERVICE:
                self._state.work = None
        return None

    def _other_holders(self, work: Work) -> tuple[Holder, ...]:
        """The other tasks that have reserved the objects of the work. There can be some after the task has had to wait."""
        contested = ((holder, tuple(name for name in holder.objects if name in work.concerned)) for holder in self._state.holders)
        return tuple(structs.replace(holder, objects=objects) for holder, objects in contested if objects)

    def _is_restored(self, work: Work) -> bool:
        return work.prior_situation is not None and known_to_hold(work.prior_situation, self._context.replica)

    def _mark_restored(self, work: Work, now: float) -> None:
        work.state = State.COMPENSATED
        self._state.restored += 1
        self._log_event(events.WorkUndone(), now, work)
        self._state.work = None

    def _strand(self, work: Work, event: events.WorkStranded, now: float) -> None:
        work.state = State.STRANDED
        self._log_event(event, now, work)
        self._state.work = None
