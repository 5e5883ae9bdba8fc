"""The dimensions of a simulated robot, for its body, its motions and its pictures."""

from __future__ import annotations

from dataclasses import dataclass

from somrs.space.solids import Solid

FINGER = 0.11
"""Length of the fingers, m."""
OPENING = 0.085
"""Largest distance of each finger from the middle, m."""
ROBOT_HEIGHT = 1.85
"""Height that a robot is taken to need above its floor, m."""
EVEN = 0.02
"""What rises less than this above a floor is no obstacle there, m."""


@dataclass(frozen=True, slots=True)
class Dimensions:
    """Lengths of a robot that follow from the radius and the height of its base, m."""

    base: float
    height: float
    gripper: bool

    @property
    def radius(self) -> float:
        """Radius of the circle that contains the robot when its boom is drawn in."""
        return self.base + (0.05 if self.gripper else 0.0)

    @property
    def hang(self) -> float:
        """Distance from the boom down to the finger tips: the boom clears the base when the tips are at the floor."""
        return self.height + 0.03

    @property
    def nearest(self) -> float:
        """Smallest distance of the hand from the turret's axis at which it can descend beside the base."""
        return self.base + 0.14

    @property
    def farthest(self) -> float:
        return self.base + 0.42

    @property
    def drawn_in(self) -> float:
        return 0.45 * self.base

    @property
    def clear(self) -> float:
        """Height of the finger tips when they pass above the base."""
        return self.height + 0.04


def dimensions_of(solid: Solid) -> Dimensions:
    return Dimensions(solid.extent, solid.height, solid.gripper)
