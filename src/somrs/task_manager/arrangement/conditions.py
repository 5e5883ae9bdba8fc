"""The conditions that services state for a step, in their Terms or when they refuse, and which of them the next plan considers.

A condition that the plan meets already is like none. Another one leads to a new plan if the policy of the task prefers its service, or if
no other service takes the step: the planner then compares the totals (`planner/conditions.py`). In the new plan the services are asked
again; a condition that they state again, and that the new plan does not meet, is not considered a second time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

from msgspec import Struct

from somrs.entish import Formula
from somrs.entish.formula import conjunction, conjuncts
from somrs.errors import FormulaError
from somrs.kernel.replica import Replica
from somrs.ontology.check import check
from somrs.planner.model.problem import StepBid
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.submission import Submit
from somrs.task_manager.arrangement.call_for_proposals import Arrangement, CallForProposals
from somrs.task_manager.context import Quotes
from somrs.task_manager.execution.bids import choose_bid
from somrs.task_manager.execution.workflow import StepRun

MOST_ROUNDS = 8
"""Maximum number of plans that are made for conditions without a completed step in between; one more for each step of the plan."""


class StatedConditions(Struct, kw_only=True):
    """The answers to requests for which a service stated a condition. `pending`: by service, the conditions that the next plan is the first
    to consider. `rounds` counts the plans that were made for conditions."""

    bids: list[StepBid] = []
    pending: dict[str, str] = {}
    rounds: int = 0

    def begin_plan(self) -> dict[str, str]:
        """Begin a plan. Returns the conditions that it is the first to consider."""
        pending, self.pending = self.pending, {}
        self.rounds += bool(pending)
        return pending

    def forget(self) -> None:
        """A step has ended: services may answer otherwise now."""
        self.bids, self.pending, self.rounds = [], {}, 0

    def is_conditional(self, service: str) -> bool:
        """Whether a service would do a step on a condition."""
        return any(bid.service == service and bid.condition is not None for bid in self.bids)

    def is_known(self, bid: StepBid) -> bool:
        """Whether a plan has considered this condition of the service for the request."""
        return any(_same_request(other, bid) and (other.service, other.condition) == (bid.service, bid.condition) for other in self.bids)

    def record(self, bid: StepBid) -> None:
        """Record an answer, unless the service has answered the same request before with less of a condition."""
        earlier = next((other for other in self.bids if _same_request(other, bid) and other.service == bid.service), None)
        if earlier is None:
            self.bids.append(bid)
        elif {*_parts(earlier.condition)} < {*_parts(bid.condition)} and (earlier.condition is not None or bid.refuses):
            self.bids[self.bids.index(earlier)] = bid


def condition_error(condition: str | None, replica: Replica) -> str | None:
    """Why a stated condition cannot be understood; None if it can."""
    try:
        if condition is not None:
            check(condition, replica.ontology, replica.map)
    except FormulaError as error:
        return f"its condition cannot be understood: {error}"
    return None


class Conditions:
    """Decides whether the answers to a call lead to a new plan. It has no state of its own."""

    def __init__(self, state: StatedConditions, arrangement: Arrangement, quotes: Quotes) -> None:
        self._state, self._arrangement, self._quotes = state, arrangement, quotes

    def consider(self, call: CallForProposals, task: Submit, broken: Collection[str], now: float) -> bool:
        """Whether the next plan is to consider conditions that services stated for the step; the answers to it are then recorded."""
        if task.recognise:
            return False  # nothing is moved so that somebody can look
        run = self._arrangement.run(call)
        answers = {bid.service: bid for bid in self._answers(run)}
        new = {
            name
            for name, bid in answers.items()
            if bid.condition != run.step.condition and name not in broken and not self._state.is_known(bid)
        }
        if not new or self._state.rounds >= MOST_ROUNDS + self._arrangement.step_count:
            return False
        if not self._are_preferred(new, call, task, broken, now):
            return False
        for bid in answers.values():
            self._state.record(bid)
        self._state.pending = {**self._state.pending, **{name: str(answers[name].condition) for name in sorted(new)}}
        return True

    def _are_preferred(self, services: set[str], call: CallForProposals, task: Submit, broken: Collection[str], now: float) -> bool:
        """Whether the policy prefers one of the services to those whose conditions are met, or there is none of these."""
        offers = {m.offer.service: m for m in self._arrangement.invited(call) if m.bid is not None and m.state is State.OFFERED}
        bids = {name: member.bid for name, member in offers.items() if member.bid is not None and name not in broken}
        run = self._arrangement.run(call)
        met = [bid for name, bid in bids.items() if self._arrangement.unmet_condition(run, offers[name]) is None]
        unmet = [bid for name, bid in bids.items() if name in services]
        return not met or choose_bid([*met, *unmet], task, now) in unmet

    def _answers(self, run: StepRun) -> Iterator[StepBid]:
        """The answers of the services that were asked for the step, each with all that it demands: what the plan meets for the step
        already, because it was demanded before, and the rest."""
        for member in self._arrangement.asked(run):
            condition = self._arrangement.unmet_condition(run, member)
            parts = [*dict.fromkeys((*_parts(run.step.condition), *_parts(condition)))]
            terms, quote = member.bid.terms if member.bid is not None else None, self._quotes.last_quote(member.offer)
            yield StepBid(
                service_type=run.step.service_type,
                inputs=tuple(run.step.inputs.items()),
                provider=member.offer.provider,
                service=member.offer.service,
                condition=conjunction(*parts) if parts else None,
                price=terms.price if terms is not None else quote[0] if quote is not None else None,
                refuses=terms is None and condition is None,
            )


def _parts(condition: Formula | None) -> tuple[Formula, ...]:
    return conjuncts(condition) if condition is not None else ()


def _same_request(first: StepBid, second: StepBid) -> bool:
    return (first.service_type, first.inputs) == (second.service_type, second.inputs)
