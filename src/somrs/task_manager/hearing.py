"""What the participants of one transaction say, or fail to say, and what comes of it: news for the client, a situation for the map, and
what became of work, so that the transaction can go on.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Protocol

from somrs.entish.parse import parse
from somrs.protocol.messages import frp
from somrs.protocol.messages.clients import EventKind
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.task_manager.looking import Looks
from somrs.task_manager.offered import Offered
from somrs.task_manager.participants import Member, Participants
from somrs.task_manager.pursuit import Pursuit
from somrs.task_manager.reports import Reports
from somrs.task_manager.work import Ledger
from somrs.task_manager.workflow import Progress, StepRun


class Owner(Protocol):
    """The transaction that they take part in."""

    outcome: Outcome | None
    ledger: Ledger
    participants: Participants
    offered: Offered
    reports: Reports
    looks: Looks

    @property
    def ending(self) -> bool:
        """Whether it was called off: who stops then stops because it was told to."""

    @property
    def pursuits(self) -> Iterable[Pursuit]: ...

    def tell(self, now: float, text: str, run: StepRun | None = None, kind: EventKind = EventKind.NEWS) -> None: ...

    def proceed(self, now: float) -> None:
        """Do whatever comes next."""


class Hearing:
    """Hears each message once it is known whose it is, and notices who falls silent."""

    def __init__(self, owner: Owner) -> None:
        self._owner = owner

    def receive(self, message: Message, now: float) -> None:
        """A message of the protocol from a participant."""
        received = self._owner.participants.receive(message, now)
        if received is None:
            return
        member, heard = received
        if heard.moved:
            self._heard(member, message, now)
        elif member.lost_at is not None:
            self._heard_late(member, message, now)

    def undelivered(self, message: Message, reason: str, now: float) -> None:
        """A message never arrived."""
        member = self._owner.participants.undelivered(message, reason, now)
        if member is not None:
            self._left(member, member.last_word, now)

    def _at(self, member: Member) -> tuple[Pursuit, StepRun] | tuple[None, None]:
        """What the participant is asked for, is committed to, or does."""
        for pursuit in self._owner.pursuits:
            if (run := pursuit.run_of(member)) is not None:
                return pursuit, run
        return None, None

    def _heard(self, member: Member, message: Message, now: float) -> None:
        name = member.offer.service
        pursuit, run = self._at(member)
        match message.body:
            case frp.Terms() as terms if pursuit is not None:
                pursuit.offers(member, terms, message.header.message_id, now)
            case frp.Refuse(reason=reason):
                self._owner.tell(now, f"{name} refuses: {reason}", run)
                self._left(member, reason, now)
            case frp.Progress() as progress:
                self._progressed(member, run, progress, now)
            case frp.Completed(situation=situation):
                member.fraction = 1.0
                self._owner.tell(now, f"{name} completed: {situation}", run)
                self._reported(member, situation, None, now)
            case frp.Failed(description=description, tried=False) if member.lost_at is None:
                self._owner.tell(now, f"{name} did not begin: {description}", run, EventKind.SETBACK)
                self._left(member, description, now)
            case frp.Failed(description=description, situation=situation):
                self._owner.tell(now, f"{name} failed: {description}", run, EventKind.SETBACK)
                self._reported(member, situation, f"failed: {description}", now)
            case frp.Stopped(situation=situation):
                self._owner.tell(now, f"{name} stopped", run)
                self._reported(member, situation, "stopped", now)
            case frp.Compensated(situation=situation):
                self._owner.tell(now, f"{name} compensated: {situation}", run, EventKind.UNDO)
                self._reported(member, situation, None, now)
            case frp.Stranded(description=description, situation=situation):
                self._owner.tell(now, f"{name} could not undo it: {description}", run, EventKind.SETBACK)
                self._reported(member, situation, description, now)
            case frp.Fault(text=text) if member.state is State.ENDED:
                self._left(member, text, now)
            case frp.Fault(text=text) if member.state in (State.FAILED, State.STRANDED):
                self._owner.tell(now, f"{name}: {text}", run, EventKind.SETBACK)
                self._reported(member, None, text, now)
            case frp.Status() if member.state in (State.FAILED, State.STRANDED):
                self._owner.tell(now, f"{name} has forgotten its contract", run, EventKind.SETBACK)
                self._reported(member, None, "it has forgotten its contract", now)

    def _progressed(self, member: Member, run: StepRun | None, progress: frp.Progress, now: float) -> None:
        member.fraction = progress.fraction
        if progress.note and progress.note != member.note:
            self._owner.tell(now, f"{member.offer.service}: {progress.note}", run)
            member.note = progress.note
        if progress.situation is not None:
            if (work := self._owner.ledger.of(member)) is not None:
                work.situation = progress.situation
            self._put_on_map(member, progress.situation, partial(self._noted, member), now)

    def _left(self, member: Member, reason: str, now: float) -> None:
        """A participant is out before it did anything."""
        member.last_word = reason
        work = self._owner.ledger.of(member)
        if work is not None and work.state is State.EXECUTING:
            self._owner.ledger.drop(work)  # its terms, or its time to begin, had run out before it was told to start
        pursuit, _ = self._at(member)
        if pursuit is not None:
            pursuit.left(member, reason, now)
        else:
            self._owner.proceed(now)

    def _reported(self, member: Member, situation: str | None, trouble: str | None, now: float) -> None:
        """A participant's work, or its undoing, is over. What it left is on the map before anything is planned or arranged on it."""
        member.reported = True
        _, run = self._at(member)
        if run is not None:
            run.progress = Progress.REPORTING
        if (work := self._owner.ledger.of(member)) is not None:
            work.end(member.state, now)
            if member.state is not State.STRANDED and work.state not in (State.COMPENSATED, State.STRANDED):
                work.state = member.state
            work.situation = situation or work.situation
            work.note = trouble or work.note
        for pursuit in self._owner.pursuits:
            pursuit.upset(f"{member.offer.service} reported while it was planned")
        if situation is not None:
            member.reporting = True
            self._put_on_map(member, situation, partial(self._settled, member, situation, trouble), now)
        else:
            self._over(member, None, trouble, now)
            self._owner.proceed(now)

    def _put_on_map(self, member: Member, situation: str, then: partial[None], now: float) -> None:
        update = UpdateMap(situation=situation, author=member.offer.service, expected_version=member.lost_at)
        self._owner.reports.put(update, then, now)

    def _noted(self, member: Member, problem: str | None, now: float) -> None:
        if problem is not None:
            _, run = self._at(member)
            self._owner.tell(now, f"the Repository rejects what {member.offer.service} reports: {problem}", run, EventKind.SETBACK)

    def _settled(self, member: Member, situation: str, trouble: str | None, problem: str | None, now: float) -> None:
        self._noted(member, problem, now)
        if problem is None:
            self._over(member, situation, trouble, now)
        else:
            self._over(member, None, trouble or f"reported an impossible situation: {problem}", now)

    def _over(self, member: Member, situation: str | None, trouble: str | None, now: float) -> None:
        """What became of a participant's work is known; what comes of that, `proceed` finds."""
        member.reporting = False
        work = self._owner.ledger.of(member)
        compensated = member.state in (State.COMPENSATED, State.STRANDED)
        called_off = member.state is State.STOPPED and self._owner.ending
        if trouble is not None and not compensated and not called_off:
            self._owner.offered.failed(member.offer.service, trouble)
            if work is not None and work.state is State.COMPLETED:
                work.state, work.result, work.note = State.FAILED, State.FAILED, trouble  # its report was impossible
        elif member.state is State.COMPLETED:
            self._owner.offered.completed(member.offer.service)
        pursuit, run = self._at(member)
        if pursuit is not None and run is not None and run.progress is Progress.REPORTING:
            pursuit.over(run, situation, trouble)
        tried = member.state is State.STRANDED and member.tried_to_undo
        silent_about = work is not None and (tried or not compensated) and (situation is None or not work.is_told_of_by(parse(situation)))
        if work is not None and trouble is not None and silent_about and not called_off:
            self._owner.looks.want(work)

    def _heard_late(self, member: Member, message: Message, now: float) -> None:
        """One that was given up, and has had its End, says what became of its work: the map has to know that, too."""
        match message.body:
            case frp.Completed(situation=str(situation)) | frp.Failed(situation=str(situation)) | frp.Stopped(situation=str(situation)):
                if not member.reported:
                    member.reported = True
                    self._put_on_map(member, situation, partial(self._noted, member), now)

    # Silence

    def silent(self, participant: str, now: float) -> None:
        """The heartbeat of a working service may have stopped."""
        member = self._owner.participants.silent(participant, now)
        if member is not None and self._owner.outcome is None:
            self.lost(member, "fell silent while it worked", now)

    def overdue(self, participant: str, now: float) -> None:
        """A working service may take far longer than it said."""
        member = self._owner.participants.overdue(participant, now)
        if member is not None and self._owner.outcome is None:
            self.lost(member, "did not come to an end", now)

    def lost(self, member: Member, reason: str, now: float) -> None:
        """It may do anything now. Its own limits see to it that it has stopped; what it left has to be found out."""
        pursuit, run = self._at(member)
        self._owner.tell(now, f"{member.offer.service} {reason}; nothing is known of what it left", run, EventKind.SETBACK)
        self._owner.offered.lost(member.offer.service, reason)
        if (work := self._owner.ledger.of(member)) is not None:
            work.end(State.UNREACHABLE, now)
            work.state, work.note = State.UNREACHABLE, reason
            self._owner.looks.want(work)
        if pursuit is not None and run is not None:
            run.excluded[member.offer.service] = reason
            run.lose(f"{member.offer.service} {reason}")
        self._owner.proceed(now)
