"""One task from the client's wish to its end: planning, arranging, executing, recovering (paper, "Protocol for failure
handling and recovery": the realization of a task is a transaction).

What is tried next when something fails is `recovery.py`'s to say; messages are correlated and routed here by `manager.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from somrs.entish import Formula
from somrs.entish.formula import conjunction
from somrs.entish.parse import parse
from somrs.ontology.truth import holds
from somrs.planner.plan import NoPlan, Plan
from somrs.planner.problem import Problem
from somrs.protocol import frp
from somrs.protocol.clients import Phase, Submit, TaskEvent
from somrs.protocol.component import Ask, Effect, Send, Wake
from somrs.protocol.directory import Discover, Discovered, Offer
from somrs.protocol.envelope import Message
from somrs.protocol.frp import Outcome, State
from somrs.protocol.knowledge import Rejected, Updated, UpdateMap
from somrs.protocol.replica import Replica
from somrs.protocol.session import CoordinatorBody, CoordinatorSession, participant_id
from somrs.protocol.states import COORDINATOR_SENDS
from somrs.task_manager.arrange import able, about, bid, choose, fitted, precondition_now, service_types
from somrs.task_manager.recovery import MOST_REPLANS, Rung, next_rung
from somrs.task_manager.setting import Setting, problem
from somrs.task_manager.workflow import Member, Progress, StepRun, Workflow

REPLY_TIME = 10.0
"""Seconds that services have to answer Arrange."""

SILENCE = 20.0
"""Seconds without a word from an executing service after which it is queried; and again as many to answer."""

GOODBYE_TIME = 86_400.0
"""Seconds for which End and Cancel are sent again: a device that is down may come back, and has to hear that it is free."""

STOP_TIME = 60.0
"""Seconds that a service has to stop safely."""


@dataclass(slots=True)
class Transaction:
    """The state of one task. Its methods append to `effects`, which the Task Manager takes and returns."""

    id: str
    task: Submit
    setting: Setting
    submitted_at: float
    phase: Phase = Phase.PLANNING
    outcome: Outcome | None = None
    ended_at: float | None = None
    explanation: str = ""
    workflow: Workflow | None = None
    members: dict[str, Member] = field(default_factory=dict)
    offers: tuple[Offer, ...] = ()
    broken: dict[str, str] = field(default_factory=dict)
    """Services that failed or would not serve in this transaction, and why: new plans leave them out."""
    events: list[TaskEvent] = field(default_factory=list)
    effects: list[Effect] = field(default_factory=list)
    replans: int = 0
    invitations: int = 0
    """Makes the ids of participants differ, however often a service is asked for a step."""
    replan_because: str | None = None
    """Why the plan is given up as soon as nothing of it runs any more."""
    stopping: Outcome | None = None
    """How it will end once everything under way has stopped."""

    # Planning

    def start(self, now: float) -> None:
        self.tell(now, f"task: {self.task.effect}")
        if self.task.deadline is not None:
            self.effects.append(Wake(f"{self.id}/deadline", now + self.task.deadline))
        self.discover(now)

    def discover(self, now: float) -> None:
        """Ask who offers what; the plan is made of it."""
        self.phase, self.offers = Phase.PLANNING, ()
        self._ask(self.setting.registry, Discover(), self._discovered)

    def _discovered(self, answer: Message, now: float) -> None:
        if self.phase is not Phase.PLANNING:
            return
        if not isinstance(answer.body, Discovered):
            self.give_up(now, f"the Service Registry answered: {_said(answer)}")
            return
        self.offers += answer.body.offers
        if answer.body.more:
            self._ask(self.setting.registry, Discover(after=self.offers[-1].service), self._discovered)
            return
        replica = self.setting.replica
        self.effects.append(Ask(f"{self.id}/plan/{self.replans}", self.problem(replica)))

    def problem(self, replica: Replica) -> Problem:
        """What is to be planned: from the map as it is now, with the services that are not known to be broken."""
        return problem(self.task, replica, [offer for offer in self.offers if offer.service not in self.broken])

    def planned(self, found: object, now: float) -> None:
        """The planner's answer."""
        match found:
            case Plan():
                kept = self.workflow
                self.workflow = Workflow(found)
                if kept is not None:
                    self._keep_commitments(kept, now)
                count = len(found.steps)
                self.tell(now, f"planned: {count} step{'s' if count != 1 else ''}" if count else "nothing to do: it is so already")
                self.proceed(now)
            case NoPlan():
                lost = "".join(f"; {service} {why}" for service, why in self.broken.items())
                self.give_up(now, f"no plan: {found.explanation}{lost}")
            case _:
                self.give_up(now, f"planning failed: {found}")

    def _keep_commitments(self, old: Workflow, now: float) -> None:
        """Services already committed to a step that is in the new plan, too, are not asked again; the others leave."""
        assert self.workflow is not None
        for kept, run in self.workflow.adopt(old):
            member = self.members[run.member or ""]
            if kept is None:
                self._send(member, frp.Cancel(reason="the plan changed"), now)
            else:
                member.step = kept.step.id

    # Arranging

    def proceed(self, now: float) -> None:
        """Do whatever comes next."""
        workflow = self.workflow
        if workflow is None or self.phase is Phase.ENDED:
            return
        if self.stopping is not None:
            self._end_when_quiet(now)
        elif self.replan_because is not None:
            self.replan(now, self.replan_because)
        elif workflow.done:
            self._finish(now)
        elif (run := workflow.open()) is not None:
            self.phase = Phase.ARRANGING
            self._arrange(run, now)
        elif workflow.arranged:
            self.phase = Phase.EXECUTING
            for run in workflow.ready():
                self._execute(run, now)

    def _arrange(self, run: StepRun, now: float) -> None:
        """Send Arrange to every able service."""
        assert self.workflow is not None
        known = service_types(self.setting.replica.ontology, self.offers)
        invited = able(run.step, self.offers, known, {*run.excluded, *self.broken})
        if not invited:
            self.recover(run, now, "no other service offers it")
            return
        run.progress, run.attempt, run.invited = Progress.ARRANGING, run.attempt + 1, []
        earliest = self.workflow.earliest_start(run, now)
        for offer in invited:
            member = self._invite(run, offer)
            body = frp.Arrange(
                service_type=offer.service_type.name,
                inputs={name: str(term) for name, term in run.step.inputs.items()},
                effect=str(run.step.effect),
                precondition=str(run.precondition or run.step.precondition) if (run.precondition or run.step.precondition) else None,
                earliest_start=earliest,
                reply_by=now + REPLY_TIME,
            )
            self._send(member, body, now, REPLY_TIME)
        self.effects.append(Wake(f"{self.id}/bids/{run.step.id}/{run.attempt}", now + REPLY_TIME))
        self.tell(now, f"asking {', '.join(offer.service for offer in invited)}", run)

    def _invite(self, run: StepRun, offer: Offer) -> Member:
        self.invitations += 1
        id = participant_id(offer.service, run.step.id, self.invitations)
        session = CoordinatorSession(transaction=self.id, participant=id, me=self.setting.address, peer=offer.address)
        member = Member(id=id, session=session, offer=offer, step=run.step.id)
        self.members[id] = member
        run.invited.append(id)
        return member

    def bids_due(self, step: str, attempt: int, now: float) -> None:
        """The time to answer Arrange is over: take the best of what came."""
        run = self.workflow.runs.get(step) if self.workflow else None
        if run is not None and run.progress is Progress.ARRANGING and run.attempt == attempt:
            self._choose(run, now, waited=True)

    def _choose(self, run: StepRun, now: float, *, waited: bool = False) -> None:
        invited = [self.members[id] for id in run.invited]
        if not waited and any(member.session.state is State.ARRANGING for member in invited):
            return
        offered = [(m.offer.provider, m.bid) for m in invited if m.bid is not None and m.session.state is State.OFFERED]
        bids = [fitted(bid, self.setting.busy(provider)) for provider, bid in offered]
        for member in invited:
            if member.session.state is State.ARRANGING:
                self._send(member, frp.Cancel(reason="no answer in time"), now)
                run.excluded[member.offer.service] = "did not answer"
        if not bids:
            why = "; ".join(f"{m.offer.service}: {m.last_word or 'did not answer'}" for m in invited)
            self.recover(run, now, f"no service takes it ({why})")
            return
        best = choose(bids, self.task, now)
        for member in invited:
            if member.session.state is not State.OFFERED or member.bid is None:
                continue
            if member.id == best.participant:
                member.committed = True
                self._send(member, frp.Accept(terms=best.terms_id), now)
            else:
                self._send(member, frp.Cancel(reason=f"another service was chosen by {self.task.policy}"), now)
        run.progress, run.member, run.start, run.finish = Progress.ARRANGED, best.participant, best.start, best.finish
        chosen = self.members[best.participant]
        terms = best.terms
        self.tell(now, f"{chosen.offer.service} does it for {terms.price:g} {terms.currency}, in {terms.duration:.0f} s", run)
        self.proceed(now)

    # Executing

    def _execute(self, run: StepRun, now: float) -> None:
        member = self.members[run.member or ""]
        try:
            situation = self.precondition(run)
        except LookupError as error:
            self._send(member, frp.Cancel(reason="its precondition does not hold any more"), now)
            run.progress, run.member = Progress.OPEN, None
            self.replan(now, f"{run.step.service_type} cannot start: {error}")
            return
        run.progress = Progress.EXECUTING
        member.heard_at = now
        self._send(
            member,
            frp.Execute(
                inputs={name: str(term) for name, term in run.step.inputs.items()},
                precondition=str(situation) if situation is not None else None,
            ),
            now,
        )
        self.effects.append(Wake(f"{self.id}/silence/{member.id}", now + SILENCE))
        self.tell(now, f"{member.offer.service} starts", run)

    def precondition(self, run: StepRun) -> Formula | None:
        """The step's precondition as it is now, with what a failed service reported about its objects."""
        replica = self.setting.replica
        known = service_types(replica.ontology, self.offers)
        parts = [precondition_now(run.step, known[run.step.service_type], replica.map, replica.ontology), about(run.step, run.reported)]
        told = [part for part in parts if part is not None]
        return conjunction(*told) if told else None

    def receive(self, message: Message, now: float) -> None:
        """A message of the protocol from a participant."""
        member = self.members.get(message.header.participant or "")
        if member is None:
            return
        heard = member.session.receive(message)
        self.effects += [Send(answer) for answer in heard.answers]
        member.heard_at, member.queried = now, False
        if not heard.moved:
            return
        run = self.workflow.runs.get(member.step) if self.workflow else None
        if run is None:
            return
        match message.body:
            case frp.Terms() as terms:
                assert self.workflow is not None
                member.bid = bid(member.id, terms, message.header.message_id, self.workflow.earliest_start(run, now))
                self.tell(now, f"{member.offer.service} offers {terms.price:g} {terms.currency}, {terms.duration:.0f} s", run)
                self._answered(run, member, now)
            case frp.Refuse(reason=reason):
                self.tell(now, f"{member.offer.service} refuses: {reason}", run)
                self._left(run, member, reason, now)
            case frp.Progress(fraction=fraction, situation=situation, note=note):
                member.fraction = fraction
                if situation is not None:
                    self._put_on_map(situation, member, lambda answer, now: None)
                if note:
                    self.tell(now, f"{member.offer.service}: {note}", run)
            case frp.Completed(situation=situation):
                member.fraction = 1.0
                self.tell(now, f"{member.offer.service} completed: {situation}", run)
                self._reported(run, member, situation, now, failed=None)
            case frp.Failed(description=description, situation=situation):
                member.last_word = description
                self.tell(now, f"{member.offer.service} failed: {description}", run)
                self._reported(run, member, situation, now, failed=description)
            case frp.Stopped(situation=situation) | frp.Compensated(situation=situation) | frp.Stranded(situation=situation):
                self.tell(now, f"{member.offer.service} {type(message.body).__name__.lower()}", run)
                self._reported(run, member, situation, now, failed="stopped")
            case frp.Fault(text=text) if member.session.state is State.ENDED:
                self._left(run, member, text, now)
            case frp.Fault() | frp.Status() if member.session.state is State.FAILED:
                member.last_word = message.body.text if isinstance(message.body, frp.Fault) else "it has forgotten its contract"
                self.tell(now, f"{member.offer.service}: {member.last_word}", run)
                self._reported(run, member, None, now, failed=member.last_word)

    def _left(self, run: StepRun, member: Member, reason: str, now: float) -> None:
        """A participant is out before it did anything."""
        member.last_word, member.bid = reason, None
        run.excluded[member.offer.service] = reason
        if run.member == member.id:
            run.progress, run.member = Progress.OPEN, None
            self.proceed(now)
        else:
            self._answered(run, member, now)

    def _answered(self, run: StepRun, member: Member, now: float) -> None:
        if run.progress is Progress.ARRANGING and member.id in run.invited:
            self._choose(run, now)

    def _reported(self, run: StepRun, member: Member, situation: str | None, now: float, failed: str | None) -> None:
        """A step is over. What it left is on the map before anything is planned or arranged on it (FRP, property 5)."""
        self.effects.append(Wake(f"{self.id}/silence/{member.id}", None))
        if run.member != member.id:
            return
        run.progress = Progress.REPORTING
        if situation is None:
            self._on_map(run, member, None, failed, now)
            return

        def known(answer: Message, now: float) -> None:
            if isinstance(answer.body, Updated):
                self.setting.when_known(answer.body.version, lambda now: self._on_map(run, member, situation, failed, now), now)
            else:
                self.tell(now, f"the Repository rejects what {member.offer.service} reports: {_said(answer)}", run)
                self._on_map(run, member, None, failed or f"reported an impossible situation: {_said(answer)}", now)

        self._put_on_map(situation, member, known)

    def _on_map(self, run: StepRun, member: Member, situation: str | None, failed: str | None, now: float) -> None:
        if failed is None:
            run.progress = Progress.DONE
            self.proceed(now)
            return
        run.progress, run.member = Progress.OPEN, None
        run.excluded[member.offer.service] = failed
        self.broken[member.offer.service] = f"failed: {failed}"
        run.reported = parse(situation) if situation is not None else None
        if self.stopping is not None:
            self.proceed(now)
        else:
            self.recover(run, now, failed)

    def _put_on_map(self, situation: str, member: Member, then: Callable[[Message, float], None]) -> None:
        self._ask(self.setting.repository, UpdateMap(situation=situation, author=member.offer.service), then)

    # Recovering

    def recover(self, run: StepRun, now: float, reason: str) -> None:
        """Climb the ladder: the step is nobody's now, and something has to be done about it."""
        known = service_types(self.setting.replica.ontology, self.offers)
        others = able(run.step, self.offers, known, {*run.excluded, *self.broken})
        try:
            run.precondition = self.precondition(run)
            possible = True
        except LookupError:
            possible = False
        match next_rung(run, others, possible):
            case Rung.REPLACE:
                run.progress = Progress.OPEN
                self.tell(now, "replacing the service", run)
                self.proceed(now)
            case Rung.REPLAN:
                if not others:
                    self.broken.update({service: why for service, why in run.excluded.items() if service not in self.broken})
                self.replan(now, reason)

    def replan(self, now: float, reason: str) -> None:
        """From the map as it is now to the task's effect; what runs is awaited first."""
        assert self.workflow is not None
        if self.replans >= MOST_REPLANS:
            self.give_up(now, f"{reason}; planned anew {self.replans} times already")
            return
        if self.workflow.busy:
            self.replan_because, self.phase = reason, Phase.RECOVERING
            return
        self.replan_because = None
        self.replans += 1
        self.tell(now, f"planning anew: {reason}")
        self.discover(now)

    # Ending

    def cancel(self, now: float, reason: str) -> None:
        """The client does not want it any more."""
        if self.phase is not Phase.ENDED and self.stopping is None:
            self.explanation = reason
            self._stop_all(now, Outcome.CANCELLED, reason)

    def give_up(self, now: float, reason: str) -> None:
        """It cannot be done, and this is why."""
        if self.phase is not Phase.ENDED and self.stopping is None:
            self.explanation = reason
            self._stop_all(now, Outcome.FAILED, reason)

    def _stop_all(self, now: float, outcome: Outcome, reason: str) -> None:
        self.stopping, self.phase = outcome, Phase.RECOVERING
        for member in self.members.values():
            match member.session.state:
                case State.EXECUTING:
                    self._send(member, frp.Stop(reason=reason), now)
                case State.ARRANGING | State.OFFERED | State.COMMITTED:
                    self._send(member, frp.Cancel(reason=reason), now)
        self.effects.append(Wake(f"{self.id}/stop", now + STOP_TIME))
        self._end_when_quiet(now)

    def _end_when_quiet(self, now: float) -> None:
        running = [m for m in self.members.values() if m.session.state in (State.EXECUTING, State.STOPPING)]
        reporting = self.workflow is not None and any(run.progress is Progress.REPORTING for run in self.workflow)
        if self.stopping is not None and not running and not reporting:
            self._end(now, self.stopping)

    def stop_overdue(self, now: float) -> None:
        """A service did not stop in time."""
        if self.phase is Phase.ENDED or self.stopping is None:
            return
        for member in self.members.values():
            if member.session.state in (State.EXECUTING, State.STOPPING):
                self.explanation += f"; {member.offer.service} did not say that it stopped"
                member.session.give_up()
        self._end(now, self.stopping)

    def _finish(self, now: float) -> None:
        replica = self.setting.replica
        if holds(parse(self.task.effect), replica.map, replica.ontology):
            self._end(now, Outcome.ACCOMPLISHED)
        else:
            self.replan(now, "every step was done, but the wish does not hold")

    def _end(self, now: float, outcome: Outcome) -> None:
        """End goes to everyone that was ever committed (FRP, property 6)."""
        for member in self.members.values():
            if member.committed and frp.End in COORDINATOR_SENDS.get(member.session.state, {}):
                self._send(member, frp.End(outcome=outcome), now)
        self.phase, self.outcome, self.ended_at = Phase.ENDED, outcome, now
        if outcome is not Outcome.ACCOMPLISHED and self.workflow is not None:
            left = [f"{run.step.service_type} was done: {run.step.effect}" for run in self.workflow if run.progress is Progress.DONE]
            self.explanation += "".join(f"; {text}" for text in left)
        for timer in ("deadline", "stop"):
            self.effects.append(Wake(f"{self.id}/{timer}", None))
        self.tell(now, f"{outcome}{f': {self.explanation}' if self.explanation else ''}")

    # Watching

    def silent(self, participant: str, now: float) -> None:
        """The heartbeat of an executing service may have stopped: ask, and after as long again, give up on it."""
        member = self.members.get(participant)
        if member is None or self.phase is Phase.ENDED or member.session.state not in (State.EXECUTING, State.STOPPING):
            return
        if now - member.heard_at < SILENCE - 0.001:
            self.effects.append(Wake(f"{self.id}/silence/{participant}", member.heard_at + SILENCE))
        elif not member.queried:
            member.queried = True
            self._send(member, frp.Query(), now, SILENCE)
            self.effects.append(Wake(f"{self.id}/silence/{participant}", now + SILENCE))
            self.tell(now, f"{member.offer.service} is silent; asking for its state")
        else:
            member.session.give_up()
            self.give_up(now, f"{member.offer.service} fell silent while it worked; nothing is known of what it left")

    def undelivered(self, message: Message, reason: str, now: float) -> None:
        """A message never arrived."""
        member = self.members.get(message.header.participant or "")
        run = self.workflow.runs.get(member.step) if member and self.workflow else None
        if member is None or run is None or self.phase is Phase.ENDED:
            return
        member.last_word = f"could not be reached: {reason}"
        match message.body:
            case frp.Arrange() if member.session.state is State.ARRANGING:
                self._send(member, frp.Cancel(reason=member.last_word), now)
                self._left(run, member, member.last_word, now)
            case frp.Accept() if member.session.state is State.COMMITTED:
                member.session.give_up()
                self._left(run, member, member.last_word, now)

    def tell(self, now: float, text: str, run: StepRun | None = None) -> None:
        """Something happened that the client wants to know."""
        self.events.append(TaskEvent(number=len(self.events) + 1, at=now, text=text, step=run.step.id if run else None))

    def _ask(self, address: str, body: object, then: Callable[[Message, float], None]) -> None:
        self.effects.append(self.setting.request(address, body, then))

    def _send(self, member: Member, body: CoordinatorBody, now: float, seconds: float = SILENCE) -> None:
        lasting = isinstance(body, frp.End | frp.Cancel)
        self.effects.append(Send(member.session.send(body), now + (GOODBYE_TIME if lasting else seconds)))


def _said(answer: Message) -> str:
    match answer.body:
        case Rejected(problems=problems):
            return "; ".join(problems)
        case frp.Fault(text=text):
            return text
        case body:
            return type(body).__name__
