"""The world through which robots drive, as far as their ways depend on it: that of a simulation, or a building on the map."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Protocol

from somrs.space.clearance import Disc
from somrs.space.dimensions import Dimensions
from somrs.space.distances import Array
from somrs.space.solids import Solid
from somrs.space.zones import Zones
from somrs.traffic.roadmap import RobotKind
from somrs.traffic.ways import Ways


class Driver(Protocol):
    """A robot for which ways are found."""

    @property
    def name(self) -> str: ...

    @property
    def size(self) -> Dimensions: ...

    @property
    def solid(self) -> Solid: ...

    @property
    def level(self) -> float:
        """The height of its floor, m."""

    @property
    def kind(self) -> RobotKind:
        """For which places of the roadmap it is."""

    def pose(self) -> tuple[float, float, float]:
        """Where it is: x and y in metres, and its yaw."""


class DrivenWorld(Protocol):
    """The world through which robots drive, as far as ways depend on it. Heights and positions are in metres."""

    @property
    def solids(self) -> Mapping[str, Solid]:
        """Everything with a body, by name."""

    def pose(self, name: str) -> tuple[float, float, float, float]:
        """The middle of an object's underside, and its yaw."""

    def container(self, name: str) -> str | None:
        """That in which a thing is; None if it is in nothing, or if a robot holds it."""

    def clearances(self, points: Array, low: float, high: float, ignored: Iterable[str] = ()) -> Array:
        """The distance from each point (n, 2) to the nearest static solid between two heights."""

    def has_leaves(self, owner: str) -> bool:
        """Whether robots can move doors of this object."""

    def leaf_ways(self, owner: str, is_open: bool) -> tuple[tuple[float, float], ...]:
        """By leaf: from where to where a robot moves it, if the object is open then, or not."""

    def leaf_bases(self, driver: Driver, owner: str, ways: Sequence[tuple[float, float]], level: float) -> list[Array]:
        """By leaf: where a robot stands to move it on this way."""

    def ways(self) -> Ways:
        """The ways on the roadmap."""

    @property
    def doors_for_all(self) -> Collection[str]:
        """The doors that open for robots by themselves."""

    @property
    def unusable_doors(self) -> Collection[str]:
        """The doors that nobody opens now."""

    @property
    def unusable_lifts(self) -> Collection[str]:
        """The lifts that nobody enters now."""

    @property
    def zones(self) -> Zones:
        """Those that operators have drawn."""

    def standing(self, driver: Driver) -> Iterable[tuple[float, Disc]]:
        """The other robots that cannot move, and the heights of their floors."""
