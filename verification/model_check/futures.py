"""Computes which messages can still have an effect, from the states that the tables allow each side to reach.

A message is dropped from the channels if it changes nothing and gets no answer in every state that its receiver can still reach. The
record that a side has received a message is dropped if no such message can change the side's state any more. Both reductions keep all
behaviour, and both are computed from the current tables.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

from somrs.protocol.frp import states
from somrs.protocol.frp.states import Kind, MessageType
from somrs.protocol.messages.frp import Cancel, End, State, Status


class Futures:
    """The effects that are still possible. With `lost_disk`, either side may start anew. With `queries`, a Status `New` has an effect."""

    def __init__(self, *, lost_disk: bool, queries: bool = False) -> None:
        self.queries = queries or lost_disk
        self.ineffective_messages = cache(self._ineffective_messages)
        self.moves_participant = cache(self._moves_participant)
        self.moves_coordinator = cache(self._moves_coordinator)
        participant = {
            state: {entry.next_state for entry in row.values()} | set(states.PARTICIPANT_SENDS.get(state, {}).values())
            for state, row in states.PARTICIPANT.items()
        }
        coordinator = {
            state: {entry.next_state for entry in row.values()}
            | set(states.COORDINATOR_SENDS.get(state, {}).values())
            | ({states.ABANDONED_STATES[state]} if state in states.ABANDONED_STATES else set())
            for state, row in states.COORDINATOR.items()
        }
        if lost_disk:
            for following in (*participant.values(), *coordinator.values()):
                following.add(State.NEW)
        if self.queries:
            for state in states.CONTRACTED:
                coordinator[state].add(State.FAILED)
        self.participant = {state: _reached(state, participant) for state in participant}
        self.coordinator = {state: _reached(state, coordinator) for state in coordinator}

    def _moves_participant(self, state: State, name: str) -> bool:
        """Whether a message of the type can change the participant's state, now or later."""
        return any(
            states.PARTICIPANT[reachable_state][kind].kind is Kind.MOVES
            for reachable_state in self.participant[state]
            for kind in _named(name, reachable_state, True)
        )

    def _moves_coordinator(self, state: State, name: str) -> bool:
        return any(
            states.COORDINATOR[reachable_state][kind].kind is Kind.MOVES
            for reachable_state in self.coordinator[state]
            for kind in _named(name, reachable_state, False)
        )

    def _ineffective_messages(self, coordinator: State, participant: State) -> tuple[frozenset[MessageType], frozenset[MessageType]]:
        """Return the types of messages to the participant, and of those to the coordinator, that cannot have an effect any more."""
        to_participant = frozenset(kind for kind in states.TO_PARTICIPANT if self._is_ineffective_down(participant, kind, frozenset()))
        silent = End in to_participant and Cancel in to_participant
        to_coordinator = frozenset(kind for kind in states.TO_COORDINATOR if self._is_ineffective_up(coordinator, kind, silent))
        return frozenset(
            kind for kind in states.TO_PARTICIPANT if self._is_ineffective_down(participant, kind, to_coordinator)
        ), to_coordinator

    def _is_ineffective_down(self, participant: State, kind: MessageType, unheard: frozenset[MessageType]) -> bool:
        entries = [states.PARTICIPANT[reachable_state][kind] for reachable_state in self.participant[participant]]
        return all(entry.kind is not Kind.MOVES and (entry.answer is None or entry.answer in unheard) for entry in entries)

    def _is_ineffective_up(self, coordinator: State, kind: MessageType, silent: bool) -> bool:
        """Whether this type of message to the coordinator has no effect. `silent`: the End or Cancel that answers it has none."""
        if kind is Status and self.queries and self.coordinator[coordinator] & states.CONTRACTED:
            return False
        entries = [states.COORDINATOR[reachable_state][kind] for reachable_state in self.coordinator[coordinator]]
        return all(entry.kind is not Kind.MOVES and (entry.answer is None or (silent and entry.kind is Kind.REPEATED)) for entry in entries)


def _named(name: str, state: State, participant: bool) -> Iterable[MessageType]:
    row = (states.PARTICIPANT if participant else states.COORDINATOR)[state]
    return (kind for kind in row if kind.__name__ == name)


def _reached(state: State, following: dict[State, set[State]]) -> frozenset[State]:
    reached, waiting = {state}, [state]
    while waiting:
        for successor in following[waiting.pop()] - reached:
            reached.add(successor)
            waiting.append(successor)
    return frozenset(reached)
