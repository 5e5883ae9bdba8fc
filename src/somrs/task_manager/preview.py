"""A preview: what a task would come to. It is planned, and, if that is wanted, services are asked for their terms as a task would ask
them, step by step in causal order, each on what the steps before promise. Nothing is accepted, and everybody is told that it is over.

It takes a few seconds at most. Whoever has not answered by then is put down with what it asked last, as an estimate.
"""

from __future__ import annotations

from functools import cached_property
from itertools import chain

from msgspec import Struct, field, structs

from somrs.kernel.component import Effects, EffectsReturning, SetTimer
from somrs.planner.model.plan import Plan
from somrs.protocol.messages import frp
from somrs.protocol.messages.clients import Preview, Previewed, Quotation, Submit
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.event_text import waiting_text
from somrs.protocol.messages.events import Event, WaitsForTasks
from somrs.protocol.messages.frp import State
from somrs.task_manager.arrangement.available_services import AvailableServices, KnownServices
from somrs.task_manager.arrangement.call_for_proposals import AT_ONCE, Arrangement, Call, Calls, call_for
from somrs.task_manager.arrangement.plan_request import Found, PlanRequest, PlanRequester
from somrs.task_manager.context import Commitments, Context, Interval
from somrs.task_manager.execution.bids import Bid, bid, choose, fitted
from somrs.task_manager.execution.member import Member
from somrs.task_manager.execution.participants import Members, Participants
from somrs.task_manager.execution.workflow import Progress, StepRun, Workflow
from somrs.task_manager.reservations import Held
from somrs.task_manager.timers import Answer, BidsDue, PlanWanted, PreviewDue
from somrs.task_manager.transaction.views import previewed, step_view

MOST_TIME = 6.0
"""Seconds that asking takes at most."""

REPLY_TIME = 2.0
"""Seconds that services have to answer for one step; in a task they have more."""

SILENT = {State.ARRANGING: f"did not answer within {REPLY_TIME:g} s", State.NEW: "was not asked: there was no time left"}
"""Why there are no terms of a service that has not said that it gives none."""

NOT_WANTED = "it was only asked what it would cost"


class PreviewState(Struct, kw_only=True):
    """One preview. `request` is answered once, with what it came to."""

    id: str
    wanted: Preview
    request: Message
    task: Submit
    planning: PlanRequest
    calls: Calls
    services: KnownServices = field(default_factory=KnownServices)
    members: Members = field(default_factory=Members)
    workflow: Workflow = field(default_factory=lambda: Workflow.of(Plan()))
    asked_at: float = 0.0
    waits: str = ""
    quotations: dict[str, list[Quotation]] = {}
    """By step."""
    unserved: dict[str, str] = {}
    over: bool = False


def new_preview(id: str, wanted: Preview, request: Message) -> PreviewState:
    """A preview that a client has just asked for; `begin` it next."""
    task = Submit(
        effect=wanted.effect,
        precondition=wanted.precondition,
        policy=wanted.policy,
        time_value=wanted.time_value,
        deadline=wanted.deadline,
        priority=wanted.priority,
    )
    planning = PlanRequest(owner=id, goal=0, serial=0, task=task)
    return PreviewState(id=id, wanted=wanted, request=request, task=task, planning=planning, calls=Calls(timer=BidsDue(id, 0)))


class Previewing:
    """Goes on with one preview; what it came to comes at its end, once. It has no state of its own."""

    def __init__(self, state: PreviewState, context: Context) -> None:
        self._state, self._context = state, context
        self._services = AvailableServices(state.services, context.replica)
        self._participants = Participants(state.id, state.members, context, self._heed, self._note)

    def begin(self, now: float) -> EffectsReturning[Previewed | None]:
        state = self._state
        self._context.reservations.enter(state.id, state.task.effect, state.task.priority)
        yield from self._planning.begin(now)
        return None

    # Planning

    @property
    def _planning(self) -> PlanRequester:
        return PlanRequester(self._state.planning, self._services, self._context, holds=False)

    def discovered(self, offers: tuple[Offer, ...] | str, now: float) -> EffectsReturning[Previewed | None]:
        """The services on offer are known, or why they cannot be."""
        return (yield from self._planned((yield from self._planning.discovered(offers)), now))

    def planned(self, question: PlanWanted, answer: Answer, now: float) -> EffectsReturning[Previewed | None]:
        """The planner's answer."""
        if self._state.planning.question != question:
            return None
        return (yield from self._planned((yield from self._planning.answered(answer)), now))

    def _planned(self, found: Found | None, now: float) -> EffectsReturning[Previewed | None]:
        state, reservations = self._state, self._context.reservations
        if found is None:
            return None
        reservations.leave(state.id)
        if isinstance(found, Held):
            tasks = {task: reservations.goal(task) for task in found.by}
            state.waits, found = waiting_text(WaitsForTasks(tasks=tasks, objects=found.objects)), found.plan
        if not isinstance(found, Plan) or not state.wanted.quotes or not found.steps:
            return (yield from self._end(structs.replace(previewed(found), waits=state.waits)))
        state.asked_at, state.workflow = now, Workflow.of(found)
        yield SetTimer(PreviewDue(state.id), now + MOST_TIME)
        return (yield from self._ask(now))

    # Asking

    @property
    def _arrangement(self) -> Arrangement:
        return Arrangement(self._state.workflow, self._state.members, self._participants)

    def receive(self, message: Message, now: float) -> EffectsReturning[Previewed | None]:
        """A service answers."""
        received = yield from self._participants.receive(message, now)
        if received is None or not received[1].moved or self._state.over:
            return None
        member, _ = received
        call = self._state.calls.of(member)
        if call is None:
            return None
        match message.body:
            case frp.Terms() as terms:
                self._context.quotes.given(member.offer.service, terms.price, terms.duration)
                self._arrangement.offered(call, member, terms, message.header.message_id)
            case frp.Refuse(reason=why) | frp.Fault(text=why):
                member.last_word = why
        return (yield from self._answered(call, now))

    def undelivered(self, message: Message, reason: str, now: float) -> EffectsReturning[Previewed | None]:
        """A service could not be reached."""
        member = yield from self._participants.undelivered(message, reason, now)
        call = self._state.calls.of(member) if member is not None else None
        return (yield from self._answered(call, now)) if call is not None and not self._state.over else None

    def ring(self, timer: object, now: float) -> EffectsReturning[Previewed | None]:
        """Somebody has not answered in time, or all of it has taken long enough."""
        state = self._state
        if state.over:
            return None
        if isinstance(timer, PreviewDue):
            for call in state.calls:
                yield from self._settle(call, now)
            yield from self._guess(now)
        else:
            for call in [*state.calls.due(now)]:
                yield from self._settle(call, now)
            yield from state.calls.wake()
        return (yield from self._ask(now))

    def _answered(self, call: Call, now: float) -> EffectsReturning[Previewed | None]:
        if not self._arrangement.answered(call):
            return None
        yield from self._settle(call, now)
        return (yield from self._ask(now))

    def _ask(self, now: float) -> EffectsReturning[Previewed | None]:
        """Ask for the steps that come next; when all were asked for, that is it."""
        state = self._state
        workflow, calls = state.workflow, state.calls
        while True:
            runs = [run for run in workflow.open if not calls.settles(run.step)]
            before = len(calls)
            for run in runs[: AT_ONCE - before]:
                able = self._services.able(run)
                if not able:
                    self._nobody(run, now, "nobody offers it")
                    continue
                earliest, latest = workflow.earliest_start(run, now), self._latest
                yield from calls.open((yield from self._arrangement.call(run, able, earliest, latest, now, REPLY_TIME)))
            if workflow.arranged:
                return (yield from self._end(self._conclusion()))
            if len(calls) or not runs:
                return None

    @property
    def _latest(self) -> float | None:
        state = self._state
        return state.asked_at + state.wanted.deadline if state.wanted.deadline is not None else None

    # Choosing

    def _settle(self, call: Call, now: float) -> Effects:
        """Take the best of what came, on paper."""
        state, run = self._state, self._arrangement.run(call)
        yield from state.calls.close(call)
        bids: dict[str, Bid] = {}
        quotations: list[Quotation] = []
        invited = self._arrangement.invited(call)
        for member in invited:
            offered = member.bid is not None and member.state is State.OFFERED
            if member.bid is not None and offered:
                bids[member.id] = fitted(member.bid, self._busy(member.offer))
            elif member.state in SILENT and (guess := self._last_asked(run, member, now)) is not None:
                bids[member.id] = guess
            quotations.append(self._quotation(member, bids.get(member.id), estimate=not offered))
            yield from self._participants.dismiss(member, NOT_WANTED, now)
        in_time = [one for one in bids.values() if self._latest is None or one.finish <= self._latest]
        best = choose(in_time, state.task, state.asked_at) if in_time else None
        state.quotations[call.step] = [
            structs.replace(quotation, chosen=best is not None and member.id == best.participant)
            for member, quotation in zip(invited, quotations, strict=True)
        ]
        if best is None:
            reasons = "; ".join(f"{one.service}: {one.reason}" for one in quotations if one.reason)
            self._nobody(run, now, f"nobody takes it ({reasons})" if not bids else "nobody would be done in time")
            return
        chosen = next(member for member in invited if member.id == best.participant)
        state.workflow.bind(run, chosen.offer.provider)
        chosen.bid = best
        state.workflow.take(run, chosen, best.start, best.finish)

    def _quotation(self, member: Member, bid: Bid | None, *, estimate: bool) -> Quotation:
        silent, asked_at = SILENT.get(member.state, ""), self._state.asked_at
        if bid is None:
            return Quotation(step=member.label, service=member.offer.service, reason=silent or member.last_word)
        return Quotation(
            step=member.label,
            service=member.offer.service,
            price=bid.terms.price,
            currency=bid.terms.currency,
            duration=bid.terms.duration,
            start=bid.start - asked_at,
            finish=bid.finish - asked_at,
            estimate=estimate,
            reason=silent if estimate else "",
        )

    def _nobody(self, run: StepRun, now: float, why: str) -> None:
        """The steps behind it are asked for all the same, as if it took no time."""
        state = self._state
        state.unserved[run.label] = why
        run.start = run.finish = state.workflow.earliest_start(run, now)
        state.workflow.move(run, Progress.ARRANGED)

    def _guess(self, now: float) -> Effects:
        """There is no time to ask for what is left: put down what services asked last."""
        state = self._state
        for run in state.workflow:
            if run.progress is not Progress.OPEN:
                continue
            known = [self._participants.known(offer, run.label, run.key) for offer in self._services.able(run)]
            for number, member in enumerate(known):  # nobody is asked: they need names of their own all the same
                member.id = f"{member.id}/{run.key}/{number}"
                state.members.by_id[member.id] = member
            call = call_for(run, (member.id for member in known), earliest=0.0, latest=None, until=now)
            yield from state.calls.open(call)
            yield from self._settle(call, now)

    def _last_asked(self, run: StepRun, member: Member, now: float) -> Bid | None:
        """The bid that the service would make if it asked what it asked last, or says that it always asks."""
        offer = member.offer
        known = self._context.quotes.last(offer)
        if known is None:
            return None
        price, duration = known
        terms = frp.Terms(effect=str(run.step.effect), price=price, duration=duration)
        return fitted(bid(member.id, terms, "", self._state.workflow.earliest_start(run, now)), self._busy(offer))

    def _busy(self, offer: Offer) -> list[Interval]:
        return [*self._commitments.get(offer.provider, ()), *self._state.workflow.promised(offer.provider)]

    @cached_property
    def _commitments(self) -> Commitments:
        return self._context.commitments()

    # Telling

    def _conclusion(self) -> Previewed:
        state = self._state
        plan, runs = state.workflow.plan, [*state.workflow]
        quotations = tuple(chain.from_iterable(state.quotations.get(run.step.id, ()) for run in runs))
        chosen = {one.step: one for one in quotations if one.chosen}
        currencies = {one.currency for one in chosen.values()}
        whole = not state.unserved
        return Previewed(
            steps=tuple(
                step_view(run.step, plan, service=one.service, price=one.price, duration=one.duration)
                if (one := chosen.get(run.label)) is not None
                else step_view(run.step, plan)
                for run in runs
            ),
            waits=state.waits,
            quotations=quotations,
            price=sum(one.price or 0.0 for one in chosen.values()) if whole and len(currencies) == 1 else None,
            currency=next(iter(sorted(currencies)), "EUR"),
            seconds=max((one.finish or 0.0 for one in chosen.values()), default=0.0) if whole else None,
            estimate=any(one.estimate for one in chosen.values()),
            unserved=state.unserved,
        )

    def _end(self, found: Previewed) -> EffectsReturning[Previewed | None]:
        self._state.over = True
        yield from self._state.calls.drop()
        yield SetTimer(PreviewDue(self._state.id), None)
        return found

    def _heed(self, event: Event, now: float) -> None:
        """There is nobody at work who could fall silent."""

    def _note(self, now: float, message: Message) -> None:
        """Of what is only asked nothing is kept."""
