"""The participants of one transaction as the coordinator sees them: what is said to them, and how long one may be silent."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from msgspec import Struct, field, structs

from somrs.kernel.component import Effect, Effects, EffectsReturning, Send, SetTimer
from somrs.protocol.frp.session import CoordinatorBody, CoordinatorSession, ReceiveResult, participant_id
from somrs.protocol.frp.states import COORDINATOR_SENDS, HOLDING_STATES, WORKING
from somrs.protocol.messages import events, frp
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.envelope import ANONYMOUS, Message
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import Outcome, State
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.device_queue import AtWork
from somrs.task_manager.execution.member import Member
from somrs.task_manager.timers import OverdueDue, SilenceDue

SILENCE = 20.0
"""Seconds without a word from a working service after which it is queried; and again as many to answer."""

DISMISSAL_TIME = 86_400.0
"""Seconds for which End and Cancel are sent again: a device that is down may come back, and has to hear that it is free."""

LATENESS = 10.0
"""How many times as long as it said a service may take, before it is stopped."""

LEAST_TIME = 60.0
"""Seconds that every service has at least, however short it said that it takes."""


UNREACHED_STATES = {State.EXECUTING: (State.OFFERED, State.COMMITTED), State.COMPENSATING: (State.COMPLETED, State.FAILED, State.STOPPED)}
"""What a participant says of its state, by the coordinator's, when it was not reached by what it was told: it is told again."""


class Members(Struct, kw_only=True):
    """Who takes part in a transaction, by id. `invited_count`: how many were; `change_count`: how often a contract changed."""

    by_id: dict[str, Member] = field(default_factory=dict)
    former: dict[str, Member] = field(default_factory=dict)
    """Of a task that is over: those that had the steps of its last plan."""
    invited_count: int = field(default=0, name="asked")
    change_count: int = field(default=0, name="changes")

    def __iter__(self) -> Iterator[Member]:
        return iter([*self.by_id.values()])

    def find_member(self, id: str | None) -> Member | None:
        return self.by_id.get(id or "")

    def find_known_member(self, id: str | None) -> Member | None:
        """Whether it takes part, or took part until the task was over."""
        return self.find_member(id) or self.former.get(id or "")

    @property
    def working(self) -> list[Member]:
        """Those whose devices may be moving."""
        return [member for member in self if member.state in WORKING or member.halting]

    def held(self, step: str) -> bool:
        """Whether the step is somebody's: one that was given up may have come back, and is being stopped."""
        return any(member.step == step and member.state in HOLDING_STATES for member in self)

    def at_work(self, id: str) -> bool:
        """Whether its device does what it was told to begin, or what it came to is not on the map yet."""
        member = self.by_id.get(id)
        return member is not None and (member.state in WORKING or member.halting or member.reporting)


EventLogger = Callable[[Event, float], None]
"""Notes what the client may want to know."""

MessageLogger = Callable[[float, Message], None]
"""Notes a message that passed."""


class Participants:
    """They join with `invite`, and leave with Cancel or End."""

    def __init__(
        self, transaction: str, members: Members, context: TaskManagerContext, log_event: EventLogger, log_message: MessageLogger
    ) -> None:
        self._transaction, self._members, self._context, self._log_event, self._log_message = (
            transaction,
            members,
            context,
            log_event,
            log_message,
        )

    # Speaking

    def invite(self, offer: Offer, label: str, step: str, arrange: frp.Arrange, now: float, seconds: float) -> EffectsReturning[Member]:
        """Ask a service, as a participant of its own however often it was asked before. `step` is the step's own name among all
        plans of the transaction, `label` the one that people know."""
        member = self.make_member(offer, label, step)
        self._members.invited_count += 1
        self._members.by_id[member.id] = member
        yield from self._send(member, arrange, now, seconds)
        return member

    def make_member(self, offer: Offer, label: str, step: str) -> Member:
        """A participant as it would be, that is not asked."""
        number = self._members.invited_count + 1
        id = participant_id(offer.service, label, number)
        session = CoordinatorSession(transaction=self._transaction, participant=id, me=self._context.address, peer=offer.address)
        return Member(id=id, session=session, offer=offer, label=label, step=step, number=number)

    def accept(self, member: Member, terms: str, now: float) -> Effects:
        assert not self._members.held(member.step), "a step is one participant's at a time (FRP, property 1)"
        yield from self._send(member, frp.Accept(terms=terms), now, SILENCE)

    def execute(self, member: Member, execute: frp.Execute, now: float) -> Effects:
        yield from self._start_work(member, execute, now)

    def compensate(self, member: Member, situation: str, now: float) -> EffectsReturning[bool]:
        """Have it undo what it did. Whether it can be told to."""
        if frp.Compensate not in COORDINATOR_SENDS.get(member.state, {}):
            return False
        member.reported, member.lost_version = False, None
        yield from self._start_work(member, frp.Compensate(situation=situation), now)
        return True

    def _start_work(self, member: Member, body: frp.Execute | frp.Compensate, now: float) -> Effects:
        self._context.queues.add_work(member.offer.provider, AtWork(self._transaction, member.id))
        yield from self._send_order(member, body, now)
        yield from self._watch(member, now)

    def _send_order(self, member: Member, body: frp.Execute | frp.Compensate, now: float) -> Effects:
        """Told again, it is another message: what is still under way of the one before must not be obeyed for longer than that says."""
        member.begins_by = now + SILENCE
        member.last_order = structs.replace(body, begin_by=member.begins_by)
        yield from self._send(member, member.last_order, now, SILENCE)

    def dismiss(self, member: Member, reason: str, now: float) -> Effects:
        """It is not needed, and has not begun."""
        if frp.Cancel in COORDINATOR_SENDS.get(member.state, {}):
            yield from self._send(member, frp.Cancel(reason=reason), now, DISMISSAL_TIME)

    def stop(self, reason: str, now: float) -> Effects:
        """Whoever works shall stop, and the others go home, but for those that hear about the end with it."""
        for member in self._members:
            if member.state is State.EXECUTING:
                yield from self.halt(member, reason, now)
            else:
                yield from self.dismiss(member, reason, now)

    def halt(self, member: Member, reason: str, now: float) -> Effects:
        """Have it stop what it executes."""
        yield from self._send(member, frp.Stop(reason=reason), now, SILENCE)

    def end(self, outcome: Outcome, now: float) -> Effects:
        """End goes to everyone that was ever committed (FRP, property 6)."""
        for member in self._members:
            if member.state in WORKING:
                yield from self.give_up_member(member)
            member.final_state = member.state
            if frp.End in COORDINATOR_SENDS.get(member.state, {}):
                yield from self._send(member, frp.End(outcome=outcome), now, DISMISSAL_TIME)
            else:
                yield from self.dismiss(member, "the task is over", now)

    def forget(self, had_steps: Iterable[str | None]) -> None:
        """Once the transaction is over: all but those that were given up, whose report may still come. Of those that had steps is told
        who they were."""
        self._members.former = {id: self._members.by_id[id] for id in had_steps if id is not None and id in self._members.by_id}
        self._members.by_id = {member.id: member for member in self._members if member.lost_version is not None and not member.reported}

    def _send(self, member: Member, body: CoordinatorBody, now: float, seconds: float) -> Effects:
        message = member.session.send(body)
        self._mark_changed(member)
        self._log_message(now, message)
        yield Send(message, now + seconds)

    def _mark_changed(self, member: Member) -> None:
        """Its contract changed."""
        self._context.touched[self._transaction] = None
        self._members.change_count += 1
        member.change_number = self._members.change_count

    # Hearing

    def receive(self, message: Message, now: float) -> EffectsReturning[tuple[Member, ReceiveResult] | None]:
        """Who said it, and what it meant; None when it is from nobody that was invited."""
        member = self._members.find_member(message.header.participant)
        if member is None:
            yield from answer_stranger(message, self._context.address)
            return None
        transition = member.session.receive(message)
        if transition.state is not transition.state_before:
            self._mark_changed(member)
        self._log_message(now, message)
        for answer in transition.answers:
            self._log_message(now, answer)
            yield Send(answer)
        member.last_heard_time, member.queried = now, False
        if transition.moved:
            member.begins_by = 0.0
        elif (
            isinstance(message.body, frp.Status)
            and message.body.state in UNREACHED_STATES.get(member.state, ())
            and member.last_order is not None
        ):
            yield from self._send_order(member, member.last_order, now)
        if transition.state_before in WORKING and transition.state not in WORKING:
            yield from self._unwatch(member)
        elif transition.state_before not in WORKING and transition.state in WORKING:
            yield from self._watch(member, now)
        return member, transition

    def delivery_failed(self, message: Message, reason: str, now: float) -> EffectsReturning[Member | None]:
        """A message never arrived. The participant, if it is out because of that."""
        member = self._members.find_member(message.header.participant)
        if member is None:
            return None
        trouble = f"could not be reached: {reason}"
        match message.body:
            case frp.Arrange() if member.state is State.ARRANGING:
                yield from self.dismiss(member, trouble, now)
            case frp.Accept() if member.state is State.COMMITTED:
                yield from self.give_up_member(member)
            case frp.Stop() if member.state is State.STOPPING:
                yield Send(message, now + SILENCE)
                return None
            case _:
                return None
        member.exit_reason = trouble
        self._mark_changed(member)
        return member

    # Silence, and lateness

    def silent(self, participant: str, now: float) -> EffectsReturning[Member | None]:
        """The heartbeat of one that works may have stopped: ask it, and after as long again give it up, and return it. One that was
        never heard to begin may have begun at the last moment at which it might, and is waited for from then on."""
        member = self._members.find_member(participant)
        if member is None or member.state not in WORKING:
            return None
        if now - member.last_heard_time < SILENCE - 0.001:
            yield SetTimer(self._silence(member), member.last_heard_time + SILENCE)
        elif not member.queried:
            member.queried = True
            rest_time = _rest_time(member, now)
            yield from self._send(member, frp.Query(), now, rest_time - now)
            yield SetTimer(self._silence(member), rest_time)
            self._log_event(events.ServiceSilent(service=member.offer.service), now)
        else:
            yield from self.give_up_member(member)
            return member
        return None

    def overdue(self, participant: str, now: float) -> EffectsReturning[Member | None]:
        """It takes far longer than it said. One that executes is stopped; one that undoes is sent home, which stops it, too; one that
        does not come to an end then is given up, and returned."""
        member = self._members.find_member(participant)
        if member is None or not (member.state in WORKING or member.halting):
            return None
        if member.state is State.COMPENSATING:
            self._log_event(events.ServiceOverdue(service=member.offer.service, undoing=True), now)
            yield from self.force_end(member, now)
            return None
        if member.halting:
            member.halting = False
            return member
        if member.state is State.EXECUTING:
            self._log_event(events.ServiceOverdue(service=member.offer.service), now)
            yield from self.halt(member, "it takes far longer than it said", now)
            yield SetTimer(self._overdue(member), now + LEAST_TIME)
            return None
        yield from self.give_up_member(member)
        return member

    def force_end(self, member: Member, now: float) -> Effects:
        """It does not come to an end of undoing its work: an End stops that, too. `overdue` returns it once it stands still."""
        yield from self.give_up_member(member)
        yield from self._send(member, frp.End(outcome=Outcome.FAILED), now, DISMISSAL_TIME)
        member.halting = True
        yield SetTimer(self._overdue(member), _rest_time(member, now))

    def give_up_member(self, member: Member) -> Effects:
        """It may do anything from now on, but nobody waits for it."""
        if member.session.abandon():
            self._mark_changed(member)
            member.lost_version = self._context.replica.version
            yield from self._unwatch(member)

    def _watch(self, member: Member, now: float) -> Effects:
        member.last_heard_time, member.queried = now, False
        terms = member.session.terms
        seconds = max(LEAST_TIME, LATENESS * terms.duration if terms is not None else 0.0)
        start = max(now, member.bid.start if member.bid is not None else now)
        yield SetTimer(self._silence(member), now + SILENCE)
        yield SetTimer(self._overdue(member), start + seconds)

    def _unwatch(self, member: Member) -> Effects:
        yield SetTimer(self._silence(member), None)
        yield SetTimer(self._overdue(member), None)

    def _silence(self, member: Member) -> SilenceDue:
        return SilenceDue(self._transaction, member.id)

    def _overdue(self, member: Member) -> OverdueDue:
        return OverdueDue(self._transaction, member.id)


def _rest_time(member: Member, now: float) -> float:
    """When one that says nothing more has stopped. If it was not heard to begin, it may until the last moment at which it might."""
    return max(now + SILENCE, member.begins_by + 2 * SILENCE)


def answer_stranger(message: Message, address: str) -> list[Effect]:
    """The answers to one that takes part in nothing that is known here, such as a transaction that is long over."""
    header = message.header
    if header.transaction is None or header.participant is None:
        return []
    peer = header.sender if header.reply_to == ANONYMOUS else header.reply_to
    session = CoordinatorSession(transaction=header.transaction, participant=header.participant, me=address, peer=peer)
    return [Send(answer) for answer in session.receive(message).answers]
