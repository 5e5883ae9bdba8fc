"""The driver of a simulated scale, which finds out what a thing weighs that stands on it."""

from __future__ import annotations

from somrs.devices.simulator.drivers.simulated import SimulatedDevice, weights_of
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.entish.formula import Formula
from somrs.service_manager.sdk.device import Result, Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed


async def _able(device: Scale, task: Task) -> None:
    """Check that the scale works, and that the thing stands on it alone. Raises Refusal, with what would make it possible."""
    await device.check_working()
    object = str(task.inputs["Object"])
    if not await task.map.holds(f"{object} isOn {device.name}"):
        raise Refusal(f"{object} does not stand on {device.name}", condition=f"{object} isOn {device.name}")
    other_things = [str(row["Other"]) for row in await task.map.query(f"?Other isOn {device.name}") if row["Other"] != object]
    if other_things:
        condition = " AND ".join(f"NOT {other_thing} isOn {device.name}" for other_thing in other_things)
        raise Refusal(f"{device.name} can weigh {object} only alone, and {', '.join(other_things)} is on it, too", condition=condition)


class Scale(SimulatedDevice):
    """A scale in the simulator."""

    type = "Scale"
    features = ("Price",)
    mobile = False

    @service("WeighObject", price=SimulatedDevice.price, duration="2 s", able=_able, inputs=("Object",), outputs=("Weight",))
    async def weigh(self, task: Task) -> Result:
        object = str(task.inputs["Object"])
        try:
            result = await self.retry_when_link_lost(lambda: self._link.weigh(object))
        except RobotGaveUp as failure:
            raise ServiceFailed(failure.description, self._out_of_order() if self.is_out_of_order(failure) else None) from failure
        return Result(outputs={"Weight": weights_of(result.object_states)[object]})

    @weigh.compensation
    async def compensate_weighing(self, task: Task, situation: Formula) -> Situation:
        """A measurement leaves nothing to undo."""
        return f"{self.name}.Working = TRUE"
