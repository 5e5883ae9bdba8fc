"""What the sonar of a robot has seen lately, as points on the map, and how far the robot can drive before it touches one."""

from __future__ import annotations

import math

from somrs.adapters.arcos.messages import Status
from somrs.adapters.arcos.odometry import Pose
from somrs.adapters.arcos.parameters import Parameters
from somrs.adapters.arcos.steering import Line

FRESH = 1.5
"""Seconds for which an echo counts. Each of the discs fires at least three times a second."""
LARGEST_RANGE = 2.5
"""Echoes from farther away are too uncertain to stop for, m."""
GAP = 0.15
"""The robot stops this far from an obstacle, m."""
MARGIN = 0.05
"""What is at most so much nearer than the robot comes, m, it was sent to."""


class SonarMap:
    """The points of the last echoes, one for each sonar disc."""

    def __init__(self) -> None:
        self._echoes: dict[int, tuple[float, float, float]] = {}

    def update(self, status: Status, pose: Pose, parameters: Parameters, now: float) -> None:
        """Take in the new ranges of a report; `pose`: of the robot, when it was sent."""
        cosine, sine = math.cos(pose.yaw), math.sin(pose.yaw)
        for number, units in status.sonar:
            if number >= len(parameters.sonar):
                continue
            disc, distance = parameters.sonar[number], units * parameters.range_metres
            if distance > LARGEST_RANGE:
                self._echoes.pop(number, None)
                continue
            x, y = disc.x + distance * math.cos(disc.heading), disc.y + distance * math.sin(disc.heading)
            self._echoes[number] = pose.x + x * cosine - y * sine, pose.y + x * sine + y * cosine, now

    def gap(self, line: Line, pose: Pose, distance: float, half_width: float, now: float) -> float | None:
        """How far the robot can drive along the line before it touches something, m; None if there is nothing within `distance`, m.
        `half_width`: of the robot, m, whose front is round."""
        direction = line.yaw + (math.pi if line.backward else 0.0)
        cosine, sine = math.cos(direction), math.sin(direction)
        gaps = []
        for x, y, time in self._echoes.values():
            dx, dy = x - pose.x, y - pose.y
            ahead, aside = dx * cosine + dy * sine, dy * cosine - dx * sine
            if now - time <= FRESH and ahead > 0 and abs(aside) < half_width:
                gaps.append(ahead - math.sqrt(half_width**2 - aside**2))
        nearest = min(gaps, default=math.inf)
        return max(0.0, nearest) if nearest < distance - MARGIN else None
