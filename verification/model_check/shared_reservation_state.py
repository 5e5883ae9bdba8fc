"""What two Repositories and their tasks know of reservations, as values that can be compared: numbers that only grow are in ranks."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import msgspec
from msgspec import Struct, structs

from somrs.kernel.reservations import LEASE, Reservation, Reservations
from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.neighbours import Neighbour
from somrs.protocol.messages.reservations import (
    Release,
    ReservationDenied,
    ReservationFree,
    ReservationLost,
    Reserve,
    Reserved,
    UnderReservation,
)
from somrs.repository.neighbour_state import NeighbourCopy, NeighbourState, SharedReservation
from somrs.repository.state import Contents
from verification.model_check.media import Channel, members
from verification.model_check.reservation_task import TASKS, Side

MAPS = ("A", "B")
REPOSITORIES, MANAGERS = ("repository-a", "repository-b"), ("tm-a", "tm-b")
LAPSED = -1.0
"""When a neighbour was heard of last, if its lease has ended. Otherwise this is 0."""


class PassedReport(Struct, frozen=True, tag=True):
    """A task has changed an object of the neighbour, in its step `step`. `reservation`: that at the neighbour."""

    task: str
    step: int
    reservation: UnderReservation | None


class ReportAnswer(Struct, frozen=True, tag=True):
    """Whether the neighbour has accepted the change of this step."""

    task: str
    step: int
    accepted: bool


class Reply(Struct, frozen=True, tag=True):
    """The answer to the Reserve with this number."""

    task: str
    serial: int
    body: Reserved | ReservationDenied


Token = Reserve | Release | PassedReport | ReportAnswer | Reply | ReservationFree | ReservationLost


class RepositoryState(Struct, kw_only=True):
    """What a Repository knows of reservations. `replies`: to requests of the neighbour that may be repeated; `accepted`: the changes that
    the neighbour has passed on, by step, and whether they were accepted; `lapsed`: the neighbour's lease has ended once. Nobody changes
    the result of `read`."""

    reservations: Reservations = msgspec.field(default_factory=Reservations)
    shared: dict[str, SharedReservation] = msgspec.field(default_factory=dict)
    replies: dict[str, Reserved | ReservationDenied] = msgspec.field(default_factory=dict)
    lapsed: bool = False
    accepted: dict[str, bool] = msgspec.field(default_factory=dict)


class State(NamedTuple):
    """`repositories`: as bytes. `channels`: from the first Repository to the second one, and back. `to_managers`: what each Task Manager
    has still to hear of its Repository."""

    sides: tuple[Side, Side]
    repositories: tuple[bytes, bytes]
    channels: tuple[Channel, Channel]
    to_managers: tuple[tuple[Struct, ...], tuple[Struct, ...]] = ((), ())


REMEMBERED = 1 << 16
"""The number of results that are remembered, of each function."""

_ENCODER = msgspec.msgpack.Encoder(order="deterministic")
_DECODER = msgspec.msgpack.Decoder(RepositoryState)
_ONTOLOGY = Ontology()


def frozen(state: RepositoryState) -> bytes:
    return _ENCODER.encode(state)


def thawed(state: bytes) -> RepositoryState:
    """A state to change."""
    return _DECODER.decode(state)


read = lru_cache(REMEMBERED)(thawed)
"""A state to read only."""


def request_id(task: str, serial: int, number: int) -> str:
    """The id of the request that a Repository passes on to the one with this number. `serial`: that of the Task Manager."""
    return message_id("reserve", task, serial, MAPS[number])


def task_message(number: int, body: Struct) -> Message:
    """What the Task Manager with this number sends to its Repository."""
    id = f"{TASKS[number]}/{getattr(body, 'serial', 0)}"
    header = Header(sender=MANAGERS[number], recipient=REPOSITORIES[number], message_id=id, reply_to=MANAGERS[number])
    return Message(header=header, body=body)  # type: ignore[arg-type]


def contents_of(state: RepositoryState, number: int, now: float) -> Contents:
    """The contents of the Repository with this number."""
    neighbour = 1 - number
    for address, heard_at in state.reservations.heard_at.items():
        state.reservations.heard_at[address] = now if heard_at != LAPSED else now - LEASE - 1.0
    for task, shared in state.shared.items():
        if shared.request is not None:
            shared.message = task_message(number, shared.request)
        if shared.request_id and shared.request is not None:
            shared.request_id = request_id(task, shared.request.serial, neighbour)
    copy = NeighbourCopy(REPOSITORIES[number], REPOSITORIES[neighbour], map_name=MAPS[neighbour])
    settings = Neighbour(map=MAPS[neighbour], address=REPOSITORIES[neighbour], shows_all=True)
    return Contents(
        ontology=_ONTOLOGY,
        map=Map().named(MAPS[number]),
        address=REPOSITORIES[number],
        neighbours={MAPS[neighbour]: NeighbourState(settings=settings, copy=copy)},
        reservations=state.reservations,
        shared_reservations=state.shared,
        answered={request_id(TASKS[neighbour], int(serial) // 2, number): body for serial, body in state.replies.items()},
    )


def state_of(contents: Contents, earlier: RepositoryState, now: float) -> RepositoryState:
    """What the contents say of reservations. `earlier`: the state with the replies before.

    What does not matter for what comes is left out: what a task has had and what others have changed of it, which it is only told, and
    the parts of the answer to a request that has its answer.
    """
    reservations = contents.reservations
    for address, heard_at in reservations.heard_at.items():
        reservations.heard_at[address] = 0.0 if heard_at + LEASE > now else LAPSED
    for shared in contents.shared_reservations.values():
        shared.message, shared.since, shared.overtaken = None, 0.0, ()
        shared.request_id = "asked" if shared.request_id else ""
        shared.lost = shared.lost if shared.request_id else {}  # what it gets later has higher numbers
        if shared.request is None:
            shared.granted, shared.holders, shared.earlier = None, (), Reservation()
    arrivals = sorted(claimant.arrival for claimant in reservations.claimants.values())
    for claimant in reservations.claimants.values():
        claimant.had = claimant.overtaken = frozenset()
        claimant.arrival = 1 + arrivals.index(claimant.arrival)
    reservations.arrivals = len(arrivals)
    return RepositoryState(
        reservations=reservations,
        shared=contents.shared_reservations,
        replies=earlier.replies,
        accepted=earlier.accepted,
        lapsed=earlier.lapsed,
    )


def for_programs(body: Struct) -> Struct:
    """The message without what only people read, and without what the model does not need."""
    match body:
        case ReservationDenied():
            return structs.replace(body, holders=())
        case Reserved():
            return structs.replace(body, overtaken=())
        case ReservationLost(task=task, fence=fence):
            return ReservationLost(task=task, fence=fence)
    return body


@lru_cache(REMEMBERED)
def tokens_in(channel: Channel) -> tuple[int, ...]:
    return tuple(dict.fromkeys((*channel.queue, *members(channel.unacknowledged | channel.copies))))
