"""Whether a robot can be reached, and since when not."""

from __future__ import annotations

import asyncio

UNHEARD = "nothing is heard of it"
"""Why a robot cannot be reached that does not say it."""


class Reach:
    """That of one robot."""

    def __init__(self) -> None:
        self.connected = asyncio.Event()
        self.silence: str | None = UNHEARD
        """Why it cannot be reached, for people; None: it can."""
        self.is_reported = False
        """Whether its program says it; otherwise, a robot that says where it is can be reached."""
        self._loss_time = 0.0

    def note(self, silence: str | None) -> bool:
        """The robot cannot be reached, for this reason; None: it can. Returns whether it is lost or back by that."""
        was_connected, self.silence = self.connected.is_set(), silence
        if silence is None:
            self.connected.set()
        elif was_connected:
            self.connected.clear()
            self._loss_time = asyncio.get_running_loop().time()
        return was_connected is not self.connected.is_set()

    async def wait_reconnected(self, timeout: float) -> bool:
        """Wait until the robot can be reached, at most until `timeout` seconds after it was lost. Returns whether it can."""
        remaining = self._loss_time + timeout - asyncio.get_running_loop().time()
        if not self.connected.is_set() and remaining > 0:
            try:
                async with asyncio.timeout(remaining):
                    await self.connected.wait()
            except TimeoutError:
                pass
        return self.connected.is_set()
