"""A task from its submission to its outcome (paper, "Protocol for failure handling and recovery": the realization of a task is a
transaction).

A transaction executes the task's goal and further goals, one at a time (`goal_executor.py`). It handles the participants' messages and
sends their reports to the map (`participant_events.py`). It has objects observed whose state is unknown (`recovery/observation.py`), and
compensates the work of a task that is not accomplished (`recovery/compensation.py`). `ending.py` stops it and gives it its outcome.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet

from somrs.kernel.component import Effects, EffectsReturning
from somrs.ontology.services import Occasion
from somrs.planner.model.plan import Plan
from somrs.protocol.messages import events
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_text import holders_text
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.previews import Previewed
from somrs.protocol.messages.reservations import ReservationLost, Reserved
from somrs.task_manager.context import TaskManagerContext
from somrs.task_manager.execution.execution_log import Work
from somrs.task_manager.execution.reports import ReportResult, UnobservedSubject, settlement
from somrs.task_manager.recovery.compensation import UNDOING, RestorationGoal, Undoing
from somrs.task_manager.recovery.handlers import fitting_handlers
from somrs.task_manager.recovery.observation import Look, LookPlan
from somrs.task_manager.requests import DiscoveredOffers, ForLook, ForPlan, ForReservation, ReservationAnswer
from somrs.task_manager.timers import Answer, BidsDue, DeadlineDue, OverdueDue, PlanWanted, RetryDue, SilenceDue, StopDue
from somrs.task_manager.transaction.deadline import Deadline
from somrs.task_manager.transaction.ending import Ending
from somrs.task_manager.transaction.goal_executor import GoalExecutor
from somrs.task_manager.transaction.next_action import GoalReached, GoalUnreachable, NextAction, NoPlanFound, Proceed, StepLost, UndoFirst
from somrs.task_manager.transaction.participant_events import GoalAction, ParticipantEvents
from somrs.task_manager.transaction.pausing import Pausing
from somrs.task_manager.transaction.renamed_objects import TaskRenamer
from somrs.task_manager.transaction.retry_wait import RetryWait
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import GoalExecution, TaskState
from somrs.task_manager.transaction.step_executor import StepExecutor


class Transaction:
    """Continues one task. It has no state of its own."""

    def __init__(self, state: TaskState, context: TaskManagerContext) -> None:
        self.state, self._context = state, context
        self._scope = TaskScope(state, context)
        self._participants, self._ending = ParticipantEvents(self._scope), Ending(self._scope)

    # Inputs

    def start(self, now: float) -> Effects:
        state = self.state
        self._scope.log_event(events.TaskStated(effect=state.task.effect), now)
        yield from Deadline(self._scope).watch(now)
        yield from self._apply_action(state.goal, (yield from self._executor(state.goal).begin(now)), now)

    def discovered(self, purpose: ForPlan | ForLook, offers: DiscoveredOffers, now: float) -> Effects:
        """Handle the services on offer, or the reason why they are not known."""
        if isinstance(purpose, ForLook):
            yield from self._look((yield from self._scope.observation.discovered(purpose, offers, now)), now)
            return
        execution = self._execution(purpose.goal)
        if execution is not None:
            yield from self._apply_action(execution, (yield from self._executor(execution).discovered(purpose.serial, offers, now)), now)

    def planned(self, question: PlanWanted, answer: Answer, now: float) -> Effects:
        """Handle the planner's answer."""
        execution = self._execution(question.goal)
        if execution is not None:
            yield from self._apply_action(execution, (yield from self._executor(execution).planned(question, answer, now)), now)

    def reserved(self, purpose: ForReservation, answer: ReservationAnswer, now: float) -> Effects:
        """Handle the answer to a request for objects; a later request has taken the place of an earlier one."""
        state = self.state
        if isinstance(answer, Reserved):
            state.log.overtake(answer.overtaken)
        if purpose.serial != state.reservation.serial:
            return
        answer = state.reservation.answered(answer)
        if purpose.goal == UNDOING and state.undoing is not None:
            self._scope.compensation(state.undoing).reserved(answer)
            yield from self.proceed(now)
        elif (execution := self._execution(purpose.goal)) is not None:
            yield from self._apply_action(execution, (yield from self._executor(execution).reserved(answer, now)), now)

    def lost_reservation(self, lost: ReservationLost, now: float) -> Effects:
        """Other tasks have taken what the task had reserved: it plans anew."""
        if self.state.reservation.lose(lost.fence) and self.state.ending is None:
            reason = f"the reservation was lost: {holders_text(lost.holders)}"
            for execution in self.state.executions:
                yield from self._executor(execution).plan_when_idle(reason)
            yield from self.proceed(now)

    def plan_quoted(self, id: str, previewed: Previewed, now: float) -> Effects:
        """Handle the quotes for one of the plans that the task compares."""
        action = yield from self._executor(self.state.goal).plan_quoted(id, previewed, now)
        yield from self._apply_action(self.state.goal, action, now)

    def receive(self, message: Message, now: float) -> Effects:
        """Handle a protocol message from a participant."""
        yield from self._apply_goal_action((yield from self._participants.receive(message, now)), now)

    def delivery_failed(self, message: Message, reason: str, now: float) -> Effects:
        """Handle a message that could not be delivered."""
        yield from self._apply_goal_action((yield from self._participants.delivery_failed(message, reason, now)), now)

    def report_answered(self, answer: Message, now: float) -> EffectsReturning[tuple[int, ReportResult] | None]:
        """Handle the Repository's answer to a report. Returns None if the report is settled.

        Otherwise returns the map version that the replica must reach before the caller calls `settled`, and what became of the report.
        """
        version, result = settlement(answer)
        if version is not None and version > self._context.replica.version:
            return version, result
        yield from self.settled(result, now)
        return None

    def settled(self, result: ReportResult, now: float) -> Effects:
        """A report is on the replica's map, or the Repository rejected it."""
        reports = self.state.reports
        match reports.waiting[0].subject:
            case UnobservedSubject() as subject:
                self._scope.observation.assumed(subject, result, now)
            case subject:
                self._participants.settled(subject, result, now)
        yield from RetryWait(self.state.goal, self._scope).hasten(now)
        if reports.settle_first():
            yield from self.proceed(now)
        else:
            yield from reports.send_next(self.state.id, self._context, now)

    def timer_fired(self, timer: BidsDue | SilenceDue | OverdueDue | DeadlineDue | RetryDue | StopDue, now: float) -> Effects:
        """Handle a timer of the task."""
        match timer:
            case BidsDue(goal=goal):
                execution = self._execution(goal)
                if execution is not None and (yield from self._executor(execution).arranger.bids_due(now)):
                    yield from self._apply_action(execution, Proceed(), now)
            case SilenceDue(participant=participant):
                yield from self._apply_goal_action((yield from self._participants.silent(participant, now)), now)
            case OverdueDue(participant=participant):
                yield from self._apply_goal_action((yield from self._participants.overdue(participant, now)), now)
            case DeadlineDue():
                yield from self._stop(now, Outcome.FAILED, (f"the deadline of {self.state.task.deadline:g} s is over",))
            case RetryDue() if self.state.reports.pending or not self._context.replica.is_current:
                yield from RetryWait(self.state.goal, self._scope).postpone(now)
            case RetryDue():
                yield from self._executor(self.state.goal).retry(now)
            case StopDue():
                yield from self._stop_overdue(now)

    def restarted(self, now: float) -> Effects:
        """Continue after a restart of the Task Manager."""
        for execution in self.state.executions:
            yield from self._executor(execution).arranger.ask_anew(now)
        yield from self.proceed(now)

    def freed(self, now: float) -> Effects:
        """The objects that the task waits for are free."""
        if self.state.ending is None:
            self._executor(self.state.goal).freed(now)
            yield from self.proceed(now)

    def services_joined(self, services: Iterable[str], now: float) -> Effects:
        """Handle the arrival of services: participants are followed to new addresses, and a task that waits tries again."""
        self._scope.services.returned(services)
        yield from self._scope.participants.services_joined(services, now)
        yield from RetryWait(self.state.goal, self._scope).hasten(now)

    def clock_adjusted(self, now: float) -> Effects:
        """Handle a notice of the world's time."""
        yield from Deadline(self._scope).watch(now)

    def map_changed(self, now: float) -> Effects:
        """Handle a change of the map, for a task with invariants: services whose invariant it breaks are stopped."""
        if self.state.ending is None:
            for execution in self.state.executions:
                yield from StepExecutor(execution, self._scope).stop_where_broken(now)

    def objects_changed(self, objects: AbstractSet[str], now: float) -> Effects:
        """Handle a change of the map, for a task that waits: if it waits for a device which changed, it tries again."""
        if not objects.isdisjoint(self._scope.services.excluded_providers):
            yield from RetryWait(self.state.goal, self._scope).hasten(now)

    def devices_freed(self, devices: AbstractSet[str], now: float) -> Effects:
        """Handle devices that an operator lets work again: the time in which they stood still does not count, and a task that waits tries
        again."""
        yield from self._scope.participants.resumed(devices, now)
        yield from RetryWait(self.state.goal, self._scope).hasten(now)

    def objects_renamed(self, names: Mapping[str, str], now: float) -> Effects:
        """Handle new names of objects: goals speak of them, and plans with the old names are made anew."""
        state = self.state
        outdated = TaskRenamer(names, self._context.replica.ontology).rename(state)
        state.reservation.rename(names)
        if outdated and state.ending is None:
            reason = "; ".join(f"{name} is {to} now" for name, to in names.items())
            for execution in outdated:
                yield from self._executor(execution).plan_when_idle(reason)
            yield from self.proceed(now)

    def cancel(self, now: float, reason: str) -> Effects:
        """Cancel the task for its client."""
        yield from self._stop(now, Outcome.CANCELLED, (reason or "cancelled by the client",))

    def pause(self, author: str, now: float) -> Effects:
        """Pause the task for an operator."""
        self._context.touched[self.state.id] = None
        yield from Pausing(self._scope).begin(author, now)

    def resume(self, author: str, now: float) -> Effects:
        """Let the task go on after a pause."""
        yield from Pausing(self._scope).end(author, now)
        yield from self.proceed(now)

    # Progress

    def proceed(self, now: float) -> Effects:
        """Do what comes next; nothing while the task is paused, or a report is on its way to the map (FRP, property 5)."""
        state = self.state
        self._context.touched[state.id] = None
        if state.pause is not None:
            yield from Pausing(self._scope).hold_devices(now)
            return
        if state.outcome is not None or state.reports.pending or state.look_queue.current_look is not None:
            return
        if state.ending is not None and state.undoing is None and state.members.working:
            return
        if state.look_queue.unseen:
            yield from self._scope.observation.begin(now)
        elif state.side_goals:
            execution = state.side_goals[-1]
            yield from self._apply_action(execution, (yield from self._executor(execution).proceed(now)), now)
        elif state.undoing is not None:
            yield from self._undo(state.undoing, now)
        elif state.ending is not None:
            yield from self._ending.begin_undoing()
            yield from self.proceed(now)
        else:
            yield from self._apply_action(state.goal, (yield from self._executor(state.goal).proceed(now)), now)

    def _apply_goal_action(self, goal_action: GoalAction, now: float) -> Effects:
        if goal_action is not None:
            execution, action = goal_action
            yield from self._apply_action(execution if execution is not None else self.state.goal, action, now)

    def _apply_action(self, execution: GoalExecution, action: NextAction | None, now: float) -> Effects:
        """Carry out the action that the execution of a goal leaves to the transaction."""
        match action:
            case Proceed():
                yield from self.proceed(now)
            case GoalReached():
                yield from self._goal_reached(execution, now)
            case GoalUnreachable(reasons):
                yield from self._goal_unreachable(execution, reasons, now)
            case StepLost(step, reasons):
                if not (yield from self._try_handler(execution, step, now)):
                    yield from self._apply_action(execution, (yield from self._executor(execution).recover(step, reasons, now)), now)
            case UndoFirst(estimate):
                if (yield from self._try_unblocking(execution, (), now, estimate)):
                    return
                yield from self._apply_action(execution, (yield from self._executor(execution).go_on(now)), now)
            case NoPlanFound(reasons):
                if not (yield from self._try_unblocking(execution, reasons, now)):
                    yield from self._apply_action(execution, (yield from self._executor(execution).without_plan(reasons, now)), now)

    def _goal_reached(self, execution: GoalExecution, now: float) -> Effects:
        """A goal holds."""
        state = self.state
        if execution is state.goal:
            yield from self._ending.conclude(Outcome.ACCOMPLISHED, now)
            return
        state.side_goals.remove(execution)
        if execution.look is not None:
            runs = (run for other_execution in state.executions for run in other_execution)
            self._scope.observation.completed(execution.look, {run.label for run in execution}, runs, now)
        elif execution.kind is GoalKind.UNDO and state.undoing is not None:
            self._scope.compensation(state.undoing).goal_reached(now)
        yield from self.proceed(now)

    def _goal_unreachable(self, execution: GoalExecution, reasons: tuple[str, ...], now: float) -> Effects:
        """A goal cannot be reached."""
        state = self.state
        if execution is state.goal:
            yield from self._stop(now, Outcome.FAILED, reasons)
            return
        state.side_goals.remove(execution)
        work = state.log.work_by_number(execution.work) if execution.work is not None else None
        self._scope.log_event(events.GoalFailed(goal=execution.kind, step=work.label if work else "the task", reasons=reasons), now)
        if execution.kind is GoalKind.LOOK and execution.look is not None:
            yield from self._look((yield from self._scope.observation.next_plan(execution.look, now)), now)
            return
        if execution.kind is GoalKind.UNDO and state.undoing is not None:
            if work is not None:
                work.note = work.note or reasons[0]
            self._scope.compensation(state.undoing).goal_failed()
        yield from self.proceed(now)

    def _try_handler(self, execution: GoalExecution, step: str, now: float) -> EffectsReturning[bool]:
        """Begin a handler for the failure of the step, if one fits, and return whether one does. The step is recovered after it."""
        assert execution.workflow is not None, "a step of it was lost"
        state, run = self.state, execution.workflow.runs[step]
        work = next((work for work in reversed(state.log.works) if work.key == run.key), None)
        if work is None or state.ending is not None:
            return False
        for handler in fitting_handlers(state.task.handlers, work, Occasion.FAILURE, self._context.replica):
            if handler.effect not in run.handled:
                run.handled.add(handler.effect)
                self._scope.log_event(events.HandlerBegun(effect=handler.effect), now, run)
                yield from self._pursue(handler.effect, GoalKind.HANDLER, work, now)
                return True
        return False

    def _try_unblocking(
        self, execution: GoalExecution, reasons: tuple[str, ...], now: float, estimate: events.UndoingCheaper | None = None
    ) -> EffectsReturning[bool]:
        """Have failed services compensate, so that there may be a plan again (FRP, third recovery step). Returns whether any can."""
        state = self.state
        works = [work for work in state.log.interrupted() if state.members.is_interrupted(work.participant)]
        if execution is not state.goal or state.ending is not None or state.undoing is not None or not works:
            return False
        if state.goal.workflow is not None and state.goal.workflow.busy:
            return False
        self._scope.log_event(estimate if estimate is not None else events.FailuresUndone(reasons=reasons), now)
        state.blocked = reasons
        state.undoing = Undoing.from_works(works, by_other_services=False)
        yield from self.proceed(now)
        return True

    def _pursue(self, goal: str, kind: GoalKind, work: Work, now: float, plan: Plan | None = None, look: Look | None = None) -> Effects:
        state = self.state
        state.goal_count += 1
        execution = GoalExecution.create(state.id, state.goal_count, goal, kind, work.number, look)
        state.side_goals.append(execution)
        yield from self._apply_action(execution, (yield from self._executor(execution).begin(now, plan)), now)

    # Compensation

    def _undo(self, undoing: Undoing, now: float) -> Effects:
        state = self.state
        match (yield from self._scope.compensation(undoing).proceed(now)):
            case RestorationGoal(goal, work):
                yield from self._pursue(goal, GoalKind.UNDO, work, now)
            case True if state.ending is not None:
                yield from self._ending.conclude(state.ending, now)
            case True:
                state.undoing = None
                executor = self._executor(state.goal)
                if undoing.restored or state.goal.deferred_plan is not None or executor.readmit_failed(now):
                    yield from executor.plan_anew(now)
                else:
                    yield from self._apply_action(state.goal, (yield from executor.without_plan(state.blocked, now)), now)

    # Observation

    def _look(self, look_plan: LookPlan | None, now: float) -> Effects:
        """Execute the plan of an observation; without one, continue the task."""
        if look_plan is None:
            yield from self.proceed(now)
            return
        work = self.state.log.work_by_number(look_plan.look.work)
        yield from self._pursue(str(look_plan.plan.steps[0].effect), GoalKind.LOOK, work, now, look_plan.plan, look_plan.look)

    # Ending

    def _stop(self, now: float, outcome: Outcome, reasons: tuple[str, ...]) -> Effects:
        if self.state.outcome is None and self.state.ending is None:
            yield from self._ending.stop(outcome, reasons, now)
            yield from self.proceed(now)

    def _stop_overdue(self, now: float) -> Effects:
        """Give up the participants that have not stopped in time."""
        state = self.state
        if state.outcome is not None or state.ending is None:
            return
        for member in state.members.working:
            if member.state is State.COMPENSATING:
                yield from self._scope.participants.force_end(member, now)
            elif not member.halting:
                yield from self._scope.participants.give_up_member(member)
                event = events.ServiceLost(service=member.offer.service, stopping=True)
                yield from self._apply_goal_action(self._participants.lost(member, event, now), now)
        yield from self.proceed(now)

    # Parts

    def _execution(self, number: int) -> GoalExecution | None:
        return next((execution for execution in self.state.executions if execution.number == number), None)

    def _executor(self, execution: GoalExecution) -> GoalExecutor:
        return GoalExecutor(execution, self._scope)
