"""The Service Manager's side of a camera that hangs somewhere: says where the things are that it sees."""

from __future__ import annotations

from somrs.devices.simulator.drivers.recognition import recognised
from somrs.devices.simulator.drivers.simulated import SimulatedDevice
from somrs.devices.simulator.link.commands import Seen
from somrs.entish.formula import Formula
from somrs.errors import RemoteError
from somrs.service_manager.sdk.device import Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed


async def _able(device: FixedCamera, task: Task) -> None:
    """Whether the camera is in order, and the object in view now."""
    await device.in_order()
    object = str(task.inputs["Object"])
    if object not in await device.view():
        raise Refusal(f"{device.name} does not see {object}")


async def _price(device: FixedCamera, task: Task) -> float | str:
    return await device.price(task, 0.0)


class FixedCamera(SimulatedDevice):
    """A camera in the simulator that stays where it is."""

    type = "Camera"
    features = ("OperationRange", "FieldOfView", "Price")
    mobile = False

    async def view(self) -> dict[str, Seen]:
        """What it sees now, by name."""
        try:
            return {seen.object: seen for seen in (await self.persistent(self._link.sense)).seen}
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}") from None

    @service("RecognizeSituation", price=_price, duration="1 s", able=_able)
    async def recognize(self, task: Task) -> Situation:
        object = str(task.inputs["Object"])
        try:
            seen = await self.view()
        except Refusal as silent:
            raise ServiceFailed(str(silent), self._out_of_order()) from None
        if object not in seen:
            raise ServiceFailed(f"{self.name} does not see {object} any more")
        return await recognised(task, object, seen)

    @recognize.compensation
    async def leave_as_it_is(self, task: Task, situation: Formula) -> Situation:
        """Whoever only looked has nothing to undo."""
        return f"{self.name}.Working = TRUE"
