"""After a failure, the Task Manager weighs the penalty for undoing against the costs of going on."""

from __future__ import annotations

import pytest
from msgspec import structs

from somrs.ontology.services import Parameter, ServiceType
from somrs.protocol.messages import events
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.submission import Policy
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Order, WorkDone
from tests.support.virtual_system import Robot, VirtualSystem, drop_object

GOAL = "Jar002 isOn Platform001"
CARRY = ServiceType(
    name="Carry",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="Destination", type="PhysicalObject")),
    precondition="?Object isOn ?Source AND NOT ?Object isOn Floor001",
    effect="?Object isOn ?Destination",
)
FETCH = structs.replace(CARRY, name="Fetch", precondition="?Object isOn Floor001")


def put_back(order: Order, situation: str) -> Work:
    yield 5.0, WorkDone(situation=situation)


def after_a_drop(penalty: float | None, fetching: float = 100.0) -> VirtualSystem:
    """Robot1 drops the jar on the floor, from which only Robot3 takes it. Robot3 has quoted its price before."""
    system = VirtualSystem()
    system.join(Robot("Robot1", 10, 30, works=drop_object, undoes=put_back, penalty=penalty), service=CARRY)
    system.join(Robot("Robot2", 12, 30), service=CARRY)
    system.join(Robot("Robot3", fetching, 30), service=FETCH)
    system.world.run(5)
    system.manager.state.quotes.record_quote("Robot3.Fetch", fetching, 30)
    return system


def undone_first(system: VirtualSystem, task: str) -> events.UndoingCheaper | None:
    logged = [entry.event for entry in system.manager.state.tasks[task].events if isinstance(entry.event, events.UndoingCheaper)]
    return logged[0] if logged else None


def test_undoing_comes_first_where_it_costs_less() -> None:
    system = after_a_drop(penalty=3)
    task = system.submit(GOAL)
    [view] = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert undone_first(system, task) == events.UndoingCheaper(undoing=15, going_on=100)
    assert [(work.service, work.state) for work in view.work] == [
        ("Robot1.Carry", State.COMPENSATED),
        ("Robot2.Carry", State.COMPLETED),
    ]


@pytest.mark.parametrize(("penalty", "fetching"), [(None, 100.0), (95.0, 100.0), (3.0, 14.0)])
def test_going_on_is_the_rule(penalty: float | None, fetching: float) -> None:
    system = after_a_drop(penalty, fetching)
    task = system.submit(GOAL)
    [view] = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert undone_first(system, task) is None
    assert [work.service for work in view.work] == ["Robot1.Carry", "Robot3.Fetch"]


def test_the_policy_says_what_counts() -> None:
    system = after_a_drop(penalty=3)
    task = system.submit(GOAL, policy=Policy.TIME)
    system.finish(task)
    assert undone_first(system, task) is None, "undoing and carrying again take longer than fetching"


def test_the_task_goes_on_where_undoing_fails() -> None:
    system = after_a_drop(penalty=3)
    system.join(Robot("Robot4", 1, 30, works=drop_object, penalty=1), service=CARRY)
    system.world.run(5)
    task = system.submit(GOAL)
    [view] = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert undone_first(system, task) is not None
    assert [work.service for work in view.work][-1] == "Robot3.Fetch"


def test_contracts_show_the_penalty() -> None:
    system = after_a_drop(penalty=3)
    system.finish(system.submit(GOAL))
    assert {contract.service: contract.penalty for contract in system.task_record().contracts}["Robot1.Carry"] == 3
