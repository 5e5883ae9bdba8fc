"""The driver of a simulated door with a drive, which opens and closes itself."""

from __future__ import annotations

from somrs.devices.simulator.drivers.mobile_robot import describe_doors
from somrs.devices.simulator.drivers.simulated import SimulatedDevice, was_open
from somrs.devices.simulator.link.commands import CommandDone
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.entish.formula import Formula
from somrs.service_manager.sdk.device import Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed


async def _able(device: PoweredDoor, task: Task) -> None:
    """Check that the order is for this door, and that its drive works. Raises Refusal."""
    if task.inputs["Door"] != device.name:
        raise Refusal(f"{device.name} opens and closes only itself")
    await device.check_working()


class PoweredDoor(SimulatedDevice):
    """A door with a drive in the simulator."""

    type = "PoweredDoor"
    features = ("Price",)
    mobile = False

    @service("OpenDoor", price=SimulatedDevice.price, duration="6 s", able=_able, inputs=("Door",))
    async def open_door(self, task: Task) -> Situation:
        return await self._move(opening=True)

    @service("CloseDoor", price=SimulatedDevice.price, duration="6 s", able=_able, inputs=("Door",))
    async def close_door(self, task: Task) -> Situation:
        return await self._move(opening=False)

    @open_door.stopping
    @close_door.stopping
    async def stop_leaf(self, task: Task) -> Situation:
        return self._described(await self.retry_when_link_lost(self._link.stop))

    @open_door.compensation
    @close_door.compensation
    async def restore(self, task: Task, situation: Formula) -> Situation:
        """Open or close the door as it was."""
        return await self._move(opening=was_open(self.name, situation))

    async def _move(self, *, opening: bool) -> str:
        command = self._link.open_doors if opening else self._link.close_doors
        try:
            return self._described(await self.retry_when_link_lost(lambda: command(self.name)))
        except RobotGaveUp as failure:
            is_broken = self.is_out_of_order(failure) or not failure.object_states
            parts = [*describe_doors(failure.object_states), *([self._out_of_order()] if is_broken else [])]
            raise ServiceFailed(failure.description, " AND ".join(parts)) from failure

    def _described(self, result: CommandDone) -> str:
        return " AND ".join(describe_doors(result.object_states))
