"""Services quote on the situation in which they are to start: what earlier steps of the plan will have changed."""

from __future__ import annotations

from typing import Any

import pytest

from somrs.ontology.services import Parameter, ServiceType
from somrs.protocol.messages.frp import Arrange, Outcome
from somrs.protocol.messages.previews import Preview, Previewed
from somrs.protocol.messages.task_views import TaskView
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal
from tests.support.virtual_devices import Pause
from tests.support.virtual_system import VirtualSystem

SITE = """
map: Lab
objects:
  Building001:
    type: Building
    parts:
      Storey001:
        type: Storey
        parts:
          Floor001: {type: Floor, at: [0, 0, -0.1], Shape: {Form: Box, Width: 20, Depth: 20, Height: 0.1}}
          Door001: {type: Door, at: [2, 0, 0], Shape: {Form: Box, Width: 0.1, Depth: 1, Height: 2}, Open: false}
  Table001: {type: Table, at: [1, 1, 0], Shape: {Form: Box, Width: 0.5, Depth: 1, Height: 0.8}}
  Shelf001: {type: Shelf, at: [8, 2, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.8}}
  Carton001: {type: Carton, at: [1, 1, 0.8]}
  Porter1: {type: PioneerP3DX, at: [3, 3]}
  Carrier1: {type: PioneerP3DX, at: [3, 5]}
  Carrier2: {type: PioneerP3DX, at: [3, 7]}
  Climber1: {type: PioneerP3DX, at: [3, 9]}
  Closer1: {type: PioneerP3DX, at: [5, 9]}
facts:
  - Carton001 isOn Table001
"""

OPEN = ServiceType(name="UnlockDoor", inputs=(Parameter(name="Door", type="Door"),), effect="?Door.Open = TRUE")
CARRY = ServiceType(
    name="CarryThrough",
    inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="Destination", type="Support")),
    precondition="?Object isOn ?Source AND Door001.Open = TRUE",
    effect="?Object isOn ?Destination",
)


class Porter(Device):
    """Opens doors."""

    type = "PioneerP3DX"

    @service(OPEN, price="1 EUR", duration="5 s")
    async def open_door(self, task: Task) -> Situation:
        await Pause(5)
        return None


async def _needs_an_open_door(device: Carrier, task: Task) -> None:
    device.read = [*device.read, await task.map.holds("Door001.Open = TRUE")]
    if not device.read[-1]:
        raise Refusal("Door001 is shut")


class Carrier(Device):
    """Refuses to carry as long as the door is shut where it quotes."""

    type = "PioneerP3DX"
    read: list[bool] = []

    @service(CARRY, price="4 EUR", duration="30 s", able=_needs_an_open_door)
    async def carry(self, task: Task) -> Situation:
        self.read = [*self.read, await task.map.holds("Door001.Open = TRUE")]
        await Pause(30)
        return None


def arranges(system: VirtualSystem) -> dict[str, str | None]:
    """The situation in each request for terms, by service type."""
    bodies = [message.body for message in system.world.messages]
    return {body.service_type: body.situation for body in bodies if isinstance(body, Arrange)}


def finished(system: VirtualSystem, goal: str, **options: Any) -> TaskView:
    (view,) = system.finish(system.submit(goal, **options))
    return view


def test_a_robot_quotes_with_the_door_open_that_is_shut_now() -> None:
    system, carrier = VirtualSystem(site=SITE), Carrier("Carrier1")
    system.join_device(Porter("Porter1"))
    system.join_device(carrier)
    view = finished(system, "Carton001 isOn Shelf001")
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert [step.service for step in view.steps] == ["Porter1.UnlockDoor", "Carrier1.CarryThrough"]
    assert arranges(system) == {"UnlockDoor": None, "CarryThrough": "Door001.Open = TRUE"}
    assert carrier.read == [True, True], "it read the promised map when it quoted, and the real one when it began"
    assert system.map.objects["Door001"].values["Open"] is True


# Conditions

CARRY_ANYWHERE = ServiceType(
    name="CarryAnywhere", inputs=CARRY.inputs, precondition="?Object isOn ?Source", effect="?Object isOn ?Destination"
)


async def _demands_an_open_door(device: Cautious, task: Task) -> None:
    if not await task.map.holds("Door001.Open = TRUE"):
        task.demand("Door001.Open = TRUE")


async def _refuses_at_a_shut_door(device: Cautious, task: Task) -> None:
    if not await task.map.holds("Door001.Open = TRUE"):
        raise Refusal("there is no way", condition="Door001.Open = TRUE")


class Cautious(Device):
    """Carries for 4 EUR, if the door is open."""

    type = "PioneerP3DX"
    able = staticmethod(_demands_an_open_door)

    @service(CARRY_ANYWHERE, price="4 EUR", duration="30 s", able=lambda device, task: type(device).able(device, task))
    async def carry(self, task: Task) -> Situation:
        await Pause(30)
        return None


class Stubborn(Cautious):
    """Refuses, and says that it would do it if the door were open."""

    able = staticmethod(_refuses_at_a_shut_door)


class Climber(Device):
    """Carries without a condition, for more."""

    type = "PioneerP3DX"
    fee = 12.0

    @service(CARRY_ANYWHERE, price=lambda device, task: device.fee, duration="30 s")
    async def carry(self, task: Task) -> Situation:
        await Pause(30)
        return None


@pytest.mark.parametrize("carrier", [Cautious, Stubborn])
def test_a_condition_of_a_service_is_made_true_by_another_one(carrier: type[Device]) -> None:
    system = VirtualSystem(site=SITE)
    system.join_device(Porter("Porter1"))
    system.join_device(carrier("Carrier1"))
    system.join_device(carrier("Carrier2"))
    view = finished(system, "Carton001 isOn Shelf001")
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert [step.service_type for step in view.steps] == ["UnlockDoor", "CarryAnywhere"]
    carry = view.steps[1]
    assert carry.condition == "Door001.Open = TRUE"
    assert carry.demanded_by == ("Carrier1.CarryAnywhere", "Carrier2.CarryAnywhere")
    assert (carry.after, carry.because) == (("step1",), ("Door001.Open = TRUE",)), "the door is opened before, not beside"
    assert arranges(system)["CarryAnywhere"] == "Door001.Open = TRUE"


@pytest.mark.parametrize("carrier", [Cautious, Stubborn])
def test_a_goal_that_names_the_door_is_reached_in_the_right_order(carrier: type[Device]) -> None:
    system = VirtualSystem(site=SITE)
    system.join_device(Porter("Porter1"))
    system.join_device(carrier("Carrier1"))
    view = finished(system, "Door001.Open = TRUE AND Carton001 isOn Shelf001")
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    carry = next(step for step in view.steps if step.service_type == "CarryAnywhere")
    assert carry.because == ("Door001.Open = TRUE",)


@pytest.mark.parametrize(("fee", "services"), [(12.0, ["Porter1.UnlockDoor", "Carrier1.CarryAnywhere"]), (4.5, ["Climber1.CarryAnywhere"])])
def test_the_total_decides(fee: float, services: list[str]) -> None:
    """The door is opened for 1 EUR: 5 EUR in all against the fee of the robot that needs no open door."""
    system, climber = VirtualSystem(site=SITE), Climber("Climber1")
    climber.fee = fee
    system.join_device(Porter("Porter1"))
    system.join_device(Cautious("Carrier1"))
    system.join_device(climber)
    finished(system, "Door001.Open = TRUE")  # the price of opening is known from now on
    system.change("Door001.Open = FALSE")
    view = finished(system, "Carton001 isOn Shelf001")
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert [step.service for step in view.steps] == services


def test_a_condition_that_nothing_makes_true_is_named() -> None:
    system = VirtualSystem(site=SITE)
    system.join_device(Cautious("Carrier1"))
    (view,) = system.finish(system.submit("Carton001 isOn Shelf001", waits=False))
    assert view.outcome is Outcome.FAILED
    assert "CarryAnywhere(Carton001, Shelf001) by Carrier1, if Door001.Open = TRUE" in view.explanation
    assert len([body for message in system.world.messages if isinstance(body := message.body, Arrange)]) == 1, "it is not asked again"


class Insatiable(Device):
    """Demands more each time."""

    type = "PioneerP3DX"
    asked = 0

    @service(CARRY_ANYWHERE, price="4 EUR", duration="30 s", able=lambda device, task: device.more(task))
    async def carry(self, task: Task) -> Situation:
        return None

    def more(self, task: Task) -> None:
        self.asked += 1
        task.demand(f"Carton001.PositionX = {self.asked + 10} m")


MOVE = ServiceType(
    name="Shift", inputs=(Parameter(name="Object", type="Graspable"), Parameter(name="To", type="number")), effect="?Object.PositionX = ?To"
)


class Shifter(Device):
    """Makes true whatever is demanded."""

    type = "PioneerP3DX"

    @service(MOVE, price="1 EUR", duration="1 s")
    async def shift(self, task: Task) -> Situation:
        return None


def test_conditions_without_end_are_given_up() -> None:
    system, greedy = VirtualSystem(site=SITE), Insatiable("Carrier1")
    system.join_device(greedy)
    system.join_device(Shifter("Porter1"))
    (view,) = system.finish(system.submit("Carton001 isOn Shelf001", waits=False))
    assert view.outcome is Outcome.FAILED
    assert "needs Carton001.PositionX" in view.explanation
    assert greedy.asked < 25


def test_a_preview_has_the_plan_with_the_condition_and_its_total() -> None:
    system = VirtualSystem(site=SITE)
    system.join_device(Porter("Porter1"))
    system.join_device(Cautious("Carrier1"))
    preview = system.ask(Preview(effect="Carton001 isOn Shelf001", quotes=True))
    assert isinstance(preview, Previewed)
    assert [step.service_type for step in preview.steps] == ["UnlockDoor", "CarryAnywhere"]
    assert (preview.price, preview.unserved) == (5.0, {})
    (view,) = system.finish(system.submit("Carton001 isOn Shelf001"))
    assert [step.price for step in view.steps] == [1.0, 4.0]


def test_a_preview_names_the_condition_that_the_plan_does_not_meet() -> None:
    system = VirtualSystem(site=SITE)
    system.join_device(Cautious("Carrier1"))
    system.join_device(Climber("Climber1"))
    preview = system.ask(Preview(effect="Carton001 isOn Shelf001", quotes=True))
    assert isinstance(preview, Previewed)
    quotations = {quotation.service: quotation for quotation in preview.quotations}
    assert (quotations["Carrier1.CarryAnywhere"].condition, quotations["Carrier1.CarryAnywhere"].chosen) == ("Door001.Open = TRUE", False)
    assert quotations["Climber1.CarryAnywhere"].chosen
