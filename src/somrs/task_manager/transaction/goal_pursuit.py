"""Makes one formula true: by a plan, arranged step by step with services, executed, and recovered when a step fails, on the ladder's first
two rungs (`recovery/ladder.py`).

The goal of a task is pursued so, and so is whatever has to be so on the way: what a handler demands, what a cognitive service is to
find out, what is to be restored. What the pursuit cannot settle by itself it gives back as `Next`, for the transaction.
"""

from __future__ import annotations

from msgspec import structs

from somrs.entish.parse import parse
from somrs.kernel.component import Effects, EffectsReturning
from somrs.ontology.services import ServiceKind
from somrs.planner.model.plan import NoPlan, Plan
from somrs.protocol.messages import events, frp
from somrs.protocol.messages.clients import Phase
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.events import GoalKind
from somrs.protocol.messages.frp import State
from somrs.task_manager.arrangement.available_services import named
from somrs.task_manager.arrangement.call_for_proposals import AT_ONCE, Arrangement, Call
from somrs.task_manager.arrangement.plan_request import Found, PlanRequest, PlanRequester
from somrs.task_manager.context import known_to_hold
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress, StepRun, Workflow
from somrs.task_manager.recovery.ladder import Rung, next_rung
from somrs.task_manager.reservations import Held
from somrs.task_manager.timers import Answer, PlanWanted
from somrs.task_manager.transaction.next import CannotBeHad, GoOn, Next, NoPlanFound, Reached, StepLost
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import GoalExecution
from somrs.task_manager.transaction.step_execution import StepExecution


class GoalPursuit:
    """Goes on with one goal of a task. It has no state of its own."""

    def __init__(self, execution: GoalExecution, scope: TaskScope) -> None:
        self._execution, self._scope = execution, scope
        self._context, self._participants, self._services = scope.context, scope.participants, scope.services
        self._tell = scope.tell

    # Planning

    def begin(self, now: float, plan: Plan | None = None) -> EffectsReturning[Next | None]:
        """Have a plan made, or take this one and no other."""
        if plan is None:
            yield from self._plan(now)
            return None
        self._execution.fixed = True
        return (yield from self._take(plan, now))

    def again(self, now: float) -> Effects:
        """The map is another now: what was impossible may be possible."""
        self._execution.replans.count()
        yield from self._plan(now)

    def _plan(self, now: float) -> Effects:
        execution, state = self._execution, self._scope.state
        execution.phase = Phase.PLANNING
        # What the client said of the beginning is about the beginning.
        precondition = state.task.precondition if execution.kind is GoalKind.TASK and execution.plans == 0 else None
        task = structs.replace(state.task, effect=execution.goal, precondition=precondition)
        execution.request = PlanRequest(owner=state.id, goal=execution.number, serial=execution.plans, task=task)
        execution.plans += 1
        yield from self._requester(execution.request).begin(now)

    def _requester(self, request: PlanRequest) -> PlanRequester:
        return PlanRequester(request, self._services, self._context, self._execution.workflow)

    def discovered(self, serial: int, offers: tuple[Offer, ...] | str, now: float) -> EffectsReturning[Next | None]:
        """The services on offer are known; to a plan that is not wanted any more it means nothing."""
        request = self._execution.request
        if request is None or request.serial != serial:
            return None
        found = yield from self._requester(request).discovered(offers)
        return (yield from self._planned(found, now)) if found is not None else None

    def planned(self, question: PlanWanted, answer: Answer, now: float) -> EffectsReturning[Next | None]:
        """The planner's answer; to a plan that is not wanted any more it means nothing."""
        request = self._execution.request
        if request is None or request.question != question:
            return None
        found = yield from self._requester(request).answered(answer)
        return (yield from self._planned(found, now)) if found is not None else None

    def _planned(self, found: Found, now: float) -> EffectsReturning[Next | None]:
        self._execution.request = None
        match found:
            case Plan():
                return (yield from self._take(found, now))
            case Held() if self._execution.kind is GoalKind.TASK:
                yield from self._wait(found, now)
                return None
            case Held():
                return (yield from self._fail((f"other tasks have {', '.join(found.objects)}",), now))
            case NoPlan():
                broken = self._services.broken
                lost = (f"{service}: {why}" for service, why in broken.items() if service not in found.lost)
                return NoPlanFound((f"no plan: {found.reasons[0]}", *found.reasons[1:], *lost))
            case str(why):
                return (yield from self._fail((why,), now))
            case _:
                return (yield from self._fail((f"planning failed: {found}",), now))

    def without_plan(self, reasons: tuple[str, ...], now: float) -> EffectsReturning[Next | None]:
        """There is none, and nothing can be undone so that there may be one."""
        if again := self._services.once_more():
            self._tell(events.TriedOnceMore(services=named(again)), now)
            yield from self._plan(now)
            return None
        return (yield from self._fail(reasons, now))

    def _wait(self, held: Held, now: float) -> Effects:
        """Until those who have what is needed have ended. Who waits has nothing that others might wait for."""
        execution, reservations = self._execution, self._context.reservations
        for run in execution:
            if run.progress is Progress.ARRANGED and (member := self._member(run)) is not None:
                yield from self._participants.dismiss(member, "the task has to wait for others", now)
                self._workflow.lose(run)
        execution.phase = Phase.WAITING
        tasks = {task: reservations.goal(task) for task in held.by}
        execution.waits = events.WaitsForTasks(tasks=tasks, objects=held.objects)
        self._tell(execution.waits, now)
        reservations.wait(self._scope.state.id, held.wanted)

    def freed(self, now: float) -> None:
        """What it waited for is free."""
        self._execution.waits, self._execution.goes_on = None, True
        self._tell(events.GoesOn(), now)

    def _take(self, plan: Plan, now: float) -> EffectsReturning[Next | None]:
        execution = self._execution
        execution.replans.planned(len(plan.steps))
        old = execution.workflow
        execution.workflow = workflow = Workflow.of(plan, f"{execution.number}.{execution.plans}/", execution.label, execution.kind)
        for member in workflow.adopt(old, self._scope.state.members) if old is not None else ():
            yield from self._participants.dismiss(member, "the plan changed", now)
        if not execution.fixed:
            self._tell(events.Planned(steps=len(plan.steps)), now)
        execution.phase = Phase.ARRANGING
        return GoOn()

    def upset(self, reason: str) -> Effects:
        """The map is to change while a plan is being made: it has to be made again."""
        execution = self._execution
        if execution.request is not None:
            yield from self._requester(execution.request).withdraw()
            execution.request = None
            execution.replan_because, execution.phase = (reason,), Phase.RECOVERING

    def abandon(self) -> Effects:
        """Nothing is made true any more. Whoever was asked or is committed hears that from the transaction."""
        execution = self._execution
        if execution.request is not None:
            yield from self._requester(execution.request).withdraw()
            execution.request = None
        execution.waits, execution.goes_on = None, False
        if execution.kind is GoalKind.TASK:
            self._context.reservations.forget(self._scope.state.id)
        yield from execution.calls.drop()

    # Arranging

    def proceed(self, now: float) -> EffectsReturning[Next | None]:
        """Do whatever comes next. Nothing does while a plan is being made."""
        execution = self._execution
        workflow = execution.workflow
        if execution.request is not None or execution.waits is not None:
            return None
        if execution.goes_on:
            execution.goes_on = False
            yield from self._plan(now)
        elif execution.replan_because is not None:
            return (yield from self._replan(now, execution.replan_because))
        elif workflow is None:
            return None
        elif (failed := workflow.failed) is not None:
            return (yield from self._begin_recovery(failed, (failed.failure or "",), now))
        elif workflow.done:
            return (yield from self._finish(now))
        elif (runs := workflow.open) or execution.calls:
            execution.phase = Phase.ARRANGING
            for run in runs[: AT_ONCE - len(execution.calls)]:
                stands, next = yield from self._arrange(run, now)
                if not stands:
                    return next
        elif workflow.arranged:
            execution.phase = Phase.EXECUTING
            for run in workflow.ready:
                if execution.phase is not Phase.EXECUTING:
                    break  # the one before found that the plan does not hold any more
                if reasons := (yield from StepExecution(execution, self._scope).begin(run, now)):
                    return (yield from self._replan(now, reasons))
        return None

    def _arrange(self, run: StepRun, now: float) -> EffectsReturning[tuple[bool, Next | None]]:
        """Ask every able service for terms. One that had the step and came back has to stop first: its report is awaited. Whether the
        plan stands: there may be nobody to ask."""
        calls = self._execution.calls
        if self._scope.state.members.held(run.key) or calls.settles(run.step):
            return True, None
        invited = self._services.able(run)
        if not invited:
            why = "; ".join(f"{service}: {reason}" for service, reason in run.excluded.items())
            reasons = (f"no service takes it ({why})" if why else "nobody offers it any more",)
            return False, (yield from self._begin_recovery(run, reasons, now))
        earliest, latest = self._workflow.earliest_start(run, now), self._scope.state.latest
        call = yield from self._arrangement.call(run, invited, earliest, latest, now)
        yield from calls.open(call)
        self._tell(events.ServicesAsked(services=named(invited)), now, run)
        return True, None

    def ask_anew(self, now: float) -> Effects:
        """Nobody could answer for some time. Who is not heard then is none who does not answer, so that all are asked once more."""
        yield from self._withdraw("the Task Manager was away, and asks anew", now)

    def _withdraw(self, reason: str, now: float) -> Effects:
        """Nobody is asked any more."""
        calls = self._execution.calls
        for call in calls:
            yield from self._arrangement.withdraw(call, reason, now)
        yield from calls.drop()

    def bids_due(self, now: float) -> EffectsReturning[Next | None]:
        """The time to answer Arrange is over."""
        calls = self._execution.calls
        due = [*calls.due(now)]
        for call in due:
            yield from self._choose(call, now)
        yield from calls.wake()
        return GoOn() if due else None

    def offers(self, member: Member, terms: frp.Terms, id: str, now: float) -> EffectsReturning[Next | None]:
        """Terms came."""
        service = member.offer.service
        self._context.quotes.given(service, terms.price, terms.duration)
        call = self._execution.calls.of(member)
        if call is None:
            return None
        offered = events.TermsOffered(service=service, price=terms.price, currency=terms.currency, duration=terms.duration)
        arrangement = self._arrangement
        self._tell(offered, now, arrangement.run(call))
        arrangement.offered(call, member, terms, id)
        if not arrangement.answered(call):
            return None
        yield from self._choose(call, now)
        return GoOn()

    def left(self, member: Member, reason: str, now: float) -> EffectsReturning[Next | None]:
        """A participant is out before it did anything."""
        call = self._execution.calls.of(member)
        if call is not None:
            self._arrangement.left(call, member, reason)
            if not self._arrangement.answered(call):
                return None
            yield from self._choose(call, now)
            return GoOn()
        if (run := self.run_of(member)) is not None:
            run.excluded[member.offer.service] = reason
            self._workflow.lose(run)
            return GoOn()
        return None

    def _choose(self, call: Call, now: float) -> Effects:
        """Take the best of what came; without any, whoever is left is asked."""
        yield from self._execution.calls.close(call)
        state = self._scope.state
        chosen = yield from self._arrangement.award(call, state.task, self._context.commitments(), self._services.broken, now)
        if chosen is not None and chosen.bid is not None:
            run, terms = self._arrangement.run(call), chosen.bid.terms
            self._workflow.bind(run, chosen.offer.provider)
            event = events.ServiceChosen(service=chosen.offer.service, price=terms.price, currency=terms.currency, duration=terms.duration)
            self._tell(event, now, run)

    def run_of(self, member: Member) -> StepRun | None:
        """The step that the participant is asked for, is committed to, or does."""
        execution = self._execution
        call = execution.calls.of(member)
        if call is not None:
            return self._workflow.runs[call.step]
        return execution.workflow.held_by(member) if execution.workflow is not None else None

    # Recovering

    def _begin_recovery(self, run: StepRun, reasons: tuple[str, ...], now: float) -> EffectsReturning[Next | None]:
        """The step is nobody's now, and something has to be done about it."""
        begun = run.failure is not None
        looked = self._execution.kind is GoalKind.LOOK  # that the map does not call a thing unknown is no finding
        if begun and not looked and known_to_hold(run.step.effect, self._context.replica):
            self._workflow.fail(run, None)
            self._workflow.move(run, Progress.DONE)
            self._tell(events.FoundSo(), now, run)
            return GoOn()
        if begun:
            return StepLost(run.step.id, reasons)
        return (yield from self.recover(run.step.id, reasons, now))

    def recover(self, step: str, reasons: tuple[str, ...], now: float) -> EffectsReturning[Next | None]:
        """Climb the ladder."""
        run, services = self._workflow.runs[step], self._services
        begun = run.failure is not None
        self._workflow.fail(run, None)
        others = services.able(run)
        try:
            run.precondition = services.precondition(run)
            possible = True
        except LookupError:
            possible = False
        bound = run.step.provider is not None  # a plan without it would be a detour, if there is one
        if begun and not others and (possible or bound) and (others := services.once_more(run)):
            self._tell(events.MayTryAgain(services=named(others)), now, run)
        harmless = services.type_of(run.step).kind is not ServiceKind.PHYSICAL
        match next_rung(others, possible, known=run.reported is not None or harmless):
            case Rung.REPLACE:
                self._tell(events.ServiceReplaced(), now, run)
                return GoOn()
            case Rung.REPLAN:
                if not others:
                    services.exclude(run.excluded)
                return (yield from self._replan(now, reasons))

    def _replan(self, now: float, reasons: tuple[str, ...]) -> EffectsReturning[Next | None]:
        """From the map as it is now to the goal; what runs is awaited first."""
        execution = self._execution
        assert execution.workflow is not None or execution.replan_because is not None
        if execution.fixed:
            return (yield from self._fail(reasons, now))
        if execution.replans.spent:
            return (yield from self._fail((*reasons, str(execution.replans)), now))
        yield from self._withdraw("the plan changed", now)
        if execution.workflow is not None and execution.workflow.busy:
            execution.replan_because, execution.phase = reasons, Phase.RECOVERING
            return None
        execution.replan_because = None
        execution.replans.count()
        self._tell(events.Replanned(reasons=reasons), now)
        yield from self._plan(now)
        return None

    # Ending

    def _finish(self, now: float) -> EffectsReturning[Next | None]:
        execution = self._execution
        if execution.fixed or known_to_hold(parse(execution.goal), self._context.replica):
            return Reached()
        goal = "the goal" if execution.kind is GoalKind.TASK else execution.goal
        return (yield from self._replan(now, (f"every step was done, but {goal} does not hold",)))

    def _fail(self, reasons: tuple[str, ...], now: float) -> EffectsReturning[Next | None]:
        yield from self._withdraw("the plan was given up", now)
        yield from self.abandon()
        for run in self._execution:
            member = self._member(run)
            if member is None:
                continue
            if run.progress is Progress.ARRANGED:
                yield from self._participants.dismiss(member, "the plan was given up", now)
            elif run.progress is Progress.EXECUTING and member.state is State.EXECUTING:
                yield from self._participants.halt(member, "the plan was given up", now)
        return CannotBeHad(reasons)

    # What it works with

    @property
    def _workflow(self) -> Workflow:
        assert self._execution.workflow is not None, "there is a plan"
        return self._execution.workflow

    @property
    def _arrangement(self) -> Arrangement:
        return Arrangement(self._workflow, self._scope.state.members, self._participants)

    def _member(self, run: StepRun) -> Member | None:
        return self._scope.state.members.get(run.participant)
