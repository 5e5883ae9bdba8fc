"""Plans for a client that asks what is so (paper, "Services": cognitive services recognise situations that formulas describe).

Such a plan consists of observations, in no order. Nothing is moved for it: a cognitive service takes part only if its precondition holds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import islice, product

from msgspec import structs

from somrs.entish import Attribute, Comparison, Name, Relation, Term, Variable
from somrs.entish.formula import Atom, Not, conjuncts, literals, substitute, variables
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.ontology.map import Map
from somrs.ontology.matching import types_of, unifiers
from somrs.ontology.services import PROVIDER, ServiceKind, ServiceType
from somrs.ontology.truth import bindings
from somrs.ontology.types import UNKNOWN, Ontology
from somrs.planner.losses import resting_text
from somrs.planner.model.plan import NoPlan, Obstacle, Plan, Step, describe_use
from somrs.planner.model.problem import AvailableService, Problem, rejection_text
from somrs.planner.model.reading import looked_for_in, outputs_in_effect

MOST_OBSERVATIONS = 50
"""The maximum number of observations for one question."""


def plan_recognition(problem: Problem) -> Plan | NoPlan:
    """The observations that answer the question `problem.goal`, without those that were made already (`problem.observed`).

    For each part of the question, it is the service type on offer that can tell most about it: one that also finds objects that nobody
    has named, then one whose effect speaks of just this part, then one that finds out the place and state of each object concerned.
    """
    steps: dict[str, Step] = {}
    planner = _Recognition(problem)
    for atom in planner.atoms:
        steps.update({step.use: step for step in planner.observations(atom)})
    new_steps = [step for use, step in steps.items() if use not in problem.observed]
    if not new_steps and not problem.observed:
        return planner.no_plan()
    return Plan(tuple(structs.replace(step, id=f"step{n}") for n, step in enumerate(islice(new_steps, MOST_OBSERVATIONS), 1)))


class _Recognition:
    """Finds observations for the parts of one question."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.map, self.ontology = problem, problem.map, problem.ontology
        self._offers = [offer for offer in problem.services if offer.service_type.kind is ServiceKind.COGNITIVE and offer.providers]
        self._candidates: dict[str, list[str]] = {}
        parts = literals(problem.goal)
        self.atoms = [*dict.fromkeys(part.atom if isinstance(part, Not) else part for part in parts)]
        """The parts of the question."""

    def observations(self, atom: Atom) -> list[Step]:
        """The observations that tell about one part of the question."""
        ranked = sorted(self._offers, key=lambda offer: _rank(offer.service_type, atom, self.ontology))
        for offer in ranked:
            steps = {step.use: step for step in self._uses(offer, atom)}
            if steps:
                return [*steps.values()]
        return []

    def no_plan(self) -> NoPlan:
        """Why nobody can be asked."""
        types = {**self.ontology.services, **{offer.service_type.name: offer.service_type for offer in self._offers}}
        able = [
            name
            for name, service in types.items()
            if service.kind is ServiceKind.COGNITIVE and any(_speaks_of(service, part, self.ontology) for part in self.atoms)
        ]
        offered = {offer.service_type.name for offer in self._offers}
        absent = tuple(name for name in able if name not in offered)
        in_vain = sorted({device for device, _ in self.problem.fruitless})
        if in_vain:
            absent = ()  # they have looked; whoever else could look is not waited for
            text = f"{' and '.join(in_vain)} looked, and found nothing{rejection_text(self.problem.rejected)}"
        elif absent and len(absent) == len(able):
            resting = resting_text(loss for loss in self.problem.resting if loss.service_type.name in absent)
            text = f"nobody can look: no device offers {' or '.join(absent)} now{resting}"
        elif able:
            text = f"nobody can look now: {' and '.join(able)} need other circumstances, or there is no object to look at"
        else:
            text = "no cognitive service type tells about this"
        obstacle = Obstacle.NOT_OFFERED if able else Obstacle.NO_SERVICE_TYPE
        return NoPlan(explanation=f"{self.problem.goal}: {text}", unoffered=absent, obstacles=(obstacle,))

    def _uses(self, offer: AvailableService, atom: Atom) -> Iterator[Step]:
        service = offer.service_type
        for unifier in _unifiers(service, atom, self.ontology, self.map):
            choices = [self._values(parameter.name, parameter.type, unifier) for parameter in service.inputs]
            for values in product(*choices):
                step = self._step(offer, {parameter.name: value for parameter, value in zip(service.inputs, values, strict=True)})
                if step is not None:
                    yield step

    def _values(self, name: str, type: str, unifier: Mapping[str, Term]) -> list[Term]:
        """The values to try for an input: the one that the question gives, or objects that may be an answer."""
        term = unifier.get(name)
        if term is None or isinstance(term, Variable):
            variable = term.name if isinstance(term, Variable) else None
            return [Name(object) for object in self._objects(variable, type)]
        fits = not isinstance(term, Name) or self._is_of_type(term.name, type)
        return [term] if fits else []

    def _objects(self, variable: str | None, type: str) -> Iterator[str]:
        """The objects that are an answer according to the map, then those of which nothing is known."""
        answers = self._answers(variable) if variable is not None else []
        return (name for name in dict.fromkeys([*answers, *self._unknown()]) if self._is_of_type(name, type))

    def _answers(self, variable: str) -> list[str]:
        if variable not in self._candidates:
            rows = islice(bindings(self.problem.goal, self.map, self.ontology), MOST_OBSERVATIONS)
            terms = (row.get(variable) for row in rows)
            self._candidates[variable] = [*dict.fromkeys(term.name for term in terms if isinstance(term, Name))]
        return self._candidates[variable]

    def _unknown(self) -> Iterable[str]:
        return sorted(self.map.with_value(UNKNOWN, True))

    def _is_of_type(self, name: str, type: str) -> bool:
        return name in self.map.objects and self.ontology.is_subtype(self.map.objects[name].type, type)

    def _step(self, offer: AvailableService, inputs: dict[str, Term]) -> Step | None:
        """The use of a service that can be asked now: its precondition holds, and some device has not told nothing."""
        service = offer.service_type
        use = describe_use(service.name, inputs)
        tireless = (device for device in offer.providers if (device, use) not in self.problem.fruitless)
        devices = [device for device in tireless if self._can(service, device, inputs)]
        if not devices:
            return None
        effect = parse(service.effect)
        formulas = [effect, *([parse(service.start_condition)] if service.start_condition is not None else [])]
        is_bound = any(PROVIDER in variables(formula) for formula in formulas)
        bound_to = {PROVIDER: Name(devices[0])} if is_bound else {}
        return Step(
            id=use,
            service_type=service.name,
            inputs=inputs,
            effect=substitute(effect, {**inputs, **bound_to}),
            provider=devices[0] if is_bound else None,
            device_group=use if is_bound else None,
            alternative_providers=tuple(devices[1:]) if is_bound else (),
            kind=service.kind,
        )

    def _can(self, service: ServiceType, device: str, inputs: dict[str, Term]) -> bool:
        if service.start_condition is None:
            return True
        condition = substitute(parse(service.start_condition), {**inputs, PROVIDER: Name(device)})
        try:
            return next(bindings(condition, self.map, self.ontology), None) is not None
        except FormulaError:  # a device that is not on the map
            return False


def _unifiers(service: ServiceType, atom: Atom, ontology: Ontology, map: Map | None) -> Iterator[Mapping[str, Term]]:
    """The bindings with which the effect of the service speaks of the atom."""
    types = types_of(service, ontology)
    effect = parse(service.effect)
    yield from unifiers(effect, atom, ontology, types, map)
    for part in conjuncts(effect):
        owner = looked_for_in(part)
        if isinstance(owner, Variable):
            yield from ({owner.name: subject} for subject in _subjects(atom))


def _subjects(atom: Atom) -> Iterator[Name | Variable]:
    """The objects that an atom is about: the first argument of a relation, the objects whose attributes are compared."""
    match atom:
        case Relation(_, arguments):
            yield arguments[0]
        case Comparison(left_term, _, right_term):
            yield from (term.owner for term in (left_term, right_term) if isinstance(term, Attribute))


def _speaks_of(service: ServiceType, atom: Atom, ontology: Ontology) -> bool:
    return next(_unifiers(service, atom, ontology, None), None) is not None


def _rank(service: ServiceType, atom: Atom, ontology: Ontology) -> tuple[int, str]:
    """The order in which service types are asked about an atom: those that find the objects that the question leaves open; those that the
    question gives all inputs; those that find out the place and state of an object; those whose inputs have to be guessed."""
    exact = next(unifiers(parse(service.effect), atom, ontology, types_of(service, ontology)), None)
    if exact is None:
        return 2, service.name
    if any(isinstance(exact.get(name), Variable) for name in outputs_in_effect(service)):
        return 0, service.name
    is_given = all(not isinstance(exact.get(parameter.name), Variable | None) for parameter in service.inputs)
    return 1 if is_given else 3, service.name
