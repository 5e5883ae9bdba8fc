"""When nothing is known of what a failure left: who can look (paper, "Protocol for failure handling and recovery": a cognitive
service is to recognise the situation), and what the map says when nobody can.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from msgspec import Struct, field

from somrs.entish import Name
from somrs.entish.formula import Attribute, Comparison, Truth, substitute
from somrs.entish.parse import parse
from somrs.kernel.component import Effects, EffectsReturning
from somrs.ontology.objects import Change, Fact, FactRemoved, Map, ValueSet
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages import events
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.task_manager.arrangement.available_services import AvailableServices
from somrs.task_manager.context import Context
from somrs.task_manager.execution.execution_log import ExecutionLog, Work
from somrs.task_manager.execution.participants import Members
from somrs.task_manager.execution.reports import OfNobody, Report, Reports
from somrs.task_manager.requests import ForLook


class Look(Struct, kw_only=True):
    """An object of which nothing is known since that `work` was lost. `ways` are the plans by which it can be looked at, the next first.

    `since` is the map's version from which on nothing is known. If nobody can say how the object is, the map says that.
    """

    object: str
    work: int
    since: int
    serial: int
    ways: list[Plan] = []


class Unseen(Struct, frozen=True):
    """An object that has to be looked at, and the number of the work that was lost."""

    object: str
    work: int


class Looks(Struct, kw_only=True):
    """What is `wanted`, one object after the other; `asking`: it is being found out who can look. `begun` counts."""

    wanted: list[Unseen] = field(default_factory=list)
    asking: Look | None = None
    begun: int = 0

    def want(self, work: Work) -> None:
        """Nobody knows what the work left."""
        if work.service_type.kind is ServiceKind.PHYSICAL:
            self.wanted += [Unseen(name, work.number) for name in work.concerned]

    def again(self, look: Look) -> None:
        """Whoever looked was called off before anything was seen."""
        self.wanted.append(Unseen(look.object, look.work))

    def drop(self) -> None:
        """It does not matter any more who can look at what is being asked for."""
        if self.asking is not None:
            self.wanted.insert(0, Unseen(self.asking.object, self.asking.work))
            self.asking = None


class LookBy(Struct, frozen=True):
    """A plan that has to be pursued, so that the object is looked at."""

    plan: Plan
    look: Look


class Observation:
    """Finds somebody who can look, and says so on the map where nobody can. `tell` notes what happened to a piece of work."""

    def __init__(
        self,
        state: Looks,
        *,
        owner: str,
        log: ExecutionLog,
        members: Members,
        services: AvailableServices,
        reports: Reports,
        context: Context,
        tell: Callable[[Event, float, Work], None],
    ) -> None:
        self._state, self._owner, self._log, self._members = state, owner, log, members
        self._services, self._reports, self._context, self._tell = services, reports, context, tell

    def begin(self, now: float) -> Effects:
        """Find out who can look at the next object."""
        state, unseen = self._state, self._state.wanted.pop(0)
        member = self._members.get(self._log.numbered(unseen.work).participant)
        since = member.lost_at if member is not None and member.lost_at is not None else self._context.replica.version
        state.begun += 1
        state.asking = Look(object=unseen.object, work=unseen.work, since=since, serial=state.begun)
        yield from self._context.requests.discover(ForLook(self._owner, state.begun), now)

    def discovered(self, purpose: ForLook, offers: tuple[Offer, ...] | str, now: float) -> EffectsReturning[LookBy | None]:
        """The services on offer are known, or why they cannot be. Who is to look, if anybody can."""
        look = self._state.asking
        if look is None or look.serial != purpose.serial:
            return None
        self._state.asking = None
        replica = self._context.replica
        if not isinstance(offers, str):
            self._services.discovered(offers)
            look.ways = ways(look.object, offers, replica.map, replica.ontology)
        return (yield from self.next_way(look, now))

    def next_way(self, look: Look, now: float) -> EffectsReturning[LookBy | None]:
        """Have it looked at in the next way; without any, nothing is assumed about the object."""
        work = self._log.numbered(look.work)
        if look.ways:
            plan = look.ways.pop(0)
            self._tell(events.LookBegun(service_type=plan.steps[0].service_type, object=look.object), now, work)
            return LookBy(plan, look)
        member = self._members.get(work.participant)
        told_meanwhile = work.state is State.UNREACHABLE and member is not None and member.reported
        if not told_meanwhile:
            replica = self._context.replica
            changes = tuple(unknown(look.object, replica.map, replica.ontology))
            self._tell(events.NobodyLooks(object=look.object), now, work)
            update = UpdateMap(changes=changes, author="nobody could look", expected_version=look.since)
            report = Report(update=update, about=OfNobody(look.object, look.work))
            yield from self._reports.put(self._owner, report, self._context, now)
        return None

    def assumed(self, about: OfNobody, problems: tuple[str, ...], now: float) -> None:
        """The map says that nothing is known of the object, or that it does not say so."""
        work = self._log.numbered(about.work)
        member = self._members.get(work.participant)
        if problems:
            self._tell(events.KnownOtherwise(object=about.object, problems=problems), now, work)
        elif work.state is State.UNREACHABLE and member is not None:
            member.lost_at = self._context.replica.version  # its own report, should it come after all, is news


def ways(object: str, offers: Iterable[Offer], map: Map, ontology: Ontology) -> list[Plan]:
    """For each cognitive service type whose effect is that the object is known: the plan of one step that it is."""
    types = {offer.service_type.name: offer.service_type for offer in offers if offer.service_type.kind is ServiceKind.COGNITIVE}
    steps = [_step(service_type, object, map, ontology) for _, service_type in sorted(types.items())]
    return [Plan((step,)) for step in steps if step is not None]


def _step(service_type: ServiceType, object: str, map: Map, ontology: Ontology) -> Step | None:
    if object not in map.objects or len(service_type.inputs) != 1:
        return None
    (parameter,) = service_type.inputs
    known = Comparison(Attribute(Name(object), UNKNOWN), "=", Truth(False))
    effect = substitute(parse(service_type.effect), {parameter.name: Name(object)})
    if effect != known or not ontology.is_subtype(map.objects[object].type, parameter.type):
        return None
    return Step(id="step1", service_type=service_type.name, inputs={parameter.name: Name(object)}, effect=effect)


def unknown(object: str, map: Map, ontology: Ontology) -> list[Change]:
    """It may be anywhere: the facts about it that exclude each other go, and the map says so."""
    if object not in map.objects:
        return []
    facts = [
        Fact(relation.name, arguments)
        for relation in ontology.relations.values()
        if relation.excludes is not None
        for arguments in map.facts_with(relation.name, 0, object)
    ]
    return [*[FactRemoved(fact) for fact in facts], ValueSet(object, UNKNOWN, True)]
