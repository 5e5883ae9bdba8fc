"""The coordinator's side: hears what the participant says, and does what `COORDINATOR_SENDS` lets it, by the rules that the Task
Manager keeps to in a transaction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

from somrs.protocol.frp import states
from somrs.protocol.frp.session import CoordinatorBody, CoordinatorSession
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from verification.model_check.sides import PARTICIPANT, SM, TM, TRANSACTION, Fair, Side, Step, key, trial

# Bodies say nothing here: what they carry changes no state.
COORDINATOR_SAYS: dict[type[object], CoordinatorBody] = {
    frp.Arrange: frp.Arrange(service_type="S", inputs={}, effect="E"),
    frp.Cancel: frp.Cancel(reason="r"),
    frp.Execute: frp.Execute(inputs={}),
    frp.Stop: frp.Stop(reason="r"),
    frp.Compensate: frp.Compensate(situation="S"),
    frp.Query: frp.Query(),
    frp.End: frp.End(outcome=frp.Outcome.FAILED),
}


# What a Task Manager says in each state (`task_manager.participants`), whatever the table lets it; Cancel and End where it does.
MUST_SAY: dict[State, type[object]] = {
    State.NEW: frp.Arrange,
    State.OFFERED: frp.Accept,
    State.COMMITTED: frp.Execute,
    State.EXECUTING: frp.Stop,
}


MUST_SAY_AGAIN: dict[State, type[object]] = {State.EXECUTING: frp.Execute, State.COMPENSATING: frp.Compensate}
"""What it says again when the participant was not reached in time."""


class Phase(Enum):
    """How far the transaction is. Failed and cancelled ones go the same way, so both are `BROKEN`."""

    OPEN = "open"
    STOPPING = "stopping"
    ACCOMPLISHED = "accomplished"
    BROKEN = "failed or cancelled"
    LOST = "forgotten"
    """Its Task Manager lost its disk."""


@dataclass(frozen=True, kw_only=True)
class Coordinator:
    """The coordinator's side. `left` is the session's state before it ended, or its disk was lost."""

    session: CoordinatorSession
    phase: Phase = Phase.OPEN
    left: State | None = None
    given_up: bool = False
    """Nobody waits for it any more, and it has not said since how its work ended."""
    overdue: bool = False
    """The transaction ended though not everything was undone, and said so."""


OUT = frozenset((State.NEW, State.ENDED, State.FAILED, State.STOPPED, State.COMPENSATED, State.STRANDED, State.UNREACHABLE))
"""The coordinator's states in which a participant is of no more use for the step."""

UNDONE_AT_LAST = frozenset((State.COMPLETED, State.FAILED, State.STOPPED))
"""The coordinator's states in which a participant that was told to start has to undo, when the transaction is not accomplished."""


class Coordinators(Side[Coordinator]):
    """The coordinator's side, for every message and every choice."""

    queries: bool = False

    def first(self) -> int:
        return self._add(Coordinator(session=_fresh_coordinator()))

    def _add(self, one: Coordinator) -> int:
        known = key(one.session, lambda state, name: name == "Terms" or self.futures.moves_coordinator(state, name))
        return self._number((known, one.phase, one.left, one.given_up, one.overdue), one)

    def _receive(self, at: int, token: int, what: str) -> Step:
        one, session = self.states[at], self.states[at].session.copy()
        message = self.hears.messages[token]
        self.says.ready(session, states.COORDINATOR[session.state][type(message.body)].answer)
        heard = session.receive(message)
        says, wrong = self._spoken(session, heard.answers)
        if heard.state_before is State.ENDED and heard.state is not State.ENDED:
            wrong = f"a participant whose part is over becomes {heard.state}"
        if heard.moved and heard.state is not heard.state_before:
            one = replace(one, given_up=False)
        return Step(what, self._moved(one, session, one.phase), says, wrong=wrong)

    def _moved(self, one: Coordinator, session: CoordinatorSession, phase: Phase, left: State | None = None) -> int:
        if session.state is State.ENDED and one.session.state is not State.ENDED:
            one = replace(one, left=left or one.session.state)
        if phase is Phase.LOST and session.state is State.ENDED:
            session = _fresh_coordinator()  # a Task Manager that knows nothing keeps nothing
        session.reason = ""
        return self._add(replace(one, session=session, phase=phase))

    def _all_moves(self, at: int) -> Iterator[Step]:
        """`joint` names the moves that depend on the other participants, or move them, too."""
        one = self.states[at]
        state, said = one.session.state, one.session.sent_messages
        allowed = states.COORDINATOR_SENDS.get(state, {})
        undo = state in UNDONE_AT_LAST and "Execute" in said
        if one.phase is Phase.OPEN:
            for kind in dict.fromkeys((*allowed, *([MUST_SAY[state]] if state in MUST_SAY else []))):
                if kind is MUST_SAY_AGAIN.get(state):
                    continue
                if kind is frp.Compensate and undo:
                    yield self._say(at, kind, joint="claim")
                elif kind is frp.Accept:
                    yield self._say(at, kind, joint="claim", fair=Fair.YES)
                elif kind not in (frp.End, frp.Compensate):
                    yield self._say(at, kind, fair=Fair.YES if kind in (frp.Arrange, frp.Execute) else Fair.NO)
            yield self._stop(at, "cancel")
            if state in OUT:
                yield self._stop(at, "fail", fair=Fair.YES)
            if state not in states.WORKING:
                yield self._end(at, "accomplish+" if state is State.COMPLETED else "accomplish-", Phase.ACCOMPLISHED, fair=Fair.YES)
        elif one.phase is Phase.STOPPING:
            if undo and frp.Compensate in allowed:
                yield self._say(at, frp.Compensate, joint="claim", fair=Fair.YES)
            if state is State.UNREACHABLE and frp.Stop in allowed:
                yield self._say(at, frp.Stop)
            if state not in states.WORKING and not undo:
                yield self._end(at, "end", Phase.BROKEN, fair=Fair.YES)
            yield self._end(at, "overdue", Phase.BROKEN)
        if one.phase in (Phase.OPEN, Phase.STOPPING) and state in states.ABANDONED_STATES:
            yield self._give_up(at)
        if one.phase in (Phase.OPEN, Phase.STOPPING) and state in MUST_SAY_AGAIN:
            yield self._say(at, MUST_SAY_AGAIN[state], joint="again")
        if self.queries and one.phase in (Phase.OPEN, Phase.STOPPING) and state in states.WORKING:
            yield self._say(at, frp.Query)

    def _say(self, at: int, kind: type[object], *, fair: Fair = Fair.NO, joint: str = "") -> Step:
        what = f"says {kind.__name__}{' again' if joint == 'again' else ''}"
        return trial(lambda: self._spoken_up(at, kind, what, fair, joint), what, at)

    def _spoken_up(self, at: int, kind: type[object], what: str, fair: Fair, joint: str) -> Step:
        one, session = self.states[at], self.states[at].session.copy()
        if kind is frp.Query:
            session.sent_messages = {name: said for name, said in session.sent_messages.items() if name != "Query"}
            session.number = [*State].index(session.state)  # questions asked in one state are the same question
        elif joint == "again":
            self.says.ready_again(session, kind)
        else:
            self.says.ready(session, kind)
        message = session.accept() if kind is frp.Accept else session.send(COORDINATOR_SAYS[kind])
        return Step(what, self._moved(one, session, one.phase), (self.says.number(message, session.number),), fair, joint)

    def _stop(self, at: int, rule: str, *, fair: Fair = Fair.NO) -> Step:
        """As `Participants.stop` of the Task Manager: whoever works is told to stop, the others go home."""

        def step() -> Step:
            one, session = self.states[at], self.states[at].session.copy()
            kind: type[object] | None = frp.Stop if session.state is State.EXECUTING else frp.Cancel
            if kind is frp.Cancel and kind not in states.COORDINATOR_SENDS.get(session.state, {}):
                kind = None
            numbers = self._say_to(session, kind)
            return Step(f"the transaction is stopped ({rule})", self._moved(one, session, Phase.STOPPING), numbers, fair, rule)

        return trial(step, rule, at)

    def _end(self, at: int, rule: str, phase: Phase, *, fair: Fair = Fair.NO) -> Step:
        """As `Participants.end` of the Task Manager: End to everyone that was committed, Cancel to the others."""

        def step() -> Step:
            one, session = self.states[at], self.states[at].session.copy()
            overdue = rule == "overdue"
            if session.state in states.WORKING and session.abandon():
                one = replace(one, given_up=True)
            left, allowed = session.state, states.COORDINATOR_SENDS.get(session.state, {})
            numbers = self._say_to(session, next((kind for kind in (frp.End, frp.Cancel) if kind in allowed), None))
            after = self._moved(replace(one, overdue=overdue), session, phase, left)
            what = f"the transaction ends ({'overdue' if overdue else phase.value})"
            return Step(what, after, numbers, fair, rule)

        return trial(step, rule, at)

    def _say_to(self, session: CoordinatorSession, kind: type[object] | None) -> tuple[int, ...]:
        if kind is None:
            return ()
        self.says.ready(session, kind)
        return (self.says.number(session.send(COORDINATOR_SAYS[kind]), session.number),)

    def _give_up(self, at: int) -> Step:
        one, session = self.states[at], self.states[at].session.copy()
        session.abandon()
        return Step("gives it up", self._moved(replace(one, given_up=True), session, one.phase), joint="give up")

    def without_memory(self, at: int) -> int:
        """The state after the Task Manager's disk was lost."""
        return self._add(Coordinator(session=_fresh_coordinator(), phase=Phase.LOST, left=self.states[at].session.state))

    def said(self, at: int) -> tuple[int, ...]:
        """Everything it said that its node may send again after a restart; orders only as long as they are wanted."""
        session = self.states[at].session
        orders = {"Execute": State.EXECUTING, "Compensate": State.COMPENSATING}
        return tuple(
            self.says.number(message, 1)
            for name in session.sent_messages
            if name != "Query" and orders.get(name, session.state) is session.state
            for message in session._repeat(name)
        )


def _fresh_coordinator() -> CoordinatorSession:
    return CoordinatorSession(transaction=TRANSACTION, participant=PARTICIPANT, me=TM, peer=SM)
