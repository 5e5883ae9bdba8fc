"""A task that reserves what it changes, as its Task Manager sees it, for the model of reservations."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

from msgspec import Struct

from somrs.kernel.component import Effects
from somrs.kernel.reservations import Reservation
from somrs.protocol.messages.reservations import (
    ClaimReservations,
    ReservationDenied,
    ReservationFree,
    ReservationLost,
    ReservationMode,
    Reserve,
    Reserved,
)
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.requests import ReservationAnswer
from somrs.task_manager.reservations import ReservationRequester, TaskReservation

TASKS = ("a", "b")
NOW = 1.0
"""The time, in seconds, which is part of the number of some messages: that is then higher than all others."""
FRESH = 100
"""Where numbers that only grow go on: higher than all ranks."""
TRY, WAIT, UNDO = ReservationMode.TRY, ReservationMode.WAIT, ReservationMode.UNDO


class Report(Struct, frozen=True):
    """A task has changed the object of its step `step`. `attempt` counts the reports of a step, of which each has an id of its own."""

    task: str
    step: int
    fence: int


class Answer(Struct, frozen=True):
    """The answer to the request with this number; to a report, whether it was accepted."""

    serial: int
    body: Reserved | ReservationDenied | bool


class Side(NamedTuple):
    """A task at its Task Manager. `awaits`: the number of the request to which it awaits the answer, and its mode. `retried`: it has
    released what it had once, to try again later."""

    phase: str = "planning"
    step: int = 0
    held: frozenset[str] = frozenset()
    fence: int = 0
    requested: frozenset[str] = frozenset()
    serial: int = 0
    waiting: frozenset[str] | None = None
    is_free: bool = False
    lost: int = 0
    settled: int = 0
    sent: int = 0
    awaits: tuple[int, str] = (0, "")
    retried: bool = False

    @property
    def works(self) -> bool:
        return self.phase in ("working", "reporting")

    def reduced(self) -> Side:
        """The task without what cannot have an effect any more: whatever a task that has ended knows, and, when it awaits no answer, its
        latest request and whether that is free. The number of its next message is higher than all others."""
        if self.phase == "ended":
            return Side("ended", sent=FRESH)
        if self.awaits[0] > 0:
            return self if self.sent == FRESH else self._replace(sent=FRESH)
        return self._replace(requested=frozenset(), is_free=False, sent=FRESH)


class _Recorder:
    """Takes the place of the requests of a Task Manager: it notes what is sent, and numbers it."""

    def __init__(self, count: int) -> None:
        self.count, self.sent = count, list[Struct]()

    def next_serial(self, now: float) -> int:
        self.count += 1
        return self.count

    def reserve(self, body: Reserve, purpose: object, now: float) -> Effects:
        yield from ()
        self.sent.append(body)

    def notify(self, body: Struct, now: float) -> Effects:
        yield from ()
        self.sent.append(body)


class _Context(NamedTuple):
    requests: _Recorder
    local_reservations: None = None


def _answer_of(effects: Any) -> ReservationAnswer | None:
    while True:
        try:
            next(effects)
        except StopIteration as end:
            return cast("ReservationAnswer | None", end.value)


class ReservingTask:
    """A task that acts. What it sends is in `recorder.sent`. `needs`: the objects that it changes, in this order."""

    def __init__(self, number: int, side: Side, needs: tuple[str, str]) -> None:
        self._needs, self._name = needs, TASKS[number]
        self.phase, self.step, self.awaits, self.retried = side.phase, side.step, side.awaits, side.retried
        waiting = Reservation(changes=side.waiting) if side.waiting is not None else None
        self.reservation = TaskReservation(
            held=Reservation(changes=side.held),
            fence=side.fence,
            requested=Reservation(changes=side.requested),
            serial=side.serial,
            waiting=waiting,
            is_free=side.is_free,
            lost=side.lost,
            settled=side.settled,
        )
        self.recorder = _Recorder(side.sent)
        context = cast("TaskManagerContext", _Context(self.recorder))
        self._reserving = ReservationRequester(self.reservation, self._name, "", 0, context)

    def side(self) -> Side:
        held = self.reservation
        waiting = held.waiting.changes if held.waiting is not None else None
        return Side(
            self.phase, self.step, held.held.changes, held.fence, held.requested.changes, held.serial, waiting, held.is_free,
            held.lost, held.settled, self.recorder.count, self.awaits, self.retried,
        )  # fmt: skip

    def ask(self, mode: ReservationMode) -> None:
        needed = self._needs[: self.step + 1] if mode is not UNDO else self._needs[: self.step]
        answer = _answer_of(self._reserving.request(Reservation(changes=frozenset(needed)), mode, 1, 0.0))
        self.phase = "undoing" if mode is UNDO else "asking"
        self.awaits = (self.reservation.serial, mode) if answer is None else (0, "")
        if answer is not None:
            self._answered(answer, mode)

    def hear(self, message: Struct) -> None:
        match message:
            case Answer(serial=serial, body=bool() as accepted) if self.phase == "reporting" and serial == self.awaits[0]:
                self.awaits = (0, "")
                self._reported(accepted=accepted)
            case Answer(serial=serial, body=Reserved() | ReservationDenied() as body) if serial == self.awaits[0]:
                mode = ReservationMode(self.awaits[1])
                self.awaits = (0, "")
                if serial == self.reservation.serial:
                    self._answered(self.reservation.answered(body), mode)
            case ReservationFree() if self.phase != "ended":
                self.reservation.is_free = True
                if self.phase == "waiting":
                    self.phase = "planning"
            case ReservationLost(fence=fence) if self.phase != "ended" and self.reservation.lose(fence) and self.phase == "working":
                self.phase = "planning"

    def _answered(self, answer: ReservationAnswer, mode: ReservationMode) -> None:
        match answer:
            case Reserved() if mode is UNDO:
                self._end()
            case Reserved():
                self.phase = "working"
            case ReservationDenied(waits=True) if mode is WAIT:
                self.phase = "planning" if self.reservation.is_free else "waiting"
            case _:
                self.ask(UNDO if mode is UNDO else WAIT)

    def report(self) -> None:
        self.phase, self.awaits = "reporting", (-1 - self.step, "")
        self.recorder.sent.append(Report(self._name, self.step, self.reservation.fence))

    def _reported(self, *, accepted: bool) -> None:
        if not accepted or not self.reservation.held:
            self.phase = "planning"
        elif self.step == 0:
            self.step, self.phase = 1, "planning"
        else:
            self._end()

    def wait_to_retry(self) -> None:
        _answer_of(self._reserving.release(0.0))
        self.phase, self.retried = "planning", True

    def cancel(self) -> None:
        if self.reservation.waiting is not None:
            _answer_of(self._reserving.release(0.0))
        self.awaits = (0, "")
        if self.step:
            self.ask(UNDO)
        else:
            self._end()

    def _end(self) -> None:
        _answer_of(self._reserving.release(0.0, ended=True))
        self.phase, self.awaits = "ended", (0, "")

    def claim(self) -> None:
        claim = self.reservation.claim(self._name, "", 0)
        self.recorder.sent.append(ClaimReservations(serial=self.recorder.next_serial(0.0), claims=(claim,) if claim is not None else ()))
