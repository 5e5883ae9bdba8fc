"""One task from the client's wish to its end: planning, arranging, executing, recovering (paper, "Protocol for failure
handling and recovery": the realization of a task is a transaction).

What is tried next when something fails is `recovery.py`'s to say; who takes a step `tender.py`'s; how participants are spoken
to, and for how long one may be silent, `participants.py`'s.
"""

from __future__ import annotations

from somrs.entish.parse import parse
from somrs.ontology.truth import holds
from somrs.planner.plan import NoPlan, Plan
from somrs.protocol import frp
from somrs.protocol.clients import Phase, Submit, TaskEvent
from somrs.protocol.component import Wake
from somrs.protocol.envelope import Message
from somrs.protocol.frp import Outcome, State
from somrs.task_manager.draft import Draft
from somrs.task_manager.offered import Offered
from somrs.task_manager.participants import Member, Participants
from somrs.task_manager.recovery import MOST_REPLANS, Rung, next_rung
from somrs.task_manager.reports import Reports
from somrs.task_manager.setting import Setting
from somrs.task_manager.tender import Tender, call
from somrs.task_manager.workflow import Progress, StepRun, Workflow

STOP_TIME = 60.0
"""Seconds that everybody has to stop safely, and the Repository to hear what is so then."""


class Transaction:
    """The state of one task."""

    def __init__(self, id: str, task: Submit, setting: Setting, now: float) -> None:
        self.id, self.task, self.submitted_at = id, task, now
        self.phase = Phase.PLANNING
        self.outcome: Outcome | None = None
        self.ended_at: float | None = None
        self.explanation = ""
        self.events: list[TaskEvent] = []
        self.workflow: Workflow | None = None
        self._setting = setting
        self._participants = Participants(id, setting, self.tell)
        self._reports = Reports(setting, self.proceed)
        self._offered = Offered(replica=setting.replica)
        self._draft: Draft | None = None
        self._done: list[str] = []
        """What was done, in this plan and those before."""
        self._replans = 0
        self._replan_because: str | None = None
        """Why the plan is given up as soon as nothing of it runs any more."""
        self._tender: Tender | None = None
        self._stopping: Outcome | None = None
        """How it will end once everything under way has stopped."""

    # Planning

    def start(self, now: float) -> None:
        self.tell(now, f"task: {self.task.effect}")
        if self.task.deadline is not None:
            self._wake("deadline", now + self.task.deadline)
        self._plan(now)

    def _plan(self, now: float) -> None:
        self.phase = Phase.PLANNING
        self._draft = Draft(f"{self.id}/plan/{self._replans}", self.task, self._offered, self._setting, self._planned)
        self._draft.begin(now)

    def planned(self, question: str, found: object, now: float) -> None:
        """The planner's answer; to a draft that was withdrawn it means nothing."""
        if self._draft is not None and self._draft.question == question:
            self._draft.answered(found, now)

    def _planned(self, found: object, now: float) -> None:
        self._draft = None
        match found:
            case Plan():
                old, self.workflow = self.workflow, Workflow(found)
                for member in self.workflow.adopt(old) if old is not None else ():
                    self._participants.dismiss(member, "the plan changed", now)
                count = len(found.steps)
                self.tell(now, f"planned: {count} step{'s' if count != 1 else ''}" if count else "nothing to do: it is so already")
                self.phase = Phase.ARRANGING
                self.proceed(now)
            case NoPlan():
                lost = "".join(f"; {service}: {why}" for service, why in self._offered.broken.items())
                self.give_up(now, f"no plan: {found.explanation}{lost}")
            case str(why):
                self.give_up(now, why)
            case _:
                self.give_up(now, f"planning failed: {found}")

    def _drop_draft(self) -> None:
        if self._draft is not None:
            self._draft.withdraw()
            self._draft = None

    # Arranging

    def proceed(self, now: float) -> None:
        """Do whatever comes next. Nothing does while a plan is being made, or a report is on its way to the map."""
        workflow = self.workflow
        if self.phase is Phase.ENDED or self._reports.pending:
            return
        if self._stopping is not None:
            self._end_when_quiet(now)
        elif workflow is None or self._draft is not None:
            return
        elif self._replan_because is not None:
            self._replan(now, self._replan_because)
        elif (failed := workflow.failed()) is not None:
            self._recover(failed, failed.failure or "", now)
        elif workflow.done:
            self._finish(now)
        elif (run := workflow.open()) is not None:
            self.phase = Phase.ARRANGING
            self._arrange(run, now)
        elif workflow.arranged:
            self.phase = Phase.EXECUTING
            for run in workflow.ready():
                if self.phase is Phase.EXECUTING:  # the one before may have found that the plan does not hold any more
                    self._execute(run, now)

    def _arrange(self, run: StepRun, now: float) -> None:
        """Ask every able service for terms."""
        assert self.workflow is not None
        invited = self._offered.able(run)
        if not invited:
            why = "; ".join(f"{service}: {reason}" for service, reason in run.excluded.items())
            self._recover(run, f"no service takes it ({why})" if why else "nobody offers it any more", now)
            return
        self._tender = call(run, invited, self._participants, self.workflow.earliest_start(run, now), now)
        self._wake("bids", self._tender.until)
        self.tell(now, f"asking {', '.join(offer.service for offer in invited)}", run)

    def bids_due(self, now: float) -> None:
        """The time to answer Arrange is over."""
        if self._tender is not None and now >= self._tender.until - 0.001:
            self._choose(self._tender, now)

    def _choose(self, tender: Tender, now: float) -> None:
        """Take the best of what came; without any, whoever is left is asked."""
        self._drop_tender()
        chosen = tender.award(self._participants, self.task, self._setting.busy, self._offered.broken, now)
        if chosen is not None and chosen.bid is not None:
            terms = chosen.bid.terms
            self.tell(now, f"{chosen.offer.service} does it for {terms.price:g} {terms.currency}, in {terms.duration:.0f} s", tender.run)
        self.proceed(now)

    def _drop_tender(self) -> None:
        self._tender = None
        self._wake("bids", None)

    # Executing

    def _execute(self, run: StepRun, now: float) -> None:
        assert run.member is not None, "an arranged step is somebody's"
        member = run.member
        try:
            situation = self._offered.precondition(run)
        except LookupError as error:
            self._participants.dismiss(member, "its precondition does not hold any more", now)
            run.lose()
            self._replan(now, f"{run.step.service_type} cannot start: {error}")
            return
        run.progress = Progress.EXECUTING
        inputs = {name: str(term) for name, term in run.step.inputs.items()}
        self._participants.execute(member, frp.Execute(inputs=inputs, precondition=str(situation) if situation is not None else None), now)
        self.tell(now, f"{member.offer.service} starts", run)

    def receive(self, message: Message, now: float) -> None:
        """A message of the protocol from a participant."""
        received = self._participants.receive(message, now)
        if received is None:
            return
        member, heard = received
        run = self._run_of(member)
        if heard.moved:
            self._heard(member, run, message, now)
        elif member.lost_at is not None:
            self._heard_late(member, message, now)

    def _run_of(self, member: Member) -> StepRun | None:
        if self._tender is not None and member in self._tender:
            return self._tender.run
        return self.workflow.held_by(member) if self.workflow is not None else None

    def _heard(self, member: Member, run: StepRun | None, message: Message, now: float) -> None:
        name = member.offer.service
        match message.body:
            case frp.Terms() as terms if self._tender is not None and member in self._tender:
                self.tell(now, f"{name} offers {terms.price:g} {terms.currency}, {terms.duration:.0f} s", run)
                self._tender.offered(member, terms, message.header.message_id)
                self._answered(now)
            case frp.Refuse(reason=reason):
                self.tell(now, f"{name} refuses: {reason}", run)
                self._left(member, reason, now)
            case frp.Progress() as progress:
                self._progressed(member, run, progress, now)
            case frp.Completed(situation=situation):
                member.fraction = 1.0
                self.tell(now, f"{name} completed: {situation}", run)
                self._reported(member, run, situation, None, now)
            case frp.Failed(description=description, situation=situation):
                self.tell(now, f"{name} failed: {description}", run)
                self._reported(member, run, situation, description, now)
            case frp.Stopped(situation=situation) | frp.Compensated(situation=situation) | frp.Stranded(situation=situation):
                self.tell(now, f"{name} {type(message.body).__name__.lower()}", run)
                self._reported(member, run, situation, "stopped", now)
            case frp.Fault(text=text) if member.state is State.ENDED:
                self._left(member, text, now)
            case frp.Fault() | frp.Status() if member.state is State.FAILED:
                description = message.body.text if isinstance(message.body, frp.Fault) else "it has forgotten its contract"
                self.tell(now, f"{name}: {description}", run)
                self._reported(member, run, None, description, now)

    def _progressed(self, member: Member, run: StepRun | None, progress: frp.Progress, now: float) -> None:
        member.fraction = progress.fraction
        if progress.note and progress.note != member.note:
            self.tell(now, f"{member.offer.service}: {progress.note}", run)
        member.note = progress.note
        if progress.situation is not None:
            self._put_on_map(member, run, progress.situation, now)

    def _left(self, member: Member, reason: str, now: float) -> None:
        """A participant is out before it did anything."""
        member.last_word = reason
        if self._tender is not None and member in self._tender:
            self._tender.left(member, reason)
            self._answered(now)
        elif (run := self._run_of(member)) is not None:
            run.excluded[member.offer.service] = reason
            run.lose()
            self.proceed(now)

    def _answered(self, now: float) -> None:
        if self._tender is not None and self._tender.answered:
            self._choose(self._tender, now)

    # What was done

    def _reported(self, member: Member, run: StepRun | None, situation: str | None, failed: str | None, now: float) -> None:
        """A participant's work is over. What it left is on the map before anything is planned or arranged on it."""
        member.reported = True
        if run is not None:
            run.progress = Progress.REPORTING
        if self._draft is not None:
            self._drop_draft()
            self._replan_because, self.phase = f"{member.offer.service} reported while it was planned", Phase.RECOVERING
        if situation is not None:
            self._put_on_map(member, run, situation, now, failed=failed, final=True)
        else:
            self._over(member, run, None, failed)
            self.proceed(now)

    def _put_on_map(
        self, member: Member, run: StepRun | None, situation: str, now: float, *, failed: str | None = None, final: bool = False
    ) -> None:
        service = member.offer.service

        def settled(problem: str | None, now: float) -> None:
            if problem is not None:
                self.tell(now, f"the Repository rejects what {service} reports: {problem}", run)
            if final and problem is None:
                self._over(member, run, situation, failed)
            elif final:
                self._over(member, run, None, failed or f"reported an impossible situation: {problem}")

        self._reports.put(situation, service, settled, now, unless_changed_since=member.lost_at)

    def _over(self, member: Member, run: StepRun | None, situation: str | None, failed: str | None) -> None:
        """What became of a participant's work is known; what comes of that, `proceed` finds."""
        if failed is not None:
            self._offered.broken[member.offer.service] = f"failed: {failed}"
        elif run is not None:
            run.progress = Progress.DONE
            self._done.append(f"{run.step.service_type} was done: {situation}")
        if run is not None and failed is not None:
            run.excluded[member.offer.service] = failed
            run.reported = parse(situation) if situation is not None else None
            run.lose(failed)

    def _heard_late(self, member: Member, message: Message, now: float) -> None:
        """One that was given up, and has had its End, says what became of its work: the map has to know that, too."""
        match message.body:
            case frp.Completed(situation=str(situation)) | frp.Failed(situation=str(situation)) | frp.Stopped(situation=str(situation)):
                if not member.reported:
                    member.reported = True
                    self._put_on_map(member, None, situation, now)

    # Recovering

    def _recover(self, run: StepRun, reason: str, now: float) -> None:
        """Climb the ladder: the step is nobody's now, and something has to be done about it."""
        run.failure = None
        others = self._offered.able(run)
        try:
            run.precondition = self._offered.precondition(run)
            possible = True
        except LookupError:
            possible = False
        match next_rung(run, others, possible):
            case Rung.REPLACE:
                self.tell(now, "replacing the service", run)
                self.proceed(now)
            case Rung.REPLAN:
                if not others:
                    self._offered.broken = {**run.excluded, **self._offered.broken}
                self._replan(now, reason)

    def _replan(self, now: float, reason: str) -> None:
        """From the map as it is now to the task's effect; what runs is awaited first."""
        assert self.workflow is not None
        if self._replans >= MOST_REPLANS:
            self.give_up(now, f"{reason}; planned anew {self._replans} times already")
            return
        if self._tender is not None:
            self._tender.withdraw(self._participants, "the plan changed", now)
            self._drop_tender()
        if self.workflow.busy:
            self._replan_because, self.phase = reason, Phase.RECOVERING
            return
        self._replan_because = None
        self._replans += 1
        self.tell(now, f"planning anew: {reason}")
        self._plan(now)

    # Ending

    def cancel(self, now: float, reason: str) -> None:
        """The client does not want it any more."""
        self._stop(now, Outcome.CANCELLED, reason or "cancelled by the client")

    def give_up(self, now: float, reason: str) -> None:
        """It cannot be done, and this is why."""
        self._stop(now, Outcome.FAILED, reason)

    def _stop(self, now: float, outcome: Outcome, reason: str) -> None:
        if self.phase is Phase.ENDED or self._stopping is not None:
            return
        self._drop_draft()
        self._stopping, self.phase, self.explanation = outcome, Phase.RECOVERING, reason
        self._drop_tender()
        self._participants.stop(reason, now)
        self._wake("stop", now + STOP_TIME)
        self.proceed(now)

    def _end_when_quiet(self, now: float) -> None:
        if self._stopping is not None and not self._participants.working:
            self._end(now, self._stopping)

    def stop_overdue(self, now: float) -> None:
        """Not everybody has stopped in time."""
        if self.phase is Phase.ENDED or self._stopping is None:
            return
        for member in self._participants.working:
            self.explanation += f"; {member.offer.service} did not say that it stopped"
        if self._reports.pending:
            self.explanation += "; not everything that was reported is on the map yet, because the Repository does not answer"
        self._end(now, self._stopping)

    def _finish(self, now: float) -> None:
        replica = self._setting.replica
        if holds(parse(self.task.effect), replica.map, replica.ontology):
            self._end(now, Outcome.ACCOMPLISHED)
        else:
            self._replan(now, "every step was done, but the wish does not hold")

    def _end(self, now: float, outcome: Outcome) -> None:
        self._participants.end(outcome, now)
        self.phase, self.outcome, self.ended_at = Phase.ENDED, outcome, now
        if outcome is not Outcome.ACCOMPLISHED:
            interrupted = [run for run in self.workflow or () if run.progress is Progress.OPEN and run.reported is not None]
            left = [*self._done, *(f"{run.step.service_type} was interrupted: {run.reported}" for run in interrupted)]
            self.explanation += "".join(f"; {text}" for text in left)
        for timer in ("deadline", "stop"):
            self._wake(timer, None)
        self.tell(now, f"{outcome}{f': {self.explanation}' if self.explanation else ''}")

    # Watching

    def silent(self, participant: str, now: float) -> None:
        """The heartbeat of an executing service may have stopped."""
        member = self._participants.silent(participant, now)
        if member is None or self.phase is Phase.ENDED:
            return
        reason = f"{member.offer.service} fell silent while it worked; nothing is known of what it left"
        self.tell(now, reason, self._run_of(member))
        if self._stopping is not None:
            self.explanation += f"; {reason}"
            self.proceed(now)
        elif self._run_of(member) is not None:
            self.give_up(now, reason)

    def undelivered(self, message: Message, reason: str, now: float) -> None:
        """A message never arrived."""
        member = self._participants.undelivered(message, reason, now)
        if member is not None:
            self._left(member, member.last_word, now)

    def tell(self, now: float, text: str, run: StepRun | None = None) -> None:
        """Something happened that the client wants to know."""
        self.events.append(TaskEvent(number=len(self.events) + 1, at=now, text=text, step=run.step.id if run else None))

    def _wake(self, timer: str, at: float | None) -> None:
        self._setting.effects.append(Wake(f"{self.id}/{timer}", at))
