"""Several plans for a task: services quote all of them, and the policy of the task prefers one."""

from __future__ import annotations

from somrs.ontology.services import Parameter, ServiceType
from somrs.protocol.messages import events
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.submission import CancelTask, Policy
from somrs.task_manager.manager import TaskManager
from tests.support.virtual_system import Robot, VirtualSystem

GOAL = "Jar002 isOn Platform001"
THROW = ServiceType(
    name="Throw",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="Destination", type="PhysicalObject")),
    precondition="?Object isOn ?From",
    effect="?Object isOn ?Destination",
)


def two_ways(carrier: Robot, thrower: Robot) -> VirtualSystem:
    """TransferObject and Throw lead to the goal."""
    system = VirtualSystem(carrier)
    system.join(thrower, service=THROW)
    system.world.run(5)
    return system


def comparison(system: VirtualSystem, task: str) -> events.PlansCompared:
    [event] = [logged.event for logged in system.manager.state.tasks[task].events if isinstance(logged.event, events.PlansCompared)]
    return event


def services(system: VirtualSystem, task: str) -> list[str | None]:
    [view] = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    return [step.service for step in view.steps]


def test_the_policy_prefers_a_plan_by_its_terms() -> None:
    system = two_ways(Robot("Robot1", 30, 20), Robot("Robot2", 10, 60))
    cheap = system.submit(GOAL)
    assert services(system, cheap) == ["Robot2.Throw"]
    compared = comparison(system, cheap)
    assert sorted((plan.service_types, plan.price) for plan in compared.plans) == [(("Throw",), 10), (("TransferObject",), 30)]
    assert compared.plans[compared.chosen].price == 10
    quick = system.submit("Tin001 isOn Platform001", policy=Policy.TIME)
    assert services(system, quick) == ["Robot1.TransferObject"]


def test_a_plan_that_no_service_takes_is_not_preferred() -> None:
    system = two_ways(Robot("Robot1", 30, 20), Robot("Robot2", 10, 60, refuses="it is too far for me"))
    task = system.submit(GOAL)
    assert services(system, task) == ["Robot1.TransferObject"]
    assert sorted(plan.price or 0 for plan in comparison(system, task).plans) == [0, 30]


def test_what_services_quoted_binds_nobody() -> None:
    system = two_ways(Robot("Robot1", 30, 20), Robot("Robot2", 10, 60))
    task = system.submit(GOAL)
    services(system, task)
    quoted = [message for message in system.world.messages if (message.header.transaction or "").startswith(f"{task}/")]
    assert {type(message.body).__name__ for message in quoted} == {"Arrange", "Terms", "Cancel"}
    assert system.manager.state.previews == {}


def test_a_cancelled_comparison_ends() -> None:
    system = two_ways(Robot("Robot1", 30, 20, mute=True), Robot("Robot2", 10, 60, mute=True))
    task = system.submit(GOAL)
    system.world.run(1)
    assert system.manager.state.previews
    system.ask(CancelTask(task=task))
    [view] = system.finish(task)
    assert view.outcome is Outcome.CANCELLED
    system.world.run(60)
    assert system.manager.state.previews == {}


def test_a_comparison_survives_a_restart_of_the_task_manager() -> None:
    for snapshot in (False, True):
        system = two_ways(Robot("Robot1", 30, 20), Robot("Robot2", 10, 60))
        task = system.submit(GOAL)
        system.world.run(0.05)
        system.restart_manager(snapshot=snapshot)
        assert isinstance(system.manager, TaskManager)
        assert services(system, task) == ["Robot2.Throw"]


def test_a_preview_shows_the_plans_side_by_side() -> None:
    system = two_ways(Robot("Robot1", 30, 20), Robot("Robot2", 10, 60))
    previewed = system.ask(Preview(effect=GOAL, quotes=True))
    assert isinstance(previewed, Previewed)
    assert (previewed.price, [step.service for step in previewed.steps]) == (10, ["Robot2.Throw"])
    [other] = previewed.alternatives
    assert (other.price, round(other.seconds or 0), [step.service for step in other.steps]) == (30, 20, ["Robot1.TransferObject"])
    quick = system.ask(Preview(effect=GOAL, quotes=True, policy=Policy.TIME))
    assert isinstance(quick, Previewed)
    assert [step.service for step in quick.steps] == ["Robot1.TransferObject"]
    unquoted = system.ask(Preview(effect=GOAL))
    assert isinstance(unquoted, Previewed)
    assert not unquoted.alternatives
