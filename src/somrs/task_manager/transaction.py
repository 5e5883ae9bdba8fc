"""One task from the client's wish to its end (paper, "Protocol for failure handling and recovery": the realization of a task is a
transaction).

It pursues the wish, and whatever has to be so on the way, one thing at a time (`pursuit.py`); hears the participants, and has what they
report put on the map (`hearing.py`); has somebody look where nobody reports (`looking.py`); and undoes what was done when it ends
otherwise than wanted (`compensation.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial

from somrs.entish.parse import parse
from somrs.kernel.component import Record, Wake
from somrs.ontology.services import Handler, Occasion
from somrs.planner.model.plan import Plan
from somrs.protocol.messages.clients import EventKind, Phase, Submit, TaskEvent
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Outcome, State
from somrs.task_manager.claims import Claim
from somrs.task_manager.compensation import Undoing
from somrs.task_manager.handlers import fitting
from somrs.task_manager.hearing import Hearing
from somrs.task_manager.looking import Look, Looks
from somrs.task_manager.offered import Offered
from somrs.task_manager.participants import Participants
from somrs.task_manager.purpose import Purpose
from somrs.task_manager.pursuit import Pursuit
from somrs.task_manager.records import record
from somrs.task_manager.reports import Reports
from somrs.task_manager.setting import Setting
from somrs.task_manager.work import INTERRUPTED, Ledger, Work
from somrs.task_manager.workflow import StepRun

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
        self.passed = 0
        """How many there were."""
        self.setbacks = 0
        """How often something went wrong."""
        self.ledger = Ledger()
        self.participants = Participants(id, setting, partial(self.tell, kind=EventKind.SETBACK), self._note)
        self.offered = Offered(replica=setting.replica)
        self.reports = Reports(setting, self.proceed)
        self._numbers = 1
        self.wish = Pursuit(1, task.effect, Purpose.WISH, self)
        self._aside: list[Pursuit] = []
        """What is pursued before the wish is gone on with; the last one is what goes on."""
        self.looks = Looks(self)
        self.hearing = Hearing(self)
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
        if self._ending is not None or self._aside or self.looks.asking:
            return Phase.RECOVERING
        return self.wish.phase

    @property
    def latest(self) -> float | None:
        return self.submitted_at + self.task.deadline if self.task.deadline is not None and self._ending is None else None

    @property
    def ending(self) -> bool:
        """Whether it ends otherwise than wanted, once everything under way has stopped, and is undone."""
        return self._ending is not None

    @property
    def pursuits(self) -> Iterator[Pursuit]:
        yield self.wish
        yield from self._aside

    # What comes

    def start(self, now: float) -> None:
        self.tell(now, f"task: {self.task.effect}")
        self.setting.claims.enter(self.id, self.task.effect, self.task.priority)
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

    def cancel(self, now: float, reason: str) -> None:
        """The client does not want it any more."""
        self._stop(now, Outcome.CANCELLED, reason or "cancelled by the client")

    def give_up(self, now: float, reason: str) -> None:
        """It cannot be done, and this is why."""
        self._stop(now, Outcome.FAILED, reason)

    # Going on

    def proceed(self, now: float) -> None:
        """Do whatever comes next. Nothing does while a report is on its way to the map (FRP, property 5)."""
        self.setting.touched[self.id] = None
        if self.outcome is not None or self.reports.pending or self.looks.asking:
            return
        if self._ending is not None and self._undoing is None and self.participants.working:
            return
        if self.looks.wanted:
            self.looks.begin(now)
        elif self._aside:
            self._aside[-1].proceed(now)
        elif self._undoing is not None:
            self._undo(self._undoing, now)
        elif self._ending is not None:
            self._wake("stop", None)
            works = self.ledger.to_undo()
            self._keep_to_itself(works)
            self._undoing = Undoing(works, self, by_others=True)
            self._undo(self._undoing, now)
        else:
            self.wish.proceed(now)

    def _keep_to_itself(self, works: Iterable[Work]) -> None:
        """Nobody else has to do with what is going to be undone, but for those who have it already."""
        claims = self.setting.claims
        for work in works:
            wanted = Claim(changes=frozenset(work.concerned))
            if not claims.holders(self.id, wanted):
                claims.hold(self.id, wanted)

    def _undo(self, undoing: Undoing, now: float) -> None:
        if not undoing.proceed(now):
            return
        if self._ending is not None:
            self._end(now, self._ending)
        else:
            self._undoing = None
            if undoing.restored or self.offered.once_more():
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
                self.looks.next_way(pursuit.look, now)
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

    def taken_over(self, work: Work) -> bool:
        """Whether another task has the objects of the work by now: this one had to wait since."""
        return bool(self.setting.claims.holders(self.id, Claim(changes=frozenset(work.concerned))))

    def handlers(self, work: Work, on: Occasion) -> list[Handler]:
        return fitting(self.task.handlers, work, on, self.setting.replica)

    def restore(self, goal: str, work: Work, now: float) -> None:
        self._pursue(goal, Purpose.UNDO, work, now)

    def tell_of(self, work: Work, text: str, now: float, kind: EventKind) -> None:
        self.tell(now, text, work, kind)

    def _pursue(self, goal: str, purpose: Purpose, work: Work, now: float) -> None:
        self._numbers += 1
        pursuit = Pursuit(self._numbers, goal, purpose, self, work)
        self._aside.append(pursuit)
        pursuit.begin(now)

    # What looks say

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

    # Ending

    def _stop(self, now: float, outcome: Outcome, reason: str) -> None:
        if self.outcome is not None or self._ending is not None:
            return
        self._ending, self.explanation = outcome, f"{reason}; it was {self.wish.waits}" if self.wish.waits else reason
        if outcome is Outcome.CANCELLED:
            self.tell(now, f"stopping: {reason}")
        for pursuit in self.pursuits:
            pursuit.abandon()
            if pursuit.look is not None:
                self.looks.again(pursuit.look)
        self._aside.clear()
        self._undoing = None
        self.looks.drop()
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
                self.hearing.lost(member, "did not say that it stopped", now)
        self.proceed(now)

    def _end(self, now: float, outcome: Outcome) -> None:
        self.participants.end(outcome, now)
        self.outcome, self.ended_at = outcome, now
        self.setting.claims.leave(self.id)
        if outcome is not Outcome.ACCOMPLISHED:
            self.explanation += "".join(f"; {work.in_words()}" for work in self.ledger if work.matters)
        for timer in ("deadline", "stop"):
            self._wake(timer, None)
        self.tell(now, f"{outcome}{f': {self.explanation}' if self.explanation else ''}", kind=EventKind.END)
        self.setting.effects.append(Record(record(self)))
        self.messages.clear()
        self.participants.forget()

    # Noting

    def tell(self, now: float, text: str, run: StepRun | Work | None = None, kind: EventKind = EventKind.NEWS) -> None:
        """Something happened that the client wants to know."""
        self.setting.touched[self.id] = None
        self.setbacks += kind is EventKind.SETBACK
        self.events.append(TaskEvent(number=len(self.events) + 1, at=now, text=text, step=run.label if run else None, kind=kind))

    def _note(self, now: float, message: Message) -> None:
        if self.outcome is None:
            self.messages.append((now, message))
            self.passed += 1
            self.setting.touched[self.id] = None

    def _wake(self, timer: str, at: float | None) -> None:
        self.setting.effects.append(Wake(f"{self.id}/{timer}", at))
