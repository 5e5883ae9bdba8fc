"""Converts a PDDL domain and problem to an ontology, a map, service types, devices and a task."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from somrs.entish import Formula, Name, Number
from somrs.entish.formula import substitute_term
from somrs.entish.parse import parse_term
from somrs.errors import UsageError
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.schema import RESERVED
from somrs.ontology.services import PROVIDER, ServiceType
from somrs.ontology.types import ABSTRACT, PART_OF, AttributeType, Definition, FunctionType, Kind, ObjectType, Ontology, RelationType, Value
from somrs.ontology.values import measure
from somrs.planner.model.plan import Step
from somrs.planner.model.problem import AvailableService, Problem
from somrs.sites.pddl.actions import Actions, Offer
from somrs.sites.pddl.effects import changed_predicates
from somrs.sites.pddl.formulas import FormulaReader, SymbolTable
from somrs.sites.pddl.kinds import DEVICE, DRIVER, Kinds
from somrs.sites.pddl.names import Names
from somrs.sites.pddl.syntax import Domain, Signature, Task, Typed
from somrs.sites.pddl.text import Group, Node, Word, number, raise_all

WORLD = "World"
"""The root of the map. It is also the argument of predicates and functions without parameters."""
AGENT = "Agent"
"""The type of the single device when the domain names no agents."""


@dataclass(frozen=True, kw_only=True)
class ImportedProblem:
    """A domain and a problem in terms of SO-MRS.

    `agents` are the devices on the map, each with the service types that it offers. `notes` tell people what was left out.
    """

    name: str
    ontology: Ontology
    map: Map
    goal: Formula
    services: tuple[ServiceType, ...]
    agents: Mapping[str, tuple[ServiceType, ...]]
    notes: tuple[str, ...]
    _offers: Mapping[str, Offer]
    _objects: Names

    @property
    def task(self) -> str:
        """The goal as text, for `somrs do`."""
        return str(self.goal)

    def problem(self) -> Problem:
        """The problem for the planner, with every agent available."""
        return Problem(ontology=self.ontology, map=self.map, goal=self.goal, services=self._available)

    @cached_property
    def _available(self) -> tuple[AvailableService, ...]:
        """Every service type, with the agents that offer it."""
        providers: dict[str, list[str]] = {service.name: [] for service in self.services}
        for agent, offered in self.agents.items():
            for service in offered:
                providers[service.name].append(agent)
        return tuple(AvailableService(service, tuple(providers[service.name])) for service in self.services)

    def price(self, service: str, inputs: Mapping[str, str], agent: str) -> float:
        """The cost of a service with these inputs (names of objects) by the agent; 1 when the problem has no costs."""
        return self.cost(
            Step(id="", service_type=service, inputs={k: Name(v) for k, v in inputs.items()}, effect=self.goal, provider=agent)
        )

    def cost(self, step: Step) -> float:
        """The cost of the step; 1 when the problem has no costs. Raises UsageError if the problem does not define it."""
        cost = self._offers[step.service_type].service.cost
        if cost is None:
            return 1.0
        measured = measure(parse_term(cost), self.map, self.ontology, step.bindings)
        if measured is None or not isinstance(measured.constant, Number):
            raise UsageError(f"the problem does not say what {step} costs: {cost} has no value; give one in its :init")
        return measured.constant.value

    def pddl_name(self, object: str) -> str:
        """The PDDL name of an object of the map."""
        return self._objects.pddl(object)

    def pddl_step(self, step: Step) -> str:
        """A step in PDDL, with the agent first: `(drive driver1 truck1 depot0 depot1)`.

        A step without a provider gets the first agent that offers the service.
        """
        offer = self._offers[step.service_type]
        provider = step.provider
        if provider is None:
            provider = next(agent for agent, offered in self.agents.items() if offer.service in offered)
        bound = {**step.inputs, PROVIDER: Name(provider)}
        arguments = [substitute_term(term, bound) for term in offer.arguments]
        return f"({' '.join([offer.action, *(self.pddl_name(term.name) for term in arguments if isinstance(term, Name))])})"

    def pddl_plan(self, steps: Iterable[Step]) -> str:
        """The steps as a PDDL plan file for validators: one step a line, in the given order."""
        return "".join(f"{self.pddl_step(step)}\n" for step in steps)


def build(domain: Domain, task: Task) -> ImportedProblem:
    """The imported problem. Raises ModelError with all mistakes and unsupported features of the files."""
    raise_all(domain.mistakes, task.mistakes)  # the next steps look names up
    return _ProblemBuilder(domain, task).imported()


class _ProblemBuilder:
    def __init__(self, domain: Domain, task: Task) -> None:
        self.domain, self.task = domain, task
        base = upper()
        things = {**task.objects, **domain.constants}
        for name, thing in task.objects.items():
            if name in domain.constants and domain.constants[name].types != thing.types:
                task.mistakes.note(
                    thing.word, thing.written, "duplicate", "is a constant of another type in the domain; keep one of the two"
                )
        things = {name: _with_one_type(thing, domain) for name, thing in things.items()}
        relations, types, attributes, functions = Names(base.relations), Names(base.types), Names([*base.attributes, *RESERVED]), Names()
        self._function_names = Names(base.functions)
        for signature in domain.predicates.values():
            relations.add(signature.word.text, signature.word.written)
        for signature in domain.functions.values():
            is_attribute = len(signature.parameters) < 2
            (attributes if is_attribute else functions).add(signature.word.text, self._function_names.fresh(signature.word.written))
        self.objects = Names()
        for name, thing in things.items():
            self.objects.add(name, thing.written)
        self.things = things
        self.world = self.objects.fresh(WORLD)
        self.kinds = Kinds(domain, things.values(), types, relations)
        self._world_type = types.fresh(WORLD)
        self.cost, self.notes = _metric(task, domain)
        self.facts: dict[Fact, None] = {}
        self.symbols = SymbolTable(
            domain=domain,
            kinds=self.kinds,
            objects=self.objects,
            relations=relations,
            attributes=attributes,
            functions=functions,
            types={name: thing.types[0] for name, thing in things.items()},
            world=self.world,
            cost=self.cost,
            facts=self.facts.keys(),
            changing=frozenset(relations.entish(name) for name in changed_predicates(domain)),
        )
        self.values: dict[str, dict[str, Value]] = {}
        self.tables: dict[str, dict[str, float]] = {}
        self._agent_type = types.fresh(AGENT)

    def imported(self) -> ImportedProblem:
        reader = FormulaReader(self.symbols, self.task.mistakes, "init", {})
        for node in self.task.init:
            self._initial(node, reader)
        map = self._map()
        offers = [*Actions(self.symbols, map, self.cost is not None).make_offers()]
        goal = self._goal()
        raise_all(self.domain.mistakes, self.task.mistakes)
        assert goal is not None
        services = tuple(offer.service for offer in offers)
        agents, lone_agent = self._agents(offers)
        map = Map(
            [*self._objects(), *([Object(name=lone_agent, type=self._agent_type)] if lone_agent is not None else [])],
            [*self._all_facts(), *([Fact(PART_OF, (lone_agent, self.world))] if lone_agent is not None else [])],
        )
        if self.domain.name.lower() != self.task.domain.lower():
            self.notes.append(f"the problem names the domain {self.task.domain}, and the domain's name is {self.domain.name}")
        return ImportedProblem(
            name=self.task.name or self.domain.name,
            ontology=upper().extended([*self._definitions(lone_agent is not None), *services]),
            map=map,
            goal=goal,
            services=services,
            agents=agents,
            notes=tuple(self.notes),
            _offers={offer.service.name: offer for offer in offers},
            _objects=self.objects,
        )

    # The map

    def _initial(self, node: Node, reader: FormulaReader) -> None:
        if not isinstance(node, Group) or not node.head:
            reader.mistakes.note(node, "init", "syntax", f"{str(node)[:60]} is not a fact; a fact is a group: (at truck1 depot)")
        elif node.head == "not":
            pass  # facts that are not stated do not hold
        elif node.head == "=" and len(node.items) == 3:
            self._value(node, reader)
        elif node.head == "at" and len(node.items) == 3 and number(node.items[1]) is not None:
            reader.mistakes.unsupported(node, "init", "timed initial facts are not supported")
        elif (atom := reader.atom(node)) is not None:
            self.facts[Fact(atom.relation, tuple(argument.name for argument in atom.arguments))] = None

    def _value(self, node: Group, reader: FormulaReader) -> None:
        target, value = node.items[1], number(node.items[2])
        if value is None or not isinstance(target, Group):
            reader.mistakes.note(node, "init", "syntax", f"{node} gives no value; write (= (function object) number)")
            return
        if target.head == self.cost or (target.head == "total-cost" and len(target.items) == 1):
            return  # the initial value of the cost does not matter
        arguments = tuple(item.text for item in target.items[1:] if not isinstance(item, Group))
        if reader.number(target) is None:
            return
        names = [self.objects.entish(name) for name in arguments]
        if len(names) > 1:
            self.tables.setdefault(target.head, {})[" ".join(names)] = value
        else:
            self.values.setdefault(names[0] if names else self.world, {})[self.symbols.attributes.entish(target.head)] = value

    def _map(self) -> Map:
        return Map(self._objects(), self._all_facts())

    def _objects(self) -> Iterator[Object]:
        yield Object(name=self.world, type=self._world_type, values={"Label": self.task.name, **self.values.get(self.world, {})})
        for name, thing in self.things.items():
            entish_name = self.objects.entish(name)
            label: dict[str, Value] = {"Label": thing.written} if entish_name != thing.written else {}
            yield Object(
                name=entish_name, type=self.kinds.names.entish(thing.types[0]), values={**label, **self.values.get(entish_name, {})}
            )

    def _all_facts(self) -> Iterator[Fact]:
        yield from (Fact(PART_OF, (self.objects.entish(name), self.world)) for name in self.things)
        yield from self.facts
        for relation, sorts in self.kinds.picked.items():
            for name, thing in self.things.items():
                if thing.types[0] in sorts:
                    yield Fact(relation, (self.objects.entish(name),))

    # The ontology

    def _definitions(self, has_lone_agent: bool) -> Iterator[Definition]:
        attributes: dict[str, list[str]] = {}
        for name, signature in self.domain.functions.items():
            if name != self.cost and len(signature.parameters) < 2:
                attribute = self.symbols.attributes.entish(name)
                yield AttributeType(name=attribute, kind=Kind.NUMBER)
                for type_name in self.kinds.covering(signature.parameters[0]) if signature.parameters else [self._world_type]:
                    attributes.setdefault(type_name, []).append(attribute)
        for name, signature in self.domain.predicates.items():
            yield RelationType(name=self.symbols.relations.entish(name), joins=self._joins(signature.parameters) or (self._world_type,))
        for relation in self.kinds.picked:
            yield RelationType(name=relation, joins=(self.kinds.of_picked(relation),), doc="Selects the objects to which an action applies")
        for name, signature in self.domain.functions.items():
            if len(signature.parameters) > 1:
                yield self._table(name, signature)
        yield ObjectType(name=self._world_type, parent=ABSTRACT, attributes=tuple(attributes.get(self._world_type, ())))
        yield from self.kinds.definitions(attributes)
        if has_lone_agent:
            yield ObjectType(name=self._agent_type, parent=DEVICE, driver=DRIVER, doc="Offers all actions of the domain")

    def _joins(self, parameters: tuple[Typed, ...]) -> tuple[str, ...]:
        return tuple(self.kinds.joined(parameter) for parameter in parameters)

    def _table(self, name: str, signature: Signature) -> FunctionType:
        values = self.tables.get(name, {})
        return FunctionType(name=self.symbols.functions.entish(name), parameters=self._joins(signature.parameters), values=values)

    # Agents and the goal

    def _agents(self, offers: list[Offer]) -> tuple[dict[str, tuple[ServiceType, ...]], str | None]:
        """The devices with their service types, and the name of the single device that is added when the domain names no agents."""
        named = frozenset[str]().union(*(offer.agents for offer in offers if offer.agents is not None))
        if not named:
            lone_agent = self.objects.fresh(f"{AGENT}1")
            return {lone_agent: tuple(offer.service for offer in offers)}, lone_agent
        agents: dict[str, tuple[ServiceType, ...]] = {}
        for name, thing in self.things.items():
            if thing.types[0] in named:
                able = (offer for offer in offers if offer.agents is None or thing.types[0] in offer.agents)
                agents[self.objects.entish(name)] = tuple(offer.service for offer in able)
        return agents, None

    def _goal(self) -> Formula | None:
        assert self.task.goal is not None
        reader = FormulaReader(self.symbols, self.task.mistakes, "goal", {})
        goal = reader.condition(self.task.goal)
        if goal is None and not self.task.mistakes.problems:
            self.task.mistakes.note(self.task.goal, "goal", "goal", "this goal is empty; write a condition in it")
        return goal


def _with_one_type(thing: Typed, domain: Domain) -> Typed:
    """The object with a single type: if it is declared as `either` of several, with a new type below them, so it can be used as any."""
    if len(thing.types) < 2:
        return thing
    name = "-and-".join(thing.types)
    domain.parents.setdefault(name, thing.types)
    domain.types.setdefault(name, Word(name, name, thing.word.line))
    return Typed(word=thing.word, types=(name,))


def _metric(task: Task, domain: Domain) -> tuple[str | None, list[str]]:
    """The function that the plan should minimise, and notes."""
    if task.metric is None:
        return None, []
    match task.metric.items[1:]:
        case (way, Group(items)) if str(way).lower() == "minimize" and len(items) == 1:
            name = task.metric.items[2].head if isinstance(task.metric.items[2], Group) else ""
            if name in domain.functions and not domain.functions[name].parameters:
                return name, []
            if name == "total-time":
                return None, ["the metric total-time is ignored; the system minimises the duration anyway"]
    message = (
        f"a metric {' '.join(map(str, task.metric.items[1:]))} is not supported; only one function without parameters can be minimised"
    )
    task.mistakes.unsupported(task.metric, "metric", message)
    return None, []
