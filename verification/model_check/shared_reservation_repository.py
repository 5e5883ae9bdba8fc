"""What a Repository does in the model of reservations at two Repositories, as functions of its state.

The Repository is the one that runs in the system (`repository/component.py`), with a map that has nothing on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from msgspec import Struct

from somrs.kernel.component import Effect, Received, Send, TimerFired
from somrs.ontology.qualified_names import home_of, plain_name
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.reservations import (
    ClaimReservations,
    Release,
    ReservationDenied,
    ReservationFree,
    ReservationLost,
    Reserve,
    Reserved,
    UnderReservation,
)
from somrs.repository.component import Repository
from somrs.repository.forwarding import reservation_at
from somrs.repository.state import RepetitionDue, ReservationsDue
from verification.model_check.reservation_task import NOW, Answer, Report
from verification.model_check.shared_reservation_state import (
    LAPSED,
    MANAGERS,
    REMEMBERED,
    REPOSITORIES,
    PassedReport,
    Reply,
    ReportAnswer,
    RepositoryState,
    Token,
    contents_of,
    for_programs,
    frozen,
    read,
    request_id,
    state_of,
    task_message,
    thawed,
)

NEEDS = (("x", "B:y"), ("y", "A:x"))
"""The objects that each task changes, in this order, as its Repository names them."""


class LeaseEnded(Struct, frozen=True):
    """The neighbour has not been heard of for longer than its lease."""


class TimeToRepeat(Struct, frozen=True):
    """The requests of the Repository are due again."""


class ByTask(Struct, frozen=True):
    """What the Task Manager sends."""

    body: Reserve | Release | ClaimReservations | Report


Event = ByTask | LeaseEnded | TimeToRepeat | Token


class Handled(NamedTuple):
    """The state after an event, what the Repository tells its Task Manager and sends to its neighbour, and why this is wrong."""

    state: bytes
    told: tuple[Struct, ...] = ()
    sent: tuple[Token, ...] = ()
    wrong: str = ""


@dataclass
class _Outgoing:
    """What is sent while an event is handled."""

    told: list[Struct]
    sent: list[Token]


class RepositoryPair:
    """Two Repositories that are neighbours. They have no state of their own, but remember what came of what in which state."""

    def __init__(self) -> None:
        self.handle: Callable[[int, bytes, Event], Handled] = lru_cache(REMEMBERED)(_handle)


def _handle(number: int, state: bytes, event: Event) -> Handled:
    """What comes of an event at the Repository with this number."""
    match event:
        case ByTask(body=Report() as report):
            return _report(number, state, report)
        case ByTask(body=body):
            return _handle_input(number, thawed(state), Received(task_message(number, body)))
        case PassedReport() as report:
            return _passed_report(number, state, report)
        case ReportAnswer(step=step, accepted=accepted):
            return Handled(state, told=(Answer(-1 - step, accepted),))
        case TimeToRepeat():
            return _handle_input(number, thawed(state), TimerFired(RepetitionDue()))
        case LeaseEnded():
            repository = thawed(state)
            repository.reservations.heard_at[REPOSITORIES[1 - number]] = LAPSED
            repository.lapsed = True
            return _handle_input(number, repository, TimerFired(ReservationsDue()))
        case message:
            return _handle_input(number, thawed(state), Received(_neighbour_message(number, message)))


def _neighbour_message(number: int, token: Token) -> Message:
    """A message of the neighbour to the Repository with this number."""
    sender = REPOSITORIES[1 - number]
    match token:
        case Reply(task=task, serial=serial, body=body):
            return Message(header=_header(number, f"{sender}/reply", request_id(task, serial // 2, 1 - number)), body=body)
        case Reserve(task=task, serial=serial):
            return Message(header=_header(number, request_id(task, serial // 2, number)), body=token)
        case _:
            return Message(header=_header(number, f"{sender}/notice"), body=token)  # type: ignore[arg-type]


def _header(number: int, id: str, relates_to: str | None = None) -> Header:
    sender = REPOSITORIES[1 - number]
    return Header(sender=sender, recipient=REPOSITORIES[number], message_id=id, reply_to=sender, relates_to=relates_to)


def _handle_input(number: int, earlier: RepositoryState, event: Received | TimerFired) -> Handled:
    contents = contents_of(earlier, number, NOW)
    effects = Repository(REPOSITORIES[number], contents).handle(event, NOW)
    state, outgoing = state_of(contents, earlier, NOW), _Outgoing([], [])
    for effect in effects:
        _note(number, effect, event, state, outgoing)
    return Handled(frozen(state), tuple(outgoing.told), tuple(outgoing.sent))


def _note(number: int, effect: Effect, event: Received | TimerFired, state: RepositoryState, outgoing: _Outgoing) -> None:
    if not isinstance(effect, Send):
        return
    header, body = effect.message.header, for_programs(effect.message.body)
    if header.recipient == MANAGERS[number]:
        is_answer = isinstance(body, Reserved | ReservationDenied)
        outgoing.told.append(Answer(int((header.relates_to or "").rpartition("/")[2]), body) if is_answer else body)  # type: ignore[arg-type]
    elif isinstance(body, Reserved | ReservationDenied):
        assert isinstance(event, Received), "a request of a neighbour is answered at once"
        request = event.message.body
        assert isinstance(request, Reserve)
        state.replies[str(request.serial)] = body
        outgoing.sent.append(Reply(request.task, request.serial, body))
    elif isinstance(body, Reserve | Release | ReservationFree | ReservationLost):
        outgoing.sent.append(body)


# Reports of changes


def _report(number: int, state: bytes, report: Report) -> Handled:
    """A task of this Repository reports a change."""
    name, reservation = NEEDS[number][report.step], UnderReservation(task=report.task, fence=report.fence)
    is_accepted = _is_allowed(state, name, reservation)
    if home_of(name) and is_accepted:
        passed = reservation_at(home_of(name), reservation, contents_of(thawed(state), number, NOW))
        return Handled(state, sent=(PassedReport(report.task, report.step, passed),))
    wrong = _wrong_change(state, name, report.task) if is_accepted else ""
    return Handled(state, told=(Answer(-1 - report.step, is_accepted),), wrong=wrong)


def _passed_report(number: int, state: bytes, report: PassedReport) -> Handled:
    """The neighbour passes on what a task of its own reports."""
    repository, wrong = thawed(state), ""
    if not repository.accepted.get(str(report.step)):
        name, reservation = plain_name(NEEDS[1 - number][report.step]), report.reservation
        is_accepted = _is_allowed(state, name, reservation)
        wrong = _wrong_change(state, name, reservation.task if reservation is not None else "") if is_accepted else ""
        repository.accepted[str(report.step)] = is_accepted
    answer = ReportAnswer(report.task, report.step, repository.accepted[str(report.step)])
    return Handled(frozen(repository), sent=(answer,), wrong=wrong)


def _is_allowed(state: bytes, name: str, reservation: UnderReservation | None) -> bool:
    reservations = read(state).reservations
    return (
        reservation is None
        or reservations.is_held(reservation.task, reservation.fence)
        or not reservations.changers([name], reservation.task)
    )


def _wrong_change(state: bytes, name: str, changing_task: str) -> str:
    for task, claimant in read(state).reservations.claimants.items():
        if task != changing_task and name in claimant.held.changes:
            return f"another task changed {name}, which {task} has reserved"
    return ""
