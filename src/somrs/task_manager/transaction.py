"""One task from the client's wish to its end (paper, "Protocol for failure handling and recovery": the realization of a task is a
transaction).

It pursues the wish, and whatever has to be so on the way, one thing at a time (`pursuit.py`); hears the participants, and has what they
report put on the map; has somebody look where nobody reports (`looking.py`); and undoes what was done when it ends otherwise than
wanted (`compensation.py`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from somrs.entish.parse import parse
from somrs.ontology.services import Handler, Occasion
from somrs.planner.plan import Plan
from somrs.protocol import frp
from somrs.protocol.clients import EventKind, Phase, Submit, TaskEvent
from somrs.protocol.component import Record, Wake
from somrs.protocol.envelope import Message
from somrs.protocol.frp import Outcome, State
from somrs.protocol.knowledge import UpdateMap
from somrs.task_manager.compensation import Undoing
from somrs.task_manager.handlers import fitting
from somrs.task_manager.looking import Look, Looks
from somrs.task_manager.offered import Offered
from somrs.task_manager.participants import Member, Participants
from somrs.task_manager.pursuit import Purpose, Pursuit
from somrs.task_manager.records import record
from somrs.task_manager.reports import Reports
from somrs.task_manager.setting import Setting
from somrs.task_manager.work import INTERRUPTED, Ledger, Work
from somrs.task_manager.workflow import Progress, StepRun

STOP_TIME = 60.0
"""Seconds that everybody has to stop safely; who has not by then is given up."""


class Transaction:
    """The state of one task. `client` is who wants it."""

    def __init__(self, id: str, task: Submit, setting: Setting, now: float, client: str = "") -> None:
        self.id, self.task, self.setting, self.submitted_at, self.client = id, task, setting, now, client
        self.outcome: Outcome | None = None
        self.ended_at: float | None = None
        self.explanation = ""
        self.events: list[TaskEvent] = []
        self.messages: list[tuple[float, Message]] = []
        """Of the protocol, until the end: then they are recorded."""
        self.ledger = Ledger()
        self.participants = Participants(id, setting, partial(self.tell, kind=EventKind.SETBACK), self._note)
        self.offered = Offered(replica=setting.replica)
        self.reports = Reports(setting, self.proceed)
        self._numbers = 1
        self.wish = Pursuit(1, task.effect, Purpose.WISH, self)
        self._aside: list[Pursuit] = []
        """What is pursued before the wish is gone on with; the last one is what goes on."""
        self._looks = Looks(self)
        self._undoing: Undoing | None = None
        self._blocked = ""
        """Why there is no plan, while what failures left is undone."""
        self._ending: Outcome | None = None
        """How it will end once everything under way has stopped, and is undone."""

    @property
    def phase(self) -> Phase:
        """How far it is."""
        if self.outcome is not None:
            return Phase.ENDED
        if self._undoing is not None:
            return Phase.COMPENSATING
        if self._ending is not None or self._aside or self._looks.asking:
            return Phase.RECOVERING
        return self.wish.phase

    @property
    def latest(self) -> float | None:
        return self.submitted_at + self.task.deadline if self.task.deadline is not None and self._ending is None else None

    @property
    def pursuits(self) -> Iterator[Pursuit]:
        yield self.wish
        yield from self._aside

    # What comes

    def start(self, now: float) -> None:
        self.tell(now, f"task: {self.task.effect}")
        if self.latest is not None:
            self._wake("deadline", self.latest)
        self.wish.begin(now)

    def planned(self, question: str, found: object, now: float) -> None:
        """The planner's answer."""
        for pursuit in [*self.pursuits]:
            pursuit.planned(question, found, now)

    def bids_due(self, number: str, now: float) -> None:
        for pursuit in [*self.pursuits]:
            if pursuit.is_asked_by(number):
                pursuit.bids_due(now)

    def receive(self, message: Message, now: float) -> None:
        """A message of the protocol from a participant."""
        received = self.participants.receive(message, now)
        if received is None:
            return
        member, heard = received
        if heard.moved:
            self._heard(member, message, now)
        elif member.lost_at is not None:
            self._heard_late(member, message, now)

    def undelivered(self, message: Message, reason: str, now: float) -> None:
        """A message never arrived."""
        member = self.participants.undelivered(message, reason, now)
        if member is not None:
            self._left(member, member.last_word, now)

    def silent(self, participant: str, now: float) -> None:
        """The heartbeat of a working service may have stopped."""
        member = self.participants.silent(participant, now)
        if member is not None and self.outcome is None:
            self._lost(member, "fell silent while it worked; nothing is known of what it left", now)

    def overdue(self, participant: str, now: float) -> None:
        """A working service may take far longer than it said."""
        member = self.participants.overdue(participant, now)
        if member is not None and self.outcome is None:
            self._lost(member, "did not come to an end; nothing is known of what it left", now)

    def cancel(self, now: float, reason: str) -> None:
        """The client does not want it any more."""
        self._stop(now, Outcome.CANCELLED, reason or "cancelled by the client")

    def give_up(self, now: float, reason: str) -> None:
        """It cannot be done, and this is why."""
        self._stop(now, Outcome.FAILED, reason)

    # Going on

    def proceed(self, now: float) -> None:
        """Do whatever comes next. Nothing does while a report is on its way to the map (FRP, property 5)."""
        if self.outcome is not None or self.reports.pending or self._looks.asking:
            return
        if self._ending is not None and self._undoing is None and self.participants.working:
            return
        if self._looks.wanted:
            self._looks.begin(now)
        elif self._aside:
            self._aside[-1].proceed(now)
        elif self._undoing is not None:
            self._undo(self._undoing, now)
        elif self._ending is not None:
            self._wake("stop", None)
            self._undoing = Undoing(self.ledger.to_undo(), self, by_others=True)
            self._undo(self._undoing, now)
        else:
            self.wish.proceed(now)

    def _undo(self, undoing: Undoing, now: float) -> None:
        if not undoing.proceed(now):
            return
        if self._ending is not None:
            self._end(now, self._ending)
        else:
            self._undoing = None
            if undoing.restored:
                self.wish.again(now)
            else:
                self.give_up(now, self._blocked)

    # What pursuits say

    def reached(self, pursuit: Pursuit, now: float) -> None:
        """What was pursued is so."""
        if pursuit is self.wish:
            self._end(now, Outcome.ACCOMPLISHED)
            return
        self._aside.remove(pursuit)
        match pursuit.purpose:
            case Purpose.LOOK:
                self._looked(pursuit, now)
            case Purpose.UNDO if self._undoing is not None:
                self._undoing.achieved(now)
        self.proceed(now)

    def failed(self, pursuit: Pursuit, why: str, now: float) -> None:
        """What was pursued cannot be had."""
        if pursuit is self.wish:
            self.give_up(now, why)
            return
        self._aside.remove(pursuit)
        self.tell(now, f"{pursuit.purpose} for {pursuit.work.label if pursuit.work else 'the task'}: {why}", kind=EventKind.SETBACK)
        match pursuit.purpose:
            case Purpose.LOOK if pursuit.look is not None:
                self._looks.next_way(pursuit.look, now)
            case Purpose.UNDO if self._undoing is not None:
                if pursuit.work is not None:
                    pursuit.work.note = pursuit.work.note or why
                self._undoing.tried()
        self.proceed(now)

    def handled(self, run: StepRun, now: float) -> bool:
        """Whether a procedure that was laid down for the failure of the step is begun."""
        work = next((work for work in reversed(self.ledger.works) if work.step is run.step), None)
        if work is None or self._ending is not None:
            return False
        for handler in self.handlers(work, Occasion.FAILURE):
            if handler.effect not in run.handled:
                run.handled.add(handler.effect)
                self.tell(now, f"the step failed, and for that was laid down: {handler.effect}", run, EventKind.HANDLER)
                self._pursue(handler.effect, Purpose.HANDLER, work, now)
                return True
        return False

    def unblocked(self, pursuit: Pursuit, why: str, now: float) -> bool:
        """Whether what failures left can be undone by those that failed, so that there may be a plan again (FRP, third rung)."""
        works = [work for work in self.ledger.interrupted() if work.member.state in INTERRUPTED and work.member.lost_at is None]
        if pursuit is not self.wish or self._ending is not None or self._undoing is not None or not works:
            return False
        if self.wish.workflow is not None and self.wish.workflow.busy:
            return False
        self.tell(now, f"{why}; undoing what failed", kind=EventKind.UNDO)
        self._blocked = why
        self._undoing = Undoing(works, self, by_others=False)
        self.proceed(now)
        return True

    # What undoing says

    def handlers(self, work: Work, on: Occasion) -> list[Handler]:
        return fitting(self.task.handlers, work, on, self.setting.replica)

    def restore(self, goal: str, work: Work, now: float) -> None:
        self._pursue(goal, Purpose.UNDO, work, now)

    def tell_of(self, work: Work, text: str, now: float, kind: EventKind) -> None:
        self.events.append(TaskEvent(number=len(self.events) + 1, at=now, text=text, step=work.label, kind=kind))

    def _pursue(self, goal: str, purpose: Purpose, work: Work, now: float) -> None:
        self._numbers += 1
        pursuit = Pursuit(self._numbers, goal, purpose, self, work)
        self._aside.append(pursuit)
        pursuit.begin(now)

    # What participants say

    def _at(self, member: Member) -> tuple[Pursuit, StepRun] | tuple[None, None]:
        """What the participant is asked for, is committed to, or does."""
        for pursuit in self.pursuits:
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
                self.tell(now, f"{name} refuses: {reason}", run)
                self._left(member, reason, now)
            case frp.Progress() as progress:
                self._progressed(member, run, progress, now)
            case frp.Completed(situation=situation):
                member.fraction = 1.0
                self.tell(now, f"{name} completed: {situation}", run)
                self._reported(member, situation, None, now)
            case frp.Failed(description=description, situation=situation):
                self.tell(now, f"{name} failed: {description}", run, EventKind.SETBACK)
                self._reported(member, situation, f"failed: {description}", now)
            case frp.Stopped(situation=situation):
                self.tell(now, f"{name} stopped", run)
                self._reported(member, situation, "stopped", now)
            case frp.Compensated(situation=situation):
                self.tell(now, f"{name} compensated: {situation}", run, EventKind.UNDO)
                self._reported(member, situation, None, now)
            case frp.Stranded(description=description, situation=situation):
                self.tell(now, f"{name} could not undo it: {description}", run, EventKind.SETBACK)
                self._reported(member, situation, description, now)
            case frp.Fault(text=text) if member.state is State.ENDED:
                self._left(member, text, now)
            case frp.Fault(text=text) if member.state in (State.FAILED, State.STRANDED):
                self.tell(now, f"{name}: {text}", run, EventKind.SETBACK)
                self._reported(member, None, text, now)
            case frp.Status() if member.state in (State.FAILED, State.STRANDED):
                self.tell(now, f"{name} has forgotten its contract", run, EventKind.SETBACK)
                self._reported(member, None, "it has forgotten its contract", now)

    def _progressed(self, member: Member, run: StepRun | None, progress: frp.Progress, now: float) -> None:
        member.fraction = progress.fraction
        if progress.note and progress.note != member.note:
            self.tell(now, f"{member.offer.service}: {progress.note}", run)
        member.note = progress.note
        if progress.situation is not None:
            if (work := self.ledger.of(member)) is not None:
                work.situation = progress.situation
            self._put_on_map(member, progress.situation, partial(self._noted, member), now)

    def _left(self, member: Member, reason: str, now: float) -> None:
        """A participant is out before it did anything."""
        member.last_word = reason
        work = self.ledger.of(member)
        if work is not None and work.state is State.EXECUTING:
            self.ledger.drop(work)  # its terms had run out before it was told to start
        pursuit, _ = self._at(member)
        if pursuit is not None:
            pursuit.left(member, reason, now)

    def _reported(self, member: Member, situation: str | None, trouble: str | None, now: float) -> None:
        """A participant's work, or its undoing, is over. What it left is on the map before anything is planned or arranged on it."""
        member.reported = True
        _, run = self._at(member)
        if run is not None:
            run.progress = Progress.REPORTING
        if (work := self.ledger.of(member)) is not None:
            if member.state is not State.STRANDED and work.state not in (State.COMPENSATED, State.STRANDED):
                work.state = member.state
            work.situation = situation or work.situation
            work.note = trouble or work.note
        for pursuit in self.pursuits:
            pursuit.upset(f"{member.offer.service} reported while it was planned")
        if situation is not None:
            self._put_on_map(member, situation, partial(self._settled, member, situation, trouble), now)
        else:
            self._over(member, None, trouble, now)
            self.proceed(now)

    def _put_on_map(self, member: Member, situation: str, then: partial[None], now: float) -> None:
        update = UpdateMap(situation=situation, author=member.offer.service, expected_version=member.lost_at)
        self.reports.put(update, then, now)

    def _noted(self, member: Member, problem: str | None, now: float) -> None:
        if problem is not None:
            _, run = self._at(member)
            self.tell(now, f"the Repository rejects what {member.offer.service} reports: {problem}", run, EventKind.SETBACK)

    def _settled(self, member: Member, situation: str, trouble: str | None, problem: str | None, now: float) -> None:
        self._noted(member, problem, now)
        if problem is None:
            self._over(member, situation, trouble, now)
        else:
            self._over(member, None, trouble or f"reported an impossible situation: {problem}", now)

    def _over(self, member: Member, situation: str | None, trouble: str | None, now: float) -> None:
        """What became of a participant's work is known; what comes of that, `proceed` finds."""
        work = self.ledger.of(member)
        compensated = member.state in (State.COMPENSATED, State.STRANDED)
        called_off = member.state is State.STOPPED and self._ending is not None
        if trouble is not None and not compensated and not called_off:
            self.offered.broken[member.offer.service] = trouble
            if work is not None and work.state is State.COMPLETED:
                work.state, work.note = State.FAILED, trouble  # its report was impossible
        pursuit, run = self._at(member)
        if pursuit is not None and run is not None and run.progress is Progress.REPORTING:
            pursuit.over(run, situation, trouble)
        tried = member.state is State.STRANDED and member.tried_to_undo
        silent_about = work is not None and (tried or not compensated) and (situation is None or not work.is_told_of_by(parse(situation)))
        if work is not None and trouble is not None and silent_about and not called_off:
            self._looks.want(work)

    def _heard_late(self, member: Member, message: Message, now: float) -> None:
        """One that was given up, and has had its End, says what became of its work: the map has to know that, too."""
        match message.body:
            case frp.Completed(situation=str(situation)) | frp.Failed(situation=str(situation)) | frp.Stopped(situation=str(situation)):
                if not member.reported:
                    member.reported = True
                    self._put_on_map(member, situation, partial(self._noted, member), now)

    def look_by(self, plan: Plan, look: Look, now: float) -> None:
        self._numbers += 1
        pursuit = Pursuit(self._numbers, str(plan.steps[0].effect), Purpose.LOOK, self, look.work, look)
        self._aside.append(pursuit)
        pursuit.begin(now, plan)

    def _looked(self, pursuit: Pursuit, now: float) -> None:
        """The finding is on the map, as every report is; the step that was lost begins where it says."""
        assert pursuit.look is not None, "whoever looks knows for what"
        labels = {run.label for run in pursuit}
        finding = next((work.situation for work in reversed(self.ledger.works) if work.label in labels), None)
        lost = pursuit.look.work
        lost.situation = finding or lost.situation
        self.tell_of(lost, f"seen: {finding}", now, EventKind.LOOK)
        for other in self.pursuits:
            for run in other:
                if run.step is lost.step and run.failure is not None and finding is not None:
                    run.reported = parse(finding)

    # Silence

    def _lost(self, member: Member, reason: str, now: float) -> None:
        """It may do anything now. Its own limits see to it that it has stopped; what it left has to be found out."""
        pursuit, run = self._at(member)
        reason = f"{member.offer.service} {reason}"
        self.tell(now, reason, run, EventKind.SETBACK)
        self.offered.broken[member.offer.service] = reason
        if (work := self.ledger.of(member)) is not None:
            work.state, work.note = State.UNREACHABLE, reason
            self._looks.want(work)
        if pursuit is not None and run is not None:
            run.excluded[member.offer.service] = reason
            run.lose(reason)
        self.proceed(now)

    # Ending

    def _stop(self, now: float, outcome: Outcome, reason: str) -> None:
        if self.outcome is not None or self._ending is not None:
            return
        self._ending, self.explanation = outcome, reason
        for pursuit in self.pursuits:
            pursuit.abandon()
            if pursuit.look is not None:
                self._looks.again(pursuit.look)
        self._aside.clear()
        self._undoing = None
        self._looks.drop()
        self._wake("deadline", None)
        self.participants.stop(reason, now)
        self._wake("stop", now + STOP_TIME)
        self.proceed(now)

    def stop_overdue(self, now: float) -> None:
        """Not everybody has stopped in time."""
        if self.outcome is not None or self._ending is None:
            return
        for member in self.participants.working:
            if member.state is State.COMPENSATING:
                self.participants.send_home(member, now)
            elif not member.halting:
                self.participants.give_up(member)
                self._lost(member, "did not say that it stopped; nothing is known of what it left", now)
        self.proceed(now)

    def _end(self, now: float, outcome: Outcome) -> None:
        self.participants.end(outcome, now)
        self.outcome, self.ended_at = outcome, now
        if outcome is not Outcome.ACCOMPLISHED:
            self.explanation += "".join(f"; {work.in_words()}" for work in self.ledger if work.matters)
        for timer in ("deadline", "stop"):
            self._wake(timer, None)
        self.tell(now, f"{outcome}{f': {self.explanation}' if self.explanation else ''}", kind=EventKind.END)
        self.setting.effects.append(Record(record(self)))
        self.messages.clear()
        self.participants.forget()

    # Noting

    def tell(self, now: float, text: str, run: StepRun | None = None, kind: EventKind = EventKind.NEWS) -> None:
        """Something happened that the client wants to know."""
        self.events.append(TaskEvent(number=len(self.events) + 1, at=now, text=text, step=run.label if run else None, kind=kind))

    def _note(self, now: float, message: Message) -> None:
        if self.outcome is None:
            self.messages.append((now, message))

    def _wake(self, timer: str, at: float | None) -> None:
        self.setting.effects.append(Wake(f"{self.id}/{timer}", at))
