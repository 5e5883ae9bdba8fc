"""What can still matter: the states that the tables let a side come to, and the messages that are past having an effect.

A message that changes nothing and is answered by nothing, in every state that its receiver can still come to, is left out of
the channels; and that a side has heard one is left out of its state when no such message can move it any more. Both
forget only what makes no difference to anything that can follow, and both are read off the tables as they are.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

from somrs.protocol.frp import states
from somrs.protocol.frp.states import Kind, MessageType
from somrs.protocol.messages.frp import Cancel, End, State, Status


class Futures:
    """Of both sides. With `lost_disk`, either may start anew. With `queries`, a Status that knows nothing counts."""

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
        """Whether a message of the type can move the participant, now or later."""
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
        """The types of messages to the participant, and of those to the coordinator, that can have no effect any more."""
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
        """`silent`: End and Cancel, with which a coordinator answers again, have no effect."""
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
