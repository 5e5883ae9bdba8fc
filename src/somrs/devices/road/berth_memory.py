"""The berths of a robot that ways may lead to or from, and the headings that it is to have there."""

from __future__ import annotations

from collections.abc import Collection

from somrs.protocol.messages.traffic import Berth

REMEMBERED = 8
"""How many of the last berths are remembered, besides those in use."""


class BerthMemory:
    """Those of one robot."""

    def __init__(self) -> None:
        self._berths: dict[str, Berth] = {}
        self._yaws: dict[str, float] = {}
        self._used: Collection[str] = ()

    def remember(self, berth: Berth, yaw: float | None) -> None:
        """Keep a berth. `yaw`: the heading that the robot is to have there, rad."""
        used = [name for name in self._berths if name in self._used]
        self._berths = {name: self._berths[name] for name in (*used, *[*self._berths][-REMEMBERED:])} | {berth.name: berth}
        self._yaws = {name: heading for name, heading in self._yaws.items() if name in self._berths}
        if yaw is not None:
            self._yaws[berth.name] = yaw

    def use(self, names: Collection[str]) -> None:
        """The last way leads through these places, and the robot is on it: their berths are not forgotten."""
        self._used = names

    def berth(self, name: str) -> Berth | None:
        return self._berths.get(name)

    def yaw(self, name: str) -> float | None:
        return self._yaws.get(name)
