"""Explores every state of the models of reservations, and checks two properties: mutual exclusion and termination."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Generic, Protocol

from verification.model_check.media import DUPLICATING, FIFO, OUTBOX, UNORDERED, UNORDERED_LOSSY
from verification.model_check.property import Property
from verification.model_check.reservation_model import Move, ReservationModel, S, System
from verification.model_check.shared_reservation_model import SharedReservationModel, SharedSystem
from verification.model_check.suite import Check, Counterexample, Result

MODELS = {
    "restarts, decisions": tuple(ReservationModel(medium=medium) for medium in (FIFO, OUTBOX, UNORDERED)),
    "restarts": tuple(ReservationModel(medium=medium, decisions=False) for medium in (UNORDERED_LOSSY, DUPLICATING)),
    "decisions": (ReservationModel(medium=DUPLICATING, restarts=False),),
    "restarts, leases that end": tuple(ReservationModel(medium=medium, decisions=False, lapses=True) for medium in (FIFO, UNORDERED)),
}
"""The configurations that are checked, by what can happen in them. The others have too many states."""

_MEDIA = (FIFO, OUTBOX, UNORDERED, UNORDERED_LOSSY, DUPLICATING)

SHARED_MODELS = {
    "delays": tuple(SharedReservationModel(medium=medium, delays=True) for medium in _MEDIA),
    "delays, restarts": tuple(SharedReservationModel(medium=medium, delays=True, restarts=True) for medium in _MEDIA),
    "decisions": tuple(SharedReservationModel(medium=medium, decisions=True) for medium in _MEDIA),
    "leases that end": tuple(SharedReservationModel(medium=medium, lapses=True) for medium in _MEDIA),
    "delays, decisions": tuple(SharedReservationModel(medium=medium, delays=True, decisions=True) for medium in (FIFO, OUTBOX, UNORDERED)),
    "delays, leases that end": tuple(
        SharedReservationModel(medium=medium, delays=True, lapses=True) for medium in (FIFO, OUTBOX, UNORDERED)
    ),
}
"""The configurations with two Repositories that are checked, by what can happen in them. Delays together with decisions, or with leases
that end, have too many states on the media that lose messages and keep no order."""

EXCLUSION = Property.MUTUAL_EXCLUSION


class ModelledSystem(Protocol[S]):
    """A model: its first state, the moves from each, and whether it has ended."""

    @property
    def first(self) -> S: ...

    def moves(self, state: S) -> Iterator[Move[S]]: ...

    def has_ended(self, state: S) -> bool: ...


@dataclass
class _Space(Generic[S]):
    """All states, each with the one from which it was reached first and the move that led to it; and the fair moves, backwards."""

    origins: dict[S, tuple[S, str] | None] = field(default_factory=dict)
    fair_predecessors: dict[S, list[S]] = field(default_factory=dict)
    wrong: tuple[S, str, str] | None = None
    """The first move that violates mutual exclusion: where, which and why."""

    def chart(self, state: S) -> list[str]:
        """The moves that lead to the state."""
        moves: list[str] = []
        while (origin := self.origins[state]) is not None:
            state, name = origin
            moves.append(name)
        return moves[::-1]


def reservation_checks() -> list[Check]:
    """The checks of all configurations with one Repository."""
    return [partial(check_reservations, model, configuration) for configuration, models in MODELS.items() for model in models]


def shared_reservation_checks() -> list[Check]:
    """The checks of all configurations with two Repositories."""
    return [partial(check_reservations, model, configuration) for configuration, models in SHARED_MODELS.items() for model in models]


def check_reservations(model: ReservationModel | SharedReservationModel, configuration: str) -> Result:
    """Check one configuration, up to the first violation of mutual exclusion."""
    if isinstance(model, SharedReservationModel):
        return _check(SharedSystem(model), model.medium.name, configuration)
    return _check(System(model), model.medium.name, configuration)


def _check(system: ModelledSystem[S], medium: str, configuration: str) -> Result:
    started_at = time.perf_counter()
    space = _explore(system)
    cells: dict[Property, Counterexample | None] = {EXCLUSION: None, Property.TERMINATION: None}
    if space.wrong is not None:
        state, name, reason = space.wrong
        cells[EXCLUSION] = Counterexample(property=EXCLUSION, reason=reason, chart=[*space.chart(state), name, f"  => {reason}"])
    elif (stuck := _stuck(space, system)) is not None:
        reason = "no fair moves lead to the end of both tasks from here"
        cells[Property.TERMINATION] = Counterexample(
            property=Property.TERMINATION, reason=reason, chart=[*space.chart(stuck), f"  => {reason}"]
        )
    seconds = time.perf_counter() - started_at
    return Result(medium=medium, configuration=configuration, states=len(space.origins), seconds=seconds, cells=cells)


def _explore(system: ModelledSystem[S]) -> _Space[S]:
    space = _Space[S]()
    space.origins[system.first] = None
    unexplored = deque([system.first])
    while unexplored:
        state = unexplored.popleft()
        for move in system.moves(state):
            if move.wrong:
                space.wrong = state, move.name, move.wrong
                return space
            if move.target not in space.origins:
                space.origins[move.target] = state, move.name
                unexplored.append(move.target)
            if move.fair:
                space.fair_predecessors.setdefault(move.target, []).append(state)
    return space


def _stuck(space: _Space[S], system: ModelledSystem[S]) -> S | None:
    """A state from which no fair moves lead to the end; None if there is none."""
    good = {state for state in space.origins if system.has_ended(state)}
    unexplored = [*good]
    while unexplored:
        for earlier in space.fair_predecessors.get(unexplored.pop(), ()):
            if earlier not in good:
                good.add(earlier)
                unexplored.append(earlier)
    return next((state for state in space.origins if state not in good), None)
