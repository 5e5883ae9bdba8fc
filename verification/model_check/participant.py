"""The participant's side: receives the coordinator's messages, and sends what `PARTICIPANT_SENDS` allows.

It includes the device, the timers and restarts. A `WorkState` is what was really done, as opposed to what was reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

from somrs.protocol.frp import states
from somrs.protocol.frp.participant_session import ParticipantSession
from somrs.protocol.frp.session import ParticipantBody
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from verification.model_check import step
from verification.model_check.sides import (
    NOW,
    PARTICIPANT,
    SM,
    TM,
    TRANSACTION,
    Action,
    Fair,
    Side,
    describe,
    forget_fleeting,
    key,
    try_action,
)
from verification.model_check.step import StepKind

# The contents of the bodies are arbitrary: no state depends on them.
PARTICIPANT_BODIES: dict[type[object], ParticipantBody] = {
    frp.Terms: step.TERMS,
    frp.Refuse: step.REFUSE,
    frp.Progress: frp.Progress(fraction=0.5),
    frp.Completed: frp.Completed(situation="S"),
    frp.Failed: frp.Failed(description="d"),
    frp.Stopped: frp.Stopped(),
    frp.Compensated: frp.Compensated(situation="S"),
    frp.Stranded: frp.Stranded(description="d"),
}


# What a Service Manager sends in each state (`service_manager.participant`); a table that does not allow it is wrong.
REQUIRED_MESSAGES: dict[State, tuple[type[object], ...]] = {
    State.ARRANGING: (frp.Terms, frp.Refuse),
    State.OFFERED: (frp.Refuse,),
    State.COMMITTED: (frp.Failed,),
    State.EXECUTING: (frp.Progress, frp.Completed, frp.Failed),
    State.STOPPING: (frp.Progress, frp.Completed, frp.Failed, frp.Stopped),
    State.COMPENSATING: (frp.Progress, frp.Compensated, frp.Stranded),
}


class WorkState(Enum):
    """The work that a participant has really done."""

    NOT_STARTED = "nothing"
    STARTED = "begun"
    LOOKED = "seen, and nothing changed"
    COMPLETED = "done"
    HALF = "partly done"
    UNDONE = "undone"
    STRANDED = "not undone"


@dataclass(frozen=True, kw_only=True)
class Participant:
    """The participant's side. `verdict` is the report that follows when a halted device has stopped."""

    session: ParticipantSession
    moving: bool = False
    """The device works, or has not stopped yet."""
    verdict: type[object] | None = None
    halted: bool = False
    work_state: WorkState = WorkState.NOT_STARTED
    committed: bool = False
    """The participant has received the Accept of its terms."""
    forgot: bool = False
    """The participant has lost its disk."""


@dataclass
class Participants(Side[Participant]):
    """The participant's states, with the results of every message and every choice."""

    kind: StepKind = StepKind.PLAIN

    def first(self) -> int:
        return self._add(Participant(session=_fresh_participant()))

    def _add(self, participant: Participant) -> int:
        session_key = key(participant.session, self.futures.moves_participant)
        return self._number(
            (
                session_key,
                participant.moving,
                participant.verdict,
                participant.halted,
                participant.work_state,
                participant.committed,
                participant.forgot,
            ),
            participant,
        )

    def _receive(self, state_number: int, token: int, description: str) -> Action:
        participant, session = self.states[state_number], self.states[state_number].session.copy()
        message = self.inbox.messages[token]
        objection = session.objection(message, NOW)
        if objection and isinstance(message.body, frp.Execute) and session.state in states.UNBEGUN:
            tokens = self._refused(session, states.UNBEGUN[session.state])
            return Action(description, self._add(replace(participant, session=session)), tokens)
        self.outbox.prepare(session, states.PARTICIPANT[session.state][type(message.body)].answer)
        result = session.receive(message)
        forget_fleeting(session)
        tokens, wrong = self._number_messages(session, result.answers)
        participant_after = replace(
            participant,
            session=session,
            committed=participant.committed or (result.moved and isinstance(message.body, frp.Accept | frp.Execute)),
        )
        if result.state_before is State.ENDED and result.state is not State.ENDED:
            wrong = f"a participant that has ended becomes {result.state}"
        elif objection and result.moved and result.state is State.COMPENSATING:
            tokens = (*tokens, *self._refused(session, frp.Stranded))
        elif result.moved and result.state in (State.EXECUTING, State.COMPENSATING) and result.state_before is not result.state:
            is_start = result.state is State.EXECUTING
            participant_after = replace(
                participant_after,
                moving=True,
                halted=False,
                verdict=None,
                work_state=self._begun if is_start else participant.work_state,
            )
        elif result.moved and result.state is State.ENDED:
            participant_after = replace(participant_after, verdict=None, halted=False)
        return Action(description, self._add(participant_after), tokens, wrong=wrong)

    @property
    def _begun(self) -> WorkState:
        return WorkState.LOOKED if self.kind is StepKind.RECOGNITION else WorkState.STARTED

    def _refused(self, session: ParticipantSession, kind: type[object]) -> tuple[int, ...]:
        """Answer an order that must not be carried out, as `ServiceManager` does: nothing moves."""
        self.outbox.prepare(session, kind)
        return (self.outbox.number(session.send(self._bodies(session.state, kind)[0]), session.number),)

    def _bodies(self, state: State, kind: type[object]) -> tuple[ParticipantBody, ...]:
        """What the participant may say with a message of this type."""
        if kind is frp.Failed and state is State.COMMITTED:
            return (frp.Failed(description="d", tried=False),)
        if kind not in (frp.Terms, frp.Refuse):
            return (PARTICIPANT_BODIES[kind],)
        if state is not State.ARRANGING:
            return (step.expiry(self.kind),)
        return tuple(answer for answer in step.answers(self.kind) if isinstance(answer, kind))

    def _all_actions(self, state_number: int) -> Iterator[Action]:
        """Yield the participant's moves, with those of its device and its timers."""
        participant = self.states[state_number]
        state = participant.session.state
        for kind in dict.fromkeys((*states.PARTICIPANT_SENDS.get(state, {}), *REQUIRED_MESSAGES.get(state, ()))):
            if (not participant.halted and (participant.moving or state not in states.WORKING)) or kind is frp.Progress:
                for body in self._bodies(state, kind):
                    yield self._send(state_number, body)
        if participant.halted and participant.verdict is not None:
            yield self._send(state_number, PARTICIPANT_BODIES[participant.verdict])
        if participant.moving and state not in states.WORKING:
            yield Action(
                "comes to rest", self._add(replace(participant, moving=False, work_state=_interrupted(participant))), fair=Fair.YES
            )
        if participant.moving and state in (State.EXECUTING, State.COMPENSATING):
            yield Action("is cut off, and halts", self._add(_halted(participant)))

    def _send(self, state_number: int, body: ParticipantBody) -> Action:
        description = f"sends {describe(body)}"
        return try_action(lambda: self._perform_send(state_number, body, description), description, state_number)

    def _perform_send(self, state_number: int, body: ParticipantBody, description: str) -> Action:
        participant, session, kind = self.states[state_number], self.states[state_number].session.copy(), type(body)
        self.outbox.prepare(session, kind)
        message = session.send(body)
        forget_fleeting(session)
        participant_after = replace(participant, session=session)
        wrong = ""
        if kind in (frp.Completed, frp.Compensated) and not participant.moving:
            wrong = f"sends {kind.__name__}, although its device was stopped before the work was done"
        if kind is not frp.Progress:
            participant_after = replace(
                participant_after, moving=False, verdict=None, halted=False, work_state=_reported_work_state(participant, kind)
            )
        # Fairness does not require that terms expire or that a device breaks before it begins, except when the coordinator's disk is lost.
        fair, timer = Fair.YES, participant.session.state in (State.OFFERED, State.COMMITTED)
        if timer:
            fair = Fair.NO
        elif participant.session.state is State.EXECUTING and participant.moving and kind is not frp.Progress:
            fair = Fair.ENDING
        return Action(
            description, self._add(participant_after), (self.outbox.number(message, session.number),), fair, "timer" if timer else "", wrong
        )

    def restarted(self, state_number: int) -> tuple[int, tuple[int, ...]]:
        """Return the state after a restart, and the reports sent again. The device is halted, and reports its work as interrupted."""
        participant = self.states[state_number]
        tokens = tuple(self.outbox.number(message, 1) for message in participant.session.last_report())
        if participant.session.state in states.WORKING:
            participant = _halted(participant)
        elif participant.moving:
            participant = replace(participant, moving=False, work_state=_interrupted(participant))
        return self._add(participant), tokens

    def without_memory(self, state_number: int) -> int:
        """Return the state after the loss of the participant's disk."""
        participant = self.states[state_number]
        return self._add(Participant(session=_fresh_participant(), work_state=_interrupted(participant), forgot=True))


def _fresh_participant() -> ParticipantSession:
    return ParticipantSession(transaction=TRANSACTION, participant=PARTICIPANT, me=SM, peer=TM)


def _halted(participant: Participant) -> Participant:
    return replace(
        participant, moving=False, halted=True, verdict=states.RESUMES.get(participant.session.state), work_state=_interrupted(participant)
    )


def _interrupted(participant: Participant) -> WorkState:
    if participant.session.state is State.COMPENSATING and participant.moving:
        return WorkState.STRANDED
    return WorkState.HALF if participant.work_state is WorkState.STARTED else participant.work_state


def _reported_work_state(participant: Participant, kind: type[object]) -> WorkState:
    """Return the real state of the work after a report of this type."""
    if participant.work_state is WorkState.LOOKED:
        return WorkState.LOOKED
    if kind is frp.Completed:
        return WorkState.COMPLETED
    if kind is frp.Compensated:
        return WorkState.UNDONE
    if kind is frp.Stranded:
        return WorkState.STRANDED
    return _interrupted(participant)
