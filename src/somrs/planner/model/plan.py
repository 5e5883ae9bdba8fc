"""Abstract plans: service types with their inputs, and the causal links between them (paper, "SO-MRS architecture": Planner).

An abstract plan is a directed acyclic graph. How plans are found is in `planning.py`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import cached_property
from heapq import heappop, heappush

from msgspec import Struct, field

from somrs.entish import Formula, Name, Term
from somrs.entish.formula import Substitution
from somrs.ontology.services import PROVIDER


class Step(Struct, frozen=True):
    """One use of a service type.

    `inputs` are by the service type's input names. `provider` is the device that has to do it, when the service type's formulas speak of
    `?Provider`; otherwise None: any provider will do. Those `alternative_providers` could do it as well, if one of them does all steps that
    say the `device_group`. `precondition` and `effect` have no variables left."""

    id: str
    service_type: str
    inputs: dict[str, Term]
    effect: Formula
    precondition: Formula | None = None
    provider: str | None = None
    device_group: str | None = field(default=None, name="same")
    alternative_providers: tuple[str, ...] = field(default=(), name="alike")

    @property
    def bindings(self) -> Substitution:
        """The inputs and, if the plan names one, the provider: what to substitute in the service type's formulas."""
        return self.inputs if self.provider is None else {**self.inputs, PROVIDER: Name(self.provider)}

    def __str__(self) -> str:
        inputs_text = ", ".join(f"{name}: {term}" for name, term in self.inputs.items())
        devices = " or ".join((self.provider, *self.alternative_providers)) if self.provider is not None else ""
        return f"{self.service_type}({inputs_text})" + (f" by {devices}" if devices else "")


class Link(Struct, frozen=True):
    """Step `after` comes after step `before`, because `before` brings `fact` about; or, when `is_protection`, because `after` would
    undo `fact`, which `before` (or a step that must be over by then) still needs or has yet to see undone and restored."""

    before: str
    after: str
    fact: str
    is_protection: bool = field(default=False, name="keeps")


class Plan(Struct, frozen=True, dict=True, tag=True):
    """The steps in an order in which they can be done one by one, and the links that say which order is needed."""

    steps: tuple[Step, ...] = ()
    links: tuple[Link, ...] = ()

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
        """The links that say what has to be done before this step."""
        return self._incoming_links.get(id, ())

    def predecessors(self, id: str) -> tuple[str, ...]:
        """The ids of the steps that have to be done before this one, as far as the links say so directly."""
        return tuple(dict.fromkeys(link.before for link in self._incoming_links.get(id, ())))

    def successors(self, id: str) -> tuple[str, ...]:
        """The ids of the steps that wait for this one directly."""
        return tuple(dict.fromkeys(link.after for link in self._outgoing_links.get(id, ())))

    def topological(self) -> tuple[Step, ...]:
        """The steps, each after all that it waits for. Steps that wait for nothing among the rest keep the plan's order."""
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
        """The steps that can start when those in `completed_ids` are over; those are not among them."""
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
    """What stands in the way of a plan, as clients know it (`protocol/messages/clients.py`)."""

    NO_SERVICE_TYPE = "no-service-type"
    """No service type that is known brings it about."""
    NOT_OFFERED = "not-offered"
    """Nobody offers a service that would bring it about."""
    PROMISED = "promised"
    """Who, or what, it takes is promised to other tasks, or nobody knows what state it is in."""
    PRECONDITION = "precondition"
    """The map denies what the client says of the beginning."""
    NO_OBJECT = "no-object"
    """There is no object of such a name on the map."""
    TWO_PLACES = "two-places"
    """Something would be in two places at a time."""


class NoPlan(Struct, frozen=True, tag=True):
    """Why there is no plan.

    `explanation` is for people. `unreachable` are the parts of the goal that no service on offer can bring about,
    `missing` the facts that would make a difference, `unoffered` the service types that would help if anybody offered them.
    """

    explanation: str
    unreachable: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    unoffered: tuple[str, ...] = ()
    undecided: bool = False
    """Whether there may be a plan all the same: it was too much to look through, or cannot be expressed."""
    separate_reasons: tuple[str, ...] = field(default=(), name="said")
    """The reasons that the explanation is made of, if there are several."""
    obstacles: tuple[Obstacle, ...] = ()
    """What the reasons come to."""
    lost: tuple[str, ...] = ()
    """The services of which the reasons say why they cannot do it any more."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """The explanation, each reason by itself."""
        return self.separate_reasons or (self.explanation,)


def linearisations(plan: Plan) -> Iterator[tuple[Step, ...]]:
    """Every order in which the steps can be done one by one."""

    def extend(prefix: tuple[Step, ...]) -> Iterator[tuple[Step, ...]]:
        if len(prefix) == len(plan.steps):
            yield prefix
        for step in plan.ready({step.id for step in prefix}):
            yield from extend((*prefix, step))

    return extend(())
