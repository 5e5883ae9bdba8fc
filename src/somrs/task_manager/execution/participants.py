"""The participants of one transaction as the coordinator sees them: the messages to and from them, and their timeouts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

from msgspec import structs

from somrs.kernel.component import Effects, EffectsReturning, Send, SetTimer
from somrs.ontology.modes import stands_still
from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.session import CoordinatorBody, ReceiveResult, participant_id
from somrs.protocol.frp.states import COORDINATOR_SENDS, REPORTED_STATES, UNREACHED_STATES, WORKING, Kind
from somrs.protocol.messages import events, frp
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import Outcome, State
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.device_queue import AtWork
from somrs.task_manager.execution.member import Member, Members
from somrs.task_manager.execution.senders import answer_stranger, follow_address
from somrs.task_manager.execution.translation import Translation
from somrs.task_manager.timers import OverdueDue, SilenceDue

SILENCE = 20.0
"""Seconds without a message after which a working service is queried, and seconds that it has to answer; more if all are late."""

DISMISSAL_TIME = 86_400.0
"""Seconds for which End and Cancel are sent again: a device that is down may return, and has to learn that it is free."""

LATENESS = 10.0
"""A service is stopped after so many times its promised duration; later if the work of others takes longer than promised, too."""

LEAST_TIME = 60.0
"""Minimum seconds before a service is stopped, however short its promised duration is."""


EventLogger = Callable[[Event, float], None]
"""Logs an event for the client."""

MessageLogger = Callable[[float, Message], None]
"""Logs a message that was sent or received."""


class Participants:
    """Exchanges messages with the participants. A participant joins with `invite`, and leaves with Cancel or End."""

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

    # Sending

    def invite(self, offer: Offer, label: str, step: str, arrange: frp.Arrange, now: float, seconds: float) -> EffectsReturning[Member]:
        """Ask a service for terms within `seconds`, as a new participant even if it was asked before.

        `step` is the step's key, which is unique among all plans of the transaction; `label` is its name for people.
        """
        member = self.make_member(offer, label, step)
        member.last_heard_time = now
        self._members.invited_count += 1
        self._members.by_id[member.id] = member
        yield from self._send(member, arrange, now, seconds)
        return member

    def make_member(self, offer: Offer, label: str, step: str) -> Member:
        """The next participant, which is not invited yet."""
        number = self._members.invited_count + 1
        id = participant_id(offer.service, label, number)
        session = CoordinatorSession(transaction=self._transaction, participant=id, me=self._context.address, peer=offer.address)
        return Member(id=id, session=session, offer=offer, label=label, step=step, number=number)

    def accept(self, member: Member, terms: str, now: float) -> Effects:
        assert not self._members.held(member.step), "a step belongs to one participant at a time (FRP, property 1)"
        yield from self._send(member, frp.Accept(terms=terms), now, self._silence_time)

    def execute(self, member: Member, execute: frp.Execute, now: float) -> Effects:
        yield from self._start_work(member, execute, now)

    def compensate(self, member: Member, situation: str, now: float) -> EffectsReturning[bool]:
        """Order a participant to compensate its work. Returns whether its state allows that."""
        if frp.Compensate not in COORDINATOR_SENDS.get(member.state, {}):
            return False
        member.reported, member.lost_version = False, None
        yield from self._start_work(member, frp.Compensate(situation=situation), now)
        return True

    def _start_work(self, member: Member, body: frp.Execute | frp.Compensate, now: float) -> Effects:
        if member.offer.occupies:
            self._context.queues.add_work(member.offer.provider, AtWork(self._transaction, member.id))
        member.last_order_time = now
        yield from self._send_order(member, body, now)
        yield from self._watch(member, now)

    def _send_order(self, member: Member, body: frp.Execute | frp.Compensate, now: float) -> Effects:
        """Send an order. A repeated order is a new message, so that `begin_by` of the earlier message keeps its meaning."""
        member.begins_by = now + self._silence_time
        member.last_order = structs.replace(body, begin_by=member.begins_by)
        yield from self._send(member, member.last_order, now, self._silence_time)

    def is_unreached(self, member: Member, body: object) -> bool:
        """Whether the message shows that the last order has not arrived."""
        return isinstance(body, frp.Status) and member.last_order is not None and body.state in UNREACHED_STATES.get(member.state, ())

    def has_reported(self, member: Member, body: object) -> bool:
        """Whether the message shows that the participant has sent a report that has not come."""
        return isinstance(body, frp.Status) and body.state in REPORTED_STATES.get(member.state, ())

    def ask_for_report(self, member: Member, status: frp.Status, now: float) -> Effects:
        """Have a participant repeat its report. One that somebody else has stopped repeats it in answer to a Stop."""
        if member.state is State.EXECUTING and status.state is State.STOPPED:
            yield from self.halt(member, "it was stopped already", now)
            return
        for message in member.session.last_order():
            self._log_message(now, message)
            yield Send(self._translation(member).outgoing(message), now + self._silence_time)

    def order_again(self, member: Member, now: float) -> Effects:
        """Repeat the last order."""
        assert member.last_order is not None, "there is an order that has not arrived"
        yield from self._send_order(member, member.last_order, now)

    def dismiss(self, member: Member, reason: str, now: float) -> Effects:
        """Cancel a participant that is not needed, if it has not begun."""
        if frp.Cancel in COORDINATOR_SENDS.get(member.state, {}):
            yield from self._send(member, frp.Cancel(reason=reason), now, DISMISSAL_TIME)

    def stop(self, reason: str, now: float) -> Effects:
        """Stop the executing participants, and cancel those that have not begun. The others receive End later."""
        for member in self._members:
            if member.state is State.EXECUTING:
                yield from self.halt(member, reason, now)
            else:
                yield from self.dismiss(member, reason, now)

    def halt(self, member: Member, reason: str, now: float) -> Effects:
        """Order a participant to stop its execution."""
        yield from self._send(member, frp.Stop(reason=reason), now, self._silence_time)

    def end(self, outcome: Outcome, now: float) -> Effects:
        """Send End to all participants that were ever committed (FRP, property 6), and cancel the others."""
        for member in self._members:
            if member.state in WORKING:
                yield from self.give_up_member(member)
            member.final_state = member.state
            if frp.End in COORDINATOR_SENDS.get(member.state, {}):
                yield from self._send(member, frp.End(outcome=outcome), now, DISMISSAL_TIME)
            else:
                yield from self.dismiss(member, "the task is over", now)

    def forget(self, had_steps: Iterable[str | None]) -> None:
        """Drop the participants of an ended transaction, except those that were given up and may still report.

        `had_steps`: the ids of participants that clients still see, as `former`.
        """
        self._members.former = {id: self._members.by_id[id] for id in had_steps if id is not None and id in self._members.by_id}
        self._members.by_id = {member.id: member for member in self._members if member.lost_version is not None and not member.reported}

    def _send(self, member: Member, body: CoordinatorBody, now: float, seconds: float) -> Effects:
        message = member.session.send(body)
        self._mark_changed(member)
        self._log_message(now, message)
        yield Send(self._translation(member).outgoing(message), now + seconds)

    def _translation(self, member: Member) -> Translation:
        replica = self._context.replica
        return Translation(member.offer.provider, replica.map, replica.ontology)

    def _mark_changed(self, member: Member) -> None:
        """Record that the participant's contract has changed."""
        self._context.touched[self._transaction] = None
        self._members.change_count += 1
        member.change_number = self._members.change_count

    # Receiving

    def receive(self, message: Message, now: float) -> EffectsReturning[tuple[Member, ReceiveResult, Message] | None]:
        """Handle a message. Returns its participant, its meaning and itself in the names of the map here; None for a stranger's."""
        member = self._members.find_member(message.header.participant)
        if member is None:
            yield from answer_stranger(message, self._context.address)
            return None
        message = self._translation(member).incoming(message)
        if message.header.sender != member.session.peer:
            follow_address(member, self._context.directory)
        transition = member.session.receive(message)
        if transition.kind is Kind.FOREIGN:
            for answer in transition.answers:
                yield Send(answer)
            return None
        if transition.state is not transition.state_before:
            self._mark_changed(member)
        self._log_message(now, message)
        for answer in transition.answers:
            self._log_message(now, answer)
            yield Send(self._translation(member).outgoing(answer))
        self._record_pace(member, transition.state_before, message, now)
        member.last_heard_time, member.queried = now, False
        if transition.moved:
            member.begins_by = 0.0
        if transition.state_before in WORKING and transition.state not in WORKING:
            yield from self._unwatch(member)
        elif transition.state_before not in WORKING and transition.state in WORKING:
            yield from self._watch(member, now)
        return member, transition, message

    def _record_pace(self, member: Member, state_before: State, message: Message, now: float) -> None:
        """Record how long the answer to Arrange took, or the time since the last message from a working participant."""
        if state_before is State.ARRANGING and isinstance(message.body, frp.Terms | frp.Refuse):
            self._context.pace.answered(now - member.last_heard_time)
        elif state_before in WORKING:
            self._context.pace.heard(now - member.last_heard_time)

    def delivery_failed(self, message: Message, reason: str, now: float) -> EffectsReturning[Member | None]:
        """Handle a message that could not be delivered. Returns the participant if it leaves because of that."""
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
                yield Send(message, now + self._silence_time)
                return None
            case _:
                return None
        member.exit_reason = trouble
        self._mark_changed(member)
        return member

    # Timeouts

    def silent(self, participant: str, now: float) -> EffectsReturning[Member | None]:
        """Check the heartbeat of a working participant. Returns the participant if it is given up.

        A silent participant is queried first, and given up if it does not answer in time. If its start was not confirmed, the time counts
        from the last moment at which it may have begun.
        """
        member = self._members.find_member(participant)
        if member is None or member.state not in WORKING:
            return None
        silence = self._silence_time
        if now - member.last_heard_time < silence - 0.001:
            yield SetTimer(self._silence(member), member.last_heard_time + silence)
        elif not member.queried:
            member.queried = True
            rest_time = self._rest_time(member, now)
            yield from self._send(member, frp.Query(), now, rest_time - now)
            yield SetTimer(self._silence(member), rest_time)
            self._log_event(events.ServiceSilent(service=member.offer.service), now)
        else:
            yield from self.give_up_member(member)
            return member
        return None

    def overdue(self, participant: str, now: float) -> EffectsReturning[Member | None]:
        """Handle a participant that takes far longer than it promised. Returns the participant if it is given up.

        An executing participant receives Stop. A compensating participant receives End, which also stops it. Either is given up if that
        has no effect.
        """
        member = self._members.find_member(participant)
        if member is None or not (member.state in WORKING or member.halting):
            return None
        if stands_still(member.offer.provider, self._context.replica.map, self._context.replica.ontology):
            yield SetTimer(self._overdue(member), now + self._silence_time)
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
            yield SetTimer(self._overdue(member), now + self._context.pace.silence(LEAST_TIME))
            return None
        yield from self.give_up_member(member)
        return member

    def resumed(self, devices: Collection[str], now: float) -> Effects:
        """Give the work of devices that had been stopped its whole time again."""
        for member in self._members.working:
            if member.offer.provider in devices and not member.halting:
                yield from self._watch(member, now)

    def services_joined(self, services: Iterable[str], now: float) -> Effects:
        """Follow devices to other addresses. Those at work are asked how far they are: what they reported from there was refused. Those
        that were given up are asked, too: one that has lost its contract says so, and no report of it is awaited any more."""
        joined = {*services}
        for member in self._members:
            if member.offer.service not in joined:
                continue
            is_elsewhere = follow_address(member, self._context.directory)
            if is_elsewhere:
                self._mark_changed(member)
            was_given_up = member.lost_version is not None and member.is_awaited
            if was_given_up or (is_elsewhere and member.state in WORKING):
                yield from self._send(member, frp.Query(), now, self._silence_time)

    def hindered(self, member: Member, now: float) -> Effects:
        """Give the work of a participant that cannot go on now its whole time again."""
        if member.state in (State.EXECUTING, State.COMPENSATING) and not member.halting:
            yield from self._watch(member, now)

    def force_end(self, member: Member, now: float) -> Effects:
        """Send End to a participant that does not finish its compensation. `overdue` returns it when it must have stopped."""
        yield from self.give_up_member(member)
        yield from self._send(member, frp.End(outcome=Outcome.FAILED), now, DISMISSAL_TIME)
        member.halting = True
        yield SetTimer(self._overdue(member), self._rest_time(member, now))

    def give_up_member(self, member: Member) -> Effects:
        """Stop waiting for a participant, although its device may still act."""
        if member.session.abandon():
            self._mark_changed(member)
            member.lost_version = self._context.replica.version
            yield from self._unwatch(member)

    def _watch(self, member: Member, now: float) -> Effects:
        member.last_heard_time, member.queried = now, False
        terms = member.session.terms
        seconds = max(LEAST_TIME, self._context.pace.stretch(LATENESS * terms.duration) if terms is not None else 0.0)
        start = max(now, member.bid.start if member.bid is not None else now)
        yield SetTimer(self._silence(member), now + self._silence_time)
        yield SetTimer(self._overdue(member), start + seconds)

    def _unwatch(self, member: Member) -> Effects:
        yield SetTimer(self._silence(member), None)
        yield SetTimer(self._overdue(member), None)

    @property
    def _silence_time(self) -> float:
        """Seconds without a message after which a working service is silent, measured against the intervals of all services."""
        return self._context.pace.silence(SILENCE)

    def _rest_time(self, member: Member, now: float) -> float:
        """When a silent participant must have stopped. If its start was not confirmed, it may have begun as late as `begins_by`."""
        return max(now + self._silence_time, member.begins_by + 2 * self._silence_time)

    def _silence(self, member: Member) -> SilenceDue:
        return SilenceDue(self._transaction, member.id)

    def _overdue(self, member: Member) -> OverdueDue:
        return OverdueDue(self._transaction, member.id)
