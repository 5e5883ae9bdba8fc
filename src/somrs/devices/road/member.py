"""What a device has that takes part in traffic as a robot; without the libraries that the robot itself needs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology


class WholeMap(Protocol):
    """Reads the map of the system, of which the device's process has a copy."""

    async def __call__(self, *, is_current: bool = True) -> tuple[Map, Ontology]:
        """The map and the ontology as they are now; if it need not be `is_current`, as they were when the last news came. Raises
        RemoteError."""


class RoadHardware(Protocol):
    """The hardware of a robot, for its program in traffic."""

    tell: Callable[[object], None]
    """Notifies the program."""

    async def carry_out(self, task: object) -> object:
        """Do what the program asks for. Raises RemoteError."""


@runtime_checkable
class RoadMember(Protocol):
    """A device that drives where traffic grants it."""

    road: RoadHardware
    whole_map: WholeMap
