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
from verification.model_check.property import Property
from verification.model_check.sides import PARTICIPANT, SM, TM, TRANSACTION, Action, Fair, Side, describe, key, try_action
from verification.model_check.step import Step, StepKind, arranges, is_conditional, is_promised

# The contents of these bodies are arbitrary: no state depends on them. `Step` makes Arrange and Execute.
COORDINATOR_BODIES: dict[type[object], CoordinatorBody] = {
    frp.Cancel: frp.Cancel(reason="r"),
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
    is_open: bool | None = None
    """What the map says of the door; None if the step does not depend on it."""
    reporting: bool = False
    """What the participant recognised is not on the map yet."""


UNUSABLE_STATES = frozenset((State.NEW, State.ENDED, State.FAILED, State.STOPPED, State.COMPENSATED, State.STRANDED, State.UNREACHABLE))
"""The coordinator's states in which a participant can no longer do the step."""

NEEDS_COMPENSATION = frozenset((State.COMPLETED, State.FAILED, State.STOPPED))
"""The coordinator's states in which a participant that received Execute has to compensate if the transaction is not accomplished."""


INITIALLY_OPEN = {StepKind.CONDITIONAL: False, StepKind.WHILE: True}
"""What the map says of the door at first, where the step depends on it."""


@dataclass
class Coordinators(Side[Coordinator]):
    """The coordinator's states, with the results of every message and every choice."""

    kind: StepKind = StepKind.PLAIN
    queries: bool = False

    def __post_init__(self) -> None:
        self.step = Step(self.kind)

    def first(self) -> int:
        return self._add(Coordinator(session=_fresh_coordinator(), is_open=INITIALLY_OPEN.get(self.kind)))

    def _add(self, coordinator: Coordinator) -> int:
        session_key = key(coordinator.session, lambda state, name: name == "Terms" or self.futures.moves_coordinator(state, name))
        return self._number(
            (
                session_key,
                coordinator.phase,
                coordinator.last_state,
                coordinator.abandoned,
                coordinator.overdue,
                coordinator.is_open,
                coordinator.reporting,
            ),
            coordinator,
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
            reports = self.kind is StepKind.RECOGNITION and result.state in NEEDS_COMPENSATION
            coordinator = replace(coordinator, abandoned=False, reporting=coordinator.reporting or reports)
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
        allowed, waits = states.COORDINATOR_SENDS.get(state, {}), self.waits_for_map(coordinator)
        may_undo = state in NEEDS_COMPENSATION and "Execute" in sent_messages and self.step.needs_undoing(coordinator.session)
        # Whoever says that nothing was begun need not undo anything; if it was given up before, it may be told to.
        must_undo = may_undo and not _says_that_nothing_was_begun(coordinator)
        if coordinator.phase is Phase.OPEN:
            yield from self._map_changes(state_number)
            for kind in dict.fromkeys((*allowed, *([REQUIRED_MESSAGES[state]] if state in REQUIRED_MESSAGES else []))):
                if kind is REQUIRED_REPEATS.get(state):
                    continue
                if kind is frp.Compensate and may_undo:
                    yield self._send(state_number, kind, joint="claim")
                elif kind is frp.Arrange:
                    for arrange in arranges(self.kind):
                        yield self._send(state_number, kind, arrange, fair=Fair.YES)
                elif kind is frp.Accept:
                    if self.step.meets_condition(coordinator.session, coordinator.is_open):
                        yield self._send(state_number, kind, joint="claim", fair=Fair.YES)
                elif kind is frp.Execute:
                    if (order := self.step.order(coordinator.session, coordinator.is_open)) is not None:
                        yield self._send(state_number, kind, order, fair=Fair.YES)
                elif kind not in (frp.End, frp.Compensate):
                    yield self._send(state_number, kind)
            yield self._stop(state_number, "cancel")
            if self._may_ask_again(coordinator):
                yield self._ask_again(state_number)
            if state in UNUSABLE_STATES and not waits and not _has_passing_refusal(coordinator):
                yield self._stop(state_number, "fail", fair=Fair.YES)
            if state not in states.WORKING and not waits:
                yield self._end(
                    state_number, "accomplish+" if state is State.COMPLETED else "accomplish-", Phase.ACCOMPLISHED, fair=Fair.YES
                )
        elif coordinator.phase is Phase.STOPPING:
            if may_undo and frp.Compensate in allowed:
                yield self._send(state_number, frp.Compensate, joint="claim", fair=Fair.YES if must_undo else Fair.NO)
            if state is State.UNREACHABLE and frp.Stop in allowed:
                yield self._send(state_number, frp.Stop)
            if state not in states.WORKING and not must_undo and not waits:
                yield self._end(state_number, "end", Phase.BROKEN, fair=Fair.YES)
            if not waits:
                yield self._end(state_number, "overdue", Phase.BROKEN)
        if coordinator.reporting:
            target = self._add(replace(coordinator, reporting=False))
            yield Action("the map has what was recognised", target, fair=Fair.YES)
        if coordinator.phase in (Phase.OPEN, Phase.STOPPING) and state in states.ABANDONED_STATES:
            yield self._abandon(state_number)
        if coordinator.phase in (Phase.OPEN, Phase.STOPPING) and state in REQUIRED_REPEATS:
            yield self._repeat_order(state_number)
        if (
            self.queries
            and coordinator.phase in (Phase.OPEN, Phase.STOPPING)
            and state in states.WORKING | {State.UNREACHABLE, State.STRANDED}
        ):
            yield self._send(state_number, frp.Query)

    @staticmethod
    def waits_for_map(coordinator: Coordinator) -> bool:
        """Whether the transaction waits until the map has a report (`Transaction.proceed`)."""
        return coordinator.reporting

    def _map_changes(self, state_number: int) -> Iterator[Action]:
        """The map says that the door is open, or shut. A service whose invariant this breaks is stopped in the same step."""
        coordinator, session = self.states[state_number], self.states[state_number].session.copy()
        if coordinator.is_open is None:
            return
        is_open = not coordinator.is_open
        description, fair = f"the door is {'open' if is_open else 'shut'}", Fair.YES if is_open else Fair.NO
        must_stop = session.state is State.EXECUTING and self.step.must_stop(session, is_open)

        def take_action() -> Action:
            numbers = self._send_kind(session, frp.Stop if must_stop else None)
            return Action(description, self._moved(replace(coordinator, is_open=is_open), session, coordinator.phase), numbers, fair, "map")

        yield try_action(take_action, description, state_number)

    def _repeat_order(self, state_number: int) -> Action:
        """The last order has not arrived. It is sent again; but if the step may not begin any more, it is stopped."""
        coordinator = self.states[state_number]
        kind = REQUIRED_REPEATS[coordinator.session.state]
        if kind is not frp.Execute:
            return self._send(state_number, kind, joint="again")
        order = self.step.order(coordinator.session, coordinator.is_open)
        return self._send(state_number, frp.Execute if order is not None else frp.Stop, order, joint="again")

    def _may_ask_again(self, coordinator: Coordinator) -> bool:
        """Whether a new session with the same service may follow: this one led to nothing, and the service did not refuse for good."""
        session = coordinator.session
        if self.kind not in (StepKind.CONDITIONAL, StepKind.NOT_NOW) or session.state is not State.ENDED:
            return False
        return session.refusal is None or session.refusal.passes

    def _ask_again(self, state_number: int) -> Action:
        """Begin a new session. `Link` begins that of the participant."""
        coordinator = self.states[state_number]
        target = self._add(Coordinator(session=_fresh_coordinator(), is_open=coordinator.is_open))
        refusal = coordinator.session.refusal
        for_good = refusal is not None and not refusal.not_now and refusal.condition is None
        wrong = "a service that refused for good is asked again" if for_good else ""
        return Action("asks again, in a new session", target, (), Fair.YES, "anew", wrong, Property.REFUSAL)

    def _send(
        self, state_number: int, kind: type[object], body: CoordinatorBody | None = None, *, fair: Fair = Fair.NO, joint: str = ""
    ) -> Action:
        description = f"sends {describe(body) if body is not None else kind.__name__}{' again' if joint == 'again' else ''}"
        return try_action(lambda: self._perform_send(state_number, kind, body, description, fair, joint), description, state_number)

    def _perform_send(
        self, state_number: int, kind: type[object], body: CoordinatorBody | None, description: str, fair: Fair, joint: str
    ) -> Action:
        coordinator, session = self.states[state_number], self.states[state_number].session.copy()
        if kind is frp.Query:
            session.sent_messages = {name: record for name, record in session.sent_messages.items() if name != "Query"}
            session.number = [*State].index(session.state)  # all Queries in one state have the same id, which keeps the states finite
        elif joint == "again" and kind is not frp.Stop:
            self.outbox.prepare_repeat(session, kind)
        else:
            self.outbox.prepare(session, kind)
        message = session.accept() if kind is frp.Accept else session.send(body or COORDINATOR_BODIES[kind])
        tokens = (self.outbox.number(message, session.number),)
        wrong = _condition_ignored(coordinator, kind)
        return Action(description, self._moved(coordinator, session, coordinator.phase), tokens, fair, joint, wrong, Property.CONDITION)

    def _stop(self, state_number: int, rule: str, *, fair: Fair = Fair.NO) -> Action:
        """Stop the transaction, as `Participants.stop` of the Task Manager: Stop to a participant that works, Cancel to the others."""

        def take_action() -> Action:
            coordinator, session = self.states[state_number], self.states[state_number].session.copy()
            kind: type[object] | None = frp.Stop if session.state is State.EXECUTING else frp.Cancel
            if kind is frp.Cancel and kind not in states.COORDINATOR_SENDS.get(session.state, {}):
                kind = None
            numbers = self._send_kind(session, kind)
            target = self._moved(coordinator, session, Phase.STOPPING)
            refusal = coordinator.session.refusal
            passes = rule == "fail" and refusal is not None and (refusal.not_now or refusal.condition is not None)
            wrong = "the task fails, although the service refused only for now" if passes else ""
            return Action(f"the transaction is stopped ({rule})", target, numbers, fair, rule, wrong, Property.REFUSAL)

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


def _has_passing_refusal(coordinator: Coordinator) -> bool:
    """Whether the session ended by a refusal for now, so that the transaction waits, and does not fail for it."""
    refusal = coordinator.session.refusal
    return coordinator.session.state is State.ENDED and refusal is not None and refusal.passes


def _says_that_nothing_was_begun(coordinator: Coordinator) -> bool:
    received = coordinator.session.received_messages.get(coordinator.session.state.value)
    return received is not None and isinstance(received.body, frp.Failed | frp.Stopped) and not received.body.tried


def _condition_ignored(coordinator: Coordinator, kind: type[object]) -> str:
    """Why the message disregards the condition of the service; empty if it does not. Independent of the product's decisions."""
    if not is_conditional(coordinator.session.terms):
        return ""
    if kind is frp.Accept and not (coordinator.is_open or is_promised(coordinator.session)):
        return "terms are accepted, although the plan does not meet their condition"
    if kind is frp.Execute and not coordinator.is_open:
        return "the order to begin is sent, although the condition of the service does not hold"
    return ""


def _fresh_coordinator() -> CoordinatorSession:
    return CoordinatorSession(transaction=TRANSACTION, participant=PARTICIPANT, me=TM, peer=SM)
