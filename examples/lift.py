"""A lift of your own in one file: its controller takes the cabin to a floor, and says when people use it.

python examples/lift.py --name Lift1
"""

import asyncio

from somrs import LiftDevice, PassageCall, run


class Controller:
    """Stands for the controller of the lift. Write here what talks to yours."""

    def __init__(self) -> None:
        self.level = 0.0

    async def move(self, level: float) -> None:
        """Shut the doors, take the cabin to a floor, and open them."""
        await asyncio.sleep(1)
        self.level = level

    async def end(self) -> None:
        """Let people use the lift again."""


class MyLift(LiftDevice):
    """A lift on the map that takes robots where traffic calls it."""

    async def open(self) -> None:
        self.controller = Controller()
        self.status(level=self.controller.level)

    async def serve(self, call: PassageCall) -> None:
        assert call.level is not None
        if call.level != self.controller.level:
            self.status(level=None)
            await self.controller.move(call.level)
            self.status(level=call.level)

    async def release(self) -> None:
        await self.controller.end()


if __name__ == "__main__":
    run(MyLift)
