"""The maps of vehicles, and where they lie on the map of the site."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


def sent_angle(radians: float) -> float:
    """An angle as it is sent: to four decimals, and between -π and π (3.0, 7.3). Rounded, π would be more than that."""
    return max(-math.pi, min(math.pi, round(math.remainder(radians, math.tau), 4)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """`x`, `y` in metres and `yaw` in radians on the map of the site; `level`: the height of the floor in metres, None: as before."""

    x: float
    y: float
    yaw: float
    level: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A map of vehicles: where its origin lies on the map of the site (metres), how it is turned (radians), and on which floor (metres)."""

    map_id: str
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    level: float | None = None

    def to_site(self, x: float, y: float, theta: float) -> Pose:
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        yaw = math.remainder(theta + self.yaw, math.tau)
        return Pose(x=self.x + cos * x - sin * y, y=self.y + sin * x + cos * y, yaw=yaw, level=self.level)

    def from_site(self, x: float, y: float) -> tuple[float, float]:
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        dx, dy = x - self.x, y - self.y
        return cos * dx + sin * dy, -sin * dx + cos * dy


class Frames:
    """All maps of the vehicles of a site. If there are none, each map of a vehicle is the map of the site itself."""

    def __init__(self, frames: Sequence[Frame] = ()) -> None:
        self._frames: Mapping[str, Frame] = {frame.map_id: frame for frame in frames}

    @property
    def all(self) -> tuple[Frame, ...]:
        """Those that the settings name."""
        return tuple(self._frames.values())

    def has(self, map_id: str) -> bool:
        """Whether it is known where this map lies."""
        return not self._frames or map_id in self._frames

    def frame(self, map_id: str) -> Frame:
        return self._frames.get(map_id) or Frame(map_id=map_id)

    def frame_at(self, level: float, map_id: str) -> Frame:
        """The map of a floor: the one of the nearest level. `map_id`: the map on which the vehicle is, which has precedence among equals,
        and is taken if no map has a level."""
        current = self.frame(map_id)
        candidates = [frame for frame in self._frames.values() if frame.level is not None]
        if not candidates:
            return current
        return min(candidates, key=lambda frame: (round(abs((frame.level or 0.0) - level), 3), frame.map_id != map_id, frame.map_id))
