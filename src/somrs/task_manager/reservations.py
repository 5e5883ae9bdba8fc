"""What a task has reserved at the Repository, as far as its Task Manager knows, and its requests for more.

Who gets which objects is in `kernel/reservations.py`.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from somrs.kernel.component import Effects, EffectsReturning
from somrs.kernel.reservations import Claimant, Granted, Reservation
from somrs.ontology.objects import Fact
from somrs.planner.model.plan import Plan
from somrs.protocol.messages.reservations import (
    Claim,
    Release,
    ReservationDenied,
    ReservationMode,
    Reserve,
    Reserved,
    UnderReservation,
)
from somrs.protocol.messages.waits import Holder
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.requests import ForReservation, ReservationAnswer


class BlockedPlan(Struct, frozen=True, kw_only=True):
    """A plan that needs objects of other tasks: the `holders`, with the contested objects. The task waits for them, if it may."""

    holders: tuple[Holder, ...]
    plan: Plan


class TaskReservation(Struct, kw_only=True):
    """What a task has: `held`. `fence`: the number under which it has this, or had what it had last.

    `requested` is the latest request, with the number `serial`. `waiting`: what the task waits for at the Repository. `is_free`: the
    Repository has said that this is free, possibly before it said that the task has to wait. `lost`: the highest number under which other
    tasks have taken what the task had. `settled`: the number of the latest message whose effect is known.
    """

    held: Reservation = Reservation()
    fence: int = 0
    requested: Reservation = Reservation()
    serial: int = 0
    waiting: Reservation | None = None
    is_free: bool = False
    lost: int = 0
    settled: int = 0

    def under(self, task: str, *, only_seen: bool = False) -> UnderReservation | None:
        """The reservation as reports of the task name it, even if it is lost; None if the task has never reserved."""
        return UnderReservation(task=task, fence=self.fence, only_seen=only_seen) if self.serial or self.held else None

    def claim(self, task: str, goal: str, priority: int) -> Claim | None:
        """What the task has, for a Repository that may not know it; None if it has never reserved."""
        if not self.serial and not self.held and self.waiting is None:
            return None
        reservation = self.waiting or self.held
        return Claim(
            task=task,
            serial=self.settled,
            fence=self.fence,
            waits=self.waiting is not None,
            goal=goal,
            priority=priority,
            changes=tuple(sorted(reservation.changes)),
            relies_on=tuple(sorted(reservation.relies_on)),
        )

    def lose(self, fence: int) -> bool:
        """Other tasks have taken what the task had under this number. Returns whether it still had it."""
        is_lost = bool(self.held) and self.fence == fence
        self.lost = max(self.lost, fence)
        if is_lost:
            self.clear()
        return is_lost

    def answered(self, answer: ReservationAnswer) -> ReservationAnswer:
        """Note the answer to the latest request. Returns it as a denial if other tasks have taken since what it grants."""
        if not isinstance(answer, str):
            self.settled = self.serial
        match answer:
            case Reserved(task=task, fence=fence) if 0 < fence <= self.lost:
                self.clear()
                return ReservationDenied(task=task, holders=())
            case Reserved(fence=fence, holders=holders):
                self.held |= self.requested.without({name for holder in holders for name in holder.objects})
                self.fence, self.waiting = fence, None
            case ReservationDenied(waits=True):
                self.clear()
                self.waiting = self.requested
        return answer

    def rename(self, names: Mapping[str, str]) -> None:
        """Give objects the names that they have now."""
        self.held, self.requested = self.held.renamed(names), self.requested.renamed(names)
        self.waiting = self.waiting.renamed(names) if self.waiting is not None else None

    def clear(self) -> None:
        """The task has nothing any more, and waits for nothing."""
        self.held, self.waiting = Reservation(), None


class ReservationRequester:
    """Requests the reservations of one task. It has no state of its own. `goal` and `priority` are those of the task."""

    def __init__(self, state: TaskReservation, task: str, goal: str, priority: int, context: TaskManagerContext) -> None:
        self._state, self._task, self._goal, self._priority, self._context = state, task, goal, priority, context

    def request(
        self, needed: Reservation, mode: ReservationMode, goal: int, now: float, facts: tuple[Fact, ...] = ()
    ) -> EffectsReturning[ReservationAnswer | None]:
        """Request what is needed for the goal with the number `goal`. `facts`: those of several maps that the plan makes true. Returns the
        answer; None if it comes later, for `state.serial`."""
        state = self._state
        if mode is not ReservationMode.ASK and state.held.includes(needed) and not facts:
            return Reserved(task=self._task, fence=state.fence)
        state.requested, state.serial, state.is_free = needed, self._context.requests.next_serial(now), False
        if self._context.local_reservations is not None:
            return self._reserve_locally(needed, mode, now)
        reserve = Reserve(
            task=self._task,
            serial=state.serial,
            mode=mode,
            goal=self._goal,
            priority=self._priority,
            changes=tuple(sorted(needed.changes)),
            relies_on=tuple(sorted(needed.relies_on)),
            facts=facts,
        )
        yield from self._context.requests.reserve(reserve, ForReservation(self._task, goal, state.serial), now)
        return None

    def _reserve_locally(self, needed: Reservation, mode: ReservationMode, now: float) -> ReservationAnswer:
        reservations = self._context.local_reservations
        assert reservations is not None
        claimant = Claimant(holder="", goal=self._goal, priority=self._priority, arrival=0)
        answer: ReservationAnswer
        match reservations.reserve(self._task, claimant, needed, mode, now):
            case Granted(fence=fence, overtaken=overtaken, holders=holders):
                answer = Reserved(task=self._task, fence=fence, overtaken=tuple(sorted(overtaken)), holders=holders)
            case denied:
                answer = ReservationDenied(task=self._task, holders=denied.holders, waits=denied.waits)
        if mode is not ReservationMode.ASK:
            self._state.answered(answer)
        return answer

    def release(self, now: float, *, ended: bool = False) -> Effects:
        """Release what the task holds, and let it wait no more."""
        state, local = self._state, self._context.local_reservations
        has_any = bool(state.held) or state.waiting is not None
        state.clear()
        if local is not None:
            (local.remove if ended else local.release)(self._task)
        elif has_any or (ended and state.serial):
            state.serial = state.settled = self._context.requests.next_serial(now)
            yield from self._context.requests.notify(Release(task=self._task, serial=state.serial, ended=ended), now)
