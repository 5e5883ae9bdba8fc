"""Calls for proposals, one for each step: the invited services, and the choice of terms (paper, "SO-MRS architecture": Arrangement)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence

from msgspec import Struct, field

from somrs.entish import Formula
from somrs.entish.parse import parse
from somrs.kernel.component import Effects, EffectsReturning, SetTimer
from somrs.kernel.replica import Replica
from somrs.ontology.effects import apply_effect, net_effect
from somrs.ontology.truth import formula_holds
from somrs.ontology.work_budget import ExcessiveWork
from somrs.planner.model.plan import Step
from somrs.planner.model.provider_choice import assign_provider
from somrs.protocol.messages import frp
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.submission import Submit
from somrs.task_manager.context import Commitments, Interval
from somrs.task_manager.execution.bids import choose_bid, fit_bid, make_bid
from somrs.task_manager.execution.member import Member, Members
from somrs.task_manager.execution.participants import Participants
from somrs.task_manager.execution.workflow import Progress, StepRun, Workflow
from somrs.task_manager.timers import BidsDue

MAX_OPEN_CALLS = 32
"""Maximum number of open calls. With more, terms could expire while other services prepare theirs."""

REPLY_TIME = 10.0
"""Seconds that services have to answer Arrange; more if all are late."""


class CallForProposals(Struct, kw_only=True, eq=False):
    """A call for the step with the id `step`, which can start at `earliest` and must finish by `latest`.

    `invited` are ids of participants. They were asked at `asked_at`, and their answers are awaited until `reply_by`.
    """

    step: str
    key: str
    device_group: str | None = field(name="same")
    """Steps with the same group have to be done by the same device."""
    invited: tuple[str, ...]
    earliest: float
    latest: float | None
    reply_by: float = field(name="until")
    asked_at: float = 0.0


class OpenCalls(Struct, kw_only=True):
    """All open calls of one goal, by the keys of their steps. `timer` fires at `timer_at`, when the first call is due."""

    timer: BidsDue
    pending: dict[str, CallForProposals] = field(default_factory=dict)
    timer_at: float | None = field(default=None, name="woken")

    def __len__(self) -> int:
        return len(self.pending)

    def __iter__(self) -> Iterator[CallForProposals]:
        return iter([*self.pending.values()])

    def open(self, call: CallForProposals) -> Effects:
        self.pending[call.key] = call
        yield from self.set_timer()

    def close(self, call: CallForProposals) -> Effects:
        """Close a call: its answers are not awaited any more."""
        del self.pending[call.key]
        yield from self.set_timer()

    def close_all(self) -> Effects:
        self.pending.clear()
        yield from self.set_timer()

    def find_call(self, member: Member) -> CallForProposals | None:
        """The open call to which the participant was invited."""
        call = self.pending.get(member.step)
        return call if call is not None and member.id in call.invited else None

    def settles(self, step: Step) -> bool:
        """Whether an open call for another step also decides which device does this step."""
        return bool(step.alternative_providers) and any(call.device_group == step.device_group for call in self.pending.values())

    def due(self, now: float) -> Iterator[CallForProposals]:
        """The calls whose time to answer is over, without those that the caller closes meanwhile. Call `set_timer` afterwards."""
        self.timer_at = None
        for call in self:
            if now >= call.reply_by - 0.001 and self.pending.get(call.key) is call:
                yield call

    def set_timer(self) -> Effects:
        """Set the timer for the remaining calls."""
        fire_time = min((call.reply_by for call in self.pending.values()), default=None)
        if fire_time != self.timer_at:
            self.timer_at = fire_time
            yield SetTimer(self.timer, fire_time)


class Arrangement:
    """Asks services for terms for the steps of a workflow, and accepts the best terms."""

    def __init__(self, workflow: Workflow, members: Members, participants: Participants, replica: Replica) -> None:
        self._workflow, self._members, self._participants, self._replica = workflow, members, participants, replica

    def invited(self, call: CallForProposals) -> list[Member]:
        return [self._members.by_id[id] for id in call.invited]

    def asked(self, run: StepRun) -> list[Member]:
        """The participants that were asked for the step in this plan."""
        return [member for member in self._members if member.step == run.key]

    @property
    def step_count(self) -> int:
        return self._workflow.step_count

    def unmet_condition(self, run: StepRun, member: Member) -> Formula | None:
        """The condition that the service states for the step, in its terms or its refusal, unless the plan meets it.

        The plan does not meet it either if a step that may be done meanwhile ends what has to hold throughout.
        """
        condition, invariant = member.session.condition, member.session.invariant
        if condition is None and invariant is None:
            return None
        promised = self._workflow.promised_effects(run)
        unmet = unmet_condition(condition, promised, self._replica)
        if unmet is not None or invariant is None:
            return unmet
        outcomes = (other.step.outcome for other in self._workflow.concurrent(run))
        endings = (unmet_condition(invariant, [*promised, outcome], self._replica) for outcome in outcomes if outcome is not None)
        return next((ending for ending in endings if ending is not None), None)

    def is_answered(self, call: CallForProposals) -> bool:
        """Whether no answer is missing."""
        return all(member.state is not State.ARRANGING for member in self.invited(call))

    def is_unanswered(self, call: CallForProposals) -> bool:
        """Whether no answer has come: all may be late, rather than silent."""
        return {member.state for member in self.invited(call)} == {State.ARRANGING}

    def run(self, call: CallForProposals) -> StepRun:
        return self._workflow.runs[call.step]

    def add_bid(self, call: CallForProposals, member: Member, terms: frp.Terms, terms_id: str, attempts: int = 1) -> None:
        member.bid = make_bid(member.id, terms, terms_id, call.earliest, attempts)

    def participant_left(self, call: CallForProposals, member: Member, reason: str) -> None:
        """Exclude a participant that left. If its terms expired before they could be accepted, it may be asked once more."""
        run, service = self.run(call), member.offer.service
        if member.bid is None or service in run.lapsed:
            run.excluded[service] = reason
        else:
            run.lapsed.add(service)
        member.bid = None

    def award(
        self, call: CallForProposals, task: Submit, commitments: Commitments, broken: Collection[str], now: float
    ) -> EffectsReturning[Member | None]:
        """Accept the bid that the policy prefers, and dismiss the other participants, including services in `broken`.

        Returns the chosen participant, or None if there is none.
        """
        run, participants = self.run(call), self._participants
        for member in self.invited(call):
            if member.state is State.ARRANGING:
                member.exit_reason = run.excluded[member.offer.service] = "did not answer"
                yield from participants.dismiss(member, "no answer in time", now)
        for member in self.invited(call):
            if member.bid is not None and member.state is State.OFFERED and (condition := self.unmet_condition(run, member)) is not None:
                member.exit_reason = run.excluded[member.offer.service] = f"needs {condition}"
                yield from participants.dismiss(member, f"the plan does not meet its condition: {condition}", now)
        bidders = {m.id: (m, m.bid) for m in self.invited(call) if m.bid is not None and m.state is State.OFFERED}
        bids = [fit_bid(bid, _busy(m.offer, commitments)) for m, bid in bidders.values() if m.offer.service not in broken]
        if call.latest is not None:
            for late in [candidate for candidate in bids if candidate.finish > call.latest]:
                member, _ = bidders[late.participant]
                run.excluded[member.offer.service] = f"would be done {late.finish - call.latest:.0f} s too late"
                yield from participants.dismiss(member, "it would be done too late", now)
                bids.remove(late)
        if not bids:
            yield from self.withdraw(call, "it failed at another step", now)
            return None
        if self._members.held(run.key):
            yield from self.withdraw(call, "another service still holds the step, and has to stop first", now)
            return None
        best = choose_bid(bids, task, now)
        for member, _ in bidders.values():
            if member.id == best.participant:
                yield from participants.accept(member, best.terms_id, now)
            else:
                yield from participants.dismiss(member, f"another service was chosen by {task.policy}", now)
        chosen = bidders[best.participant][0]
        chosen.bid = best
        self._workflow.assign(run, chosen, best.start, best.finish)
        return chosen

    def withdraw(self, call: CallForProposals, reason: str, now: float) -> Effects:
        """Dismiss the participants of a call, and leave its step open."""
        self._workflow.move(self.run(call), Progress.OPEN)
        for member in self.invited(call):
            yield from self._participants.dismiss(member, reason, now)

    def invite_services(
        self, run: StepRun, offers: Sequence[Offer], earliest: float, latest: float | None, now: float, seconds: float
    ) -> EffectsReturning[CallForProposals]:
        """Send Arrange to the services of these offers, which have `seconds` to answer."""
        self._workflow.move(run, Progress.ARRANGING)
        inputs = {name: str(term) for name, term in run.step.inputs.items()}
        situation = self._promised_situation(run)
        arranges: dict[tuple[str, str | None], frp.Arrange] = {}

        def arrange(offer: Offer) -> frp.Arrange:
            """One message for all offers of a type, or for each device if the step names its device."""
            key = offer.service_type.name, offer.provider if run.step.alternative_providers else None
            if key not in arranges:
                step = assign_provider(run.step, offer.provider) if run.step.alternative_providers else run.step
                precondition = step.precondition if run.step.alternative_providers else run.precondition or step.precondition
                arranges[key] = frp.Arrange(
                    service_type=offer.service_type.name,
                    inputs=inputs,
                    effect=str(step.effect),
                    precondition=str(precondition) if precondition is not None else None,
                    earliest_start=earliest,
                    latest_finish=latest,
                    reply_by=now + seconds,
                    situation=situation,
                )
            return arranges[key]

        invited: list[str] = []
        for offer in offers:
            member = yield from self._participants.invite(offer, run.label, run.key, arrange(offer), now, seconds)
            invited.append(member.id)
        return make_call(run, invited, earliest=earliest, latest=latest, reply_by=now + seconds, asked_at=now)

    def _promised_situation(self, run: StepRun) -> str | None:
        """What the map will have changed to when the step starts, by the effects of the steps before it; None if nothing."""
        situation = net_effect(self._workflow.promised_effects(run), self._replica.map, self._replica.ontology)
        return str(situation) if situation is not None else None


def _busy(offer: Offer, commitments: Commitments) -> Sequence[Interval]:
    """The intervals in which a device cannot do what it offers, because of its other commitments."""
    return commitments.get(offer.provider, ()) if offer.occupies else ()


def unmet_condition(stated: str | None, promised: Sequence[Formula], replica: Replica) -> Formula | None:
    """The condition that a participant states, unless it holds on the map with the promised effects, which come true in this order."""
    if stated is None:
        return None
    situation = net_effect(promised, replica.map, replica.ontology)
    promised_map = apply_effect(situation, replica.map, replica.ontology) if situation is not None else replica.map
    condition = parse(stated)
    try:
        return condition if not formula_holds(condition, promised_map, replica.ontology) else None
    except ExcessiveWork:
        return condition


def make_call(
    run: StepRun, invited: Iterable[str], *, earliest: float, latest: float | None, reply_by: float, asked_at: float
) -> CallForProposals:
    """The call for a step with these participants."""
    return CallForProposals(
        step=run.step.id,
        key=run.key,
        device_group=run.step.device_group,
        invited=tuple(invited),
        earliest=earliest,
        latest=latest,
        reply_by=reply_by,
        asked_at=asked_at,
    )
