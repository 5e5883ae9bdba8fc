"""One formula that a transaction makes true: by a plan, arranged step by step with services, executed, and recovered when a
step fails, on the ladder's first two rungs (`recovery.py`).

The wish of a task is pursued so, and so is whatever has to be so on the way: what a handler demands, what a cognitive service is to
find out, what is to be restored. Who takes a step is `tender.py`'s to say; what the pursuit cannot settle by itself, its owner's.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import structs

from somrs.entish.parse import parse
from somrs.ontology.services import ServiceKind
from somrs.planner.model.plan import NoPlan, Plan
from somrs.protocol.messages import frp
from somrs.protocol.messages.clients import EventKind, Phase
from somrs.protocol.messages.frp import State
from somrs.task_manager.claims import Held
from somrs.task_manager.draft import Draft
from somrs.task_manager.looking import Look
from somrs.task_manager.offered import named
from somrs.task_manager.owner import Owner
from somrs.task_manager.participants import Member
from somrs.task_manager.purpose import Purpose
from somrs.task_manager.recovery import Replans, Rung, next_rung
from somrs.task_manager.setting import known_to_hold
from somrs.task_manager.tender import AT_ONCE, Tender, Tenders, call
from somrs.task_manager.work import Work
from somrs.task_manager.workflow import Progress, StepRun, Workflow


class Pursuit:
    """`goal` is Entish. `work` is what it is about, when it is not the wish; `look` what is to be found out."""

    def __init__(self, number: int, goal: str, purpose: Purpose, owner: Owner, work: Work | None = None, look: Look | None = None) -> None:
        self.goal, self.purpose, self.work, self.look = goal, purpose, work, look
        self.workflow: Workflow | None = None
        self.phase = Phase.PLANNING
        self.tenders = Tenders(f"{owner.id}/bids/{number}", owner.setting.effects)
        """The steps that services are being asked for."""
        self._owner = owner
        self._number = number
        self._label = "" if purpose is Purpose.WISH else f"{purpose}{number}."
        self.waits = ""
        """For whom, and what they have; it goes on when they have ended."""
        self._goes_on = False
        """It was waiting, and makes its plan as soon as it may."""
        self._draft: Draft | None = None
        self._plans = 0
        self._replans = Replans()
        """Plans since anything was completed."""
        self._fixed = False
        self._replan_because: str | None = None
        """Why the plan is given up as soon as nothing of it runs any more."""

    def __iter__(self) -> Iterator[StepRun]:
        return iter(self.workflow or ())

    # Planning

    def begin(self, now: float, plan: Plan | None = None) -> None:
        """Have a plan made, or take this one and no other."""
        if plan is None:
            self._plan(now)
        else:
            self._fixed = True
            self._take(plan, now)

    def again(self, now: float) -> None:
        """The map is another now: what was impossible may be possible."""
        self._replans.count()
        self._plan(now)

    def _plan(self, now: float) -> None:
        self.phase = Phase.PLANNING
        owner = self._owner
        # What the client said of the beginning is about the beginning.
        precondition = owner.task.precondition if self.purpose is Purpose.WISH and self._plans == 0 else None
        task = structs.replace(owner.task, effect=self.goal, precondition=precondition)
        name = f"{owner.id}/plan/{self._number}.{self._plans}"
        self._draft = Draft(name, owner.id, task, owner.offered, owner.setting, self._planned, self.workflow)
        self._plans += 1
        self._draft.begin(now)

    def planned(self, question: str, found: object, now: float) -> None:
        """The planner's answer; to a draft that was withdrawn it means nothing."""
        if self._draft is not None and self._draft.question == question:
            self._draft.answered(found, now)

    def _planned(self, found: object, now: float) -> None:
        self._draft = None
        match found:
            case Plan():
                self._take(found, now)
            case Held() if self.purpose is Purpose.WISH:
                self._wait(found, now)
            case Held():
                self._fail(f"other tasks have {found.objects}", now)
            case NoPlan():
                broken = self._owner.offered.broken
                lost = "".join(f"; {service}: {why}" for service, why in broken.items() if service not in found.explanation)
                why = f"no plan: {found.explanation}{lost}"
                if self._owner.unblocked(self, why, now):
                    return
                if again := self._owner.offered.once_more():
                    self._tell(now, f"there is no plan without {named(again)}, which may try again", kind=EventKind.REPLAN)
                    self._plan(now)
                else:
                    self._fail(why, now)
            case str(why):
                self._fail(why, now)
            case _:
                self._fail(f"planning failed: {found}", now)

    def _wait(self, held: Held, now: float) -> None:
        """Until those who have what is needed have ended. Who waits has nothing that others might wait for."""
        claims = self._owner.setting.claims
        for run in self:
            if run.progress is Progress.ARRANGED and run.member is not None:
                self._owner.participants.dismiss(run.member, "the task has to wait for others", now)
                run.lose()
        self.phase = Phase.WAITING
        self.waits = held.in_words(claims)
        self._tell(now, self.waits, kind=EventKind.WAIT)
        claims.wait(self._owner.id, held.claim, self._freed)

    def _freed(self, now: float) -> None:
        self.waits, self._goes_on = "", True
        self._tell(now, "going on: what it waited for is free", kind=EventKind.WAIT)
        self._owner.proceed(now)

    def _take(self, plan: Plan, now: float) -> None:
        self._replans.planned(len(plan.steps))
        old, self.workflow = self.workflow, Workflow(plan, f"{self._number}.{self._plans}/", self._label)
        for member in self.workflow.adopt(old) if old is not None else ():
            self._owner.participants.dismiss(member, "the plan changed", now)
        count = len(plan.steps)
        if not self._fixed:
            self._tell(now, f"planned: {count} step{'s' if count != 1 else ''}" if count else "nothing to do: it is so already")
        self.phase = Phase.ARRANGING
        self._owner.proceed(now)

    def upset(self, reason: str) -> None:
        """The map is to change while a plan is being made: it has to be made again."""
        if self._draft is not None:
            self._draft.withdraw()
            self._draft = None
            self._replan_because, self.phase = reason, Phase.RECOVERING

    def abandon(self) -> None:
        """Nothing is made true any more. Whoever was asked or is committed hears that from the transaction."""
        if self._draft is not None:
            self._draft.withdraw()
            self._draft = None
        self.waits, self._goes_on = "", False
        if self.purpose is Purpose.WISH:
            self._owner.setting.claims.forget(self._owner.id)
        self.tenders.drop()

    # Arranging

    def proceed(self, now: float) -> None:
        """Do whatever comes next. Nothing does while a plan is being made."""
        workflow = self.workflow
        if self._draft is not None or self.waits:
            return
        if self._goes_on:
            self._goes_on = False
            self._plan(now)
        elif self._replan_because is not None:
            self._replan(now, self._replan_because)
        elif workflow is None:
            return
        elif (failed := workflow.failed) is not None:
            self._recover(failed, failed.failure or "", now)
        elif workflow.done:
            self._finish(now)
        elif (runs := workflow.open) or self.tenders:
            self.phase = Phase.ARRANGING
            for run in runs[: AT_ONCE - len(self.tenders)]:
                if not self._arrange(run, now):
                    break
        elif workflow.arranged:
            self.phase = Phase.EXECUTING
            for run in workflow.ready:
                if self.phase is Phase.EXECUTING:  # the one before may have found that the plan does not hold any more
                    self._execute(run, now)

    def _arrange(self, run: StepRun, now: float) -> bool:
        """Ask every able service for terms. One that had the step and came back has to stop first: its report is awaited. Whether the
        plan stands: there may be nobody to ask."""
        assert self.workflow is not None
        if self._owner.participants.held(run.key) or self.tenders.settles(run.step):
            return True
        invited = self._owner.offered.able(run)
        if not invited:
            why = "; ".join(f"{service}: {reason}" for service, reason in run.excluded.items())
            self._recover(run, f"no service takes it ({why})" if why else "nobody offers it any more", now)
            return False
        earliest, latest = self.workflow.earliest_start(run, now), self._owner.latest
        self.tenders.open(call(run, invited, self._owner.participants, earliest, latest, now))
        self._tell(now, f"asking {', '.join(offer.service for offer in invited)}", run)
        return True

    def bids_due(self, now: float) -> None:
        """The time to answer Arrange is over."""
        for tender in self.tenders.due(now):
            self._choose(tender, now)

    def offers(self, member: Member, terms: frp.Terms, id: str, now: float) -> None:
        """Terms came."""
        self._owner.setting.quoted(member.offer.service, terms.price, terms.duration)
        tender = self.tenders.of(member)
        if tender is not None:
            self._tell(now, f"{member.offer.service} offers {terms.price:g} {terms.currency}, {terms.duration:.0f} s", tender.run)
            tender.offered(member, terms, id)
            if tender.answered:
                self._choose(tender, now)

    def left(self, member: Member, reason: str, now: float) -> None:
        """A participant is out before it did anything."""
        tender = self.tenders.of(member)
        if tender is not None:
            tender.left(member, reason)
            if tender.answered:
                self._choose(tender, now)
        elif (run := self.run_of(member)) is not None:
            run.excluded[member.offer.service] = reason
            run.lose()
            self._owner.proceed(now)

    def _choose(self, tender: Tender, now: float) -> None:
        """Take the best of what came; without any, whoever is left is asked."""
        self.tenders.close(tender)
        owner = self._owner
        chosen = tender.award(owner.participants, owner.task, owner.setting.busy, owner.offered.broken, now)
        if chosen is not None and chosen.bid is not None and self.workflow is not None:
            self.workflow.bind(tender.run, chosen.offer.provider)
            terms = chosen.bid.terms
            self._tell(now, f"{chosen.offer.service} does it for {terms.price:g} {terms.currency}, in {terms.duration:.0f} s", tender.run)
        owner.proceed(now)

    def is_asked_by(self, number: str) -> bool:
        """Whether the timer of that number is this pursuit's."""
        return number == str(self._number)

    # Executing

    def run_of(self, member: Member) -> StepRun | None:
        """The step that the participant is asked for, is committed to, or does."""
        tender = self.tenders.of(member)
        if tender is not None:
            return tender.run
        return self.workflow.held_by(member) if self.workflow is not None else None

    def _execute(self, run: StepRun, now: float) -> None:
        assert run.member is not None, "an arranged step is somebody's"
        owner, member = self._owner, run.member
        rank = (-owner.task.priority, run.start, owner.submitted_at, owner.id)
        if not owner.setting.turns.takes(member.offer, owner.id, rank, owner.proceed):
            if not run.waits:
                run.waits = True
                self._tell(now, f"waiting for its turn at {member.offer.provider}", run, EventKind.WAIT)
            return
        try:
            situation = owner.offered.precondition(run)
        except LookupError as error:
            owner.participants.dismiss(member, "its precondition does not hold any more", now)
            run.lose()
            self._replan(now, f"{run.step.service_type} cannot start: {error}")
            return
        run.progress = Progress.EXECUTING
        replica = owner.setting.replica
        owner.ledger.begin(
            run.label,
            run.step,
            owner.offered.type_of(run.step),
            member,
            replica.map,
            replica.ontology,
            now,
            undoes=self.purpose is Purpose.UNDO,
        )
        inputs = {name: str(term) for name, term in run.step.inputs.items()}
        owner.participants.execute(member, frp.Execute(inputs=inputs, precondition=str(situation) if situation is not None else None), now)
        self._tell(now, f"{member.offer.service} starts", run)

    def over(self, run: StepRun, situation: str | None, failed: str | None) -> None:
        """What became of a step is known, and on the map; what comes of that, `proceed` finds."""
        assert run.member is not None, "somebody did it"
        if failed is None:
            run.progress = Progress.DONE
            self._replans.done()
        else:
            run.excluded[run.member.offer.service] = failed
            run.reported = parse(situation) if situation is not None else None
            run.lose(failed)

    # Recovering

    def _recover(self, run: StepRun, reason: str, now: float) -> None:
        """Climb the ladder: the step is nobody's now, and something has to be done about it."""
        owner = self._owner
        begun = run.failure is not None
        looked = self.purpose is Purpose.LOOK  # that the map does not call a thing unknown is no finding
        if begun and not looked and self._so_already(run):
            run.failure, run.progress = None, Progress.DONE
            self._tell(now, "what it was to bring about is so", run)
            owner.proceed(now)
            return
        if begun and owner.handled(run, now):
            return
        run.failure = None
        others = owner.offered.able(run)
        try:
            run.precondition = owner.offered.precondition(run)
            possible = True
        except LookupError:
            possible = False
        bound = run.step.provider is not None  # a plan without it would be a detour, if there is one
        if begun and not others and (possible or bound) and (others := owner.offered.once_more(run)):
            self._tell(now, f"nobody else can do it: {named(others)} may try again", run)
        harmless = owner.offered.type_of(run.step).kind is not ServiceKind.PHYSICAL
        match next_rung(others, possible, known=run.reported is not None or harmless):
            case Rung.REPLACE:
                self._tell(now, "replacing the service", run, EventKind.REPLACE)
                owner.proceed(now)
            case Rung.REPLAN:
                if not others:
                    owner.offered.broken = {**run.excluded, **owner.offered.broken}
                self._replan(now, reason)

    def _so_already(self, run: StepRun) -> bool:
        return known_to_hold(run.step.effect, self._owner.setting.replica)

    def _replan(self, now: float, reason: str) -> None:
        """From the map as it is now to the goal; what runs is awaited first."""
        assert self.workflow is not None or self._replan_because is not None
        if self._fixed:
            self._fail(reason, now)
            return
        if self._replans.spent:
            self._fail(f"{reason}; {self._replans}", now)
            return
        self.tenders.withdraw(self._owner.participants, "the plan changed", now)
        if self.workflow is not None and self.workflow.busy:
            self._replan_because, self.phase = reason, Phase.RECOVERING
            return
        self._replan_because = None
        self._replans.count()
        self._tell(now, f"planning anew: {reason}", kind=EventKind.REPLAN)
        self._plan(now)

    # Ending

    def _finish(self, now: float) -> None:
        if self._fixed or known_to_hold(parse(self.goal), self._owner.setting.replica):
            self._owner.reached(self, now)
        else:
            self._replan(now, f"every step was done, but {'the wish' if self.purpose is Purpose.WISH else self.goal} does not hold")

    def _fail(self, why: str, now: float) -> None:
        self.abandon()
        for run in self.workflow or ():
            if run.progress is Progress.ARRANGED and run.member is not None:
                self._owner.participants.dismiss(run.member, "the plan was given up", now)
            elif run.progress is Progress.EXECUTING and run.member is not None and run.member.state is State.EXECUTING:
                self._owner.participants.halt(run.member, "the plan was given up", now)
        self._owner.failed(self, why, now)

    def _tell(self, now: float, text: str, run: StepRun | None = None, kind: EventKind = EventKind.NEWS) -> None:
        self._owner.tell(now, text, run, kind)
