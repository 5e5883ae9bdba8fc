"""Services quote on the situation in which they are to start: what earlier steps of the plan will have changed."""

from __future__ import annotations

from somrs.ontology.services import Parameter, ServiceType
from somrs.protocol.messages.clients import TaskView
from somrs.protocol.messages.frp import Arrange, Outcome
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
facts:
  - Carton001 isOn Table001
"""

OPEN = ServiceType(name="OpenDoor", inputs=(Parameter(name="Door", type="Door"),), effect="?Door.Open = TRUE")
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


def finished(system: VirtualSystem, goal: str, **options: object) -> TaskView:
    (view,) = system.finish(system.submit(goal, **options))
    return view


def test_a_robot_quotes_with_the_door_open_that_is_shut_now() -> None:
    system, carrier = VirtualSystem(site=SITE), Carrier("Carrier1")
    system.join_device(Porter("Porter1"))
    system.join_device(carrier)
    view = finished(system, "Carton001 isOn Shelf001")
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert [step.service for step in view.steps] == ["Porter1.OpenDoor", "Carrier1.CarryThrough"]
    assert arranges(system) == {"OpenDoor": None, "CarryThrough": "Door001.Open = TRUE"}
    assert carrier.read == [True, True], "it read the promised map when it quoted, and the real one when it began"
    assert system.map.objects["Door001"].values["Open"] is True
