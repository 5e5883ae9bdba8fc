"""The driver of a simulated stationary camera, which reports the positions of the objects that it sees."""

from __future__ import annotations

from somrs.devices.simulator.drivers.looking import describe_things
from somrs.devices.simulator.drivers.recognition import describe_recognition
from somrs.devices.simulator.drivers.simulated import SimulatedDevice
from somrs.devices.simulator.link.commands import ObjectState
from somrs.entish.formula import Formula
from somrs.errors import RemoteError
from somrs.service_manager.sdk.device import Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed


async def _able(device: FixedCamera, task: Task) -> None:
    """Check that the camera works, and that the object is in view now. Raises Refusal."""
    await device.check_working()
    object = str(task.inputs["Object"])
    if object not in await device.view():
        raise Refusal(f"{device.name} does not see {object}", not_now=True)


async def _able_to_look(device: FixedCamera, task: Task) -> None:
    """Check that the camera works, and that the place is in view now. Raises Refusal."""
    await device.check_working()
    place = str(task.inputs["Place"])
    if place not in await device.view():
        raise Refusal(f"{device.name} does not see {place}")


async def _price(device: FixedCamera, task: Task) -> float | str:
    return await device.price(task, 0.0)


class FixedCamera(SimulatedDevice):
    """A stationary camera in the simulator."""

    type = "Camera"
    features = ("OperationRange", "FieldOfView", "Price")
    mobile = False

    async def view(self) -> dict[str, ObjectState]:
        """The objects that it sees now, by name. Raises Refusal when the camera does not answer."""
        try:
            return {state.object: state for state in (await self.retry_when_link_lost(self._link.sense)).object_states}
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}", not_now=True) from None

    @service("RecognizeSituation", price=_price, duration="1 s", able=_able)
    async def recognize(self, task: Task) -> Situation:
        object = str(task.inputs["Object"])
        try:
            observations = await self.view()
        except Refusal as silent:
            raise ServiceFailed(str(silent), self._out_of_order()) from None
        if object not in observations:
            raise ServiceFailed(f"{self.name} no longer sees {object}")
        return await describe_recognition(task, object, observations)

    @service("LookAt", price=_price, duration="1 s", able=_able_to_look)
    async def look_at_place(self, task: Task) -> Situation:
        try:
            observations = await self.view()
        except Refusal as silent:
            raise ServiceFailed(str(silent), self._out_of_order()) from None
        return " AND ".join(describe_things(str(task.inputs["Place"]), observations.values()) or [f"{self.name}.Working = TRUE"])

    @recognize.compensation
    @look_at_place.compensation
    async def compensate_recognition(self, task: Task, situation: Formula) -> Situation:
        """An observation leaves nothing to undo."""
        return f"{self.name}.Working = TRUE"
