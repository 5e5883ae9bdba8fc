"""What a robot's numbers mean, and how fast it may be: the parameters of Pioneer robots.

The controller sends distances and angles in units of its own. The parameter file of a robot (`p3dx.p` and the like, which come with the
robot) has the factors; those of the common types are here.
"""

from __future__ import annotations

import math
import re

from msgspec import Struct
from msgspec.structs import replace

from somrs.errors import UsageError


class SonarDisc(Struct, frozen=True, kw_only=True):
    """A sonar disc of the robot: its place from the centre, m (x: ahead, y: to the left), and where it looks, rad."""

    x: float
    y: float
    heading: float


def _disc(x: float, y: float, degrees: float) -> SonarDisc:
    return SonarDisc(x=x / 1000, y=y / 1000, heading=math.radians(degrees))


# Sonar of the P3-DX, mm and degrees (Operations Manual, figure 12, and its parameter file).
_FRONT = ((69, 136, 90), (114, 119, 50), (148, 78, 30), (166, 27, 10), (166, -27, -10), (148, -78, -30), (114, -119, -50), (69, -136, -90))
_REAR = (
    (-157, -136, -90), (-203, -119, -130), (-237, -78, -150), (-255, -27, -170),
    (-255, 27, 170), (-237, 78, 150), (-203, 119, 130), (-157, 136, 90),
)  # fmt: skip


class Parameters(Struct, frozen=True, kw_only=True):
    """Factors from the robot's units to metres, radians and m/s, and the robot's body.

    `half_width`: of the lane that it needs when it drives straight on, m. `axle`: the distance of its wheels, m. `speed`, `turning`: the
    largest velocities, m/s and rad/s; `acceleration`, `turning_acceleration`: with which it brakes, m/s² and rad/s². `watchdog`: seconds
    after which it stops if it has heard nothing.
    """

    metres: float = 0.001
    radians: float = 2 * math.pi / 4096
    speed_metres: float = 0.001
    range_metres: float = 0.001
    half_width: float = 0.21
    axle: float = 0.33
    sonar: tuple[SonarDisc, ...] = tuple(_disc(*place) for place in (*_FRONT, *_REAR))
    speed: float = 0.5
    turning: float = 1.0
    acceleration: float = 0.3
    turning_acceleration: float = 1.5
    watchdog: float = 2.0


TYPES = {
    "p3dx": Parameters(metres=0.000485),
    "p3dx-sh": Parameters(),
    "p3at": Parameters(metres=0.000465, half_width=0.25, axle=0.4),
    "p3at-sh": Parameters(half_width=0.25, axle=0.4),
}
"""Parameters by the subclass that a robot says when a session begins."""

_NUMBER = re.compile(r"^\s*(\w+)\s+(-?[\d.]+(?:[eE][-+]?\d+)?)")
_FACTORS = {"DistConvFactor": "metres", "VelConvFactor": "speed_metres", "RangeConvFactor": "range_metres"}


def read_parameters(text: str, defaults: Parameters) -> Parameters:
    """The parameters of a robot's parameter file, in its own format: lines with a name and values, comments after `;`.

    What the file does not have is as in `defaults`. Raises UsageError for a factor that is not positive.
    """
    changes: dict[str, float] = {}
    discs: dict[int, SonarDisc] = {}
    for line in text.splitlines():
        words = line.split(";")[0].split()
        if words[:1] == ["SonarUnit"] and len(words) >= 5:
            discs[int(words[1])] = _disc(*(float(word) for word in words[2:5]))
        elif match := _NUMBER.match(line):
            name, number = match[1], float(match[2])
            if name in _FACTORS:
                changes[_FACTORS[name]] = number / 1000
            elif name == "RobotWidth":
                changes["half_width"] = number / 2000
            elif name == "AngleConvFactor":
                changes["radians"] = _exact_angle(number)
    for field, number in changes.items():
        if number <= 0:
            raise UsageError(f"the parameter file has no positive number for `{field}`: take the file that belongs to the robot")
    sonar = tuple(discs[number] for number in range(len(discs)) if number in discs) or defaults.sonar
    return replace(defaults, sonar=sonar, **changes)


def _exact_angle(factor: float) -> float:
    """Parameter files have the angle of 1/4096 turn with three digits, which would be 1 degree wrong after one turn."""
    exact = 2 * math.pi / 4096
    return exact if abs(factor - exact) < 0.01 * exact else factor
