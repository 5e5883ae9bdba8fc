"""Previews: the plan, the price and the duration of a task, without executing it.

A preview plans the task. If the client wants quotes, it then asks services for terms as a task does: step by step in causal order, each
step after the promised finish of the steps before it. It accepts no terms, and dismisses all services.

A preview takes a few seconds, and less than a minute if all services are late. For a service that has not answered by then, its last terms
are the estimate. Its state is in `preview_state.py`.
"""

from __future__ import annotations

from functools import cached_property
from itertools import chain

from msgspec import structs

from somrs.kernel.component import Effects, EffectsReturning, SetTimer
from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages import frp
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.previews import OtherPlan, Previewed, Quotation
from somrs.protocol.messages.reservations import ReservationMode
from somrs.protocol.messages.waits import WaitsForTasks
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.arrangement.call_for_proposals import MAX_OPEN_CALLS, Arrangement, CallForProposals, make_call
from somrs.task_manager.arrangement.conditions import Conditions, condition_error
from somrs.task_manager.arrangement.plan_request import PlanRequester, PlanResult
from somrs.task_manager.context import Commitments, Interval, PlanToQuote, TaskManagerContext
from somrs.task_manager.execution.bids import Bid, choose_bid, fit_bid, make_bid, plan_preference
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.participants import Participants
from somrs.task_manager.execution.workflow import Progress, StepRun, Workflow
from somrs.task_manager.outlook import foresee
from somrs.task_manager.preview_state import PreviewState
from somrs.task_manager.requests import DiscoveredOffers, ReservationAnswered
from somrs.task_manager.reservations import BlockedPlan, ReservationRequester
from somrs.task_manager.timers import Answer, PlanWanted, PreviewDue
from somrs.task_manager.transaction.views import foreseen_views, preview_reply, step_view

REPLY_TIME = 2.0
"""Seconds that services have to answer for one step; more if all are late. A task gives them more."""

MOST_REPLY_TIME = 15.0
"""Maximum seconds for one step, so that a preview ends before its client gives up."""

MOST_ROUNDS = 3
"""A preview asks services for as long as so many steps in a row without an answer; the terms of the others are estimated."""

SILENT = {State.ARRANGING: "has not answered yet", State.NEW: "was not asked: there was no time left"}
"""Why a service that has not refused gave no terms, by its state."""

PREVIEW_ONLY = "only a preview was requested"


class PreviewExecutor:
    """Continues one preview. Its methods return the result once, at the end. It has no state of its own."""

    def __init__(self, state: PreviewState, context: TaskManagerContext) -> None:
        self._state, self._context = state, context
        self._services = AvailableServices(state.services, context.replica, context.directory)
        self._participants = Participants(state.id, state.members, context, self._ignore_event, self._ignore_message)

    def begin(self, now: float) -> EffectsReturning[Previewed | None]:
        yield from self._planning.begin(now)
        return None

    def begin_with_plan(self, plan: Plan, now: float) -> EffectsReturning[Previewed | None]:
        """Ask for quotes for this plan."""
        self._services.discovered(self._state.services.offers)
        state = self._state
        state.bidding_start, state.workflow, state.outlook = now, Workflow.from_plan(plan.certain_part), plan
        yield SetTimer(PreviewDue(state.id), now + MOST_ROUNDS * self._reply_time)
        return (yield from self._ask(now))

    # Planning

    @property
    def _planning(self) -> PlanRequester:
        state, task = self._state, self._state.task
        reserving = ReservationRequester(state.reservation, state.id, task.effect, task.priority, self._context)
        return PlanRequester(state.planning, self._services, self._context, reserving, (ReservationMode.ASK, ReservationMode.ASK))

    def discovered(self, offers: DiscoveredOffers, now: float) -> EffectsReturning[Previewed | None]:
        """Handle the services on offer, or the reason why they are not known."""
        return (yield from self._planned((yield from self._planning.discovered(offers)), now))

    def planned(self, question: PlanWanted, answer: Answer, now: float) -> EffectsReturning[Previewed | None]:
        """Handle the planner's answer."""
        if self._state.planning.question != question:
            return None
        return (yield from self._planned((yield from self._planning.answered(answer, now)), now))

    def reserved(self, answered: ReservationAnswered, now: float) -> EffectsReturning[Previewed | None]:
        """Handle the answer to the question whether the objects of the plan are free."""
        if self._state.reservation.serial != answered.purpose.serial:
            return None
        return (yield from self._planned((yield from self._planning.reserved(answered.answer, now)), now))

    def _planned(self, result: PlanResult | None, now: float) -> EffectsReturning[Previewed | None]:
        state = self._state
        if result is None:
            return None
        if isinstance(result, BlockedPlan):
            state.waiting_for, result = WaitsForTasks.on(result.holders), result.plan
        if not isinstance(result, Plan) or not state.query.quotes or not result.steps:
            return (yield from self._end(structs.replace(preview_reply(result), waits=state.waits, waiting_for=state.waiting_for)))
        if serial := state.planning.serial:
            state.workflow, state.outlook = Workflow.from_plan(result.certain_part, f"{serial}/"), result
            return (yield from self._ask(now))
        for number, rival in enumerate(result.alternatives, 2):
            id = f"{state.id}/plan{number}"
            state.rivals[id] = None
            self._context.plans_to_quote.append(PlanToQuote(id, state.id, state.task, rival, self._services.for_quotes()))
        return (yield from self.begin_with_plan(result, now))

    def rival_ended(self, id: str, result: Previewed, now: float) -> EffectsReturning[Previewed | None]:
        """Handle the preview of another plan."""
        yield from ()
        self._state.rivals[id] = result
        return self._compare()

    def _compare(self) -> Previewed | None:
        """The preferred result with the others, once all plans have quotes."""
        state = self._state
        rivals = [rival for rival in state.rivals.values() if rival is not None]
        if state.result is None or len(rivals) < len(state.rivals):
            return None
        state.ended = True
        best, *others = sorted([state.result, *rivals], key=lambda result: plan_preference(state.task, result))
        return structs.replace(best, waits=state.waits, waiting_for=state.waiting_for, alternatives=tuple(map(_other_plan, others)))

    # Calls for proposals

    @property
    def _arrangement(self) -> Arrangement:
        return Arrangement(self._state.workflow, self._state.members, self._participants, self._context.replica)

    def receive(self, message: Message, now: float) -> EffectsReturning[Previewed | None]:
        """Handle a service's message."""
        received = yield from self._participants.receive(message, now)
        if received is None or not received[1].moved or self._state.result is not None:
            return None
        member, _, message = received
        call = self._state.calls.find_call(member)
        if call is None:
            return None
        match message.body:
            case frp.Terms(condition=condition) if (error := condition_error(condition, self._context.replica)) is not None:
                member.exit_reason = error
                yield from self._participants.dismiss(member, error, now)
            case frp.Terms() as terms:
                self._context.quotes.record_quote(member.offer.service, terms.price, terms.duration)
                self._arrangement.add_bid(call, member, terms, message.header.message_id)
            case frp.Refuse(reason=reason) | frp.Fault(text=reason):
                member.exit_reason = reason
        return (yield from self._answered(call, now))

    def delivery_failed(self, message: Message, reason: str, now: float) -> EffectsReturning[Previewed | None]:
        """Handle a message that did not reach its service."""
        member = yield from self._participants.delivery_failed(message, reason, now)
        call = self._state.calls.find_call(member) if member is not None else None
        return (yield from self._answered(call, now)) if call is not None and self._state.result is None else None

    def timer_fired(self, timer: object, now: float) -> EffectsReturning[Previewed | None]:
        """The time to answer a call, or the time of the whole preview, is over."""
        state = self._state
        if state.result is not None:
            return None
        if isinstance(timer, PreviewDue):
            for call in state.calls:
                yield from self._settle(call, now)
            yield from self._estimate_rest(now)
        else:
            for call in [*state.calls.due(now)]:
                yield from self._settle(call, now)
            yield from state.calls.set_timer()
        return (yield from self._ask(now))

    def _answered(self, call: CallForProposals, now: float) -> EffectsReturning[Previewed | None]:
        if not self._arrangement.is_answered(call):
            return None
        yield from self._settle(call, now)
        return (yield from self._ask(now))

    def _ask(self, now: float) -> EffectsReturning[Previewed | None]:
        """Open calls for the next steps. The preview ends when there are no more."""
        state = self._state
        workflow, calls = state.workflow, state.calls
        if state.conditions.pending and not len(calls):
            return (yield from self._begin_again(now))
        while not state.conditions.pending:
            runs = [run for run in workflow.open if not calls.settles(run.step)]
            call_count = len(calls)
            for run in runs[: MAX_OPEN_CALLS - call_count]:
                able = self._services.able_offers(run)
                if not able:
                    self._mark_unserved(run, now, "no device offers it")
                    continue
                earliest, latest = workflow.earliest_start(run, now), self._latest_finish
                yield from calls.open((yield from self._arrangement.invite_services(run, able, earliest, latest, now, self._reply_time)))
            if workflow.arranged:
                if state.owner is None and self._services.redefined_types(workflow):
                    return (yield from self._begin_again(now))
                return (yield from self._end(self._conclusion()))
            if len(calls) or not runs:
                return None
        return None

    def _begin_again(self, now: float) -> EffectsReturning[Previewed | None]:
        """Plan again, because service types of the plan are defined anew, or with conditions that services stated."""
        state = self._state
        state.conditions.begin_plan()
        bids = tuple(state.conditions.bids)
        state.planning = structs.replace(state.planning, serial=state.planning.serial + 1, bids=bids, most_plans=1)
        state.quotations, state.unserved = {}, {}
        return (yield from self.begin(now))

    @property
    def _reply_time(self) -> float:
        return min(self._context.pace.answer_time(REPLY_TIME), MOST_REPLY_TIME)

    @property
    def _latest_finish(self) -> float | None:
        state = self._state
        return state.bidding_start + state.query.deadline if state.query.deadline is not None else None

    # Choice

    def _settle(self, call: CallForProposals, now: float) -> Effects:
        """Close a call and choose the best bid, without accepting it."""
        state, run = self._state, self._arrangement.run(call)
        yield from state.calls.close(call)
        if self._arrangement.is_unanswered(call):
            self._context.pace.answered(now - call.asked_at)  # the next preview gives them more time
        conditions = Conditions(state.conditions, self._arrangement, self._context.quotes)
        has_time = now < state.bidding_start + MOST_ROUNDS * self._reply_time
        if state.owner is None and has_time and conditions.consider(call, state.task, (), now):
            yield from self._arrangement.withdraw(call, PREVIEW_ONLY, now)
            return
        bids: dict[str, Bid] = {}
        quotations: list[Quotation] = []
        invited = self._arrangement.invited(call)
        for member in invited:
            offered = member.bid is not None and member.state is State.OFFERED
            if member.bid is not None and offered:
                bids[member.id] = fit_bid(member.bid, self._busy(member.offer))
            elif member.state in SILENT and (guess := self._estimate_bid(run, member, now)) is not None:
                bids[member.id] = guess
            quotation = self._quotation(member, bids.get(member.id), estimate=not offered)
            condition = self._arrangement.unmet_condition(run, member)
            if condition is not None:
                bids.pop(member.id, None)
            quotations.append(structs.replace(quotation, condition=str(condition) if condition is not None else None))
            yield from self._participants.dismiss(member, PREVIEW_ONLY, now)
        in_time = [candidate for candidate in bids.values() if self._latest_finish is None or candidate.finish <= self._latest_finish]
        best = choose_bid(in_time, state.task, state.bidding_start) if in_time else None
        state.quotations[call.step] = [
            structs.replace(quotation, chosen=best is not None and member.id == best.participant)
            for member, quotation in zip(invited, quotations, strict=True)
        ]
        if best is None:
            reasons = "; ".join(f"{quotation.service}: {text}" for quotation in quotations if (text := _why_not(quotation)))
            self._mark_unserved(run, now, f"no service takes it ({reasons})" if not bids else "no service would finish in time")
            return
        chosen = next(member for member in invited if member.id == best.participant)
        state.workflow.bind(run, chosen.offer.provider)
        chosen.bid = best
        state.workflow.assign(run, chosen, best.start, best.finish)

    def _quotation(self, member: Member, bid: Bid | None, *, estimate: bool) -> Quotation:
        silent, bidding_start = SILENT.get(member.state, ""), self._state.bidding_start
        if bid is None:
            return Quotation(step=member.label, service=member.offer.service, reason=silent or member.exit_reason)
        return Quotation(
            step=member.label,
            service=member.offer.service,
            price=bid.terms.price,
            currency=bid.terms.currency,
            duration=bid.terms.duration,
            start=bid.start - bidding_start,
            finish=bid.finish - bidding_start,
            estimate=estimate,
            reason=silent if estimate else "",
        )

    def _mark_unserved(self, run: StepRun, now: float, reason: str) -> None:
        """Mark a step that no service takes. The steps after it are arranged as if it took no time."""
        state = self._state
        state.unserved[run.label] = reason
        run.start = run.finish = state.workflow.earliest_start(run, now)
        state.workflow.move(run, Progress.ARRANGED)

    def _estimate_rest(self, now: float) -> Effects:
        """Estimate the remaining steps from the last terms of services, because there is no time to ask for new ones."""
        state = self._state
        for run in state.workflow:
            if run.progress is not Progress.OPEN:
                continue
            members = [self._participants.make_member(offer, run.label, run.key) for offer in self._services.able_offers(run)]
            for number, member in enumerate(members):  # only invitations are counted: make the ids unique
                member.id = f"{member.id}/{run.key}/{number}"
                state.members.by_id[member.id] = member
            call = make_call(run, (member.id for member in members), earliest=0.0, latest=None, reply_by=now, asked_at=now)
            yield from state.calls.open(call)
            yield from self._settle(call, now)

    def _estimate_bid(self, run: StepRun, member: Member, now: float) -> Bid | None:
        """The bid of the service with its last or fixed price and duration; None if they are not known."""
        offer = member.offer
        quote = self._context.quotes.last_quote(offer)
        if quote is None:
            return None
        price, duration = quote
        terms = frp.Terms(effect=str(run.step.effect), price=price, duration=duration)
        return fit_bid(make_bid(member.id, terms, "", self._state.workflow.earliest_start(run, now)), self._busy(offer))

    def _busy(self, offer: Offer) -> list[Interval]:
        if not offer.occupies:
            return []
        return [*self._commitments.get(offer.provider, ()), *self._state.workflow.promised(offer.provider)]

    @cached_property
    def _commitments(self) -> Commitments:
        return self._context.commitments()

    # Result

    def _conclusion(self) -> Previewed:
        state = self._state
        plan, runs = state.outlook or state.workflow.plan, [*state.workflow]
        foreseen = tuple(foreseen_views(plan))
        quotations = tuple(chain.from_iterable(state.quotations.get(run.step.id, ()) for run in runs))
        chosen = {quotation.step: quotation for quotation in quotations if quotation.chosen}
        currencies = {quotation.currency for quotation in chosen.values()}
        whole = not state.unserved and not foreseen
        price = sum(quotation.price or 0.0 for quotation in chosen.values())
        seconds = max((quotation.finish or 0.0 for quotation in chosen.values()), default=0.0)
        is_quoted = not state.unserved and len(currencies) <= 1
        return Previewed(
            steps=tuple(
                step_view(
                    run.step,
                    plan,
                    service=chosen_quotation.service,
                    price=chosen_quotation.price,
                    currency=chosen_quotation.currency,
                    duration=chosen_quotation.duration,
                )
                if (chosen_quotation := chosen.get(run.label)) is not None
                else step_view(run.step, plan)
                for run in runs
            )
            + foreseen,
            waits=state.waits,
            waiting_for=state.waiting_for,
            quotations=quotations,
            price=price if whole and len(currencies) == 1 else None,
            currency=next(iter(sorted(currencies)), "EUR"),
            seconds=seconds if whole else None,
            estimate=any(quotation.estimate for quotation in chosen.values()),
            unserved=state.unserved,
            outlook=foresee(plan, price, seconds, self._last_terms) if is_quoted else None,
        )

    def _last_terms(self, step: Step) -> list[tuple[float, float]]:
        quotes = (self._context.quotes.last_quote(offer) for offer in self._services.offers_for(step))
        return [quote for quote in quotes if quote is not None]

    def _end(self, answer: Previewed) -> EffectsReturning[Previewed | None]:
        state = self._state
        state.result = answer
        yield from state.calls.close_all()
        yield SetTimer(PreviewDue(state.id), None)
        return self._compare()

    def _ignore_event(self, event: Event, now: float) -> None:
        """A preview keeps no events."""

    def _ignore_message(self, now: float, message: Message) -> None:
        """A preview keeps no messages."""


def _why_not(quotation: Quotation) -> str:
    """Why the service would not get the step."""
    needs = f"needs {quotation.condition}" if quotation.condition is not None else ""
    return "; ".join(text for text in (quotation.reason, needs) if text)


def _other_plan(result: Previewed) -> OtherPlan:
    return OtherPlan(steps=result.steps, price=result.price, currency=result.currency, seconds=result.seconds, outlook=result.outlook)
