"""Why there is no plan, for people: which part of the goal nothing can bring about, and what is missing for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from somrs.entish import Name, Relation, Variable
from somrs.entish.formula import Literal, Substitution, alternatives, conjunction, conjuncts, names, substitute, variables
from somrs.entish.parse import nearest, parse
from somrs.ontology.matching import achieving_bindings, can_achieve, unifiers
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.truth import bindings, formula_holds
from somrs.planner.grounding.grounding import Grounding, TooLarge
from somrs.planner.grounding.relevance import demands
from somrs.planner.model.operators import Inexpressible, goal_operators
from somrs.planner.model.plan import NoPlan, Obstacle
from somrs.planner.model.problem import Available, Lost, Problem
from somrs.planner.model.world import World
from somrs.planner.search.conflict import impossible, smallest, torn

DEPTH = 4
"""How many services back a reason is looked for."""


def unmet_precondition(problem: Problem) -> NoPlan | None:
    """What the client says of the beginning and the map denies."""
    if problem.precondition is None or formula_holds(problem.precondition, problem.map, problem.ontology):
        return None
    parts = conjuncts(problem.precondition)
    denied = [part for part in parts if not formula_holds(part, problem.map, problem.ontology)] or parts
    said = " and ".join(map(str, denied))
    return NoPlan(
        explanation=f"the task starts from {said}, which does not hold on the map",
        missing=tuple(map(str, denied)),
        obstacles=(Obstacle.PRECONDITION,),
    )


def why_not(problem: Problem, world: World, guessed: bool = False) -> NoPlan:
    """The reasons, for the alternative of the goal that lacks least. `guessed`: values that nobody named were not tried."""
    best: _Reasons | None = None
    for branch in alternatives(problem.goal):
        reasons = _Reasons(problem, world)
        reasons.explain_all(branch)
        if best is None or len(reasons.unreachable) < len(best.unreachable):
            best = reasons
    assert best is not None, "a formula has an alternative"
    told = "; ".join(best.said)
    left_out = [inexpressible for inexpressible in world.repertoire.left_out if str(inexpressible) not in told]
    best.said.update((f"not considered: {inexpressible}", None) for inexpressible in left_out)
    if guessed:
        best.said["services that can be given any number or text were tried with those only that the task names"] = None
    return NoPlan(
        explanation="; ".join(best.said),
        unreachable=tuple(best.unreachable),
        missing=tuple(best.missing),
        unoffered=tuple(best.unoffered),
        undecided=guessed or bool(world.repertoire.left_out),
        said=tuple(best.said),
        obstacles=tuple(obstacle for obstacle in Obstacle if obstacle in best.obstacles),
        lost=tuple(best.lost),
    )


@dataclass(slots=True, eq=False)
class _Reasons:
    """The reasons found so far."""

    problem: Problem
    world: World
    unreachable: list[str] = field(default_factory=list)
    missing: dict[str, None] = field(default_factory=dict)
    unoffered: dict[str, None] = field(default_factory=dict)
    said: dict[str, None] = field(default_factory=dict)
    obstacles: set[Obstacle] = field(default_factory=set)
    lost: dict[str, None] = field(default_factory=dict)

    def explain_all(self, parts: Sequence[Literal]) -> None:
        """Why the parts of the goal cannot come about: each that cannot, else as few as possible that cannot together."""
        for literal in parts:
            if not self.reachable([literal]):
                self.unreachable.append(str(literal))
                self.explain(literal, DEPTH)
        if self.unreachable:
            return
        together = smallest(parts, self.world)
        self.unreachable.extend(map(str, together))
        if len(together) == 1:
            self.said[f"no order of services makes {_wish(together[0])} true"] = None
            self.explain(together[0], DEPTH)
            return
        thing = torn(together, self.world)
        self.obstacles.update([Obstacle.TWO_PLACES] * (thing is not None))
        because = f": {thing} would be in two places at a time" if thing is not None else ", in no order of services"
        self.said[f"{' and '.join(map(_wish, together))} can each be brought about, but not all together{because}"] = None

    def reachable(self, literals: Sequence[Literal]) -> bool:
        """Whether all can come about together if nothing that is true ever became false; when in doubt, yes."""
        try:
            goals = list(goal_operators(conjunction(*literals), self.world.known))
            return Grounding(self.world, demands(goals, self.world)).reached
        except (Inexpressible, TooLarge):
            return True

    def explain(self, literal: Literal, depth: int) -> None:
        """Why the literal, which is not reachable, is not."""
        if self._unknown_objects(literal):
            return
        offered = [available for available in self.problem.services if self.world.providers[available.service_type.name]]
        helpful = [a for a in offered if can_achieve(a.service_type, literal, self.problem.ontology, self.problem.map)]
        if not helpful:
            self._nobody(literal, {available.service_type.name for available in offered})
            return
        for available in helpful:
            service = available.service_type
            unexpressed = [i for i in self.world.repertoire.left_out if str(i.formula).startswith(f"{service.name}: ")]
            self.said.update(
                (f"{literal} could be brought about by {service.name}, which cannot be planned with: {i}", None) for i in unexpressed
            )
            if not unexpressed:
                self._lacking(available, literal, depth)

    def _unknown_objects(self, literal: Literal) -> bool:
        unknown = [name for name in self._objects(literal) if name not in self.problem.map.objects]
        for name in unknown:
            self.obstacles.add(Obstacle.NO_OBJECT)
            hint = nearest(name, self.problem.map.objects)
            self.said[f"{literal}: there is no object {name} on the map" + (f"; {hint}" if hint else "")] = None
        kept = [name for name in names(literal) if name in self.problem.excluded]
        for name in kept:
            self.obstacles.add(Obstacle.PROMISED)
            self.said[f"{literal}: {not_usable(name)}"] = None
        return bool(unknown or kept)

    def _objects(self, literal: Literal) -> Iterator[str]:
        """The names that are not values of enumerations."""
        words = {value for attribute in self.problem.ontology.attributes.values() for value in attribute.values}
        return (name for name in names(literal) if name not in words or name in self.problem.map.objects)

    def _nobody(self, literal: Literal, there: set[str]) -> None:
        types = {one.service_type.name: one.service_type for one in self.problem.lost}
        types |= {available.service_type.name: available.service_type for available in self.problem.services}
        known = {**self.problem.ontology.services, **types}
        absent = [
            name
            for name, service in known.items()
            if name not in there and can_achieve(service, literal, self.problem.ontology, self.problem.map)
        ]
        busy = {a.service_type.name: a.providers for a in self.problem.services if a.service_type.name in absent and a.providers}
        lost = {name: [one for one in self.problem.lost if one.service_type.name == name] for name in absent if name not in busy}
        nobody = [name for name, services in lost.items() if not services]
        self.unoffered.update(dict.fromkeys(nobody))
        for name, providers in busy.items():
            self.obstacles.add(Obstacle.PROMISED)
            why = f"{' and '.join(providers)} are promised to other tasks, or nobody knows what state they are in"
            why = not_usable(providers[0]) if len(providers) == 1 else why
            self.said[f"{_wish(literal)} could be brought about by {name}, but {why}"] = None
        for name, services in lost.items():
            if services:
                self.lost.update((one.service, None) for one in services)
                self.said[f"{_wish(literal)} could be brought about by {name}, but nobody is left to do it ({_each(services)})"] = None
        if nobody:
            self.obstacles.add(Obstacle.NOT_OFFERED)
            self.said[f"{_wish(literal)} could be brought about by {' or '.join(nobody)}, which nobody offers now"] = None
        if not absent:
            self.obstacles.add(Obstacle.NO_SERVICE_TYPE)
            self.missing[_wish(literal)] = None
            unfit = next((f": {said}" for service in known.values() for said in self._unfit(service, literal)), "")
            self.said[f"{_wish(literal)} does not hold on the map, and no service type brings it about{unfit}"] = None

    def _unfit(self, service: ServiceType, literal: Literal) -> Iterator[str]:
        """That the service brings about such things, but not of objects of such types."""
        types = {parameter.name: parameter.type for parameter in service.inputs}
        for given in unifiers(parse(service.effect), literal, self.problem.ontology, types):
            objects = {name: self.problem.map.objects.get(term.name) for name, term in given.items() if isinstance(term, Name)}
            for name, object in objects.items():
                if object is not None and name in types and not self.problem.ontology.is_subtype(object.type, types[name]):
                    yield f"{service.name} takes only a {types[name]} as its {name}, and {object.name} is a {object.type}"

    def _lacking(self, available: Available, literal: Literal, depth: int) -> None:
        """What the service needs and cannot have."""
        service = available.service_type
        bound = next(achieving_bindings(service, literal, self.problem.ontology, self.problem.map), {})
        given = {name: term for name, term in bound.items() if not isinstance(term, Variable)}
        given.setdefault(PROVIDER, Name(self.world.providers[service.name][0]))
        had: list[Literal] = []
        lacking: list[Literal] = []
        for part in next(alternatives(substitute(parse(service.precondition), given))) if service.precondition is not None else ():
            (lacking if impossible([*had, part], self.world) else had).append(part)
        row = self._row(had)
        for part in lacking:
            if had and self.reachable([*had, part]):
                self._together(service.name, literal, smallest([*had, part], self.world))
                continue
            missing = substitute(part, row)
            assert isinstance(missing, Literal), "variables of a literal were replaced"
            circular = _wish(missing) in (_wish(literal), *self.missing)
            self.missing[_wish(missing)] = None
            if not circular or depth == DEPTH:
                self.said[f"{service.name} could bring about {_wish(literal)}, but needs {_wish(missing)}{self._instead(missing)}"] = None
            if depth > 0 and not circular:
                self.explain(missing, depth - 1)
        if not lacking:
            self.said[f"{service.name} brings about such things, but not {_wish(literal)}"] = None

    def _row(self, had: Sequence[Literal]) -> Substitution:
        """What the variables of the parts stand for on the map, of those that a relation gives a value."""
        given = {name for part in had if isinstance(part, Relation) for name in variables(part)}
        parts = [part for part in had if given.issuperset(variables(part))]
        return next(bindings(conjunction(*parts), self.problem.map, self.problem.ontology), {}) if parts else {}

    def _together(self, service: str, literal: Literal, parts: Sequence[Literal]) -> None:
        """The service needs what can come about, but not all of it at a time."""
        needs = str(conjunction(*parts)).replace(" AND ", " and ")
        self.missing[needs] = None
        self.said[f"{service} could bring about {_wish(literal)}, but needs {needs}, and no order of services leads to that"] = None

    def _instead(self, literal: Literal) -> str:
        """What the map says in the place of a relation that would have to hold."""
        if not isinstance(literal, Relation) or not isinstance(literal.arguments[0], Name):
            return ""
        name, wanted = literal.arguments[0].name, self.problem.ontology.relations.get(literal.relation)
        group = [r.name for r in self.problem.ontology.relations.values() if wanted and r.excludes and r.excludes == wanted.excludes]
        told = [str(fact) for fact in self.problem.map.facts_about(name) if fact.relation in group and fact.arguments[0] == name]
        if told:
            return f", and the map says {' and '.join(told)}"
        return f", and the map does not say where {name} is" if group else ""


def _each(services: Sequence[Lost]) -> str:
    """Who does not do it, and why; those with the same reason together."""
    whys: dict[str, list[str]] = {}
    for one in services:
        whys.setdefault(one.why, []).append(one.service)
    return "; ".join(f"{' and '.join(names)}: {why}" for why, names in whys.items())


def _wish(literal: Literal) -> str:
    """The literal with `?` for what may be anything."""
    blank = {name: Name("?") for name, variable in variables(literal).items() if variable.type is None}
    return str(substitute(literal, blank))


def not_usable(name: str) -> str:
    """Why nothing can be done with, or said of, an object that is excluded."""
    return f"{name} is promised to another task, or nobody knows what state it is in"
