"""Which messages and answers can still have an effect in the model of reservations at two Repositories.

Whatever cannot is left out of a state, so that states that differ in nothing else are one. This is sound where the receiver, now and in
every later state, does the same with it as without it:

- A Repository ignores the messages about a task that have no higher number than the latest one that it has heeded; it repeats the answer
  to a request only as long as the answer is awaited.
- A task that has ended asks for nothing more. All it sends from then on are Releases that say so: its Repository answers each notice that
  its objects are free with one, and each has a higher number than the one before. The first that arrives has the effect of all, unless a
  request of the task arrives later and has a higher number. So those above all requests in transit are as one. Without this, notices that
  are repeated make ever more Releases, and the states have no end on media that lose acknowledgements.
- A notice about a task that neither Repository knows any more, and about a number that the task does not have, changes nothing.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache

from somrs.protocol.messages.reservations import Release, ReservationFree, ReservationLost, Reserve
from verification.model_check.reservation_task import TASKS, Side
from verification.model_check.shared_reservation_state import (
    MAPS,
    REMEMBERED,
    PassedReport,
    Reply,
    ReportAnswer,
    Token,
    frozen,
    read,
    thawed,
)


def spent_messages(messages: Collection[Token], number: int, sides: tuple[Side, Side], repositories: tuple[bytes, bytes]) -> list[Token]:
    """Those messages in transit from the Repository with this number that cannot have an effect any more."""
    spent = [message for message in messages if _is_spent(message, number, sides, repositories)]
    task = TASKS[number]
    if sides[number].phase != "ended" or task in read(repositories[number]).shared:
        return spent
    requests = [message.serial for message in messages if isinstance(message, Reserve) and message not in spent]
    final_releases = [
        message
        for message in messages
        if isinstance(message, Release) and message.ended and message not in spent and message.serial > max(requests, default=-1)
    ]
    is_known = bool(requests) or task in read(repositories[1 - number]).reservations.claimants
    return [*spent, *final_releases[is_known:]]


def _is_spent(message: Token, number: int, sides: tuple[Side, Side], repositories: tuple[bytes, bytes]) -> bool:
    sender, recipient = read(repositories[number]), read(repositories[1 - number])
    match message:
        case Reserve(task=task, serial=serial):
            return recipient.reservations.last_serial(task) >= serial != _awaited_serial(repositories[number], task)
        case Release(task=task, serial=serial):
            return recipient.reservations.last_serial(task) >= serial
        case Reply(task=task, serial=serial):
            return serial != _awaited_serial(repositories[1 - number], task)
        case PassedReport(step=step):
            return sides[number].awaits[0] != -1 - step
        case ReportAnswer(step=step):
            return sides[1 - number].awaits[0] != -1 - step
        case ReservationFree(task=task):
            return task not in recipient.shared and task not in sender.reservations.claimants
        case ReservationLost(task=task, fence=fence):
            shared = recipient.shared.get(task)
            return shared is None or (not shared.request_id and shared.fences.get(MAPS[number]) != fence)
        case _:
            return False


def _awaited_serial(state: bytes, task: str) -> int:
    """The number of the request of the task that is passed on; -1 if there is none."""
    shared = read(state).shared.get(task)
    return 2 * shared.request.serial if shared is not None and shared.request is not None and shared.request_id else -1


def without_answers(number: int, sides: tuple[Side, Side], repositories: tuple[bytes, bytes]) -> bytes:
    """The state of the Repository with this number, without answers that its neighbour does not await any more."""
    neighbour = 1 - number
    return _without_answers(repositories[number], _awaited_serial(repositories[neighbour], TASKS[neighbour]), sides[neighbour].awaits[0])


@lru_cache(REMEMBERED)
def _without_answers(state: bytes, awaited_serial: int, awaited_report: int) -> bytes:
    repository = read(state)
    replies = {serial: body for serial, body in repository.replies.items() if int(serial) == awaited_serial}
    accepted = {step: accepted for step, accepted in repository.accepted.items() if awaited_report == -1 - int(step)}
    if len(replies) == len(repository.replies) and len(accepted) == len(repository.accepted):
        return state
    changed = thawed(state)
    changed.replies, changed.accepted = replies, accepted
    return frozen(changed)
