"""Whatever happens on the line and to the robot: it never leaves what is released, and comes to its goal when the faults are over."""

from __future__ import annotations

import math
import random

from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.adapters.arcos.events import Broken, Follow, GaveUp, Passed
from somrs.devices.road_robot import Way
from tests.support.pioneers import Line, Pioneer, damaged, perfect, way

OUTSIDE = 0.15
"""How far from what is released a robot may be, m: it turns and brakes."""


class Trial:
    """A robot that is sent along drawn ways, a piece at a time, and has drawn faults meanwhile."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.pioneer = Pioneer(watchdog=self.chance.choice((0.5, 2.0))).ready()
        self.number = 1
        self.points = [(0.0, 0.0)]
        self.released = 1
        self.farthest = 0.0

    def go_on(self) -> None:
        """Have one more thing happen, and let some time pass. Who gave up gets another way, which begins where it stands."""
        if self.has_given_up:
            return
        pioneer, chance = self.pioneer, self.chance
        match chance.randrange(10):
            case 0:
                pioneer.to_robot = self._line()
            case 1:
                pioneer.from_robot = self._line()
            case 2 if pioneer.is_connected:
                pioneer.disconnect()
            case 3:
                pioneer.firmware.is_silent = not pioneer.firmware.is_silent
            case 4:
                self._mend()
            case 5 if not pioneer.is_connected:
                pioneer.connect()
            case _:
                self._release_more()
        self.run(chance.uniform(0.1, 6.0))

    @property
    def has_given_up(self) -> bool:
        return any(isinstance(effect, GaveUp) for effect in self.pioneer.effects)

    def run(self, seconds: float) -> None:
        end = self.pioneer.now + seconds
        while self.pioneer.now < end:
            self.pioneer.run(0.1)
            self.farthest = max(self.farthest, self._distance_to_released())

    def finish(self) -> bool:
        """Mend everything, and have the robot drive to its end. Returns whether it comes there."""
        self._mend()
        if not self.pioneer.is_connected:
            self.pioneer.connect()
        self.released = len(self.points)
        self.pioneer.give(Follow(self._way()))
        end = len(self.points)
        return end == 1 or self.pioneer.run(120 + 60 * end, lambda: Passed(end) in self.pioneer.effects and self.pioneer.stands())

    def _line(self) -> Line:
        if self.chance.random() < 0.3:
            return lambda data: b""
        share = self.chance.choice((0.001, 0.01, 0.05))
        return lambda data: damaged(data, self.chance, share)

    def _mend(self) -> None:
        self.pioneer.to_robot = self.pioneer.from_robot = perfect
        self.pioneer.firmware.is_silent = False

    def _release_more(self) -> None:
        if self.released == len(self.points):
            x, y = self.points[-1]
            angle, distance = self.chance.uniform(-math.pi, math.pi), self.chance.uniform(0.3, 2.0)
            self.points.append((x + distance * math.cos(angle), y + distance * math.sin(angle)))
        else:
            self.released += 1
        self.pioneer.give(Follow(self._way()))

    def _way(self) -> Way:
        return way(*self.points, released=self.released)

    def _distance_to_released(self) -> float:
        place = self.pioneer.body.place
        released = self.points[: self.released]
        return min(_distance((place.x, place.y), start, end) for start, end in zip(released, [*released[1:], released[-1]], strict=True))


def _distance(point: tuple[float, float], start: tuple[float, float], end: tuple[float, float]) -> float:
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = dx * dx + dy * dy
    share = ((point[0] - start[0]) * dx + (point[1] - start[1]) * dy) / length if length else 0.0
    share = min(1.0, max(0.0, share))
    return math.dist(point, (start[0] + share * dx, start[1] + share * dy))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**9))
def test_a_robot_stays_in_what_is_released_and_comes_to_its_end(seed: int) -> None:
    trial = Trial(seed)
    for _ in range(12):
        trial.go_on()
    assert trial.farthest < OUTSIDE
    assert not [effect for effect in trial.pioneer.effects if isinstance(effect, Broken)]
    if not trial.has_given_up:
        assert trial.finish()
        assert trial.pioneer.distance_to(*trial.points[-1]) < 0.1
