"""An automatic door of your own in one file.

python examples/automatic_door.py --name Door1
"""

import asyncio

from somrs import DoorDevice, PassageCall, run


class MyDoor(DoorDevice):
    """A door on the map that opens for the robots that are to drive through it."""

    async def open(self) -> None:
        self.status()

    async def serve(self, call: PassageCall) -> None:
        await asyncio.sleep(1)  # write here what opens your door, and waits until it is open

    async def release(self) -> None:
        pass  # write here what lets it shut, when nobody is in it


if __name__ == "__main__":
    run(MyDoor)
