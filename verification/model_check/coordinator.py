"""The coordinator's side: receives the participant's messages, and sends what `COORDINATOR_SENDS` allows, by the Task Manager's rules for
a transaction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

from somrs.protocol.frp import states
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.session import CoordinatorBody
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from verification.model_check.sides import PARTICIPANT, SM, TM, TRANSACTION, Action, Fair, Side, key, try_action

# The contents of the bodies are arbitrary: no state depends on them.
COORDINATOR_BODIES: dict[type[object], CoordinatorBody] = {
    frp.Arrange: frp.Arrange(service_type="S", inputs={}, effect="E"),
    frp.Cancel: frp.Cancel(reason="r"),
    frp.Execute: frp.Execute(inputs={}),
    frp.Stop: frp.Stop(reason="r"),
    frp.Compensate: frp.Compensate(situation="S"),
    frp.Query: frp.Query(),
    frp.End: frp.End(outcome=frp.Outcome.FAILED),
}


# What a Task Manager sends in each state (`task_manager.participants`), even if the table does not allow it; Cancel and End if allowed.
REQUIRED_MESSAGES: dict[State, type[object]] = {
    State.NEW: frp.Arrange,
    State.OFFERED: frp.Accept,
    State.COMMITTED: frp.Execute,
    State.EXECUTING: frp.Stop,
}


REQUIRED_REPEATS: dict[State, type[object]] = {State.EXECUTING: frp.Execute, State.COMPENSATING: frp.Compensate}
"""The orders that are sent again when the participant was not reached in time."""


class Phase(Enum):
    """The phase of the transaction. Failed and cancelled ones follow the same rules, so both are `BROKEN`."""

    OPEN = "open"
    STOPPING = "stopping"
    ACCOMPLISHED = "accomplished"
    BROKEN = "failed or cancelled"
    LOST = "forgotten"
    """Its Task Manager lost its disk."""


@dataclass(frozen=True, kw_only=True)
class Coordinator:
    """The coordinator's side. `last_state` is the session's state before it ended or its disk was lost."""

    session: CoordinatorSession
    phase: Phase = Phase.OPEN
    last_state: State | None = None
    abandoned: bool = False
    """The coordinator has given the participant up, and has received no report since."""
    overdue: bool = False
    """The transaction ended before everything was compensated, and its outcome says so."""


UNUSABLE_STATES = frozenset((State.NEW, State.ENDED, State.FAILED, State.STOPPED, State.COMPENSATED, State.STRANDED, State.UNREACHABLE))
"""The coordinator's states in which a participant can no longer do the step."""

NEEDS_COMPENSATION = frozenset((State.COMPLETED, State.FAILED, State.STOPPED))
"""The coordinator's states in which a participant that received Execute has to compensate if the transaction is not accomplished."""


class Coordinators(Side[Coordinator]):
    """The coordinator's states, with the results of every message and every choice."""

    queries: bool = False

    def first(self) -> int:
        return self._add(Coordinator(session=_fresh_coordinator()))

    def _add(self, coordinator: Coordinator) -> int:
        session_key = key(coordinator.session, lambda state, name: name == "Terms" or self.futures.moves_coordinator(state, name))
        return self._number(
            (session_key, coordinator.phase, coordinator.last_state, coordinator.abandoned, coordinator.overdue), coordinator
        )

    def _receive(self, state_number: int, token: int, description: str) -> Action:
        coordinator, session = self.states[state_number], self.states[state_number].session.copy()
        message = self.inbox.messages[token]
        self.outbox.prepare(session, states.COORDINATOR[session.state][type(message.body)].answer)
        result = session.receive(message)
        tokens, wrong = self._number_messages(session, result.answers)
        if result.state_before is State.ENDED and result.state is not State.ENDED:
            wrong = f"the state of a participant that has ended becomes {result.state}"
        if result.moved and result.state is not result.state_before:
            coordinator = replace(coordinator, abandoned=False)
        return Action(description, self._moved(coordinator, session, coordinator.phase), tokens, wrong=wrong)

    def _moved(self, coordinator: Coordinator, session: CoordinatorSession, phase: Phase, last_state: State | None = None) -> int:
        if session.state is State.ENDED and coordinator.session.state is not State.ENDED:
            coordinator = replace(coordinator, last_state=last_state or coordinator.session.state)
        if phase is Phase.LOST and session.state is State.ENDED:
            session = _fresh_coordinator()  # a Task Manager that has lost its disk keeps no record of an ended participant
        session.reason = ""
        return self._add(replace(coordinator, session=session, phase=phase))

    def _all_actions(self, state_number: int) -> Iterator[Action]:
        """Yield the coordinator's moves. `joint` names the rule of those that depend on the other participants, or move them as well."""
        coordinator = self.states[state_number]
        state, sent_messages = coordinator.session.state, coordinator.session.sent_messages
        allowed = states.COORDINATOR_SENDS.get(state, {})
        undo = state in NEEDS_COMPENSATION and "Execute" in sent_messages
        if coordinator.phase is Phase.OPEN:
            for kind in dict.fromkeys((*allowed, *([REQUIRED_MESSAGES[state]] if state in REQUIRED_MESSAGES else []))):
                if kind is REQUIRED_REPEATS.get(state):
                    continue
                if kind is frp.Compensate and undo:
                    yield self._send(state_number, kind, joint="claim")
                elif kind is frp.Accept:
                    yield self._send(state_number, kind, joint="claim", fair=Fair.YES)
                elif kind not in (frp.End, frp.Compensate):
                    yield self._send(state_number, kind, fair=Fair.YES if kind in (frp.Arrange, frp.Execute) else Fair.NO)
            yield self._stop(state_number, "cancel")
            if state in UNUSABLE_STATES:
                yield self._stop(state_number, "fail", fair=Fair.YES)
            if state not in states.WORKING:
                yield self._end(
                    state_number, "accomplish+" if state is State.COMPLETED else "accomplish-", Phase.ACCOMPLISHED, fair=Fair.YES
                )
        elif coordinator.phase is Phase.STOPPING:
            if undo and frp.Compensate in allowed:
                yield self._send(state_number, frp.Compensate, joint="claim", fair=Fair.YES)
            if state is State.UNREACHABLE and frp.Stop in allowed:
                yield self._send(state_number, frp.Stop)
            if state not in states.WORKING and not undo:
                yield self._end(state_number, "end", Phase.BROKEN, fair=Fair.YES)
            yield self._end(state_number, "overdue", Phase.BROKEN)
        if coordinator.phase in (Phase.OPEN, Phase.STOPPING) and state in states.ABANDONED_STATES:
            yield self._abandon(state_number)
        if coordinator.phase in (Phase.OPEN, Phase.STOPPING) and state in REQUIRED_REPEATS:
            yield self._send(state_number, REQUIRED_REPEATS[state], joint="again")
        if self.queries and coordinator.phase in (Phase.OPEN, Phase.STOPPING) and state in states.WORKING:
            yield self._send(state_number, frp.Query)

    def _send(self, state_number: int, kind: type[object], *, fair: Fair = Fair.NO, joint: str = "") -> Action:
        description = f"sends {kind.__name__}{' again' if joint == 'again' else ''}"
        return try_action(lambda: self._perform_send(state_number, kind, description, fair, joint), description, state_number)

    def _perform_send(self, state_number: int, kind: type[object], description: str, fair: Fair, joint: str) -> Action:
        coordinator, session = self.states[state_number], self.states[state_number].session.copy()
        if kind is frp.Query:
            session.sent_messages = {name: record for name, record in session.sent_messages.items() if name != "Query"}
            session.number = [*State].index(session.state)  # all Queries in one state have the same id, which keeps the states finite
        elif joint == "again":
            self.outbox.prepare_repeat(session, kind)
        else:
            self.outbox.prepare(session, kind)
        message = session.accept() if kind is frp.Accept else session.send(COORDINATOR_BODIES[kind])
        return Action(
            description, self._moved(coordinator, session, coordinator.phase), (self.outbox.number(message, session.number),), fair, joint
        )

    def _stop(self, state_number: int, rule: str, *, fair: Fair = Fair.NO) -> Action:
        """Stop the transaction, as `Participants.stop` of the Task Manager: Stop to a participant that works, Cancel to the others."""

        def take_action() -> Action:
            coordinator, session = self.states[state_number], self.states[state_number].session.copy()
            kind: type[object] | None = frp.Stop if session.state is State.EXECUTING else frp.Cancel
            if kind is frp.Cancel and kind not in states.COORDINATOR_SENDS.get(session.state, {}):
                kind = None
            numbers = self._send_kind(session, kind)
            return Action(f"the transaction is stopped ({rule})", self._moved(coordinator, session, Phase.STOPPING), numbers, fair, rule)

        return try_action(take_action, rule, state_number)

    def _end(self, state_number: int, rule: str, phase: Phase, *, fair: Fair = Fair.NO) -> Action:
        """End the transaction, as `Participants.end` of the Task Manager: End to every committed participant, Cancel to the others."""

        def take_action() -> Action:
            coordinator, session = self.states[state_number], self.states[state_number].session.copy()
            overdue = rule == "overdue"
            if session.state in states.WORKING and session.abandon():
                coordinator = replace(coordinator, abandoned=True)
            last_state, allowed = session.state, states.COORDINATOR_SENDS.get(session.state, {})
            numbers = self._send_kind(session, next((kind for kind in (frp.End, frp.Cancel) if kind in allowed), None))
            target = self._moved(replace(coordinator, overdue=overdue), session, phase, last_state)
            description = f"the transaction ends ({'overdue' if overdue else phase.value})"
            return Action(description, target, numbers, fair, rule)

        return try_action(take_action, rule, state_number)

    def _send_kind(self, session: CoordinatorSession, kind: type[object] | None) -> tuple[int, ...]:
        if kind is None:
            return ()
        self.outbox.prepare(session, kind)
        return (self.outbox.number(session.send(COORDINATOR_BODIES[kind]), session.number),)

    def _abandon(self, state_number: int) -> Action:
        coordinator, session = self.states[state_number], self.states[state_number].session.copy()
        session.abandon()
        return Action("gives it up", self._moved(replace(coordinator, abandoned=True), session, coordinator.phase), joint="give up")

    def without_memory(self, state_number: int) -> int:
        """Return the state after the loss of the Task Manager's disk."""
        return self._add(Coordinator(session=_fresh_coordinator(), phase=Phase.LOST, last_state=self.states[state_number].session.state))

    def repeatable_tokens(self, state_number: int) -> tuple[int, ...]:
        """Return the messages that the node may send again after a restart; an order only in the state that it belongs to."""
        session = self.states[state_number].session
        orders = {"Execute": State.EXECUTING, "Compensate": State.COMPENSATING}
        return tuple(
            self.outbox.number(message, 1)
            for name in session.sent_messages
            if name != "Query" and orders.get(name, session.state) is session.state
            for message in session._repeat(name)
        )


def _fresh_coordinator() -> CoordinatorSession:
    return CoordinatorSession(transaction=TRANSACTION, participant=PARTICIPANT, me=TM, peer=SM)
