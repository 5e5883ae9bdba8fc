"""Calls for terms, each for one step: who was invited, and which terms are taken."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from somrs.kernel.component import Effect, Wake
from somrs.planner.model.choice import by
from somrs.planner.model.plan import Step
from somrs.protocol.messages import frp
from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import State
from somrs.task_manager.arrange import bid, choose, fitted
from somrs.task_manager.participants import Member, Participants
from somrs.task_manager.workflow import Progress, StepRun

AT_ONCE = 32
"""For so many steps services are asked at a time: what they offer should not run out while others think about theirs."""

REPLY_TIME = 10.0
"""Seconds that services have to answer Arrange."""

Busy = Callable[[str], Iterable[tuple[float, float]]]
"""From when until when a provider is committed."""


@dataclass(slots=True, kw_only=True)
class Tender:
    """The step is to be had from `earliest` on, and to be done by `latest`. Answers are awaited until `until`."""

    run: StepRun
    invited: list[Member]
    earliest: float
    latest: float | None
    until: float

    @property
    def answered(self) -> bool:
        """Whether nobody is awaited any more."""
        return all(member.state is not State.ARRANGING for member in self.invited)

    def offered(self, member: Member, terms: frp.Terms, terms_id: str) -> None:
        member.bid = bid(member.id, terms, terms_id, self.earliest)

    def left(self, member: Member, reason: str) -> None:
        """It is out. Whose terms ran out before they could be taken may be asked once more."""
        service = member.offer.service
        if member.bid is None or service in self.run.lapsed:
            self.run.excluded[service] = reason
        else:
            self.run.lapsed.add(service)
        member.bid = None

    def award(self, participants: Participants, task: Submit, busy: Busy, broken: Collection[str], now: float) -> Member | None:
        """Accept the terms that the policy prefers; everybody else is dismissed, and so is what broke at other work meanwhile."""
        for member in self.invited:
            if member.state is State.ARRANGING:
                member.last_word = self.run.excluded[member.offer.service] = "did not answer"
                participants.dismiss(member, "no answer in time", now)
        bidders = {m.id: (m, m.bid) for m in self.invited if m.bid is not None and m.state is State.OFFERED}
        bids = [fitted(bid, busy(m.offer.provider)) for m, bid in bidders.values() if m.offer.service not in broken]
        if self.latest is not None:
            for late in [one for one in bids if one.finish > self.latest]:
                member, _ = bidders[late.participant]
                self.run.excluded[member.offer.service] = f"would be done {late.finish - self.latest:.0f} s too late"
                bids.remove(late)
        if not bids:
            self.withdraw(participants, "it failed at another step", now)
            return None
        if participants.held(self.run.key):
            self.withdraw(participants, "one that had it has come back, and has to stop first", now)
            return None
        best = choose(bids, task, now)
        for member, _ in bidders.values():
            if member.id == best.participant:
                participants.accept(member, best.terms_id, now)
            else:
                participants.dismiss(member, f"another service was chosen by {task.policy}", now)
        chosen = bidders[best.participant][0]
        chosen.bid = best
        self.run.take(chosen, best.start, best.finish)
        return chosen

    def withdraw(self, participants: Participants, reason: str, now: float) -> None:
        """The step is not wanted any more."""
        self.run.progress = Progress.OPEN
        for member in self.invited:
            participants.dismiss(member, reason, now)


class Tenders:
    """All calls for terms of one pursuit. The timer rings when the time to answer the first of them is over."""

    def __init__(self, timer: str, effects: list[Effect]) -> None:
        self._timer, self._effects = timer, effects
        self._open: dict[str, Tender] = {}
        self._woken: float | None = None

    def __len__(self) -> int:
        return len(self._open)

    def __iter__(self) -> Iterator[Tender]:
        return iter(self._open.values())

    def open(self, tender: Tender) -> None:
        self._open[tender.run.key] = tender
        self._wake()

    def close(self, tender: Tender) -> None:
        """Nobody is awaited any more."""
        del self._open[tender.run.key]
        self._wake()

    def drop(self) -> None:
        self._open.clear()
        self._wake()

    def withdraw(self, participants: Participants, reason: str, now: float) -> None:
        """None of the steps is wanted any more."""
        for tender in self._open.values():
            tender.withdraw(participants, reason, now)
        self.drop()

    def of(self, member: Member) -> Tender | None:
        """The call that the participant answers."""
        tender = self._open.get(member.step)
        return tender if tender is not None and member in tender.invited else None

    def settles(self, step: Step) -> bool:
        """Whether it is being found out at another step which device does this one, too."""
        return bool(step.alike) and any(tender.run.step.same == step.same for tender in self._open.values())

    def due(self, now: float) -> Iterator[Tender]:
        """Those for which the time to answer is over, unless what came of the ones before has closed them."""
        self._woken = None
        for tender in [tender for tender in self._open.values() if now >= tender.until - 0.001]:
            if self._open.get(tender.run.key) is tender:
                yield tender
        self._wake()

    def _wake(self) -> None:
        at = min((tender.until for tender in self._open.values()), default=None)
        if at != self._woken:
            self._woken = at
            self._effects.append(Wake(self._timer, at))


def call(
    run: StepRun,
    offers: Sequence[Offer],
    participants: Participants,
    earliest: float,
    latest: float | None,
    now: float,
    seconds: float = REPLY_TIME,
) -> Tender:
    """Send Arrange to all of them, who have so many seconds to answer."""
    run.progress = Progress.ARRANGING
    inputs = {name: str(term) for name, term in run.step.inputs.items()}
    arranges: dict[tuple[str, str | None], frp.Arrange] = {}

    def arrange(offer: Offer) -> frp.Arrange:
        """The same for all, but for who is spoken of."""
        key = offer.service_type.name, offer.provider if run.step.alike else None
        if key not in arranges:
            step = by(run.step, offer.provider) if run.step.alike else run.step
            precondition = step.precondition if run.step.alike else run.precondition or step.precondition
            arranges[key] = frp.Arrange(
                service_type=offer.service_type.name,
                inputs=inputs,
                effect=str(step.effect),
                precondition=str(precondition) if precondition is not None else None,
                earliest_start=earliest,
                latest_finish=latest,
                reply_by=now + seconds,
            )
        return arranges[key]

    invited = [participants.invite(offer, run.label, run.key, arrange(offer), now, seconds) for offer in offers]
    return Tender(run=run, invited=invited, earliest=earliest, latest=latest, until=now + seconds)
