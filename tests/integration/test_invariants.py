"""What has to hold while a service works (`while` of its type): it is stopped when this ends, and the task goes on from there."""

from __future__ import annotations

import pytest

from somrs.ontology.services import Parameter, ServiceType
from somrs.protocol.messages import events
from somrs.protocol.messages.frp import Outcome
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from tests.integration.test_promised_situations import OPEN, SITE, Porter
from tests.support.virtual_devices import Pause
from tests.support.virtual_system import VirtualSystem

DOOR_OPEN = "Door001.Open = TRUE"
CARRY = ServiceType(
    name="CarryThrough",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="Destination", type="Support")),
    precondition="?Object isOn ?Source",
    invariant=DOOR_OPEN,
    effect="?Object isOn ?Destination",
)
CARRY_ANYHOW = ServiceType(name="CarryAnyhow", inputs=CARRY.inputs, precondition=CARRY.precondition, effect=CARRY.effect)
CLOSE = ServiceType(name="LockDoor", inputs=OPEN.inputs, effect="?Door.Open = FALSE")


class Carrier(Device):
    """Carries in 25 s, and puts the thing down where it is told to stop."""

    type = "PioneerP3DX"
    begun = 0

    @service(CARRY, price="4 EUR", duration="25 s")
    async def carry(self, task: Task) -> Situation:
        self.begun += 1
        await Pause(25)
        return None

    @carry.stopping
    async def put_down(self, task: Task) -> Situation:
        return f"{task.inputs['Object']} isOn Floor001"


class Wary(Device):
    """Carries in 25 s; it is the device, and not the type of its service, that demands an open door."""

    type = "PioneerP3DX"
    begun = 0

    async def _demand(self, task: Task) -> None:
        task.demand(DOOR_OPEN, throughout=True)

    @service(CARRY_ANYHOW, price="4 EUR", duration="25 s", able=_demand)
    async def carry(self, task: Task) -> Situation:
        self.begun += 1
        await Pause(25)
        return None

    @carry.stopping
    async def put_down(self, task: Task) -> Situation:
        return f"{task.inputs['Object']} isOn Floor001"


class Closer(Device):
    """Closes doors."""

    type = "PioneerP3DX"

    @service(CLOSE, price="1 EUR", duration="5 s")
    async def close_door(self, task: Task) -> Situation:
        await Pause(5)
        return None


def make_system(*devices: Device) -> VirtualSystem:
    system = VirtualSystem(site=SITE)
    for device in (Porter("Porter1"), *devices):
        system.join_device(device)
    return system


def logged(system: VirtualSystem, task: str, kind: type[object]) -> list[tuple[float, object]]:
    state = system.manager.state.tasks[task]
    return [(entry.at, entry.event) for entry in state.events if isinstance(entry.event, kind)]


def test_an_invariant_is_made_true_first() -> None:
    system = make_system(Carrier("Carrier1"))
    (view,) = system.finish(system.submit("Carton001 isOn Shelf001"))
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert [step.service_type for step in view.steps] == ["UnlockDoor", "CarryThrough"]
    assert view.steps[1].because == (DOOR_OPEN,)


@pytest.mark.parametrize(("kind", "service_type"), [(Carrier, "CarryThrough"), (Wary, "CarryAnyhow")], ids=["by type", "by terms"])
def test_a_door_that_closes_during_the_step_stops_it_at_once_and_nobody_is_blamed(kind: type[Carrier | Wary], service_type: str) -> None:
    carrier = kind("Carrier1")
    system = make_system(carrier)
    system.change(DOOR_OPEN)
    task = system.submit("Carton001 isOn Shelf001")
    system.world.run(3)
    system.change("Door001.Open = FALSE")
    closed_at = system.world.now
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    ((broken_at, event),) = logged(system, task, events.InvariantBroken)
    assert event == events.InvariantBroken(service=f"Carrier1.{service_type}", invariant=DOOR_OPEN)
    assert broken_at <= closed_at
    assert carrier.begun == 2, "the same robot carries on: it is not excluded"
    assert [(work.service, work.state) for work in view.work] == [
        (f"Carrier1.{service_type}", "Stopped"),
        ("Porter1.UnlockDoor", "Completed"),
        (f"Carrier1.{service_type}", "Completed"),
    ]
    assert "Door001.Open = TRUE does not hold any more" in view.work[0].note
    assert system.manager.state.tasks[task].services.failures == {}


def test_a_change_that_breaks_nothing_stops_nothing() -> None:
    carrier = Carrier("Carrier1")
    system = make_system(carrier)
    system.change(DOOR_OPEN)
    task = system.submit("Carton001 isOn Shelf001")
    system.world.run(3)
    system.change("Table001.Color = Blue")
    (view,) = system.finish(task)
    assert (view.outcome, carrier.begun, logged(system, task, events.InvariantBroken)) == (Outcome.ACCOMPLISHED, 1, [])


@pytest.mark.parametrize("is_open", [True, False])
@pytest.mark.parametrize(("kind", "service_type"), [(Carrier, "CarryThrough"), (Wary, "CarryAnyhow")], ids=["by type", "by terms"])
def test_a_step_of_the_plan_that_would_break_it_waits(kind: type[Carrier | Wary], service_type: str, is_open: bool) -> None:
    system = make_system(kind("Carrier1"), Closer("Closer1"))
    if is_open:
        system.change(DOOR_OPEN)
    task = system.submit("Carton001 isOn Shelf001 AND Door001.Open = FALSE")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert logged(system, task, events.InvariantBroken) == []
    assert [work.service_type for work in view.work][-2:] == [service_type, "LockDoor"]


def test_the_task_manager_restarts_while_the_step_works() -> None:
    system = make_system(Carrier("Carrier1"))
    system.change(DOOR_OPEN)
    task = system.submit("Carton001 isOn Shelf001")
    system.world.run(3)
    system.world.kill("tm")
    system.change("Door001.Open = FALSE")
    system.world.revive("tm")
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert len(logged(system, task, events.InvariantBroken)) == 1
