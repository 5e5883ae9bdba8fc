"""The participants of one transaction as the coordinator sees them: what is said to them, and how long one may be silent."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from msgspec import structs

from somrs.kernel.component import Effect, Send, Wake
from somrs.protocol.frp.session import CoordinatorBody, CoordinatorSession, Heard, participant_id
from somrs.protocol.frp.states import COORDINATOR_SENDS, HOLDS, WORKING
from somrs.protocol.messages import frp
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.envelope import ANONYMOUS, Message
from somrs.protocol.messages.frp import Outcome, State
from somrs.task_manager.arrange import Bid
from somrs.task_manager.setting import Setting

SILENCE = 20.0
"""Seconds without a word from a working service after which it is queried; and again as many to answer."""

GOODBYE_TIME = 86_400.0
"""Seconds for which End and Cancel are sent again: a device that is down may come back, and has to hear that it is free."""

LATENESS = 10.0
"""How many times as long as it said a service may take, before it is stopped."""

LEAST_TIME = 60.0
"""Seconds that every service has at least, however short it said that it takes."""


IDLE = {State.EXECUTING: (State.OFFERED, State.COMMITTED), State.COMPENSATING: (State.COMPLETED, State.FAILED, State.STOPPED)}
"""What a participant says of its state, by the coordinator's, when it was not reached by what it was told: it is told again."""


@dataclass(slots=True, kw_only=True, eq=False)
class Member:
    """One participant of the transaction, as the coordinator sees it. `step` is the step that it is asked for, `label` what people
    call it."""

    id: str
    session: CoordinatorSession
    offer: Offer
    label: str
    step: str
    number: int = 0
    """In the order in which they were asked."""
    bid: Bid | None = None
    fraction: float = 0.0
    note: str = ""
    heard_at: float = 0.0
    queried: bool = False
    told: frp.Execute | frp.Compensate | None = None
    """What it was told last to begin."""
    begins_by: float = 0.0
    """Until when it may begin with that, while it has not been heard to."""
    last_word: str = ""
    lost_at: int | None = None
    """The version of the map when it was given up."""
    reported: bool = False
    """It said how its work ended."""
    reporting: bool = False
    """What it said is on its way to the map."""
    halting: bool = False
    """It was sent home while it undid its work, and may be moving still."""
    left_in: State | None = None
    """Where it was when the transaction ended."""
    changed: int = 0
    """The number of the last change of its contract, among all in the transaction."""

    @property
    def state(self) -> State:
        return self.session.state

    @property
    def tried_to_undo(self) -> bool:
        """Whether things may be another way than before it was told to undo its work, which it could not."""
        said = self.session.heard.get("Stranded")
        return said is not None and isinstance(said.body, frp.Stranded) and said.body.tried


class Participants:
    """They join with `invite`, and leave with Cancel or End. `tell` notes what the client may want to know, `note` each message."""

    def __init__(
        self, transaction: str, setting: Setting, tell: Callable[[float, str], None], note: Callable[[float, Message], None]
    ) -> None:
        self._transaction, self._setting, self._tell, self._note = transaction, setting, tell, note
        self._members: dict[str, Member] = {}
        self.changes = 0
        """How often a contract changed."""

    def __iter__(self) -> Iterator[Member]:
        return iter(self._members.values())

    @property
    def working(self) -> list[Member]:
        """Those whose devices may be moving."""
        return [member for member in self if member.state in WORKING or member.halting]

    def held(self, step: str) -> bool:
        """Whether the step is somebody's: one that was given up may have come back, and is being stopped."""
        return any(member.step == step and member.state in HOLDS for member in self)

    # Speaking

    def invite(self, offer: Offer, label: str, step: str, arrange: frp.Arrange, now: float, seconds: float) -> Member:
        """Ask a service, as a participant of its own however often it was asked before. `step` is the step's own name among all
        plans of the transaction, `label` the one that people know."""
        member = self.known(offer, label, step)
        self._members[member.id] = member
        self._send(member, arrange, now, seconds)
        return member

    def known(self, offer: Offer, label: str, step: str) -> Member:
        """A participant as it would be, that is not asked."""
        id = participant_id(offer.service, label, len(self._members) + 1)
        session = CoordinatorSession(transaction=self._transaction, participant=id, me=self._setting.address, peer=offer.address)
        return Member(id=id, session=session, offer=offer, label=label, step=step, number=len(self._members) + 1)

    def accept(self, member: Member, terms: str, now: float) -> None:
        assert not self.held(member.step), "a step is one participant's at a time (FRP, property 1)"
        self._send(member, frp.Accept(terms=terms), now, SILENCE)

    def execute(self, member: Member, execute: frp.Execute, now: float) -> None:
        self._have_begin(member, execute, now)

    def compensate(self, member: Member, situation: str, now: float) -> bool:
        """Have it undo what it did. Whether it can be told to."""
        if frp.Compensate not in COORDINATOR_SENDS.get(member.state, {}):
            return False
        member.reported, member.lost_at = False, None
        self._have_begin(member, frp.Compensate(situation=situation), now)
        return True

    def _have_begin(self, member: Member, body: frp.Execute | frp.Compensate, now: float) -> None:
        self._setting.turns.begins(member.offer.provider, partial(self._is_at_work, member))
        self._order(member, body, now)
        self._watch(member, now)

    def _is_at_work(self, member: Member) -> bool:
        """Whether its device does what it was told to begin, or what it came to is not on the map yet."""
        return self._members.get(member.id) is member and (member.state in WORKING or member.halting or member.reporting)

    def _order(self, member: Member, body: frp.Execute | frp.Compensate, now: float) -> None:
        """Told again, it is another message: what is still under way of the one before must not be obeyed for longer than that says."""
        member.begins_by = now + SILENCE
        member.told = structs.replace(body, begin_by=member.begins_by)
        self._send(member, member.told, now, SILENCE)

    def dismiss(self, member: Member, reason: str, now: float) -> None:
        """It is not needed, and has not begun."""
        if frp.Cancel in COORDINATOR_SENDS.get(member.state, {}):
            self._send(member, frp.Cancel(reason=reason), now, GOODBYE_TIME)

    def stop(self, reason: str, now: float) -> None:
        """Whoever works shall stop, and the others go home, but for those that hear about the end with it."""
        for member in self:
            if member.state is State.EXECUTING:
                self.halt(member, reason, now)
            else:
                self.dismiss(member, reason, now)

    def halt(self, member: Member, reason: str, now: float) -> None:
        """Have it stop what it executes."""
        self._send(member, frp.Stop(reason=reason), now, SILENCE)

    def end(self, outcome: Outcome, now: float) -> None:
        """End goes to everyone that was ever committed (FRP, property 6)."""
        for member in self:
            if member.state in WORKING:
                self.give_up(member)
            member.left_in = member.state
            if frp.End in COORDINATOR_SENDS.get(member.state, {}):
                self._send(member, frp.End(outcome=outcome), now, GOODBYE_TIME)
            else:
                self.dismiss(member, "the task is over", now)

    def forget(self) -> None:
        """Once the transaction is over: all but those that were given up, whose report may still come."""
        self._members = {id: member for id, member in self._members.items() if member.lost_at is not None and not member.reported}

    def _send(self, member: Member, body: CoordinatorBody, now: float, seconds: float) -> Message:
        message = member.session.send(body)
        self._mark(member)
        self._note(now, message)
        self._setting.effects.append(Send(message, now + seconds))
        return message

    def _mark(self, member: Member) -> None:
        """Its contract changed."""
        self.changes += 1
        member.changed = self.changes

    # Hearing

    def receive(self, message: Message, now: float) -> tuple[Member, Heard] | None:
        """Who said it, and what it meant; None when it is from nobody that was invited."""
        member = self._members.get(message.header.participant or "")
        if member is None:
            self._setting.effects += sent_home(message, self._setting.address)
            return None
        heard = member.session.receive(message)
        if heard.state is not heard.before:
            self._mark(member)
        self._note(now, message)
        for answer in heard.answers:
            self._note(now, answer)
            self._setting.effects.append(Send(answer))
        member.heard_at, member.queried = now, False
        if heard.moved:
            member.begins_by = 0.0
        elif isinstance(message.body, frp.Status) and message.body.state in IDLE.get(member.state, ()) and member.told is not None:
            self._order(member, member.told, now)
        if heard.before in WORKING and heard.state not in WORKING:
            self._unwatch(member)
        elif heard.before not in WORKING and heard.state in WORKING:
            self._watch(member, now)
        return member, heard

    def undelivered(self, message: Message, reason: str, now: float) -> Member | None:
        """A message never arrived. The participant, if it is out because of that."""
        member = self._members.get(message.header.participant or "")
        if member is None:
            return None
        trouble = f"could not be reached: {reason}"
        match message.body:
            case frp.Arrange() if member.state is State.ARRANGING:
                self.dismiss(member, trouble, now)
            case frp.Accept() if member.state is State.COMMITTED:
                self.give_up(member)
            case frp.Stop() if member.state is State.STOPPING:
                self._setting.effects.append(Send(message, now + SILENCE))
                return None
            case _:
                return None
        member.last_word = trouble
        self._mark(member)
        return member

    # Silence, and lateness

    def silent(self, participant: str, now: float) -> Member | None:
        """The heartbeat of one that works may have stopped: ask it, and after as long again give it up, and return it. One that was
        never heard to begin may have begun at the last moment at which it might, and is waited for from then on."""
        member = self._members.get(participant)
        if member is None or member.state not in WORKING:
            return None
        if now - member.heard_at < SILENCE - 0.001:
            self._setting.effects.append(Wake(self._timer("silence", member), member.heard_at + SILENCE))
        elif not member.queried:
            member.queried = True
            until = _at_rest(member, now)
            self._send(member, frp.Query(), now, until - now)
            self._setting.effects.append(Wake(self._timer("silence", member), until))
            self._tell(now, f"{member.offer.service} is silent; asking for its state")
        else:
            self.give_up(member)
            return member
        return None

    def overdue(self, participant: str, now: float) -> Member | None:
        """It takes far longer than it said. One that executes is stopped; one that undoes is sent home, which stops it, too; one that
        does not come to an end then is given up, and returned."""
        member = self._members.get(participant)
        if member is None or not (member.state in WORKING or member.halting):
            return None
        if member.state is State.COMPENSATING:
            self._tell(now, f"{member.offer.service} takes far longer to undo it than it said; sending it home")
            self.send_home(member, now)
            return None
        if member.halting:
            member.halting = False
            return member
        if member.state is State.EXECUTING:
            self._tell(now, f"{member.offer.service} takes far longer than it said; stopping it")
            self.halt(member, "it takes far longer than it said", now)
            self._setting.effects.append(Wake(self._timer("overdue", member), now + LEAST_TIME))
            return None
        self.give_up(member)
        return member

    def send_home(self, member: Member, now: float) -> None:
        """It does not come to an end of undoing its work: an End stops that, too. `overdue` returns it once it stands still."""
        self.give_up(member)
        self._send(member, frp.End(outcome=Outcome.FAILED), now, GOODBYE_TIME)
        member.halting = True
        self._setting.effects.append(Wake(self._timer("overdue", member), _at_rest(member, now)))

    def give_up(self, member: Member) -> None:
        """It may do anything from now on, but nobody waits for it."""
        if member.session.give_up():
            self._mark(member)
            member.lost_at = self._setting.replica.version
            self._unwatch(member)

    def _watch(self, member: Member, now: float) -> None:
        member.heard_at, member.queried = now, False
        terms = member.session.terms
        seconds = max(LEAST_TIME, LATENESS * terms.duration if terms is not None else 0.0)
        start = max(now, member.bid.start if member.bid is not None else now)
        self._setting.effects += [
            Wake(self._timer("silence", member), now + SILENCE),
            Wake(self._timer("overdue", member), start + seconds),
        ]

    def _unwatch(self, member: Member) -> None:
        self._setting.effects += [Wake(self._timer("silence", member), None), Wake(self._timer("overdue", member), None)]

    def _timer(self, kind: str, member: Member) -> str:
        return f"{self._transaction}/{kind}/{member.id}"


def _at_rest(member: Member, now: float) -> float:
    """When one that says nothing more has stopped. If it was not heard to begin, it may until the last moment at which it might."""
    return max(now + SILENCE, member.begins_by + 2 * SILENCE)


def sent_home(message: Message, address: str) -> list[Effect]:
    """The answers to one that takes part in nothing that is known here, such as a transaction that is long over."""
    header = message.header
    if header.transaction is None or header.participant is None:
        return []
    peer = header.sender if header.reply_to == ANONYMOUS else header.reply_to
    session = CoordinatorSession(transaction=header.transaction, participant=header.participant, me=address, peer=peer)
    return [Send(answer) for answer in session.receive(message).answers]
