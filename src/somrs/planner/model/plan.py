"""Abstract plans: service types with their inputs, and the causal links between them (paper, "SO-MRS architecture": Planner).

An abstract plan is a directed acyclic graph. `planning.py` finds plans.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import cached_property
from heapq import heappop, heappush

from msgspec import Struct, field

from somrs.entish import Formula, Name, Term
from somrs.entish.formula import Substitution
from somrs.ontology.services import PROVIDER, ServiceKind


class Step(Struct, frozen=True):
    """A step of a plan: a service type with its inputs, by input name.

    `provider` is the device that has to execute the step, if the service type's formulas use `?Provider`; None means any provider. One of
    the `alternative_providers` can take its place, if it executes all steps of the same `device_group`. `precondition` and `effect` are
    without variables, but for outputs. `kind` is the kind of the service type. `condition` is the part of the precondition that the
    services `demanded_by` stated for this step.

    What a step tells is known when it is done: what a cognitive service finds out, and what the outputs of a service are. `finds` are the
    objects that are known only from then on, `assumed` the facts that the plan assumes."""

    id: str
    service_type: str
    inputs: dict[str, Term]
    effect: Formula
    precondition: Formula | None = None
    provider: str | None = None
    device_group: str | None = field(default=None, name="same")
    alternative_providers: tuple[str, ...] = field(default=(), name="alike")
    kind: ServiceKind = ServiceKind.PHYSICAL
    assumed: Formula | None = None
    finds: tuple[str, ...] = ()
    condition: Formula | None = None
    demanded_by: tuple[str, ...] = ()

    @property
    def tells(self) -> bool:
        """Whether the result of the step is known only when it is done."""
        return self.kind is not ServiceKind.PHYSICAL or self.assumed is not None or bool(self.finds)

    @property
    def outcome(self) -> Formula | None:
        """What holds after the step, as far as the plan knows or assumes it."""
        return self.assumed if self.tells else self.effect

    @property
    def use(self) -> str:
        """What is asked of a service, whichever device does it."""
        return describe_use(self.service_type, self.inputs)

    @property
    def bindings(self) -> Substitution:
        """The inputs and the provider, if there is one: the substitution for the service type's formulas."""
        return self.inputs if self.provider is None else {**self.inputs, PROVIDER: Name(self.provider)}

    def __str__(self) -> str:
        devices = " or ".join((self.provider, *self.alternative_providers)) if self.provider is not None else ""
        return self.use + (f" by {devices}" if devices else "")


def describe_use(service_type: str, inputs: Mapping[str, Term]) -> str:
    """A service type with its inputs: `TransferObject(Object: Jar1, Destination: Table1)`."""
    return f"{service_type}({', '.join(f'{name}: {term}' for name, term in inputs.items())})"


class Link(Struct, frozen=True):
    """An order of two steps: `after` starts when `before` has ended. A causal link: `before` makes `fact` true for `after`. If
    `is_protection`: the other order could undo `fact` where a step needs it."""

    before: str
    after: str
    fact: str
    is_protection: bool = field(default=False, name="keeps")


class Plan(Struct, frozen=True, dict=True, tag=True):
    """An abstract plan: the steps in an order in which they can be executed one by one, and the links with the required order."""

    steps: tuple[Step, ...] = ()
    links: tuple[Link, ...] = ()
    alternatives: tuple[Plan, ...] = ()
    """Other plans for the same problem, which use other service types."""
    doubts: tuple[str, ...] = ()
    """Without steps: the problems of devices that the goal is about. What the map says of them may be old."""

    @cached_property
    def _by_id(self) -> Mapping[str, Step]:
        return {step.id: step for step in self.steps}

    @cached_property
    def _incoming_links(self) -> Mapping[str, list[Link]]:
        links_by_step: dict[str, list[Link]] = {}
        for link in self.links:
            links_by_step.setdefault(link.after, []).append(link)
        return links_by_step

    @cached_property
    def _outgoing_links(self) -> Mapping[str, list[Link]]:
        links_by_step: dict[str, list[Link]] = {}
        for link in self.links:
            links_by_step.setdefault(link.before, []).append(link)
        return links_by_step

    def step(self, id: str) -> Step:
        return self._by_id[id]

    def links_to(self, id: str) -> Sequence[Link]:
        """The links from the steps that have to end before this step."""
        return self._incoming_links.get(id, ())

    def predecessors(self, id: str) -> tuple[str, ...]:
        """The ids of the steps that are linked directly before this step."""
        return tuple(dict.fromkeys(link.before for link in self._incoming_links.get(id, ())))

    def successors(self, id: str) -> tuple[str, ...]:
        """The ids of the steps that are linked directly after this step."""
        return tuple(dict.fromkeys(link.after for link in self._outgoing_links.get(id, ())))

    @cached_property
    def certain_part(self) -> Plan:
        """The part to execute before the rest can be planned with what is known then: the first steps that tell something, and those that
        enable them. The plan itself, if no step tells anything."""
        if not any(step.tells for step in self.steps):
            return self
        before: dict[str, frozenset[str]] = {}
        for step in self.topological():
            before[step.id] = frozenset(self.predecessors(step.id)).union(*(before[id] for id in self.predecessors(step.id)))
        telling = {step.id for step in self.steps if step.tells}
        kept = frozenset[str]().union(*(before[id] | {id} for id in telling if before[id].isdisjoint(telling)))
        return Plan(
            tuple(step for step in self.steps if step.id in kept),
            tuple(link for link in self.links if link.before in kept and link.after in kept),
        )

    def topological(self) -> tuple[Step, ...]:
        """The steps in topological order; unordered steps keep the plan's order. Raises ValueError if the links have a cycle."""
        place = {step.id: number for number, step in enumerate(self.steps)}
        waits_for = {step.id: len(self.predecessors(step.id)) for step in self.steps}
        ready = [place[id] for id, count in waits_for.items() if count == 0]
        order: list[Step] = []
        while ready:
            step = self.steps[heappop(ready)]
            order.append(step)
            for successor in self.successors(step.id):
                waits_for[successor] -= 1
                if waits_for[successor] == 0:
                    heappush(ready, place[successor])
        if len(order) < len(self.steps):
            raise ValueError(f"the plan's links run in a circle among {sorted(id for id, count in waits_for.items() if count)}")
        return tuple(order)

    def ready(self, completed_ids: Collection[str]) -> tuple[Step, ...]:
        """The steps that can start when the steps in `completed_ids` have ended, without the completed ones."""
        return tuple(
            step
            for step in self.steps
            if step.id not in completed_ids and all(predecessor in completed_ids for predecessor in self.predecessors(step.id))
        )

    def __str__(self) -> str:
        def line(step: Step) -> str:
            waits = ", ".join(f"{link.before} ({link.fact})" for link in self.links_to(step.id))
            return f"{step.id}: {step}" + (f" after {waits}" if waits else "")

        return "\n".join(map(line, self.steps)) if self.steps else "nothing to do"


class Obstacle(StrEnum):
    """The kind of reason why there is no plan, with the same values as in `protocol/messages/previews.py`."""

    NO_SERVICE_TYPE = "no-service-type"
    """No known service type has the required effect."""
    NOT_OFFERED = "not-offered"
    """No device offers a service with the required effect."""
    PROMISED = "promised"
    """Other tasks have reserved a required device or object."""
    UNKNOWN = "unknown"
    """The place and state of a required device or object are unknown since a failure."""
    PRECONDITION = "precondition"
    """The task's precondition does not hold on the map."""
    NO_OBJECT = "no-object"
    """The map has no object of that name."""
    TWO_PLACES = "two-places"
    """An object would be in two places at a time."""


class NoPlan(Struct, frozen=True, tag=True):
    """Why there is no plan.

    `explanation` is a text for users. `unreachable` are the parts of the goal that no service on offer can achieve, `missing` the facts
    that would be needed, `unoffered` the service types that would help if a device offered them.
    """

    explanation: str
    unreachable: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    unoffered: tuple[str, ...] = ()
    undecided: bool = False
    """Whether there may be a plan all the same: the search was incomplete, or the planner cannot express the problem."""
    separate_reasons: tuple[str, ...] = field(default=(), name="said")
    """The single reasons that make up the explanation."""
    obstacles: tuple[Obstacle, ...] = ()
    """The kinds of the reasons."""
    lost: tuple[str, ...] = ()
    """The lost services that the reasons name."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """The explanation as separate reasons."""
        return self.separate_reasons or (self.explanation,)


def linearisations(plan: Plan) -> Iterator[tuple[Step, ...]]:
    """Every order in which the steps can be executed one by one."""

    def extend(prefix: tuple[Step, ...]) -> Iterator[tuple[Step, ...]]:
        if len(prefix) == len(plan.steps):
            yield prefix
        for step in plan.ready({step.id for step in prefix}):
            yield from extend((*prefix, step))

    return extend(())
