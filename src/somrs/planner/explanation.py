"""Explains to users why there is no plan: which part of the goal no service can achieve, and what is missing for it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from somrs.entish import Attribute, Comparison, Formula, Name, Not, Relation, Truth, Variable
from somrs.entish.formula import (
    Literal,
    Substitution,
    alternatives,
    conjunction,
    conjuncts,
    count_alternatives,
    names,
    substitute,
    terms,
    variables,
)
from somrs.entish.normal_form import affirmed_variables, group_by_variables
from somrs.entish.parse import nearest, parse
from somrs.ontology.achievability import Achievability, Hindrance, blank_variables, hindrance_text, misfits, present_value
from somrs.ontology.homes import absence_text
from somrs.ontology.matching import achieving_bindings, can_achieve, types_of, unifiers
from somrs.ontology.service_kinds import undetermined_inputs
from somrs.ontology.services import PROVIDER, ServiceKind, ServiceType
from somrs.ontology.truth import bindings
from somrs.ontology.types import UNKNOWN
from somrs.ontology.values import value_of
from somrs.planner.exclusions import exclusion_obstacles, exclusion_text
from somrs.planner.grounding.grounding import Grounding
from somrs.planner.grounding.joins import TooLarge
from somrs.planner.grounding.relevance import demands
from somrs.planner.losses import losses_text, resting_text
from somrs.planner.model.choices import ALTERNATIVES
from somrs.planner.model.operators import goal_operators
from somrs.planner.model.plan import NoPlan, Obstacle
from somrs.planner.model.problem import AvailableService, Problem, rejection_text
from somrs.planner.model.reading import outputs_in_effect, tells
from somrs.planner.model.vocabulary import Inexpressible
from somrs.planner.model.world import World
from somrs.planner.reasons import Reasons
from somrs.planner.search.conflict import Tries, find_minimal_conflict, find_torn_object, is_impossible

DEPTH = 4
"""The maximum length of a chain of services that an explanation follows backward."""
EXPLAINED = 5
"""The maximum number of unreachable parts of the goal to explain one by one."""


def explain_failure(problem: Problem, world: World, guessed: bool = False) -> NoPlan:
    """The reasons for the goal's alternative with the fewest unreachable parts. `guessed`: numbers and texts that the task does not name
    were not tried as inputs."""
    best: Reasons | None = None
    tries = Tries()
    for branch in _branches(problem.goal, _Explainer(problem, world, tries)):
        explainer = _Explainer(problem, world, tries)
        explainer.explain_all(branch)
        if best is None or len(explainer.reasons.unreachable) < len(best.unreachable):
            best = explainer.reasons
    assert best is not None, "a formula has an alternative"
    explanation = "; ".join(best.texts)
    for inexpressible in world.repertoire.omissions:
        if str(inexpressible) not in explanation:
            best.say(f"not considered: {inexpressible}")
    if guessed:
        best.say("services with a number or text as input were tried only with the values that the task names")
    return best.no_plan(undecided=guessed or bool(world.repertoire.omissions))


def _branches(goal: Formula, explainer: _Explainer) -> Iterator[list[Literal]]:
    """The alternatives of the goal to explain. Of too many, only the nearest: of each independent choice, the alternative with the fewest
    unreachable parts."""
    groups = group_by_variables(conjuncts(goal), affirmed_variables(goal))
    if len(groups) == 1 or count_alternatives(goal) <= ALTERNATIVES:
        for branch in alternatives(goal):
            yield [part for part in branch if isinstance(part, Literal)]
        return
    nearest_branches = (
        min(_branches(conjunction(*group), explainer), key=lambda branch: sum(not explainer.reachable([literal]) for literal in branch))
        for group in groups
    )
    yield [literal for branch in nearest_branches for literal in branch]


@dataclass(slots=True, eq=False)
class _Explainer:
    """Finds the reasons for one alternative of the goal."""

    problem: Problem
    world: World
    tries: Tries
    reasons: Reasons = field(default_factory=Reasons)
    _conceivable: Achievability = field(init=False)
    """What could be brought about whichever devices come: a condition that no service type changes stays as it is."""

    def __post_init__(self) -> None:
        self._conceivable = Achievability([*self._known_service_types().values()], self.problem.ontology, self.problem.map, {})

    def explain_all(self, parts: Sequence[Literal]) -> None:
        """Explain each part of the goal that is unreachable by itself; if there is none, a minimal set of parts that conflict."""
        unreachable = [literal for literal in parts if not self.reachable([literal])]
        self.reasons.unreachable.extend(map(str, unreachable))
        for literal in unreachable[:EXPLAINED]:
            self._explain(literal, DEPTH)
        if len(unreachable) > EXPLAINED:
            self.reasons.say(f"{len(unreachable) - EXPLAINED} more parts of the goal are out of reach, too")
        if self.reasons.unreachable:
            return
        conflict = find_minimal_conflict(parts, self.world, self.tries)
        self.reasons.unreachable.extend(map(str, conflict))
        if len(conflict) == 1:
            self.reasons.say(f"no order of services makes {_format_literal(conflict[0])} true")
            self._explain(conflict[0], DEPTH)
            return
        thing = find_torn_object(conflict, self.world)
        self.reasons.obstacles.update([Obstacle.TWO_PLACES] * (thing is not None))
        cause = f": {thing} would be in two places at a time" if thing is not None else ", in no order of services"
        self.reasons.say(f"{' and '.join(map(_format_literal, conflict))} can each be brought about, but not all together{cause}")

    def reachable(self, literals: Sequence[Literal]) -> bool:
        """Whether the literals are reachable together in the delete relaxation (no fact becomes false); True when undecided."""
        try:
            goals = list(goal_operators(conjunction(*literals), self.world.vocabulary))
            return Grounding(self.world, demands(goals, self.world)).is_goal_reachable
        except (Inexpressible, TooLarge):
            return True

    def _explain(self, literal: Literal, depth: int) -> None:
        """Explain why the literal is not reachable."""
        if self._unknown_objects(literal):
            return
        offered = [available for available in self.problem.services if self.world.providers[available.service_type.name]]
        helpful = [offer for offer in offered if self._can_bring_about(offer, literal)]
        if not helpful:
            self._explain_no_provider(literal, {available.service_type.name: available.service_type for available in offered})
            return
        if len(helpful) > 1 and self._explain_common_hindrance(literal, [offer.service_type for offer in helpful]):
            return
        for available in helpful:
            service = available.service_type
            if tells(service):
                outputs = " and ".join(f"?{name}" for name in outputs_in_effect(service))
                known_late = f"but its {outputs} is known only when it is done"
                self.reasons.say(f"{service.name} could bring about {_format_literal(literal)}, {known_late}")
                continue
            unexpressed = [i for i in self.world.repertoire.omissions if str(i.formula).startswith(f"{service.name}: ")]
            for inexpressible in unexpressed:
                self.reasons.say(f"{literal} could be brought about by {service.name}, which cannot be planned with: {inexpressible}")
            if not unexpressed:
                self._explain_lacking(available, literal, depth)

    def _explain_common_hindrance(self, literal: Literal, services: Iterable[ServiceType]) -> bool:
        """Explain the one condition that all these services have and that nothing changes. Returns whether there is one."""
        hindrances = {service.name: self._conceivable.hindrance(service, literal) for service in services}
        lacking = {name: hindrance for name, hindrance in hindrances.items() if hindrance is not None}
        conditions = {hindrance.condition for hindrance in lacking.values()}
        if len(lacking) < len(hindrances) or len(conditions) > 1:
            return False
        self._explain_no_service_type(literal, (), lacking)
        return True

    def _can_bring_about(self, offer: AvailableService, literal: Literal) -> bool:
        """Whether one of the providers changes or computes something in a way that can make the literal true."""
        providers = {Name(name) for name in self.world.providers[offer.service_type.name]}
        matches = self._matches(offer.service_type, literal)
        return any(not isinstance(provider := match.get(PROVIDER), Name) or provider in providers for match in matches)

    def _could_help(self, service: ServiceType, literal: Literal) -> bool:
        """Whether a plan for the literal could use the service, if it were on offer. The service itself chooses the objects that are its
        outputs, so it helps with none that the literal names."""
        chosen = [output.name for output in service.outputs if output.type in self.problem.ontology.types]
        return any(not any(isinstance(match.get(name), Name) for name in chosen) for match in self._matches(service, literal))

    def _matches(self, service: ServiceType, literal: Literal) -> Iterator[Substitution]:
        """The bindings with which the service can make the literal true. A cognitive service makes nothing true."""
        if service.kind is not ServiceKind.COGNITIVE:
            ontology = self.problem.ontology
            yield from unifiers(parse(service.effect), literal, ontology, types_of(service, ontology), self.problem.map)

    def _explain_unknown_values(self, literal: Literal) -> bool:
        """Explain which values in the literal are not known, and who could find them out. Returns whether anyone could."""
        map, ontology = self.problem.map, self.problem.ontology
        unknown = [
            term
            for term in terms(literal.atom if isinstance(literal, Not) else literal)
            if isinstance(term, Attribute) and isinstance(term.owner, Name) and term.owner.name in map.objects
            if value_of(term.owner.name, term.path, map, ontology) is None
        ]
        finders = {str(term): text for term in unknown if (text := self._who_finds_out(Comparison(term, "=", Variable("value"))))}
        for name, text in finders.items():
            self.reasons.note_missing(name)
            self.reasons.obstacles.add(Obstacle.UNKNOWN)
            self.reasons.say(f"{name} is not known{text}")
        return bool(finders)

    def _who_finds_out(self, literal: Literal) -> str:
        """Text for the services that could find out the literal; empty if there are none."""
        services = {offer.service_type.name: offer.service_type for offer in self.problem.services}
        finders = [
            name
            for name, service in {**self.problem.ontology.services, **services}.items()
            if service.kind is not ServiceKind.PHYSICAL and can_achieve(service, literal, self.problem.ontology, self.problem.map)
        ]
        if not finders:
            return ""
        offered = [name for name in finders if self.world.providers.get(name)]
        if not offered:
            self.reasons.note_unoffered(finders)
            return f"; {' or '.join(finders)}, which {self._not_offered(finders)}, could find it out"
        uses = [use for name in offered for _, use in self.problem.fruitless if use.startswith(f"{name}(")]
        in_vain = sorted({device for device, use in self.problem.fruitless if use in uses and names(literal)[0] in use})
        if in_vain:
            about = [loss for loss in self.problem.rejected if loss.service_type.name in offered and names(literal)[0] in loss.reason]
            return f"; {' and '.join(in_vain)} could not find it out{rejection_text(about)}"
        return f", and {' and '.join(offered)} cannot find it out now"

    def _unknown_objects(self, literal: Literal) -> bool:
        unknown = [name for name in self._objects(literal) if name not in self.problem.map.objects]
        for name in unknown:
            self.reasons.obstacles.add(Obstacle.NO_OBJECT)
            hint = nearest(name, self.problem.map.similar_names(name))
            self.reasons.say(f"{literal}: {absence_text(name, self.problem.map)}" + (f"; {hint}" if hint else ""))
        excluded_names = [name for name in names(literal) if name in self.problem.excluded]
        if excluded_names:
            self.reasons.obstacles.update(exclusion_obstacles(excluded_names, self.problem))
            unknown_names = [name for name in excluded_names if name in self.problem.unknown]
            finders = "".join(
                dict.fromkeys(self._who_finds_out(Comparison(Attribute(Name(name), UNKNOWN), "=", Truth(False))) for name in unknown_names)
            )
            self.reasons.say(f"{literal}: {exclusion_text(excluded_names, self.problem)}{finders}")
        return bool(unknown or excluded_names)

    def _objects(self, literal: Literal) -> Iterator[str]:
        """The names of objects in the literal, without values of enumerations."""
        words = {value for attribute in self.problem.ontology.attributes.values() for value in attribute.values}
        return (name for name in names(literal) if name not in words or name in self.problem.map.objects)

    def _explain_named_provider(self, literal: Literal, offered: Iterable[ServiceType]) -> bool:
        """Explain why the device that the literal names does not do what others offer. Returns whether there is such a device."""
        texts: list[str] = []
        for service in offered:
            matching = (match.get(PROVIDER) for match in self._matches(service, literal))
            providers = [*dict.fromkeys(provider.name for provider in matching if isinstance(provider, Name))]
            concerned = [loss for loss in self.problem.lost if loss.service in {f"{name}.{service.name}" for name in providers}]
            excluded_names = [name for name in providers if name in self.problem.excluded]
            if excluded_names:
                self.reasons.obstacles.update(exclusion_obstacles(excluded_names, self.problem))
                texts.append(f"{service.name}, but {exclusion_text(excluded_names, self.problem)}")
            elif concerned:
                self.reasons.note_lost(loss.service for loss in concerned)
                texts.append(f"{service.name}, but no service is left ({losses_text(concerned)})")
            elif providers:
                self.reasons.note_unoffered([service.name])
                resting = [loss for loss in self.problem.resting if loss.service in {f"{name}.{service.name}" for name in providers}]
                texts.append(f"{service.name}, which {' and '.join(providers)} does not offer now{resting_text(resting)}")
        for text in texts:
            self.reasons.say(f"{_format_literal(literal)} could be brought about by {text}")
        return bool(texts)

    def _explain_no_provider(self, literal: Literal, offered: Mapping[str, ServiceType]) -> None:
        service_types = self._known_service_types()
        fitting = {name: service for name, service in service_types.items() if name not in offered and self._could_help(service, literal)}
        conceivable = self._conceivable
        hindrances = {name: conceivable.hindrance(service, literal) for name, service in fitting.items()}
        capable = {name: service for name, service in fitting.items() if hindrances[name] is None}
        absent = [name for name, service in capable.items() if self._applies_now(service, literal)] or [*capable]
        busy = {
            offer.service_type.name: offer.providers
            for offer in self.problem.services
            if offer.service_type.name in absent and offer.providers
        }
        lost = {name: [loss for loss in self.problem.lost if loss.service_type.name == name] for name in absent if name not in busy}
        for name, providers in busy.items():
            self.reasons.obstacles.update(exclusion_obstacles(providers, self.problem))
            cause = exclusion_text(providers, self.problem)
            self.reasons.say(f"{_format_literal(literal)} could be brought about by {name}, but {cause}")
        for name, services in lost.items():
            if services:
                self.reasons.note_lost(loss.service for loss in services)
                self.reasons.say(
                    f"{_format_literal(literal)} could be brought about by {name}, but no service is left ({losses_text(services)})"
                )
        if unoffered_names := [name for name, services in lost.items() if not services]:
            self.reasons.note_unoffered(unoffered_names)
            text = f"{' or '.join(unoffered_names)}, which {self._not_offered(unoffered_names)}"
            self.reasons.say(f"{_format_literal(literal)} could be brought about by {text}")
        if not absent and not self._explain_unknown_values(literal) and not self._explain_named_provider(literal, offered.values()):
            lacking = {name: hindrance for name, hindrance in hindrances.items() if hindrance is not None}
            self._explain_no_service_type(literal, service_types.values(), lacking)

    def _not_offered(self, service_types: Sequence[str]) -> str:
        return f"no device offers now{resting_text(loss for loss in self.problem.resting if loss.service_type.name in service_types)}"

    def _explain_no_service_type(self, literal: Literal, service_types: Iterable[ServiceType], hindrances: Mapping[str, Hindrance]) -> None:
        self.reasons.obstacles.add(Obstacle.NO_SERVICE_TYPE)
        self.reasons.note_missing(*([hindrance.condition for hindrance in hindrances.values()] or [_format_literal(literal)]))
        map, ontology = self.problem.map, self.problem.ontology
        unfit = (misfit for service in service_types for misfit in misfits(service, literal, ontology, map))
        reason = hindrance_text(hindrances) if hindrances else next(unfit, present_value(literal, ontology, map))
        reason = f": {reason}" if reason else ""
        self.reasons.say(f"{_format_literal(literal)} does not hold on the map, and no service type brings it about{reason}")

    def _known_service_types(self) -> dict[str, ServiceType]:
        """The service types of the ontology, and those that are or were on offer."""
        lost = {loss.service_type.name: loss.service_type for loss in (*self.problem.lost, *self.problem.resting)}
        offered = {available.service_type.name: available.service_type for available in self.problem.services}
        return {**self.problem.ontology.services, **lost, **offered}

    def _applies_now(self, service: ServiceType, literal: Literal) -> bool:
        """Whether the map meets the precondition with which the service would achieve the literal: nothing has to be prepared."""
        if service.start_condition is None:
            return True
        precondition, map, ontology = parse(service.start_condition), self.problem.map, self.problem.ontology
        substitutions = (
            {name: term for name, term in unifier.items() if not isinstance(term, Variable)}
            for unifier in achieving_bindings(service, literal, ontology, map)
        )
        return any(
            next(bindings(substitute(precondition, substitution), map, ontology), None) is not None for substitution in substitutions
        )

    def _explain_lacking(self, available: AvailableService, literal: Literal, depth: int) -> None:
        """Explain which preconditions of the service are unreachable."""
        service = available.service_type
        if inputs := undetermined_inputs(service):
            text = f"nothing says which value its input {' and '.join(f'?{name}' for name in inputs)} has"
            self.reasons.say(f"{service.name} could bring about {_format_literal(literal)}, but {text}")
            return
        unifier = next(achieving_bindings(service, literal, self.problem.ontology, self.problem.map), {})
        substitution = {name: term for name, term in unifier.items() if not isinstance(term, Variable)}
        substitution.setdefault(PROVIDER, Name(self.world.providers[service.name][0]))
        attainable: list[Literal] = []
        lacking: list[Literal] = []
        precondition = substitute(parse(service.start_condition), substitution) if service.start_condition is not None else None
        parts = [part for part in next(alternatives(precondition)) if isinstance(part, Literal)] if precondition is not None else []
        for part in parts:
            (lacking if is_impossible([*attainable, part], self.world, self.tries) else attainable).append(part)
        row = self._row(attainable)
        for part in lacking:
            if attainable and self.reachable([*attainable, part]):
                self._explain_conflict(service.name, literal, find_minimal_conflict([*attainable, part], self.world, self.tries))
                continue
            missing = substitute(part, row)
            assert isinstance(missing, Literal), "variables of a literal were replaced"
            circular = _format_literal(missing) in (_format_literal(literal), *self.reasons.missing)
            self.reasons.note_missing(_format_literal(missing))
            if not circular or depth == DEPTH:
                need = f"{_format_literal(missing)}{self._describe_current(missing)}"
                self.reasons.say(f"{service.name} could bring about {_format_literal(literal)}, but needs {need}")
            if depth > 0 and not circular:
                self._explain(missing, depth - 1)
        if not lacking and self.tries.left:
            self.reasons.say(f"{service.name} has such effects, but not {_format_literal(literal)}")
        elif not lacking:
            self.reasons.say(
                f"{service.name} could bring about {_format_literal(literal)}, but not here: it would take too long to find out why"
            )

    def _row(self, attainable: Sequence[Literal]) -> Substitution:
        """Values on the map for the variables of the parts, as far as relations bind them."""
        bound_variables = {name for part in attainable if isinstance(part, Relation) for name in variables(part)}
        parts = [part for part in attainable if bound_variables.issuperset(variables(part))]
        return next(bindings(conjunction(*parts), self.problem.map, self.problem.ontology), {}) if parts else {}

    def _explain_conflict(self, service: str, literal: Literal, parts: Sequence[Literal]) -> None:
        """Explain that the preconditions of the service are reachable one by one, but conflict with each other."""
        conflict_text = str(conjunction(*parts)).replace(" AND ", " and ")
        self.reasons.note_missing(conflict_text)
        self.reasons.say(
            f"{service} could bring about {_format_literal(literal)}, but needs {conflict_text}, and no order of services leads to that"
        )

    def _describe_current(self, literal: Literal) -> str:
        """Text for the facts that hold on the map instead of the required relation."""
        if not isinstance(literal, Relation) or not isinstance(literal.arguments[0], Name):
            return ""
        name, relation_type = literal.arguments[0].name, self.problem.ontology.relations.get(literal.relation)
        group = [
            r.name
            for r in self.problem.ontology.relations.values()
            if relation_type and r.excludes and r.excludes == relation_type.excludes
        ]
        current_facts = [str(fact) for fact in self.problem.map.facts_about(name) if fact.relation in group and fact.arguments[0] == name]
        if current_facts:
            return f", and the map says {' and '.join(current_facts)}"
        return f", and the map does not say where {name} is" if group else ""


def _format_literal(literal: Literal) -> str:
    return str(blank_variables(literal))
