"""The execution of the steps of one goal: a step begins when its device is free and its precondition holds, and ends with its result."""

from __future__ import annotations

from somrs.entish.parse import parse
from somrs.kernel.component import Effects, EffectsReturning
from somrs.protocol.messages import events, frp, waits
from somrs.protocol.messages.frp import State
from somrs.task_manager.execution.invariants import broken_invariant
from somrs.task_manager.execution.knowledge import output_texts, relevant_parts, told, told_all
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import Progress, StepRun, Workflow
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import GoalExecution


class StepExecutor:
    """Starts and ends steps of one goal. It has no state of its own."""

    def __init__(self, execution: GoalExecution, scope: TaskScope) -> None:
        self._execution, self._scope = execution, scope

    def begin(self, run: StepRun, now: float) -> EffectsReturning[tuple[str, ...]]:
        """Start an arranged step, unless it has to wait for its device. Returns why the plan is invalid, if it is."""
        state, context, participants = self._scope.state, self._scope.context, self._scope.participants
        member = self._member(run)
        rank = (-state.task.priority, run.start, state.submitted_at, state.id)
        if not context.queues.request_turn(member.offer, state.id, rank, context.still_at_work):
            if not run.is_waiting:
                run.is_waiting = True
                self._scope.log_event(waits.WaitsForDevice(device=member.offer.provider), now, run)
            return ()
        try:
            situation = self._scope.services.precondition(run, member)
        except LookupError as error:
            yield from participants.dismiss(member, "its precondition does not hold any more", now)
            self._workflow.release(run)
            return (f"{run.step.service_type} cannot start: {error}",)
        self._workflow.move(run, Progress.EXECUTING)
        service_type = self._scope.services.type_of(run.step)
        state.log.begin(run, service_type, member, context.replica.map, context.replica.ontology, now)
        inputs = {name: str(term) for name, term in run.step.inputs.items()}
        execute = frp.Execute(inputs=inputs, precondition=str(situation) if situation is not None else None)
        yield from participants.execute(member, execute, now)
        self._scope.log_event(events.StepStarted(service=member.offer.service), now, run)
        return ()

    def stop_where_broken(self, now: float) -> Effects:
        """Stop the services whose invariant does not hold on the map any more."""
        scope = self._scope
        for run in self._execution:
            if run.progress is not Progress.EXECUTING or (member := self._member(run)).state is not State.EXECUTING:
                continue
            broken = broken_invariant(scope.services.type_of(run.step), run, member, scope.context.replica)
            if broken is not None:
                scope.log_event(events.InvariantBroken(service=member.offer.service, invariant=broken), now, run)
                yield from self._interrupt(member, f"{broken} does not hold any more", now)

    def order_again(self, run: StepRun, now: float) -> Effects:
        """The order to begin has not reached the service. It is repeated if the step may still begin; otherwise the service is stopped."""
        member = self._member(run)
        try:
            self._scope.services.precondition(run, member)
        except LookupError as error:
            yield from self._interrupt(member, str(error), now)
        else:
            yield from self._scope.participants.order_again(member, now)

    def _interrupt(self, member: Member, reason: str, now: float) -> Effects:
        member.interruption = reason
        yield from self._scope.participants.halt(member, reason, now)

    def start_reporting(self, run: StepRun) -> None:
        """The step has ended, and its report goes to the map."""
        self._workflow.move(run, Progress.REPORTING)

    def finish_step(self, run: StepRun, situation: str | None, failure: str | None, now: float) -> None:
        """Set the result of a step whose report is settled: completed, or failed and open again."""
        self._execution.conditions.forget()
        if failure is None:
            self._workflow.move(run, Progress.COMPLETED)
            self._execution.replans.step_completed()
            self._note_what_is_told(run, situation, now)
            return
        member = self._member(run)
        if member.interruption is None:
            run.excluded[member.offer.service] = failure
        run.reported = parse(situation) if situation is not None else None
        self._workflow.release(run, failure)

    def _note_what_is_told(self, run: StepRun, situation: str | None, now: float) -> None:
        """Log what the step has told. If it has not told all that it had to, its device is not asked for it again."""
        map, ontology = self._scope.context.replica.map, self._scope.context.replica.ontology
        if not run.step.tells:
            return
        if told(run, map, ontology):
            self._scope.services.tells(run.step)
            told_parts = relevant_parts(run, situation) if situation is not None else None
            event = events.FoundOut(service=self._member(run).offer.service, situation=told_parts, outputs=output_texts(run.outputs))
            self._scope.log_event(event, now, run)
        if not told_all(run, map, ontology):
            self._scope.services.tells_nothing(self._member(run).offer.provider, run.step)

    def lost(self, run: StepRun, service: str, reason: str) -> None:
        """The service that executes the step is lost."""
        run.excluded[service] = reason
        self._workflow.release(run, f"{service} {reason}")

    @property
    def _workflow(self) -> Workflow:
        assert self._execution.workflow is not None, "there is a plan"
        return self._execution.workflow

    def _member(self, run: StepRun) -> Member:
        member = self._scope.state.members.find_member(run.participant)
        assert member is not None, "the step has a participant"
        return member
