"""The driver's part for a simulated robot with a gripper that opens and closes doors, and the doors of furniture."""

from __future__ import annotations

from somrs.devices.simulator.drivers.mobile_robot import MobileRobot
from somrs.devices.simulator.drivers.simulated import is_of_type, was_open
from somrs.devices.simulator.link.lines import HANDLES
from somrs.entish.formula import Formula
from somrs.service_manager.sdk.device import Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal

OPENING_TIME = 25.0
"""Time to grip the handle of a leaf, to move it and to release it, s."""


async def _able(device: OpeningRobot, task: Task) -> None:
    """Check that the robot works, and that its gripper is free. Raises Refusal."""
    state = await device.check_able(task)
    if await is_of_type(task, _object_of(task), "PoweredDoor"):
        raise Refusal(f"{_object_of(task)} has a drive, which opens and closes it")
    if state.holding is not None:
        raise Refusal(f"{device.name} holds {state.holding}, and needs its gripper for the handle")


async def _price(device: OpeningRobot, task: Task) -> float | str:
    return await device.price(task, await device.way_to_door(task) if device.price_per_metre else 0.0)


async def _duration(device: OpeningRobot, task: Task) -> float:
    return round(OPENING_TIME + await device.driving_time(task, await device.way_to_door(task)), 1)


class OpeningRobot(MobileRobot):
    """A mobile robot with a gripper that takes handles."""

    async def way_to_door(self, task: Task) -> float:
        """The driving distance to the handle of what is to be opened or closed, m. Raises Refusal when there is no path."""
        name = _object_of(task)
        legs = await self._legs_to(task, name + HANDLES)
        (way,) = legs.lengths
        if way is None:
            problem = "can stand nowhere from where" if legs.out_of_reach else "finds no path to a place from which"
            raise Refusal(f"{self.name} {problem} it could move the door of {name}")
        return way

    @service("OpenDoor", price=_price, duration=_duration, able=_able, inputs=("Door",))
    async def open_door(self, task: Task) -> Situation:
        return await self._move_doors(task, opening=True)

    @service("CloseDoor", price=_price, duration=_duration, able=_able, inputs=("Door",))
    async def close_door(self, task: Task) -> Situation:
        return await self._move_doors(task, opening=False)

    @service("OpenCupboard", price=_price, duration=_duration, able=_able, inputs=("Cupboard",))
    async def open_cupboard(self, task: Task) -> Situation:
        return await self._move_doors(task, opening=True)

    @service("CloseCupboard", price=_price, duration=_duration, able=_able, inputs=("Cupboard",))
    async def close_cupboard(self, task: Task) -> Situation:
        return await self._move_doors(task, opening=False)

    @open_door.stopping
    @close_door.stopping
    @open_cupboard.stopping
    @close_cupboard.stopping
    async def let_go(self, task: Task) -> Situation:
        """Stop, and release the handle."""
        return await self._commanded(task, self._link.stop)

    @open_door.compensation
    @close_door.compensation
    @open_cupboard.compensation
    @close_cupboard.compensation
    async def restore_door(self, task: Task, situation: Formula) -> Situation:
        """Open or close it as it was."""
        return await self._move_doors(task, opening=was_open(_object_of(task), situation))

    async def _move_doors(self, task: Task, *, opening: bool) -> str:
        name, command = _object_of(task), self._link.open_doors if opening else self._link.close_doors
        note = f"{'opens' if opening else 'closes'} {name}"
        return await self._commanded(task, lambda: self._driving(task, command(name), 0.05, 0.95, note))


def _object_of(task: Task) -> str:
    return str(task.inputs["Door"] if "Door" in task.inputs else task.inputs["Cupboard"])
