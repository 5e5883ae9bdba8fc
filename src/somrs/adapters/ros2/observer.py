"""Who is told what a robot with ROS 2 says."""

from __future__ import annotations

from typing import Protocol

from somrs.ontology.types import Value


class Robot(Protocol):
    """The device of the robot. Poses are on the map of the building."""

    def located(self, x: float, y: float, yaw: float, level: float | None = None) -> None: ...

    def passed(self, number: int) -> None: ...

    def gave_up(self, description: str) -> None: ...

    def broken(self, reason: str | None) -> None: ...

    def lost(self, reason: str | None) -> None: ...

    def heard(self, is_connected: bool, reason: str | None = None) -> None: ...

    def hindered(self, hindrance: str | None) -> None:
        """The robot does not do what it is told, for this reason; None: it does again."""

    def measured(self, attribute: str, value: Value) -> None:
        """An attribute of the robot has this value."""
