"""Steps that have to be done by one device, whichever it is."""

from __future__ import annotations

from collections import defaultdict

import pytest
from msgspec.structs import replace

from somrs.entish.parse import parse
from somrs.ontology.effects import apply_effect
from somrs.ontology.files.loading import load_text
from somrs.ontology.services import Parameter, ServiceType
from somrs.planner.model.causal_links import derive_links
from somrs.planner.model.plan import Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner.model.provider_choice import assign_provider, generalize_providers
from somrs.planner.model.validation import validate
from somrs.planner.planning import plan
from somrs.protocol.messages.event_kinds import EventKind
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Policy
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Capability, Order, Profile, WorkDone
from tests.support.relay import carried, maps_of
from tests.support.relay import problem as relay
from tests.support.virtual_system import SITE, Robot, VirtualSystem

PICK = ServiceType(
    name="PickUp",
    inputs=(Parameter(name="Object", type="Graspable"),),
    precondition="?Object isOn ?Source",
    effect="?Object isHeldBy ?Provider",
)
PUT_SERVICE = ServiceType(
    name="PutDown",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="Place", type="Support")),
    precondition="?Object isHeldBy ?Provider",
    effect="?Object isOn ?Place",
)


def picking(precondition: str = "", effect: str = "") -> ServiceType:
    """PickUp, with more that it needs or brings about."""
    return ServiceType(
        name="PickUp", inputs=PICK.inputs, precondition=f"{PICK.precondition}{precondition}", effect=f"{PICK.effect}{effect}"
    )


WISH = "Jar001 isOn Platform001 AND Jar002 isOn Platform001 AND Tin001 isOn Platform001"
ROBOTS = ("Robot1", "Robot2", "Robot3")


def gripping(goal: str, *services: ServiceType, robots: tuple[str, ...] = ROBOTS) -> Problem:
    loaded = load_text(SITE, "site.yaml")
    assert loaded.map is not None
    available = tuple(AvailableService(service, robots) for service in services or (PICK, PUT_SERVICE))
    return Problem(ontology=loaded.ontology, map=loaded.map, goal=parse(goal), services=available)


def planned(problem: Problem) -> Plan:
    result = plan(problem)
    assert isinstance(result, Plan)
    return result


def test_who_takes_a_thing_puts_it_down_whoever_that_is() -> None:
    problem = gripping(WISH)
    result = planned(problem)
    objects_by_group: dict[str | None, list[str]] = defaultdict(list)
    for step in result.steps:
        assert {step.provider, *step.alternative_providers} == set(ROBOTS)
        objects_by_group[step.device_group].append(str(step.inputs["Object"]))
    assert len(objects_by_group) == 3
    assert all(len(objects) == 2 and len(set(objects)) == 1 for objects in objects_by_group.values())
    for robots in (("Robot3", "Robot2", "Robot1"), ("Robot2", "Robot2", "Robot2")):
        robot_by_group = dict(zip(objects_by_group, robots, strict=True))
        assert (
            validate(Plan(tuple(assign_provider(step, robot_by_group[step.device_group]) for step in result.steps), result.links), problem)
            == []
        )


@pytest.mark.parametrize(
    "problem",
    [
        gripping(WISH, picking(" AND NOT ?Any isHeldBy ?Provider"), PUT_SERVICE),
        gripping(WISH, picking(effect=" AND ?Provider.Charge = 5"), PUT_SERVICE),
        gripping("Jar001 isHeldBy Robot2"),
        gripping(WISH, robots=("Robot1",)),
        replace(gripping(WISH), excluded=frozenset({"Robot2", "Robot3"})),
    ],
    ids=["what it holds matters", "it is changed", "the wish names it", "there is one only", "the others are promised"],
)
def test_where_it_matters_who_does_it_the_plan_says_who(problem: Problem) -> None:
    assert all(step.provider is not None and not step.alternative_providers for step in planned(problem).steps)


def test_who_is_charged_for_it_cannot_be_replaced_by_whom_that_leaves_as_it_is() -> None:
    charge = ServiceType(name="Charge", inputs=(Parameter(name="Robot", type="PioneerP3DX"),), effect="?Robot.Charge = 80 %")
    problem = gripping("Jar001 isOn Platform001", picking(" AND ?Provider.Charge >= 20 %"), PUT_SERVICE, charge)
    charged = parse("Robot1.Charge = 10 % AND Robot2.Charge = 50 % AND Robot3.Charge = 50 %")
    problem = replace(problem, map=apply_effect(charged, problem.map, problem.ontology))
    result = planned(replace(problem, excluded=frozenset({"Robot2", "Robot3"})))
    assert [(step.service_type, step.provider) for step in result.steps] == [
        ("Charge", None),
        ("PickUp", "Robot1"),
        ("PutDown", "Robot1"),
    ]
    assert generalize_providers(problem, result) == result


def test_couriers_that_move_cannot_take_each_others_place() -> None:
    steps, relay_problem = carried(2, 2), relay(2, 2)
    relay_plan = Plan(tuple(steps), derive_links(steps, maps_of(steps, relay_problem), relay_problem))
    assert generalize_providers(relay_problem, relay_plan) == relay_plan


def test_only_those_are_alike_of_which_the_same_is_so() -> None:
    problem = gripping("Jar001 isOn Platform001", picking(" AND ?Provider.Working = TRUE"), PUT_SERVICE)
    working = apply_effect(parse("Robot2.Working = FALSE"), problem.map, problem.ontology)
    result = planned(replace(problem, map=working))
    assert {(step.provider, *step.alternative_providers) for step in result.steps} <= {("Robot1", "Robot3"), ("Robot3", "Robot1")}


class Grippers(VirtualSystem):
    """Robots that pick up and put down."""

    def grip(self, robot: Robot) -> None:
        capabilities = tuple(Capability(type=type, method=type.name, stoppable=True) for type in (PICK, PUT_SERVICE))
        self._join(robot, Profile(name=robot.name, type="PioneerP3DX", capabilities=capabilities, lease=3600))


def make_system(*robots: Robot) -> Grippers:
    system = Grippers()
    for robot in robots:
        system.grip(robot)
    system.world.run(5)
    return system


def gripper(name: str, seconds: float = 10.0, price: float = 1.0, refuses: str = "") -> Robot:
    def works(order: Order) -> Work:
        yield seconds, WorkDone(situation=order.effect)

    return Robot(name, price, seconds, works=works, refuses=refuses)


def test_three_robots_take_a_thing_each() -> None:
    robots = [gripper(name) for name in ROBOTS]
    system = make_system(*robots)
    start = system.world.now
    (view,) = system.finish(system.submit(WISH, policy=Policy.TIME))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert view.ended_at is not None
    assert view.ended_at - start < 25
    for robot in robots:
        assert [order.method for order in robot.orders] == ["PickUp", "PutDown"]
        assert len({order.inputs["Object"] for order in robot.orders}) == 1
    assert system.map.has_fact("isOn", ("Tin001", "Platform001"))


def test_the_cheapest_takes_them_all_when_that_is_wanted() -> None:
    robots = [gripper("Robot1", price=5), gripper("Robot2", price=2), gripper("Robot3", price=5)]
    system = make_system(*robots)
    (view,) = system.finish(system.submit(WISH, policy=Policy.PRICE))
    assert view.outcome is Outcome.ACCOMPLISHED
    assert [len(robot.orders) for robot in robots] == [0, 6, 0]


def test_when_one_refuses_another_takes_it_without_a_new_plan() -> None:
    robots = [gripper("Robot1", refuses="it is too heavy for me"), gripper("Robot2", refuses="it is too heavy for me"), gripper("Robot3")]
    system = make_system(*robots)
    task = system.submit("Jar001 isOn Platform001")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert not [event for event in system.manager.state.tasks[task].events if event.kind is EventKind.REPLAN]
    assert len(robots[2].orders) == 2
