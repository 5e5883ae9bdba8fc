"""A scale, a program that picks shelves, and porters: one cognitive, one software and one physical service.

PYTHONPATH=examples somrs up examples/weighing.yaml
"""

import asyncio

from somrs import Device, Refusal, Situation, Task, service
from somrs.service_manager import Result

WEIGHTS = {"Parcel001": 1.2, "Parcel002": 6.5}
"""Kilograms. A real scale asks its load cell."""


class Scale(Device):
    """Finds out what the parcel weighs that stands on it."""

    type = "Scale"

    @service("WeighParcel", price="0.10 EUR", duration="1 s")
    async def weigh(self, task: Task) -> Result:
        await asyncio.sleep(1)
        return Result(outputs={"Weight": WEIGHTS[str(task.inputs["Parcel"])]})  # with it, the arranged effect is the situation


class ShelfProgram(Device):
    """Picks a shelf on which nothing stands, and which is not reserved."""

    type = "ShelfProgram"

    @service("PickShelf", duration="0.1 s")
    async def pick(self, task: Task) -> Result:
        free = await task.map.query("?Shelf: Shelf.Shape.Form = Box AND NOT ?Thing isOn ?Shelf AND NOT ?Shelf isReservedFor ?Parcel")
        if not free:
            raise Refusal("all shelves are taken")
        return Result(outputs={"Shelf": free[0]["Shelf"]})


class Porter(Device):
    """Carries a parcel that is not too heavy for it. This one only takes its time; a real one drives and grips."""

    type = "Porter"

    async def price(self, task: Task) -> float:
        porter = await self.map.object(self.name)
        return float(porter.values["Price"]) if porter is not None else 0.0

    @service("CarryParcel", price=price, duration="2 s")
    async def carry(self, task: Task) -> Situation:
        await task.progress(0.1, note=f"takes {task.inputs['Parcel']} to {task.inputs['Destination']}")
        await asyncio.sleep(2)
        return None  # the arranged effect holds
