"""What is in the way on a roadmap."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from somrs.traffic.obstructions import Obstructions
from somrs.traffic.roadmap import Lane, NumberedRoadmap, Place, Roadmap

RADIUS = 0.3
STEP = 0.7
DIRECTIONS = {"East": 0, "NorthEast": 60, "NorthWest": 120, "West": 180, "SouthWest": 240, "SouthEast": 300}


def star() -> NumberedRoadmap:
    """A place, and the six around it."""
    around = {name: (STEP * math.cos(math.radians(angle)), STEP * math.sin(math.radians(angle))) for name, angle in DIRECTIONS.items()}
    places = [Place(name=name, x=x, y=y, radius=RADIUS) for name, (x, y) in {"Middle": (0.0, 0.0), **around}.items()]
    lanes = [Lane(start=start, end=end, seconds=1.0) for name in around for start, end in (("Middle", name), (name, "Middle"))]
    return NumberedRoadmap(Roadmap(places=tuple(places), lanes=tuple(lanes), spacing=STEP))


def test_who_is_where_something_was_put_leaves_by_the_lanes_that_lead_away_from_it() -> None:
    roadmap = star()

    def room(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.hypot(points[:, 0] - 0.25, points[:, 1]) - 0.05)  # a thing in the east of the middle

    places, lanes = Obstructions(roadmap).blocked(0.0, room)
    names = roadmap.names
    assert [names[place] for place in places] == ["Middle"]
    assert {names[end] for start, end in lanes if names[start] == "Middle"} == {"East", "NorthEast", "SouthEast"}
    assert all(names[start] == "Middle" for start, _ in lanes)
