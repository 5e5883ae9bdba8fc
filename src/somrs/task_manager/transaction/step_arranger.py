"""The arrangement of the steps of one goal: the able services are asked for terms, and the best bid is accepted."""

from __future__ import annotations

from somrs.kernel.component import Effects, EffectsReturning
from somrs.protocol.messages import events, frp
from somrs.task_manager.arrangement.available_services import service_names
from somrs.task_manager.arrangement.call_for_proposals import REPLY_TIME, Arrangement, CallForProposals
from somrs.task_manager.arrangement.conditions import Conditions
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.workflow import StepRun, Workflow
from somrs.task_manager.transaction.deadline import Deadline
from somrs.task_manager.transaction.scope import TaskScope
from somrs.task_manager.transaction.state import GoalExecution


class StepArranger:
    """Opens and closes the calls for proposals of one goal. It has no state of its own."""

    def __init__(self, execution: GoalExecution, scope: TaskScope) -> None:
        self._execution, self._scope = execution, scope
        self._calls, self._pace = execution.calls, scope.context.pace

    def arrange(self, run: StepRun, now: float) -> EffectsReturning[tuple[str, ...]]:
        """Ask every able service for terms. Returns why none can be asked, if so.

        If a participant that was given up has returned and still holds the step, its report is awaited first.
        """
        if self._scope.state.members.held(run.key) or self._calls.settles(run.step):
            return ()
        invited = self._scope.services.able_offers(run)
        if not invited:
            exclusions = "; ".join(f"{service}: {reason}" for service, reason in run.excluded.items())
            return (f"no service takes it ({exclusions})" if exclusions else "no device offers it any more",)
        earliest, latest = self._workflow.earliest_start(run, now), Deadline(self._scope).latest_finish(now)
        call = yield from self._arrangement.invite_services(run, invited, earliest, latest, now, self._pace.answer_time(REPLY_TIME))
        yield from self._calls.open(call)
        self._scope.log_event(events.ServicesAsked(services=service_names(invited)), now, run)
        return ()

    def ask_anew(self, now: float) -> Effects:
        """Repeat all open calls after a restart: answers could not arrive, so that silence does not exclude a service."""
        yield from self.withdraw("the Task Manager restarted, and asks again", now)

    def withdraw(self, reason: str, now: float) -> Effects:
        """Withdraw all open calls."""
        for call in self._calls:
            yield from self._arrangement.withdraw(call, reason, now)
        yield from self._calls.close_all()

    def bids_due(self, now: float) -> EffectsReturning[bool]:
        """Choose among the bids of the calls whose time to answer is over. Returns whether there is any."""
        due = [*self._calls.due(now)]
        for call in due:
            yield from self._choose(call, now)
        yield from self._calls.set_timer()
        return bool(due)

    def terms_received(self, member: Member, terms: frp.Terms, id: str, now: float) -> EffectsReturning[bool]:
        """Handle the terms of a participant. Returns whether its call is closed by them."""
        service = member.offer.service
        self._scope.context.quotes.record_quote(service, terms.price, terms.duration)
        call = self._calls.find_call(member)
        if call is None:
            return False
        offered = events.TermsOffered(
            service=service, price=terms.price, currency=terms.currency, duration=terms.duration, condition=terms.condition
        )
        arrangement = self._arrangement
        self._scope.log_event(offered, now, arrangement.run(call))
        arrangement.add_bid(call, member, terms, id, self._scope.services.expected_attempts(service))
        return (yield from self._choose_if_answered(call, now))

    def participant_left(self, member: Member, reason: str, now: float) -> EffectsReturning[bool]:
        """A participant that is asked left. Returns whether its call is closed by that."""
        call = self._calls.find_call(member)
        if call is None:
            return False
        self._arrangement.participant_left(call, member, reason)
        return (yield from self._choose_if_answered(call, now))

    def _choose_if_answered(self, call: CallForProposals, now: float) -> EffectsReturning[bool]:
        if not self._arrangement.is_answered(call):
            return False
        yield from self._choose(call, now)
        return True

    def _choose(self, call: CallForProposals, now: float) -> Effects:
        """Close a call and accept the best bid. Without one, the step is open again, and the remaining services are asked."""
        yield from self._calls.close(call)
        state, context, services = self._scope.state, self._scope.context, self._scope.services
        if self._arrangement.is_unanswered(call):
            self._pace.answered(now - call.asked_at)  # the next call gives them more time
        conditions = Conditions(self._execution.conditions, self._arrangement, context.quotes)
        if not self._execution.fixed and conditions.consider(call, state.task, services.broken, now):
            yield from self._arrangement.withdraw(call, "the plan is to meet conditions", now)
            return
        chosen = yield from self._arrangement.award(call, state.task, context.commitments(), services.broken, now)
        if chosen is not None and chosen.bid is not None:
            run, terms = self._arrangement.run(call), chosen.bid.terms
            self._workflow.bind(run, chosen.offer.provider)
            event = events.ServiceChosen(service=chosen.offer.service, price=terms.price, currency=terms.currency, duration=terms.duration)
            self._scope.log_event(event, now, run)

    @property
    def _workflow(self) -> Workflow:
        assert self._execution.workflow is not None, "there is a plan"
        return self._execution.workflow

    @property
    def _arrangement(self) -> Arrangement:
        return Arrangement(self._workflow, self._scope.state.members, self._scope.participants, self._scope.context.replica)
