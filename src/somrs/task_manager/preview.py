"""A preview: what a task would come to. It is planned, and, if that is wanted, services are asked for their terms as a task would ask
them, step by step in causal order, each on what the steps before promise. Nothing is accepted, and everybody is told that it is over.

It takes a few seconds at most. Whoever has not answered by then is put down with what it asked last, as an estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain

from msgspec import structs

from somrs.kernel.component import Wake
from somrs.planner.model.plan import Plan
from somrs.protocol.messages import frp
from somrs.protocol.messages.clients import Preview, Previewed, Quotation, Submit
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import State
from somrs.task_manager.arrange import Bid, bid, choose, fitted
from somrs.task_manager.claims import Held
from somrs.task_manager.draft import Draft
from somrs.task_manager.offered import Offered
from somrs.task_manager.participants import Member, Participants
from somrs.task_manager.setting import Setting
from somrs.task_manager.tender import AT_ONCE, Tender, Tenders, call
from somrs.task_manager.views import previewed, step_view
from somrs.task_manager.workflow import Progress, StepRun, Workflow

MOST_TIME = 6.0
"""Seconds that asking takes at most."""

REPLY_TIME = 2.0
"""Seconds that services have to answer for one step; in a task they have more."""

SILENT = {State.ARRANGING: f"did not answer within {REPLY_TIME:g} s", State.NEW: "was not asked: there was no time left"}
"""Why there are no terms of a service that has not said that it gives none."""

NOT_WANTED = "it was only asked what it would cost"


class Previewing:
    """One preview. `tell` is called once, with what it came to."""

    def __init__(self, id: str, wanted: Preview, setting: Setting, tell: Callable[[Previewed], None]) -> None:
        self.id = id
        self.over = False
        self._wanted, self._setting, self._tell = wanted, setting, tell
        self.task = Submit(
            effect=wanted.effect,
            precondition=wanted.precondition,
            policy=wanted.policy,
            time_value=wanted.time_value,
            deadline=wanted.deadline,
            priority=wanted.priority,
        )
        self._offered = Offered(replica=setting.replica)
        self._draft = Draft(f"{id}/plan", id, self.task, self._offered, setting, self._planned, holds=False)
        self._participants = Participants(id, setting, self._heed, self._note)
        self._tenders = Tenders(f"{id}/bids", setting.effects)
        self._workflow = Workflow(Plan())
        self._asked_at = 0.0
        self._waits = ""
        self._quotations: dict[str, list[Quotation]] = {}
        """By step."""
        self._unserved: dict[str, str] = {}

    def begin(self, now: float) -> None:
        self._setting.claims.enter(self.id, self.task.effect, self.task.priority)
        self._draft.begin(now)

    # Planning

    def planned(self, question: str, found: object, now: float) -> None:
        """The planner's answer."""
        if self._draft.question == question:
            self._draft.answered(found, now)

    def _planned(self, found: object, now: float) -> None:
        self._setting.claims.leave(self.id)
        if isinstance(found, Held):
            self._waits, found = found.in_words(self._setting.claims), found.plan
        if not isinstance(found, Plan) or not self._wanted.quotes or not found.steps:
            self._end(structs.replace(previewed(found), waits=self._waits))
            return
        self._asked_at, self._workflow = now, Workflow(found)
        self._setting.effects.append(Wake(f"{self.id}/time", now + MOST_TIME))
        self._ask(now)

    # Asking

    def receive(self, message: Message, now: float) -> None:
        """A service answers."""
        received = self._participants.receive(message, now)
        if received is None or not received[1].moved or self.over:
            return
        member, _ = received
        tender = self._tenders.of(member)
        if tender is None:
            return
        match message.body:
            case frp.Terms() as terms:
                self._setting.quoted(member.offer.service, terms.price, terms.duration)
                tender.offered(member, terms, message.header.message_id)
            case frp.Refuse(reason=why) | frp.Fault(text=why):
                member.last_word = why
        self._answered(tender, now)

    def undelivered(self, message: Message, reason: str, now: float) -> None:
        """A service could not be reached."""
        member = self._participants.undelivered(message, reason, now)
        tender = self._tenders.of(member) if member is not None else None
        if tender is not None and not self.over:
            self._answered(tender, now)

    def ring(self, timer: str, now: float) -> None:
        """Somebody has not answered in time, or all of it has taken long enough."""
        if self.over:
            return
        if timer == "time":
            for tender in [*self._tenders]:
                self._settle(tender, now)
            self._guess(now)
        else:
            for tender in self._tenders.due(now):
                self._settle(tender, now)
        self._ask(now)

    def _answered(self, tender: Tender, now: float) -> None:
        if tender.answered:
            self._settle(tender, now)
            self._ask(now)

    def _ask(self, now: float) -> None:
        """Ask for the steps that come next; when all were asked for, that is it."""
        while not self.over:
            runs = [run for run in self._workflow.open if not self._tenders.settles(run.step)]
            before = len(self._tenders)
            for run in runs[: AT_ONCE - before]:
                able = self._offered.able(run)
                if not able:
                    self._nobody(run, now, "nobody offers it")
                    continue
                earliest, latest = self._workflow.earliest_start(run, now), self._latest
                self._tenders.open(call(run, able, self._participants, earliest, latest, now, REPLY_TIME))
            if self._workflow.arranged:
                self._conclude()
            if len(self._tenders) or not runs:
                return

    @property
    def _latest(self) -> float | None:
        return self._asked_at + self._wanted.deadline if self._wanted.deadline is not None else None

    # Choosing

    def _settle(self, tender: Tender, now: float) -> None:
        """Take the best of what came, on paper."""
        self._tenders.close(tender)
        bids: dict[str, Bid] = {}
        quotations: list[Quotation] = []
        for member in tender.invited:
            offered = member.bid is not None and member.state is State.OFFERED
            if member.bid is not None and offered:
                bids[member.id] = fitted(member.bid, self._busy(member.offer))
            elif member.state in SILENT and (guess := self._last_asked(tender.run, member, now)) is not None:
                bids[member.id] = guess
            quotations.append(self._quotation(member, bids.get(member.id), estimate=not offered))
            self._participants.dismiss(member, NOT_WANTED, now)
        in_time = [one for one in bids.values() if self._latest is None or one.finish <= self._latest]
        best = choose(in_time, self.task, self._asked_at) if in_time else None
        self._quotations[tender.run.step.id] = [
            structs.replace(quotation, chosen=best is not None and member.id == best.participant)
            for member, quotation in zip(tender.invited, quotations, strict=True)
        ]
        if best is None:
            reasons = "; ".join(f"{one.service}: {one.reason}" for one in quotations if one.reason)
            self._nobody(tender.run, now, f"nobody takes it ({reasons})" if not bids else "nobody would be done in time")
            return
        chosen = next(member for member in tender.invited if member.id == best.participant)
        self._workflow.bind(tender.run, chosen.offer.provider)
        chosen.bid = best
        tender.run.take(chosen, best.start, best.finish)

    def _quotation(self, member: Member, bid: Bid | None, *, estimate: bool) -> Quotation:
        silent = SILENT.get(member.state, "")
        if bid is None:
            return Quotation(step=member.label, service=member.offer.service, reason=silent or member.last_word)
        return Quotation(
            step=member.label,
            service=member.offer.service,
            price=bid.terms.price,
            currency=bid.terms.currency,
            duration=bid.terms.duration,
            start=bid.start - self._asked_at,
            finish=bid.finish - self._asked_at,
            estimate=estimate,
            reason=silent if estimate else "",
        )

    def _nobody(self, run: StepRun, now: float, why: str) -> None:
        """The steps behind it are asked for all the same, as if it took no time."""
        self._unserved[run.label] = why
        run.start = run.finish = self._workflow.earliest_start(run, now)
        run.progress = Progress.ARRANGED

    def _guess(self, now: float) -> None:
        """There is no time to ask for what is left: put down what services asked last."""
        for run in self._workflow:
            if run.progress is not Progress.OPEN:
                continue
            invited = [self._participants.known(offer, run.label, run.key) for offer in self._offered.able(run)]
            tender = Tender(run=run, invited=invited, earliest=0.0, latest=None, until=now)
            self._tenders.open(tender)
            self._settle(tender, now)

    def _last_asked(self, run: StepRun, member: Member, now: float) -> Bid | None:
        """The bid that the service would make if it asked what it asked last, or says that it always asks."""
        offer = member.offer
        known = self._setting.last_asked(offer)
        if known is None:
            return None
        price, duration = known
        terms = frp.Terms(effect=str(run.step.effect), price=price, duration=duration)
        return fitted(bid(member.id, terms, "", self._workflow.earliest_start(run, now)), self._busy(offer))

    def _busy(self, offer: Offer) -> Iterator[tuple[float, float]]:
        return chain(self._setting.busy(offer.provider), self._workflow.promised(offer.provider))

    # Telling

    def _conclude(self) -> None:
        plan, runs = self._workflow.plan, [*self._workflow]
        quotations = tuple(chain.from_iterable(self._quotations.get(run.step.id, ()) for run in runs))
        chosen = {one.step: one for one in quotations if one.chosen}
        currencies = {one.currency for one in chosen.values()}
        whole = not self._unserved
        found = Previewed(
            steps=tuple(
                step_view(run.step, plan, service=one.service, price=one.price, duration=one.duration)
                if (one := chosen.get(run.label)) is not None
                else step_view(run.step, plan)
                for run in runs
            ),
            waits=self._waits,
            quotations=quotations,
            price=sum(one.price or 0.0 for one in chosen.values()) if whole and len(currencies) == 1 else None,
            currency=next(iter(sorted(currencies)), "EUR"),
            seconds=max((one.finish or 0.0 for one in chosen.values()), default=0.0) if whole else None,
            estimate=any(one.estimate for one in chosen.values()),
            unserved=self._unserved,
        )
        self._end(found)

    def _end(self, found: Previewed) -> None:
        self.over = True
        self._tenders.drop()
        self._setting.effects.append(Wake(f"{self.id}/time", None))
        self._tell(found)

    def _heed(self, now: float, text: str) -> None:
        """There is nobody at work who could fall silent."""

    def _note(self, now: float, message: Message) -> None:
        """Of what is only asked nothing is kept."""
