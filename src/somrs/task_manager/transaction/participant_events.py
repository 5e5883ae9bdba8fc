"""The messages and the silence of a task's participants, and their consequences: events for the client, situations for the map, and
results of work.
"""

from __future__ import annotations

from msgspec import structs

from somrs.entish.parse import parse
from somrs.kernel.component import Effects, EffectsReturning
from somrs.ontology.services import ServiceKind
from somrs.protocol.messages import events, frp
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_text import join_reasons, loss_text
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.task_manager.arrangement.conditions import condition_error
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.reports import ProgressSubject, Report, ReportResult, ReportSubject, WorkSubject
from somrs.task_manager.execution.workflow import Progress, StepRun
from somrs.task_manager.transaction.goal_executor import GoalExecutor
from somrs.task_manager.transaction.next_action import NextAction, Proceed
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import GoalExecution
from somrs.task_manager.transaction.step_executor import StepExecutor

GoalAction = tuple[GoalExecution | None, NextAction] | None
"""The next action of the transaction, and the goal that it concerns (None: the task's own)."""

_PROCEED: GoalAction = (None, Proceed())


class ParticipantEvents:
    """Handles the messages of participants, and participants that fall silent or are overdue. It has no state of its own."""

    def __init__(self, scope: TaskScope) -> None:
        self._scope, self._state = scope, scope.state

    def receive(self, message: Message, now: float) -> EffectsReturning[GoalAction]:
        """Handle a protocol message from a participant."""
        received = yield from self._scope.participants.receive(message, now)
        if received is None:
            return None
        member, transition, message = received
        self._scope.services.returned((member.offer.service,))
        if transition.moved:
            return (yield from self._process_message(member, message, now))
        if self._scope.participants.is_unreached(member, message.body):
            yield from self._order_again(member, now)
        elif isinstance(message.body, frp.Status) and self._scope.participants.has_reported(member, message.body):
            yield from self._scope.participants.ask_for_report(member, message.body, now)
        if member.lost_version is not None:
            yield from self._process_late_message(member, message, now)
        return None

    def _order_again(self, member: Member, now: float) -> Effects:
        """Repeat an order that has not arrived; an Execute only if its step may still begin."""
        execution, run = self._assignment(member)
        if member.state is State.EXECUTING and execution is not None and run is not None:
            yield from StepExecutor(execution, self._scope).order_again(run, now)
        else:
            yield from self._scope.participants.order_again(member, now)

    def delivery_failed(self, message: Message, reason: str, now: float) -> EffectsReturning[GoalAction]:
        """Handle a message that could not be delivered."""
        member = yield from self._scope.participants.delivery_failed(message, reason, now)
        return (yield from self._participant_left(member, member.exit_reason, now)) if member is not None else None

    def _assignment(self, member: Member) -> tuple[GoalExecution, StepRun] | tuple[None, None]:
        """The goal and the step that the participant is asked for, is committed to, or executes."""
        for execution in self._state.executions:
            if (run := self._executor(execution).run_of(member)) is not None:
                return execution, run
        return None, None

    def _executor(self, execution: GoalExecution) -> GoalExecutor:
        return GoalExecutor(execution, self._scope)

    def _log_event(self, event: Event, run: StepRun | None, now: float) -> None:
        self._scope.log_event(event, now, run)

    def _process_message(self, member: Member, message: Message, now: float) -> EffectsReturning[GoalAction]:
        name = member.offer.service
        execution, run = self._assignment(member)
        match message.body:
            case frp.Terms() as terms:
                if execution is None:
                    return None
                if (error := condition_error(terms.condition, self._scope.context.replica)) is not None:
                    self._log_event(events.ServiceRefused(service=name, reason=error), run, now)
                    yield from self._scope.participants.dismiss(member, error, now)
                    return (yield from self._participant_left(member, error, now))
                arranger = self._executor(execution).arranger
                is_settled = yield from arranger.terms_received(member, terms, message.header.message_id, now)
                return (execution, Proceed()) if is_settled else None
            case frp.Refuse(reason=reason, not_now=not_now, condition=condition) as refusal:
                self._scope.services.refused(name, not_now=refusal.passes)
                refused = events.ServiceRefused(service=name, reason=reason, not_now=not_now, condition=condition)
                self._log_event(refused, run, now)
                return (yield from self._participant_left(member, reason, now, is_lapsed=refusal.lapsed))
            case frp.Progress() as progress:
                yield from self._progressed(member, run, progress, now)
                return None
            case frp.Completed(situation=situation, outputs=outputs, observation=observation):
                member.fraction = 1.0
                if run is not None:
                    run.outputs = outputs
                self._record_slowness(member, now)
                self._log_event(events.StepCompleted(service=name, situation=situation), run, now)
                return (yield from self._reported(member, situation, observation, None, now))
            case frp.Failed(description=description, tried=False) if member.lost_version is None:
                self._log_event(events.NotBegun(service=name, description=description), run, now)
                return (yield from self._participant_left(member, description, now))
            case frp.Failed(description=description, situation=situation, observation=observation):
                self._log_event(events.StepFailed(service=name, description=description, situation=situation), run, now)
                return (yield from self._reported(member, situation, observation, f"failed: {description}", now))
            case frp.Stopped(tried=False) if member.lost_version is None:
                reason = member.interruption or "it was stopped first"
                self._log_event(events.NotBegun(service=name, description=reason), run, now)
                return (yield from self._participant_left(member, reason, now))
            case frp.Stopped(situation=situation, observation=observation):
                self._log_event(events.StepStopped(service=name), run, now)
                trouble = f"stopped, because {member.interruption}" if member.interruption is not None else "stopped"
                return (yield from self._reported(member, situation, observation, trouble, now))
            case _:
                return (yield from self._process_undo_message(member, run, message, now))

    def _record_slowness(self, member: Member, now: float) -> None:
        """Record how much longer than promised the work of a participant took."""
        work, terms = self._state.log.work_of(member), member.session.terms
        if work is not None and terms is not None:
            self._scope.context.pace.completed(now - work.started_at, terms.duration)

    def _process_undo_message(self, member: Member, run: StepRun | None, message: Message, now: float) -> EffectsReturning[GoalAction]:
        name = member.offer.service
        match message.body:
            case frp.Compensated(situation=situation, observation=observation):
                self._log_event(events.Compensated(service=name, situation=situation), run, now)
                return (yield from self._reported(member, situation, observation, None, now))
            case frp.Stranded(description=description, situation=situation, observation=observation):
                self._log_event(events.CompensationFailed(service=name, description=description, situation=situation), run, now)
                return (yield from self._reported(member, situation, observation, description, now))
            case frp.Fault(text=text) if member.state is State.ENDED:
                return (yield from self._participant_left(member, text, now))
            case frp.Fault(text=text) if member.state in (State.FAILED, State.STRANDED):
                self._log_event(events.ServiceFaulted(service=name, text=text), run, now)
                return (yield from self._reported(member, None, None, text, now))
            case frp.Status(state=status) if member.state in (State.FAILED, State.STRANDED):
                self._log_event(events.ContractForgotten(service=name), run, now)
                trouble = "somebody else has ended its contract" if status is State.ENDED else "it has forgotten its contract"
                return (yield from self._reported(member, None, None, trouble, now))
        return None

    def _progressed(self, member: Member, run: StepRun | None, progress: frp.Progress, now: float) -> Effects:
        member.fraction = progress.fraction
        if progress.note and progress.note != member.note:
            self._log_event(events.ProgressNoted(service=member.offer.service, note=progress.note), run, now)
            member.note = progress.note
        if progress.waits:
            yield from self._scope.participants.hindered(member, now)
        if progress.situation is not None:
            if (work := self._state.log.work_of(member)) is not None:
                work.situation = progress.situation
            yield from self._put_on_map(member, progress.situation, progress.observation, ProgressSubject(member.id), now)

    def _participant_left(self, member: Member, reason: str, now: float, *, is_lapsed: bool = False) -> EffectsReturning[GoalAction]:
        """A participant left before it began its step."""
        member.exit_reason = reason
        work = self._state.log.work_of(member)
        if work is not None and work.state is State.EXECUTING:
            self._state.log.drop(work)  # its terms, or its time to begin, had expired before Execute arrived
        execution, _ = self._assignment(member)
        if execution is None:
            return _PROCEED
        action = yield from self._executor(execution).participant_left(member, reason, now, is_lapsed=is_lapsed)
        return (execution, action) if action is not None else None

    def _reported(
        self, member: Member, situation: str | None, observation: Observation | None, trouble: str | None, now: float
    ) -> EffectsReturning[GoalAction]:
        """A participant's work or compensation has ended. Its report goes to the map before the task plans or arranges anything."""
        member.reported = True
        execution, run = self._assignment(member)
        if execution is not None and run is not None:
            StepExecutor(execution, self._scope).start_reporting(run)
        if (work := self._state.log.work_of(member)) is not None:
            work.end(member.state, now)
            if member.state is not State.STRANDED and work.state not in (State.COMPENSATED, State.STRANDED):
                work.state = member.state
            work.situation = situation or work.situation
            work.observed_at = observation.as_of if observation is not None else None
            work.note = trouble or work.note
        for goal_execution in self._state.executions:
            yield from self._executor(goal_execution).invalidate_plan(f"{member.offer.service} reported during planning")
        if situation is None:
            self._conclude_work(member, None, trouble, now)
            return _PROCEED
        member.reporting = True
        yield from self._put_on_map(member, situation, observation, WorkSubject(member.id, situation, trouble), now)
        return None

    def _put_on_map(self, member: Member, situation: str, observation: Observation | None, subject: ReportSubject, now: float) -> Effects:
        expected_version = member.lost_version
        caused = member.offer.service_type.kind is ServiceKind.PHYSICAL
        if observation is not None and observation.as_of is not None:
            # The clock of the participant's host may be slow; what it reports was not so before it was told to work.
            as_of = max(observation.as_of, member.last_order_time)
            member.last_news_time = max(member.last_news_time, min(as_of, now))
            observation, expected_version = structs.replace(observation, as_of=as_of, caused=caused), None
        update = UpdateMap(
            situation=situation,
            author=member.offer.service,
            expected_version=expected_version,
            observation=observation,
            reservation=self._state.reservation.under(self._state.id, only_seen=not caused and not self._state.log.has_work_on(situation)),
        )
        yield from self._state.reports.add_report(self._state.id, Report(update=update, subject=subject), self._scope.context, now)

    def settled(self, subject: ProgressSubject | WorkSubject, result: ReportResult, now: float) -> None:
        """A participant's report is on the map, or the Repository rejected it."""
        member = self._state.members.find_member(subject.participant)
        if member is None:
            return  # the task ended before that
        observation = self._state.reports.waiting[0].update.observation
        if observation is None or observation.as_of is None:  # for the map, it is as new as its arrival
            member.last_news_time = max(member.last_news_time, now)
        for event in result.events(member.offer.service):
            self._log_event(event, self._assignment(member)[1], now)
        if isinstance(subject, WorkSubject) and result.has_lost_reservation:
            self._conclude_work(member, None, subject.trouble or join_reasons(result.problems), now, is_to_blame=False)
        elif isinstance(subject, WorkSubject) and result.problems:
            rejection = join_reasons(result.problems)
            self._scope.services.reported_impossible(member.offer.service, rejection)
            self._conclude_work(member, None, subject.trouble or f"reported an impossible situation: {rejection}", now)
        elif isinstance(subject, WorkSubject):
            situation = result.named(subject.situation)
            if (work := self._state.log.work_of(member)) is not None and work.situation == subject.situation:
                work.situation = situation
            self._conclude_work(member, situation, subject.trouble, now)

    def _conclude_work(self, member: Member, situation: str | None, trouble: str | None, now: float, *, is_to_blame: bool = True) -> None:
        """Record the result of a participant's work, which `is_to_blame` for any trouble. The transaction then decides what to do next."""
        member.reporting = False
        state, services = self._state, self._scope.services
        work = state.log.work_of(member)
        compensated = member.state in (State.COMPENSATED, State.STRANDED)
        was_cancelled = member.state is State.STOPPED and state.ending is not None
        if trouble is not None and not compensated and not was_cancelled:
            if member.interruption is not None or not is_to_blame:
                pass  # it was stopped, or its report was refused, through no fault of its own
            elif work is not None and work.service_type.kind is ServiceKind.COGNITIVE:
                services.tells_nothing(member.offer.provider, work.step)  # it may well tell other things
            else:
                services.failed(member.offer.service, trouble, now)
            if work is not None and work.state is State.COMPLETED:
                work.state, work.result, work.note = State.FAILED, State.FAILED, trouble  # its report was impossible
        elif member.state is State.COMPLETED:
            services.completed(member.offer.service)
        execution, run = self._assignment(member)
        if execution is not None and run is not None and run.progress is Progress.REPORTING:
            StepExecutor(execution, self._scope).finish_step(run, situation, trouble, now)
        undo_tried = member.state is State.STRANDED and member.tried_to_undo
        silent_about = (
            work is not None and (undo_tried or not compensated) and (situation is None or not work.is_described_by(parse(situation)))
        )
        if work is not None and trouble is not None and silent_about and not was_cancelled:
            state.look_queue.add_work(work)

    def _process_late_message(self, member: Member, message: Message, now: float) -> Effects:
        """Report the result of a participant that was given up, and has received End or counts as stranded, because the map needs it."""
        match message.body:
            case frp.Completed() | frp.Failed() | frp.Stopped() | frp.Stranded() as report if not member.reported:
                member.reported = True
                if report.situation is not None:
                    yield from self._put_on_map(member, report.situation, report.observation, ProgressSubject(member.id), now)
            case frp.Status(state=State.NEW | State.ENDED):
                member.reported = True  # it has lost its contract, and never will

    # Silence

    def silent(self, participant: str, now: float) -> EffectsReturning[GoalAction]:
        """Check the heartbeat of a working participant."""
        member = yield from self._scope.participants.silent(participant, now)
        if member is None or self._state.outcome is not None:
            return None
        return self.lost(member, events.ServiceLost(service=member.offer.service, silent=True), now)

    def overdue(self, participant: str, now: float) -> EffectsReturning[GoalAction]:
        """Check a participant that may take far longer than it promised."""
        member = yield from self._scope.participants.overdue(participant, now)
        if member is None or self._state.outcome is not None:
            return None
        return self.lost(member, events.ServiceLost(service=member.offer.service), now)

    def lost(self, member: Member, event: events.ServiceLost, now: float) -> GoalAction:
        """Record that a participant is lost. Its own time limits make it stop; the situation that it left has to be observed."""
        service, reason = member.offer.service, loss_text(event)
        execution, run = self._assignment(member)
        self._log_event(event, run, now)
        self._scope.services.lost(service, reason)
        if (work := self._state.log.work_of(member)) is not None:
            work.end(State.UNREACHABLE, now)
            work.state, work.note = State.UNREACHABLE, reason
            self._state.look_queue.add_work(work)
        if execution is not None and run is not None:
            StepExecutor(execution, self._scope).lost(run, service, reason)
        return _PROCEED
