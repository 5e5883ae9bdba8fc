"""A relay of couriers: each carries every parcel from its own place to the next. Plans have any length and parallel branches."""

from __future__ import annotations

from collections.abc import Sequence

from somrs.entish import Name, Term
from somrs.entish.formula import substitute
from somrs.entish.parse import parse
from somrs.ontology.effects import changes
from somrs.ontology.files.loading import load_text
from somrs.ontology.map import Map
from somrs.ontology.services import PROVIDER, Parameter, ServiceType
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import Ontology
from somrs.planner.model.causal_links import derive_links
from somrs.planner.model.plan import Plan, Step
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.validation import apply_step
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Capability, Order, Profile, WorkDone
from tests.support.building import wide_building
from tests.support.virtual_system import Robot, VirtualSystem

TAKE_SERVICE = ServiceType(
    name="Take",
    inputs=(Parameter(name="Parcel", type="Graspable"), Parameter(name="Place", type="Place")),
    precondition="?Parcel isOn ?Place AND ?Provider isAt ?Place",
    effect="?Parcel isHeldBy ?Provider",
)
GO_SERVICE = ServiceType(
    name="Go",
    inputs=(Parameter(name="From", type="Place"), Parameter(name="To", type="Place")),
    precondition="?Provider isAt ?From",
    effect="?Provider isAt ?To",
)
PUT_SERVICE = ServiceType(
    name="Put",
    inputs=(Parameter(name="Parcel", type="Graspable"), Parameter(name="Place", type="Place")),
    precondition="?Parcel isHeldBy ?Provider AND ?Provider isAt ?Place",
    effect="?Parcel isOn ?Place",
)
SERVICES = (TAKE_SERVICE, GO_SERVICE, PUT_SERVICE)

SECONDS = 10.0
"""The duration of each step."""


def site(couriers: int, parcels: int) -> str:
    places = [f"          Place{n}: {{type: Place, at: [{n}, 0]}}" for n in range(couriers + 1)]
    devices = [f"  Courier{n}: {{type: PioneerP3DX, at: [{n}, 1]}}" for n in range(couriers)]
    things = [f"  Parcel{n}: {{type: Jar, at: [0, 0, 0]}}" for n in range(parcels)]
    facts = [f"  - Courier{n} isAt Place{n}" for n in range(couriers)] + [f"  - Parcel{n} isOn Place0" for n in range(parcels)]
    return "\n".join([wide_building("Relay"), *places, *devices, *things, "facts:", *facts])


def carried(couriers: int, parcels: int) -> list[Step]:
    """Return the steps that carry one parcel after the other from courier to courier."""
    steps: list[Step] = []

    def add(type: ServiceType, courier: int, **inputs: str) -> None:
        bound: dict[str, Term] = {name: Name(value) for name, value in inputs.items()}
        bindings = {**bound, PROVIDER: Name(f"Courier{courier}")}
        assert type.precondition is not None
        steps.append(
            Step(
                id=f"step{len(steps) + 1}",
                service_type=type.name,
                inputs=bound,
                effect=substitute(parse(type.effect), bindings),
                precondition=substitute(parse(type.precondition), bindings),
                provider=f"Courier{courier}",
            )
        )

    for parcel in range(parcels):
        for courier in range(couriers):
            origin, destination = f"Place{courier}", f"Place{courier + 1}"
            add(TAKE_SERVICE, courier, Parcel=f"Parcel{parcel}", Place=origin)
            add(GO_SERVICE, courier, From=origin, To=destination)
            add(PUT_SERVICE, courier, Parcel=f"Parcel{parcel}", Place=destination)
            add(GO_SERVICE, courier, From=destination, To=origin)
    return steps


def goal(couriers: int, parcels: int) -> str:
    return " AND ".join(f"Parcel{n} isOn Place{couriers}" for n in range(parcels))


def problem(couriers: int, parcels: int) -> Problem:
    ontology, map = loaded(couriers, parcels)
    providers = tuple(f"Courier{n}" for n in range(couriers))
    available = tuple(AvailableService(type, providers) for type in SERVICES)
    return Problem(ontology=ontology, map=map, goal=parse(goal(couriers, parcels)), services=available)


def loaded(couriers: int, parcels: int) -> tuple[Ontology, Map]:
    loaded_site = load_text(site(couriers, parcels), "relay.yaml")
    assert loaded_site.map is not None
    return loaded_site.ontology, loaded_site.map


def maps_of(steps: Sequence[Step], problem: Problem) -> list[Map]:
    """Return the map before the first step, and the maps after each step."""
    maps = [problem.map]
    for step in steps:
        maps.append(apply_step(step, maps[-1], problem))
    return maps


def longest(plan: Plan) -> int:
    """Return the number of steps in the longest chain of links."""
    depth: dict[str, int] = {}
    for step in plan.topological():
        depth[step.id] = 1 + max((depth[predecessor] for predecessor in plan.predecessors(step.id)), default=0)
    return max(depth.values(), default=0)


class Relay(VirtualSystem):
    """Couriers on virtual time, with a plan that is known in advance. At the beginning and the end of a step, each courier checks the
    step's precondition in the true state; `wrong` lists the violations."""

    def __init__(self, couriers: int, parcels: int) -> None:
        planning_problem = problem(couriers, parcels)
        self.goal = goal(couriers, parcels)
        steps = carried(couriers, parcels)
        self.plan = Plan(tuple(steps), derive_links(steps, maps_of(steps, planning_problem), planning_problem))
        self.wrong: list[str] = []
        self.started: list[str] = []
        self._truth, self._ontology = planning_problem.map, planning_problem.ontology
        super().__init__(site=site(couriers, parcels))
        for number in range(couriers):
            robot = Robot(f"Courier{number}", price=1, duration=SECONDS, works=self._work)
            capabilities = tuple(Capability(type=type, method=type.name, stoppable=True) for type in SERVICES)
            self._join(robot, Profile(name=robot.name, type="PioneerP3DX", capabilities=capabilities, lease=3600))
        self.world.run(5)

    def _work(self, order: Order) -> Work:
        self.started.append(order.participant)
        self._look(order)
        yield SECONDS, self._complete(order)

    def _complete(self, order: Order) -> WorkDone:
        self._look(order)
        self._truth = self._truth.changed(changes(parse(order.effect), self._truth, self._ontology))
        return WorkDone(situation=order.effect)

    def learn(self, situation: str) -> None:
        """Make the situation hold in the true state, as another actor would."""
        self._truth = self._truth.changed(changes(parse(situation), self._truth, self._ontology))

    def _look(self, order: Order) -> None:
        assert order.precondition is not None
        if not formula_holds(parse(order.precondition), self._truth, self._ontology):
            self.wrong.append(f"{order.participant}: {order.precondition}")

    def _plan(self, task: object) -> Work:
        assert isinstance(task, Problem)
        self.problems.append(task)
        yield 0.0, self.plan
