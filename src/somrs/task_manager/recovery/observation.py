"""Observation of objects in an unknown state after a failure (paper, "Protocol for failure handling and recovery": a cognitive service is
to recognise the situation). If no service can observe an object, the map marks it as unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable

from msgspec import Struct, field, structs

from somrs.entish import Name
from somrs.entish.formula import Attribute, Comparison, Truth, conjunction, conjuncts, names, substitute
from somrs.entish.parse import parse
from somrs.kernel.component import Effects, EffectsReturning
from somrs.ontology.map import Map
from somrs.ontology.objects import Change, Fact, FactRemoved, ValueSet
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages import events, observations
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.context import TaskManagerContext, known_to_hold
from somrs.task_manager.execution.execution_log import ExecutionLog, Work
from somrs.task_manager.execution.member import Members
from somrs.task_manager.execution.reports import Report, ReportResult, Reports, UnobservedSubject
from somrs.task_manager.execution.workflow import StepRun
from somrs.task_manager.requests import DiscoveredOffers, ForLook
from somrs.task_manager.reservations import TaskReservation


class Look(Struct, kw_only=True):
    """The observation of an object whose state is unknown because `work` was lost. `plans` can observe it, the next one first.

    `since_version` is the map version from which on the state is unknown.
    """

    object: str
    work: int
    since_version: int = field(name="since")
    serial: int
    plans: list[Plan] = field(default_factory=list, name="ways")


class Unseen(Struct, frozen=True):
    """An object to observe, and the number of the work that was lost."""

    object: str
    work: int


class LookQueue(Struct, kw_only=True):
    """The objects to observe, one after the other. `current_look` waits for the services on offer; `look_count` counts observations."""

    unseen: list[Unseen] = field(default_factory=list, name="wanted")
    current_look: Look | None = field(default=None, name="asking")
    look_count: int = field(default=0, name="begun")

    def add_work(self, work: Work) -> None:
        """Queue the objects of physical work whose resulting situation is unknown."""
        if work.service_type.kind is ServiceKind.PHYSICAL:
            self.unseen += [Unseen(name, work.number) for name in work.concerned]

    def requeue(self, look: Look) -> None:
        """Queue an observation again that was stopped before it had a result."""
        self.unseen.append(Unseen(look.object, look.work))

    def drop(self) -> None:
        """Queue the current observation again, without waiting for the services on offer."""
        if self.current_look is not None:
            self.unseen.insert(0, Unseen(self.current_look.object, self.current_look.work))
            self.current_look = None


class LookPlan(Struct, frozen=True):
    """A plan to execute, so that the object is observed."""

    plan: Plan
    look: Look


class Observation:
    """Finds services that can observe objects, and marks objects as unknown if there are none. `log_event` logs an event of the work."""

    def __init__(
        self,
        state: LookQueue,
        *,
        owner: str,
        reservation: TaskReservation,
        log: ExecutionLog,
        members: Members,
        services: AvailableServices,
        reports: Reports,
        context: TaskManagerContext,
        log_event: Callable[[Event, float, Work], None],
    ) -> None:
        self._state, self._owner, self._reservation, self._log, self._members = state, owner, reservation, log, members
        self._services, self._reports, self._context, self._log_event = services, reports, context, log_event

    def begin(self, now: float) -> Effects:
        """Discover the services that can observe the next object."""
        state, unseen = self._state, self._state.unseen.pop(0)
        member = self._members.find_member(self._log.work_by_number(unseen.work).participant)
        since_version = member.lost_version if member is not None and member.lost_version is not None else self._context.replica.version
        state.look_count += 1
        state.current_look = Look(object=unseen.object, work=unseen.work, since_version=since_version, serial=state.look_count)
        yield from self._context.discover(ForLook(self._owner, state.look_count), now, confirmed=True)

    def discovered(self, purpose: ForLook, offers: DiscoveredOffers, now: float) -> EffectsReturning[LookPlan | None]:
        """Handle the services on offer, or the reason why they are not known. Returns the plan of the observation, if there is one."""
        look = self._state.current_look
        if look is None or look.serial != purpose.serial:
            return None
        self._state.current_look = None
        replica = self._context.replica
        if not isinstance(offers, str):
            self._services.discovered(offers)
            look.plans = look_plans(look.object, self._services.on_offer, replica.map, replica.ontology)
        return (yield from self.next_plan(look, now))

    def next_plan(self, look: Look, now: float) -> EffectsReturning[LookPlan | None]:
        """The next plan that can observe the object. Without one, the map marks the object as unknown."""
        work = self._log.work_by_number(look.work)
        if look.plans:
            plan = look.plans.pop(0)
            self._log_event(events.LookBegun(service_type=plan.steps[0].service_type, object=look.object), now, work)
            return LookPlan(plan, look)
        member = self._members.find_member(work.participant)
        told_meanwhile = work.state is State.UNREACHABLE and member is not None and member.reported
        if not told_meanwhile:
            replica = self._context.replica
            changes = tuple(unknown_changes(look.object, replica.map, replica.ontology))
            self._log_event(events.NobodyLooks(object=look.object), now, work)
            # Nothing is known of the object since the last order to its participant, or the last report of it: later news is newer.
            told = (member.last_order_time, member.last_news_time) if member is not None else ()
            unseen = observations.Observation(as_of=max((work.started_at, *told)))
            update = UpdateMap(
                changes=changes,
                author="nobody could look",
                expected_version=look.since_version,
                observation=unseen,
                reservation=self._reservation.under(self._owner),
            )
            report = Report(update=update, subject=UnobservedSubject(look.object, look.work))
            yield from self._reports.add_report(self._owner, report, self._context, now)
        return None

    def assumed(self, subject: UnobservedSubject, result: ReportResult, now: float) -> None:
        """The map marks the object as unknown, it has newer news of the object, or the Repository rejected the mark."""
        work = self._log.work_by_number(subject.work)
        member = self._members.find_member(work.participant)
        if result.problems:
            self._log_event(events.KnownOtherwise(object=subject.object, problems=result.problems), now, work)
            return
        if result.reception.superseded and not subject.repeated and self._was_seen_too_early(subject.object, work):
            replica, update = self._context.replica, self._reports.waiting[0].update
            changes = tuple(unknown_changes(subject.object, replica.map, replica.ontology))
            unseen = observations.Observation(as_of=work.ended)
            update = structs.replace(update, changes=changes, expected_version=replica.version, observation=unseen)
            report = Report(update=update, subject=structs.replace(subject, repeated=True))
            self._reports.waiting.insert(1, report)
        if work.state is State.UNREACHABLE and member is not None:
            member.lost_version = self._context.replica.version  # a late report of its own is valid from here on

    def completed(self, look: Look, labels: Container[str], runs: Iterable[StepRun], now: float) -> None:
        """Record the result of an observation, which is on the map: that of the steps with these labels. The lost step, which is one of the
        runs, continues from the observed situation."""
        observed_situation = next((work.situation for work in reversed(self._log.works) if work.label in labels), None)
        lost_work = self._log.work_by_number(look.work)
        lost_work.situation = observed_situation or lost_work.situation
        self._log_event(events.LookFound(situation=observed_situation), now, lost_work)
        for run in runs:
            if run.key == lost_work.key and run.failure is not None and observed_situation is not None:
                run.reported = parse(observed_situation)

    def _was_seen_too_early(self, object: str, work: Work) -> bool:
        """Whether the object was seen where it was before the work, which may not have been over by then."""
        parts = [part for part in conjuncts(work.prior_situation) if object in names(part)] if work.prior_situation is not None else []
        return bool(parts) and work.ended is not None and known_to_hold(conjunction(*parts), self._context.replica)


def look_plans(object: str, offers: Iterable[Offer], map: Map, ontology: Ontology) -> list[Plan]:
    """Plans of one step, one for each cognitive service type whose effect is that the state of the object is known."""
    types = {offer.service_type.name: offer.service_type for offer in offers if offer.service_type.kind is ServiceKind.COGNITIVE}
    steps = [_step(service_type, object, map, ontology) for _, service_type in sorted(types.items())]
    return [Plan((step,)) for step in steps if step is not None]


def _step(service_type: ServiceType, object: str, map: Map, ontology: Ontology) -> Step | None:
    if object not in map.objects or len(service_type.inputs) != 1:
        return None
    (parameter,) = service_type.inputs
    known_effect = Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(False))
    effect = substitute(parse(service_type.effect), {parameter.name: Name(object)})
    if effect != known_effect or not ontology.is_subtype(map.objects[object].type, parameter.type):
        return None
    return Step(id="step1", service_type=service_type.name, inputs={parameter.name: Name(object)}, effect=effect)


def unknown_changes(object: str, map: Map, ontology: Ontology) -> list[Change]:
    """The changes that mark an object as unknown. They remove its facts of exclusive relations, such as its location."""
    if object not in map.objects:
        return []
    facts = [
        Fact(relation.name, arguments)
        for relation in ontology.relations.values()
        if relation.excludes is not None
        for arguments in map.facts_with(relation.name, 0, object)
    ]
    return [*[FactRemoved(fact) for fact in facts], ValueSet(object, UNKNOWN, True)]
