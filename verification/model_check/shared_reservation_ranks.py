"""Ranks in place of numbers that only grow, in the model of reservations at two Repositories.

There are four sequences of numbers: the fencing numbers of each Repository, and the numbers of the messages about each task. The latter
are doubled on the way to the other Repository (`repository/shared_reserving.py`); ranks keep this, and the number before that of a request.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any

from msgspec import Struct, structs

from somrs.protocol.messages.reservations import Release, ReservationLost, Reserve, Reserved, UnderReservation
from verification.model_check.media import Channel
from verification.model_check.reservation_task import FRESH, TASKS, Answer, Side
from verification.model_check.shared_reservation_state import (
    REMEMBERED,
    PassedReport,
    Reply,
    RepositoryState,
    Token,
    frozen,
    read,
    thawed,
    tokens_in,
)

Number = tuple[int, int]
"""A sequence and a number in it. The sequences 0 and 1 are the fencing numbers of the Repositories, 2 and 3 the messages of the tasks."""

Ranking = tuple[tuple[Number, int], ...]
"""The numbers that become others."""


@lru_cache(REMEMBERED)
def ranking(numbers: frozenset[Number]) -> Mapping[Number, int]:
    """The ranks of those numbers which are not their own ranks. 0 stays 0."""
    changes: dict[Number, int] = {}
    for sequence in range(4):
        used = sorted(number for its_sequence, number in numbers if its_sequence == sequence and number > 0)
        changes |= {(sequence, number): rank for rank, number in enumerate(used, 1) if rank != number}
    return changes


def _rank(ranking: Ranking, sequence: int, number: int) -> int:
    return next((rank for ranked, rank in ranking if ranked == (sequence, number)), number)


def _serial_rank(ranking: Ranking, number: int, task: str, serial: int) -> int:
    """The rank of the number of a message about the task at the Repository with this number."""
    sequence = 2 + TASKS.index(task)
    return (
        _rank(ranking, sequence, serial)
        if TASKS[number] == task
        else 2 * _rank(ranking, sequence, serial // 2) + serial % 2
        if serial >= 0
        else serial
    )


# A task at its Task Manager


@lru_cache(REMEMBERED)
def numbers_of_side(side: Side, number: int) -> frozenset[Number]:
    serials = (side.serial, side.settled, max(side.awaits[0], 0))
    return frozenset({(number, side.fence), (number, side.lost), *((2 + number, serial) for serial in serials)})


@lru_cache(REMEMBERED)
def ranked_side(side: Side, number: int, ranking: Ranking) -> Side:
    def serial(value: int) -> int:
        return _rank(ranking, 2 + number, value)

    return side._replace(
        fence=_rank(ranking, number, side.fence), lost=_rank(ranking, number, side.lost), serial=serial(side.serial),
        settled=serial(side.settled), awaits=(serial(side.awaits[0]), side.awaits[1]),
    )  # fmt: skip


# A Repository


@lru_cache(REMEMBERED)
def numbers_of_repository(state: bytes, number: int) -> frozenset[Number]:
    return frozenset(_numbers_of_repository(read(state), number))


def _numbers_of_repository(repository: RepositoryState, number: int) -> Iterator[Number]:
    reservations, neighbour = repository.reservations, 1 - number
    yield 2 + number, reservations.last_serial(TASKS[number])
    yield 2 + neighbour, reservations.last_serial(TASKS[neighbour]) // 2
    for serial, reply in repository.replies.items():
        yield 2 + neighbour, int(serial) // 2
        if isinstance(reply, Reserved):
            yield number, reply.fence
    for claimant in reservations.claimants.values():
        yield number, claimant.fence
    for shared in repository.shared.values():
        for fence in (*shared.fences.values(), *shared.lost.values()):
            yield neighbour, fence
        if shared.request is not None:
            yield from ((2 + number, shared.request.serial), (2 + number, shared.request.serial - 1))
        if shared.granted is not None:
            yield number, shared.granted.fence


@lru_cache(REMEMBERED)
def ranked_repository(state: bytes, number: int, ranking: Ranking) -> bytes:
    repository, neighbour = thawed(state), 1 - number
    reservations = repository.reservations
    for task, claimant in reservations.claimants.items():
        claimant.fence = _rank(ranking, number, claimant.fence)
        claimant.serial = _serial_rank(ranking, number, task, claimant.serial)
    reservations.fences = FRESH
    reservations.ended = {task: _serial_rank(ranking, number, task, serial) for task, serial in reservations.ended.items()}
    for shared in repository.shared.values():
        shared.fences = {home: _rank(ranking, neighbour, fence) for home, fence in shared.fences.items()}
        shared.lost = {home: _rank(ranking, neighbour, fence) for home, fence in shared.lost.items()}
        if shared.request is not None:
            shared.request = structs.replace(shared.request, serial=_rank(ranking, 2 + number, shared.request.serial))
        if shared.granted is not None:
            shared.granted = structs.replace(shared.granted, fence=_rank(ranking, number, shared.granted.fence))
    repository.replies = {
        str(_serial_rank(ranking, number, TASKS[neighbour], int(serial))): _ranked_body(reply, number, ranking)
        for serial, reply in repository.replies.items()
    }
    return frozen(repository)


def _ranked_body(body: Any, number: int, ranking: Ranking) -> Any:
    return structs.replace(body, fence=_rank(ranking, number, body.fence)) if isinstance(body, Reserved | ReservationLost) else body


# Messages between the Repositories. `number`: that of the sender


def numbers_of_message(message: Token, number: int) -> frozenset[Number]:
    match message:
        case Reserve(serial=serial) | Release(serial=serial):
            return frozenset({(2 + number, serial // 2), (2 + number, serial // 2 - 1)})
        case Reply(serial=serial, body=Reserved(fence=fence)):
            return frozenset({(3 - number, serial // 2), (number, fence)})
        case Reply(serial=serial):
            return frozenset({(3 - number, serial // 2)})
        case ReservationLost(fence=fence):
            return frozenset({(number, fence)})
        case PassedReport(reservation=UnderReservation(fence=fence)):
            return frozenset({(1 - number, fence)})
        case _:
            return frozenset()


def ranked_message(message: Token, number: int, ranking: Ranking) -> Token:
    match message:
        case Reserve(task=task, serial=serial) | Release(task=task, serial=serial):
            return structs.replace(message, serial=_serial_rank(ranking, 1 - number, task, serial))
        case Reply(task=task, serial=serial, body=body):
            return Reply(task, _serial_rank(ranking, number, task, serial), _ranked_body(body, number, ranking))
        case PassedReport(reservation=UnderReservation(fence=fence) as reservation):
            return structs.replace(message, reservation=structs.replace(reservation, fence=_rank(ranking, 1 - number, fence)))
        case _:
            ranked: Token = _ranked_body(message, number, ranking)
            return ranked


def mapped(channel: Channel, tokens: Mapping[int, int]) -> Channel:
    """The channel with other tokens in place of these."""

    def mask(bits: int) -> int:
        return sum(1 << tokens[token] for token in tokens if bits >> token & 1)

    assert tokens.keys() == {*tokens_in(channel)}
    return Channel(tuple(tokens[token] for token in channel.queue), mask(channel.unacknowledged), mask(channel.copies))


# What a Task Manager has still to hear


@lru_cache(REMEMBERED)
def numbers_of_notices(notices: tuple[Struct, ...], number: int) -> frozenset[Number]:
    numbers: set[Number] = set()
    for notice in notices:
        match notice:
            case Answer(serial=serial, body=Reserved(fence=fence)):
                numbers |= {(2 + number, max(serial, 0)), (number, fence)}
            case Answer(serial=serial):
                numbers.add((2 + number, max(serial, 0)))
            case ReservationLost(fence=fence):
                numbers.add((number, fence))
    return frozenset(numbers)


@lru_cache(REMEMBERED)
def ranked_notices(notices: tuple[Struct, ...], number: int, ranking: Ranking) -> tuple[Struct, ...]:
    return tuple(
        Answer(_rank(ranking, 2 + number, notice.serial), _ranked_body(notice.body, number, ranking))
        if isinstance(notice, Answer)
        else _ranked_body(notice, number, ranking)
        for notice in notices
    )
