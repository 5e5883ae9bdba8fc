"""When nothing is known of what a failure left: who can look (paper, "Protocol for failure handling and recovery": a cognitive
service is to recognise the situation), and what the map says when nobody can.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from somrs.entish import Name
from somrs.entish.formula import Attribute, Comparison, Truth, substitute, variables
from somrs.entish.parse import parse
from somrs.ontology.objects import Change, Fact, FactRemoved, Map, ValueSet
from somrs.ontology.services import ServiceKind, ServiceType
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.planner.plan import Plan, Step
from somrs.protocol.directory import Offer
from somrs.protocol.knowledge import UpdateMap
from somrs.task_manager.setting import Setting
from somrs.task_manager.work import Work

Found = Callable[["Look", float], None]
"""Called when it is known who can look."""


@dataclass(slots=True, kw_only=True, eq=False)
class Look:
    """An object of which nothing is known since `work` was lost. `ways` are the plans by which it can be looked at, the next first.

    `assume_nothing`: if nobody can say how it is, the map says that nothing is known of it.
    """

    object: str
    work: Work
    since: int
    """The map's version from which on nothing is known."""
    assume_nothing: bool
    ways: list[Plan] = field(default_factory=list)
    offers: tuple[Offer, ...] = ()

    def begin(self, setting: Setting, found: Found, now: float) -> None:
        """Find out who can look."""
        self._setting, self._found = setting, found
        setting.questions.discover(self._discovered, now)

    _setting: Setting = field(init=False)
    _found: Found = field(init=False)

    def _discovered(self, offers: tuple[Offer, ...] | str, now: float) -> None:
        if not isinstance(offers, str):
            replica = self._setting.replica
            self.offers, self.ways = offers, ways(self.object, offers, replica.map, replica.ontology)
        self._found(self, now)

    def unknown(self, map: Map, ontology: Ontology) -> UpdateMap:
        """What the map is to say when nobody could look."""
        return UpdateMap(changes=tuple(unknown(self.object, map, ontology)), author="nobody could look", expected_version=self.since)


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
    return Step(id=f"{service_type.name}-{object}", service_type=service_type.name, inputs={parameter.name: Name(object)}, effect=effect)


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
