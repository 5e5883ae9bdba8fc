"""The execution of one goal: planning (`goal_planner.py`), arrangement (`step_arranger.py`), execution of the steps (`step_executor.py`),
and recovery of a failed step by replacement or replanning (`recovery/ladder.py`).

The goals are that of the task, and further goals on the way: what a handler demands, what a cognitive service observes, what a
compensation restores. Decisions that concern the whole task are returned to the transaction as a `NextAction`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from somrs.entish.parse import parse
from somrs.kernel.component import Effects, EffectsReturning
from somrs.ontology.services import ServiceKind
from somrs.planner.model.plan import NoPlan, Plan
from somrs.protocol.messages import events, waits
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.event_text import holders_text
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.previews import Previewed
from somrs.protocol.messages.task_views import Phase
from somrs.task_manager.arrangement.available_services import service_names
from somrs.task_manager.arrangement.call_for_proposals import MAX_OPEN_CALLS
from somrs.task_manager.arrangement.plan_request import PlanResult, ServicesUnknown
from somrs.task_manager.context import known_to_hold
from somrs.task_manager.execution.knowledge import told
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress, StepRun, Workflow
from somrs.task_manager.recovery.ladder import RecoveryStep, next_recovery_step
from somrs.task_manager.requests import DiscoveredOffers, ReservationAnswer
from somrs.task_manager.reservations import BlockedPlan
from somrs.task_manager.timers import Answer, PlanWanted
from somrs.task_manager.transaction.goal_planner import GoalPlanner
from somrs.task_manager.transaction.next_action import GoalReached, GoalUnreachable, NextAction, NoPlanFound, Proceed, StepLost, UndoFirst
from somrs.task_manager.transaction.retry_wait import RetryWait
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import GoalExecution
from somrs.task_manager.transaction.step_arranger import StepArranger
from somrs.task_manager.transaction.step_executor import StepExecutor
from somrs.task_manager.transaction.weighing import undoing_is_cheaper

MOST_LAPSES = 10
"""The number of times that services may be asked for new terms for a step, because those that were accepted did not hold any more."""


class GoalExecutor:
    """Continues the execution of one goal of a task. It has no state of its own."""

    def __init__(self, execution: GoalExecution, scope: TaskScope) -> None:
        self._execution, self._scope = execution, scope
        self._context, self._participants, self._services = scope.context, scope.participants, scope.services
        self._log_event = scope.log_event
        self._planner, self._retry_wait = GoalPlanner(execution, scope), RetryWait(execution, scope)

    # Planning

    def begin(self, now: float, plan: Plan | None = None) -> EffectsReturning[NextAction | None]:
        """Request a plan, or adopt the given plan as the only one."""
        if plan is None:
            yield from self._planner.request(now)
            return None
        self._execution.fixed = True
        return (yield from self._adopt_plan(plan, now))

    def plan_anew(self, now: float) -> Effects:
        """Request another plan after a change of the map."""
        self._execution.replans.count()
        yield from self._planner.request(now)

    def discovered(self, serial: int, offers: DiscoveredOffers, now: float) -> EffectsReturning[NextAction | None]:
        """Handle the services on offer; they are ignored if the request for the plan is out of date."""
        result = yield from self._planner.discovered(serial, offers)
        return (yield from self._planned(result, now)) if result is not None else None

    def planned(self, question: PlanWanted, answer: Answer, now: float) -> EffectsReturning[NextAction | None]:
        """Handle the planner's answer; it is ignored if the question is out of date."""
        result = yield from self._planner.answered(question, answer, now)
        return (yield from self._planned(result, now)) if result is not None else None

    def reserved(self, answer: ReservationAnswer, now: float) -> EffectsReturning[NextAction | None]:
        """Handle the answer to the request for the objects of a plan."""
        result = yield from self._planner.reserved(answer, now)
        return (yield from self._planned(result, now)) if result is not None else None

    def _planned(self, result: PlanResult, now: float) -> EffectsReturning[NextAction | None]:
        match result:
            case Plan() if (estimate := undoing_is_cheaper(self._execution, self._scope, result)) is not None:
                self._execution.deferred_plan = result
                return UndoFirst(estimate)
            case Plan():
                return (yield from self._adopt_plan(result, now))
            case BlockedPlan() if self._execution.kind is GoalKind.TASK:
                yield from self._wait(result, now)
                return Proceed() if self._execution.resumed else None
            case BlockedPlan():
                return (yield from self._fail((holders_text(result.holders),), now))
            case NoPlan():
                self._services.lacks(result.unoffered)
                first_reason, *further_reasons = self._services.why_no_plan(result)
                reasons = (f"no plan: {first_reason}", *further_reasons)
                if self._retry_wait.is_allowed and self._services.backing_off(now):
                    return (yield from self._wait_or_fail(reasons, now))
                return NoPlanFound(reasons)
            case ServicesUnknown(reason):
                return (yield from self._wait_or_fail((reason,), now, {"Service Registry": reason}))
            case str(reason):
                return (yield from self._fail((reason,), now))
            case _:
                return (yield from self._fail((f"planning failed: {result}",), now))

    def plan_quoted(self, id: str, previewed: Previewed, now: float) -> EffectsReturning[NextAction | None]:
        """Handle the quotes for one of several plans. With the last ones, adopt the plan that the policy prefers."""
        plan = yield from self._planner.plan_quoted(id, previewed, now)
        return (yield from self._adopt_plan(plan, now)) if plan is not None else None

    def go_on(self, now: float) -> EffectsReturning[NextAction | None]:
        """Adopt the plan from the present situation after all: nothing can be undone."""
        plan, self._execution.deferred_plan = self._execution.deferred_plan, None
        return (yield from self._adopt_plan(plan, now)) if plan is not None else None

    def without_plan(self, reasons: tuple[str, ...], now: float) -> EffectsReturning[NextAction | None]:
        """There is no plan, and nothing can be compensated to make one possible: try failed services again, or fail."""
        if readmitted := self.readmit_failed(now):
            self._log_event(events.TriedOnceMore(services=service_names(readmitted)), now)
            yield from self._planner.request(now)
            return None
        return (yield from self._wait_or_fail(reasons, now))

    def readmit_failed(self, now: float, run: StepRun | None = None) -> list[Offer]:
        """Readmit services that failed, for a step (None: any). A goal that may not wait does so at once. Returns their offers."""
        return self._services.readmit_failed(run, now=now if self._retry_wait.is_allowed else None)

    def _wait(self, blocked_plan: BlockedPlan, now: float) -> Effects:
        """Wait until the tasks that hold the objects have ended. Contracts are cancelled, because a waiting task holds nothing."""
        execution = self._execution
        yield from self._dismiss_arranged("the task has to wait for others", now)
        self._scope.log.end_attempt(is_news=True)
        execution.phase, execution.waiting_to_retry = Phase.WAITING, None
        execution.waiting_for = waits.WaitsForTasks.on(blocked_plan.holders)
        self._log_event(execution.waiting_for, now)
        if self._scope.state.reservation.is_free:  # the Repository said so before it said that the task has to wait
            self.freed(now)

    def _dismiss_arranged(self, reason: str, now: float) -> Effects:
        for run in self._execution:
            if run.progress is Progress.ARRANGED and (member := self._member(run)) is not None:
                yield from self._participants.dismiss(member, reason, now)
                self._workflow.release(run)

    def freed(self, now: float) -> None:
        """The objects that the goal waits for are free."""
        self._scope.state.reservation.is_free = True
        if self._execution.waiting_for is not None:
            self._execution.waiting_for, self._execution.resumed = None, True
            self._log_event(waits.GoesOn(), now)

    # Waiting to try again

    def _wait_or_fail(
        self, reasons: tuple[str, ...], now: float, hindrances: Mapping[str, str] = MappingProxyType({})
    ) -> EffectsReturning[NextAction | None]:
        """Give up for these reasons; or wait, and try again later, if some of them pass: the `hindrances`, and those known of the task."""
        passing = {**hindrances, **self._retry_wait.passing_hindrances(now)} if self._retry_wait.is_allowed else {}
        if not passing:
            return (yield from self._fail(reasons, now))
        yield from self.arranger.withdraw("the task has to wait", now)
        yield from self._dismiss_arranged("the task has to wait", now)
        yield from self._retry_wait.begin(passing, now)
        return None

    def retry(self, now: float) -> Effects:
        """Try again, if the goal waits for that."""
        if self._retry_wait.begin_attempt(now):
            yield from self._planner.request(now)

    def _adopt_plan(self, plan: Plan, now: float) -> EffectsReturning[NextAction | None]:
        execution = self._execution
        execution.replans.planned(len(plan.steps))
        old = execution.workflow
        part = plan.certain_part
        execution.outlook = plan if len(part.steps) < len(plan.steps) else None
        execution.workflow = workflow = Workflow.from_plan(part, f"{execution.number}.{execution.plans}/", execution.label, execution.kind)
        for member in workflow.adopt(old, self._scope.state.members) if old is not None else ():
            yield from self._participants.dismiss(member, "the plan changed", now)
        if not execution.fixed:
            foreseen = len(plan.steps) - len(part.steps)
            self._log_event(events.Planned(steps=len(plan.steps), foreseen=foreseen, doubts=plan.doubts), now)
        execution.phase = Phase.ARRANGING
        return Proceed()

    def invalidate_plan(self, reason: str) -> Effects:
        """Withdraw a plan request, because the map is about to change. The plan is requested again later."""
        execution = self._execution
        if self._planner.is_active:
            yield from self._planner.withdraw()
            execution.replan_because, execution.phase = (reason,), Phase.RECOVERING

    def plan_when_idle(self, reason: str) -> Effects:
        """The plan is out of date: it names objects that have other names now, or has lost them. It is made anew as soon as no step is
        executing."""
        execution = self._execution
        yield from self.invalidate_plan(reason)
        if execution.workflow is not None and not execution.fixed and not execution.is_pending:
            execution.replan_because = execution.replan_because or (reason,)

    def abandon(self, now: float) -> Effects:
        """Stop working on the goal. The transaction informs the participants."""
        execution = self._execution
        yield from self._planner.withdraw()
        execution.waiting_for, execution.resumed = None, False
        yield from self._retry_wait.abandon()
        if execution.kind is GoalKind.TASK and self._scope.state.reservation.waiting is not None:
            yield from self._scope.reserving.release(now)
        yield from execution.calls.close_all()

    # Arranging

    def proceed(self, now: float) -> EffectsReturning[NextAction | None]:
        """Do what comes next; nothing while a plan is being made or the goal waits for other tasks."""
        execution = self._execution
        workflow = execution.workflow
        if execution.is_pending:
            return None
        if execution.resumed:
            execution.resumed = False
            yield from self._planner.request(now)
        elif execution.replan_because is not None:
            return (yield from self._replan(now, execution.replan_because))
        elif workflow is None:
            return None
        elif (failed := workflow.failed) is not None:
            return (yield from self._begin_recovery(failed, (failed.failure or "",), now))
        elif workflow.is_completed:
            self._retry_wait.end(now)
            return (yield from self._finish(now))
        elif not execution.fixed and (redefined := self._services.redefined_types(workflow.unarranged)):  # what is arranged stays so
            return (yield from self._replan(now, tuple(f"{name} is defined anew" for name in redefined)))
        elif execution.conditions.pending and not execution.calls and not workflow.busy:
            yield from self._planner.request(now)
        elif execution.conditions.pending:
            execution.phase = Phase.ARRANGING
        elif (runs := workflow.open) or execution.calls:
            execution.phase = Phase.ARRANGING
            for run in runs[: MAX_OPEN_CALLS - len(execution.calls)]:
                if not self._context.may_ask(self._scope.state.id):
                    break
                if reasons := (yield from self.arranger.arrange(run, now)):
                    return (yield from self._begin_recovery(run, reasons, now))
        elif workflow.arranged:
            self._retry_wait.end(now)
            execution.phase = Phase.EXECUTING
            for run in workflow.ready:
                if reasons := (yield from StepExecutor(execution, self._scope).begin(run, now)):
                    return (yield from self._replan(now, reasons))
        return None

    def participant_left(self, member: Member, reason: str, now: float, *, is_lapsed: bool = False) -> EffectsReturning[NextAction | None]:
        """A participant left before it began its step. `is_lapsed`: it can be asked for new terms."""
        if self._execution.calls.find_call(member) is not None:
            return Proceed() if (yield from self.arranger.participant_left(member, reason, now)) else None
        if (run := self.run_of(member)) is not None:
            if member.interruption is not None:  # what the step needs has to be made true first
                self._execution.replan_because = (reason,)
            elif is_lapsed and run.lapses < MOST_LAPSES:
                run.lapses += 1
            else:
                run.excluded[member.offer.service] = reason
            self._workflow.release(run)
            return Proceed()
        return None

    @property
    def arranger(self) -> StepArranger:
        """What asks the services for terms, and chooses among them."""
        return StepArranger(self._execution, self._scope)

    def run_of(self, member: Member) -> StepRun | None:
        """The step that the participant is asked for, is committed to, or executes."""
        execution = self._execution
        call = execution.calls.find_call(member)
        if call is not None:
            return self._workflow.runs[call.step]
        return execution.workflow.held_by(member) if execution.workflow is not None else None

    # Recovering

    def _begin_recovery(self, run: StepRun, reasons: tuple[str, ...], now: float) -> EffectsReturning[NextAction | None]:
        """Begin the recovery of a step that has lost its service."""
        was_started = run.failure is not None
        is_look = self._execution.kind is GoalKind.LOOK or self._recognises  # what the map says replaces no observation
        if was_started and not is_look and known_to_hold(run.step.effect, self._context.replica):
            self._workflow.set_failure(run, None)
            self._workflow.move(run, Progress.COMPLETED)
            self._log_event(events.FoundSo(), now, run)
            return Proceed()
        if was_started:
            return StepLost(run.step.id, reasons)
        return (yield from self.recover(run.step.id, reasons, now))

    def recover(self, step: str, reasons: tuple[str, ...], now: float) -> EffectsReturning[NextAction | None]:
        """Recover the step by replacement or replanning."""
        run, services = self._workflow.runs[step], self._services
        was_started = run.failure is not None
        self._workflow.set_failure(run, None)
        alternatives = services.able_offers(run)
        try:
            run.precondition = services.precondition(run)
            possible = True
        except LookupError:
            possible = False
        bound = run.step.provider is not None  # a plan without this provider is a detour, or impossible
        if was_started and not alternatives and (possible or bound) and (alternatives := self.readmit_failed(now, run)):
            self._log_event(events.MayTryAgain(services=service_names(alternatives)), now, run)
        harmless = services.type_of(run.step).kind is not ServiceKind.PHYSICAL
        match next_recovery_step(alternatives, possible, outcome_known=run.reported is not None or harmless):
            case RecoveryStep.REPLACE:
                self._log_event(events.ServiceReplaced(), now, run)
                return Proceed()
            case RecoveryStep.REPLAN:
                conditions = self._execution.conditions
                is_met_by_none = self._recognises  # a plan that only observes moves nothing for a condition
                barred = {name: reason for name, reason in run.excluded.items() if is_met_by_none or not conditions.is_conditional(name)}
                if not alternatives and harmless and len(barred) == len(run.excluded):
                    services.tell_nothing(run)
                elif not alternatives:
                    services.exclude(barred)
                return (yield from self._replan(now, reasons))

    def _replan(self, now: float, reasons: tuple[str, ...]) -> EffectsReturning[NextAction | None]:
        """Request a plan from the current map to the goal, once all executing steps have ended."""
        execution = self._execution
        assert execution.workflow is not None or execution.replan_because is not None
        if execution.fixed:
            return (yield from self._fail(reasons, now))
        reasons_to_stop = (*reasons, str(execution.replans))
        is_exhausted = execution.replans.is_exhausted and not self._recognises  # no observation is planned twice
        if is_exhausted and not self._retry_wait.passing_hindrances(now):
            return (yield from self._fail(reasons_to_stop, now))
        yield from self.arranger.withdraw("the plan changed", now)
        if execution.workflow is not None and execution.workflow.busy:
            execution.replan_because, execution.phase = reasons, Phase.RECOVERING
            return None
        if is_exhausted:
            return (yield from self._wait_or_fail(reasons_to_stop, now))
        execution.replan_because = None
        execution.replans.count()
        self._log_event(events.Replanned(reasons=reasons), now)
        yield from self._planner.request(now)
        return None

    # Ending

    def _finish(self, now: float) -> EffectsReturning[NextAction | None]:
        execution = self._execution
        if execution.fixed or self._recognises or known_to_hold(parse(execution.goal), self._context.replica):
            return GoalReached()
        if any(run.step.tells for run in execution):
            return (yield from self._complete_plan(now))
        goal = "the goal" if execution.kind is GoalKind.TASK else execution.goal
        return (yield from self._replan(now, (f"every step was done, but {goal} does not hold",)))

    def _complete_plan(self, now: float) -> EffectsReturning[NextAction | None]:
        """Plan the rest: what the steps of the plan had to tell is known."""
        replans, map, ontology = self._execution.replans, self._context.replica.map, self._context.replica.ontology
        if not any(told(run, map, ontology) for run in self._execution if run.step.tells):
            if replans.is_exhausted:
                return (yield from self._fail((str(replans),), now))
            replans.count()
        yield from self._planner.request(now)
        return None

    def _fail(self, reasons: tuple[str, ...], now: float) -> EffectsReturning[NextAction | None]:
        yield from self.arranger.withdraw("the plan was given up", now)
        yield from self.abandon(now)
        for run in self._execution:
            member = self._member(run)
            if member is None:
                continue
            if run.progress is Progress.ARRANGED:
                yield from self._participants.dismiss(member, "the plan was given up", now)
            elif run.progress is Progress.EXECUTING and member.state is State.EXECUTING:
                yield from self._participants.halt(member, "the plan was given up", now)
        return GoalUnreachable(reasons)

    # Parts

    @property
    def _recognises(self) -> bool:
        """Whether the goal is a question, which observations answer."""
        return self._execution.kind is GoalKind.TASK and self._scope.state.task.recognise

    @property
    def _workflow(self) -> Workflow:
        assert self._execution.workflow is not None, "there is a plan"
        return self._execution.workflow

    def _member(self, run: StepRun) -> Member | None:
        return self._scope.state.members.find_member(run.participant)
