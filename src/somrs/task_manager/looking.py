"""When nothing is known of what a failure left: who can look (paper, "Protocol for failure handling and recovery": a cognitive
service is to recognise the situation), and what the map says when nobody can.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from somrs.entish import Name
from somrs.entish.formula import Attribute, Comparison, Truth, substitute, variables
from somrs.entish.parse import parse
from somrs.ontology.objects import Change, Fact, FactRemoved, Map, ValueSet
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.planner.model.plan import Plan, Step
from somrs.protocol.messages.clients import EventKind
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.task_manager.offered import Offered
from somrs.task_manager.reports import Reports
from somrs.task_manager.setting import Setting
from somrs.task_manager.work import Work


@dataclass(slots=True, kw_only=True, eq=False)
class Look:
    """An object of which nothing is known since `work` was lost. `ways` are the plans by which it can be looked at, the next first.

    `since` is the map's version from which on nothing is known. If nobody can say how the object is, the map says that.
    """

    object: str
    work: Work
    since: int
    ways: list[Plan] = field(default_factory=list)


class Owner(Protocol):
    """The transaction that wants to know."""

    setting: Setting
    offered: Offered
    reports: Reports

    def tell_of(self, work: Work, text: str, now: float, kind: EventKind) -> None: ...

    def look_by(self, plan: Plan, look: Look, now: float) -> None:
        """Have it looked at so. `next_way` is called when nothing comes of that."""

    def proceed(self, now: float) -> None: ...


class Looks:
    """What is to be looked at, one object after the other."""

    def __init__(self, owner: Owner) -> None:
        self._owner = owner
        self._wanted: deque[tuple[str, Work]] = deque()
        self._asking: Look | None = None

    @property
    def wanted(self) -> bool:
        """Whether something has to be looked at yet."""
        return bool(self._wanted)

    @property
    def asking(self) -> bool:
        """Whether it is being found out who can look."""
        return self._asking is not None

    def want(self, work: Work) -> None:
        """Nobody knows what the work left."""
        if work.service_type.kind is ServiceKind.PHYSICAL:
            self._wanted += [(name, work) for name in work.concerned]

    def again(self, look: Look) -> None:
        """Whoever looked was called off before anything was seen."""
        self._wanted.append((look.object, look.work))

    def drop(self) -> None:
        """It does not matter any more who can look at what is being asked for."""
        if self._asking is not None:
            self._wanted.appendleft((self._asking.object, self._asking.work))
            self._asking = None

    def begin(self, now: float) -> None:
        """Find out who can look at the next object."""
        object, work = self._wanted.popleft()
        since = work.member.lost_at if work.member.lost_at is not None else self._owner.setting.replica.version
        self._asking = Look(object=object, work=work, since=since)
        self._owner.setting.questions.discover(partial(self._discovered, self._asking), now)

    def _discovered(self, look: Look, offers: tuple[Offer, ...] | str, now: float) -> None:
        if look is not self._asking:
            return
        self._asking = None
        replica = self._owner.setting.replica
        if not isinstance(offers, str):
            self._owner.offered.discovered(offers)
            look.ways = ways(look.object, offers, replica.map, replica.ontology)
        self.next_way(look, now)

    def next_way(self, look: Look, now: float) -> None:
        """Have it looked at in the next way; without any, nothing is assumed about the object."""
        owner = self._owner
        if look.ways:
            plan = look.ways.pop(0)
            owner.tell_of(look.work, f"{plan.steps[0].service_type}: somebody is to look at {look.object}", now, EventKind.LOOK)
            owner.look_by(plan, look, now)
            return
        told_meanwhile = look.work.state is State.UNREACHABLE and look.work.member.reported
        if not told_meanwhile:
            replica = owner.setting.replica
            changes = tuple(unknown(look.object, replica.map, replica.ontology))
            owner.tell_of(look.work, f"nobody can look at {look.object}: nothing is assumed about it", now, EventKind.LOOK)
            update = UpdateMap(changes=changes, author="nobody could look", expected_version=look.since)
            owner.reports.put(update, partial(self._assumed, look), now)
        owner.proceed(now)

    def _assumed(self, look: Look, problem: str | None, now: float) -> None:
        if problem is not None:
            self._owner.tell_of(look.work, f"something else is known of {look.object} by now: {problem}", now, EventKind.LOOK)
        elif look.work.state is State.UNREACHABLE:
            look.work.member.lost_at = self._owner.setting.replica.version  # its own report, should it come after all, is news


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
    if effect != known or variables(effect) or not ontology.is_a(map.objects[object].type, parameter.type):
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
