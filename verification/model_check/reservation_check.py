"""Explores every state of the model of reservations, and checks two properties: mutual exclusion and termination."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from verification.model_check.explore import Tick
from verification.model_check.media import DUPLICATING, FIFO, OUTBOX, UNORDERED, UNORDERED_LOSSY
from verification.model_check.property import Property
from verification.model_check.reservation_model import ReservationModel, State, System
from verification.model_check.suite import Counterexample, Result

MODELS = {
    "restarts, decisions": tuple(ReservationModel(medium=medium) for medium in (FIFO, OUTBOX, UNORDERED)),
    "restarts": tuple(ReservationModel(medium=medium, decisions=False) for medium in (UNORDERED_LOSSY, DUPLICATING)),
    "decisions": (ReservationModel(medium=DUPLICATING, restarts=False),),
    "restarts, leases that end": tuple(ReservationModel(medium=medium, decisions=False, lapses=True) for medium in (FIFO, UNORDERED)),
}
"""The configurations that are checked, by what can happen in them. The others have too many states."""

EXCLUSION = Property.MUTUAL_EXCLUSION
TICKS = 5000
"""States between two ticks."""


@dataclass
class _Space:
    """All states, each with the one from which it was reached first and the move that led to it; and the fair moves, backwards."""

    origins: dict[State, tuple[State, str] | None] = field(default_factory=dict)
    fair_predecessors: dict[State, list[State]] = field(default_factory=dict)
    wrong: tuple[State, str, str] | None = None
    """The first move that violates mutual exclusion: where, which and why."""

    def chart(self, state: State) -> list[str]:
        """The moves that lead to the state."""
        moves: list[str] = []
        while (origin := self.origins[state]) is not None:
            state, name = origin
            moves.append(name)
        return moves[::-1]


def check_all_reservations(tick: Tick | None = None) -> Iterator[Result]:
    """Check all configurations."""
    for configuration, models in MODELS.items():
        for model in models:
            yield check_reservations(model, configuration, tick)


def check_reservations(model: ReservationModel, configuration: str, tick: Tick | None = None) -> Result:
    """Check one configuration, up to the first violation of mutual exclusion."""
    started_at = time.perf_counter()
    space = _explore(System(model), tick)
    cells: dict[Property, Counterexample | None] = {EXCLUSION: None, Property.TERMINATION: None}
    if space.wrong is not None:
        state, name, reason = space.wrong
        cells[EXCLUSION] = Counterexample(property=EXCLUSION, reason=reason, chart=[*space.chart(state), name, f"  => {reason}"])
    elif (stuck := _stuck(space)) is not None:
        reason = "no fair moves lead to the end of both tasks from here"
        cells[Property.TERMINATION] = Counterexample(
            property=Property.TERMINATION, reason=reason, chart=[*space.chart(stuck), f"  => {reason}"]
        )
    return Result(
        medium=model.medium.name,
        configuration=configuration,
        states=len(space.origins),
        seconds=time.perf_counter() - started_at,
        cells=cells,
    )


def _explore(system: System, tick: Tick | None) -> _Space:
    space = _Space()
    space.origins[system.first] = None
    unexplored = [system.first]
    while unexplored:
        state = unexplored.pop()
        for move in system.moves(state):
            if move.wrong:
                space.wrong = state, move.name, move.wrong
                return space
            if move.target not in space.origins:
                space.origins[move.target] = state, move.name
                unexplored.append(move.target)
                if tick is not None and len(space.origins) % TICKS == 0:
                    tick(len(space.origins))
            if move.fair:
                space.fair_predecessors.setdefault(move.target, []).append(state)
    return space


def _stuck(space: _Space) -> State | None:
    """A state from which no fair moves lead to the end; None if there is none."""
    good = {state for state in space.origins if _has_ended(state)}
    unexplored = [*good]
    while unexplored:
        for earlier in space.fair_predecessors.get(unexplored.pop(), ()):
            if earlier not in good:
                good.add(earlier)
                unexplored.append(earlier)
    return next((state for state in space.origins if state not in good), None)


def _has_ended(state: State) -> bool:
    """Whether both tasks have ended, nobody repeats a message, and nothing is reserved."""
    quiet = all(not channel.queue and not channel.unacknowledged for channel in (*state.to_repository, *state.to_managers))
    return quiet and all(side.phase == "ended" for side in state.sides) and not state.table[0]
