"""The things that the map has on a floor, and which of them a robot sees to be gone."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from somrs.devices.simulator.drivers.watching import REACH
from somrs.devices.simulator.link.commands import CommandDone, Point

SAME_THING = 0.3
"""Something that is seen so near to where a thing should be may be the thing, m."""
LEAST_LOOKS = 2
"""So many looks have to show that a thing is gone."""


class ExpectedThings:
    """The things of the map, by name, each with a point of it that is seen if nothing hides it."""

    def __init__(self, points: Mapping[str, Point]) -> None:
        self._points = dict(points)
        self._looks: Counter[str] = Counter()
        """How often each was not where it should be, although nothing hid the place."""

    @property
    def points(self) -> tuple[Point, ...]:
        """Where something should be: what a look is to tell of them."""
        return tuple(self._points.values())

    def gone(self, view: CommandDone) -> list[str]:
        """The things that this look and earlier ones show to be gone, each once. `view`: the look, in which `points` were expected."""
        names = [*self._points]
        for name in (names[number] for number in view.clear):
            point = self._points[name]
            is_explained = any(
                math.dist((sighting.x, sighting.y), (point.x, point.y)) <= (REACH if sighting.robot else SAME_THING)
                for sighting in view.sightings
                if not sighting.furniture
            )
            self._looks[name] = 0 if is_explained else self._looks[name] + 1
        missing = [name for name in names if self._looks[name] >= LEAST_LOOKS]
        for name in missing:
            del self._points[name]
            del self._looks[name]
        return missing
