"""The participant's side: hears what the coordinator says, and does what `PARTICIPANT_SENDS` lets it.

Its device, its timers and its restarts are here, too: what is done in the world, as against what is said of it, is a `Deed`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

from somrs.protocol.frp import states
from somrs.protocol.frp.session import ParticipantBody, ParticipantSession
from somrs.protocol.messages import frp
from somrs.protocol.messages.frp import State
from verification.model_check.sides import PARTICIPANT, SM, TM, TRANSACTION, Fair, Side, Step, forget_fleeting, is_late, key, trial

# Bodies say nothing here: what they carry changes no state.
PARTICIPANT_SAYS: dict[type[object], ParticipantBody] = {
    frp.Terms: frp.Terms(effect="E", price=1.0, duration=1.0),
    frp.Refuse: frp.Refuse(reason="r"),
    frp.Progress: frp.Progress(fraction=0.5),
    frp.Completed: frp.Completed(situation="S"),
    frp.Failed: frp.Failed(description="d"),
    frp.Stopped: frp.Stopped(),
    frp.Compensated: frp.Compensated(situation="S"),
    frp.Stranded: frp.Stranded(description="d"),
}


# What a Service Manager says in each state (`service_manager.participant`): a table that does not let it is wrong.
MUST_SAY: dict[State, tuple[type[object], ...]] = {
    State.ARRANGING: (frp.Terms, frp.Refuse),
    State.OFFERED: (frp.Refuse,),
    State.COMMITTED: (frp.Failed,),
    State.EXECUTING: (frp.Progress, frp.Completed, frp.Failed),
    State.STOPPING: (frp.Progress, frp.Completed, frp.Failed, frp.Stopped),
    State.COMPENSATING: (frp.Progress, frp.Compensated, frp.Stranded),
}


UNBEGUN: dict[State, type[object]] = {State.OFFERED: frp.Refuse, State.COMMITTED: frp.Failed}
"""What it answers to an Execute that came too late; to a Compensate, Stranded."""


class Deed(Enum):
    """What a participant has really done to the world."""

    NOTHING = "nothing"
    BEGUN = "begun"
    DONE = "done"
    HALF = "half-done"
    UNDONE = "undone"
    STRANDED = "not undone"


@dataclass(frozen=True, kw_only=True)
class Participant:
    """The participant's side. `verdict` is what it will report once the device, which it has halted, is at rest."""

    session: ParticipantSession
    moving: bool = False
    """The device is at work, or not yet at rest."""
    verdict: type[object] | None = None
    halted: bool = False
    deed: Deed = Deed.NOTHING
    committed: bool = False
    """Its terms were accepted, as it knows."""
    forgot: bool = False
    """It lost its disk once."""


class Participants(Side[Participant]):
    """The participant's side, for every message and every choice."""

    def first(self) -> int:
        return self._add(Participant(session=_fresh_participant()))

    def _add(self, one: Participant) -> int:
        known = key(one.session, self.futures.moves_participant)
        return self._number((known, one.moving, one.verdict, one.halted, one.deed, one.committed, one.forgot), one)

    def _receive(self, at: int, token: int, what: str) -> Step:
        one, session = self.states[at], self.states[at].session.copy()
        message = self.hears.messages[token]
        late = is_late(message)
        if late and isinstance(message.body, frp.Execute) and session.state in UNBEGUN:
            says = self._refused(session, UNBEGUN[session.state])
            return Step(what, self._add(replace(one, session=session)), says)
        self.says.ready(session, states.PARTICIPANT[session.state][type(message.body)].answer)
        heard = session.receive(message)
        forget_fleeting(session)
        says, wrong = self._spoken(session, heard.answers)
        after = replace(
            one, session=session, committed=one.committed or (heard.moved and isinstance(message.body, frp.Accept | frp.Execute))
        )
        if heard.state_before is State.ENDED and heard.state is not State.ENDED:
            wrong = f"a participant that is over becomes {heard.state}"
        elif late and heard.moved and heard.state is State.COMPENSATING:
            says = (*says, *self._refused(session, frp.Stranded))
        elif heard.moved and heard.state in (State.EXECUTING, State.COMPENSATING) and heard.state_before is not heard.state:
            began = heard.state is State.EXECUTING
            after = replace(after, moving=True, halted=False, verdict=None, deed=Deed.BEGUN if began else one.deed)
        elif heard.moved and heard.state is State.ENDED:
            after = replace(after, verdict=None, halted=False)
        return Step(what, self._add(after), says, wrong=wrong)

    def _refused(self, session: ParticipantSession, kind: type[object]) -> tuple[int, ...]:
        """As `ServiceManager` answers an order that came too late: nothing moves."""
        self.says.ready(session, kind)
        return (self.says.number(session.send(PARTICIPANT_SAYS[kind]), session.number),)

    def _all_moves(self, at: int) -> Iterator[Step]:
        """With what its device and its timers do to it."""
        one = self.states[at]
        state = one.session.state
        for kind in dict.fromkeys((*states.PARTICIPANT_SENDS.get(state, {}), *MUST_SAY.get(state, ()))):
            if (not one.halted and (one.moving or state not in states.WORKING)) or kind is frp.Progress:
                yield self._say(at, kind)
        if one.halted and one.verdict is not None:
            yield self._say(at, one.verdict)
        if one.moving and state not in states.WORKING:
            yield Step("comes to rest", self._add(replace(one, moving=False, deed=_interrupted(one))), fair=Fair.YES)
        if one.moving and state in (State.EXECUTING, State.COMPENSATING):
            yield Step("is cut off, and halts", self._add(_halted(one)))

    def _say(self, at: int, kind: type[object]) -> Step:
        what = f"says {kind.__name__}"
        return trial(lambda: self._spoken_up(at, kind, what), what, at)

    def _spoken_up(self, at: int, kind: type[object], what: str) -> Step:
        one, session = self.states[at], self.states[at].session.copy()
        self.says.ready(session, kind)
        message = session.send(PARTICIPANT_SAYS[kind])
        forget_fleeting(session)
        after = replace(one, session=session)
        wrong = ""
        if kind in (frp.Completed, frp.Compensated) and not one.moving:
            wrong = f"says {kind.__name__}, and its device was stopped before that was true"
        if kind is not frp.Progress:
            after = replace(after, moving=False, verdict=None, halted=False, deed=_deed(one, kind))
        # That an offer lapses, or a device breaks before it began, is left to chance, but where nobody is left to wait for.
        fair, timer = Fair.YES, one.session.state in (State.OFFERED, State.COMMITTED)
        if timer:
            fair = Fair.NO
        elif one.session.state is State.EXECUTING and one.moving and kind is not frp.Progress:
            fair = Fair.ENDING
        return Step(what, self._add(after), (self.says.number(message, session.number),), fair, "timer" if timer else "", wrong)

    def restarted(self, at: int) -> tuple[int, tuple[int, ...]]:
        """The state after a restart, and what is said again. The device is halted, and what was under way is reported so."""
        one = self.states[at]
        again = tuple(self.says.number(message, 1) for message in one.session.last_report())
        if one.session.state in states.WORKING:
            one = _halted(one)
        elif one.moving:
            one = replace(one, moving=False, deed=_interrupted(one))
        return self._add(one), again

    def without_memory(self, at: int) -> int:
        """The state after its disk was lost."""
        one = self.states[at]
        return self._add(Participant(session=_fresh_participant(), deed=_interrupted(one), forgot=True))


def _fresh_participant() -> ParticipantSession:
    return ParticipantSession(transaction=TRANSACTION, participant=PARTICIPANT, me=SM, peer=TM)


def _halted(one: Participant) -> Participant:
    return replace(one, moving=False, halted=True, verdict=states.RESUMES.get(one.session.state), deed=_interrupted(one))


def _interrupted(one: Participant) -> Deed:
    if one.session.state is State.COMPENSATING and one.moving:
        return Deed.STRANDED
    return Deed.HALF if one.deed is Deed.BEGUN else one.deed


def _deed(one: Participant, kind: type[object]) -> Deed:
    """What is so when it reports this."""
    if kind is frp.Completed:
        return Deed.DONE
    if kind is frp.Compensated:
        return Deed.UNDONE
    if kind is frp.Stranded:
        return Deed.STRANDED
    return _interrupted(one)
