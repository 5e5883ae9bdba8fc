"""What the robots of the simulator do, and where they come to stand: the truth, whatever their programs know."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Mapping

from somrs.devices.simulator.link.commands import RobotState
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.link.roads import RoadPoint
from somrs.space.lines import point_distance
from verification.adapter_runs.cases import Phase
from verification.adapter_runs.site import ROBOTS, UPPER

LOOK = 0.05
"""Seconds between two looks at the world."""
STANDING_TIME = 45.0
"""Within this time robots have to stand when nobody tells them anything, in seconds: the base of an order can be some metres long."""
MOST_OFFSET = 0.5
"""How far beside what was granted a robot may come to stand, in metres: it cuts corners, and brakes."""
STILL, STILL_LOOKS = 0.005, 10
"""Robots stand if they move by no more than this at so many looks, 0.2 s apart, in metres."""
WITHIN_REACH = 0.95
"""So near to a thing or a support, a robot has begun to work with it, in metres, whatever its arm is like."""
DOOR = (4.0, 3.0)
"""Where the door is."""
LANDING = 0.1
"""A robot that is higher than this over a floor, and so far below the next one, rides in the lift, in metres."""

States = Mapping[str, RobotState]


class Watch:
    """Looks at the robots of a simulator. `robot`: the one that does what is waited for."""

    def __init__(self, operator: OperatorLink, thing: str) -> None:
        self._operator, self._thing = operator, thing
        self.robot = ""

    async def until(self, phase: Phase) -> None:
        """Wait until a robot is in a phase of its task."""
        start = await self._operator.robots()
        thing = await self._operator.observe(self._thing)
        platform = await self._operator.observe("Platform1")
        while not self.robot:
            states = await self._operator.robots()
            for name in ROBOTS:
                state, begin = states[name], start[name]
                driven = math.dist((state.x, state.y), (begin.x, begin.y))
                to_thing, to_platform = (math.dist((state.x, state.y), (goal.x, goal.y)) for goal in (thing, platform))
                is_there = {
                    Phase.FETCHING: driven > 0.2,
                    Phase.PICKING: state.activity == "Grip" or (state.holding is None and to_thing < WITHIN_REACH),
                    Phase.CARRYING: state.holding is not None and to_thing > WITHIN_REACH + 0.2,
                    Phase.DROPPING: state.activity == "Place" or (state.holding is not None and to_platform < WITHIN_REACH),
                    Phase.CHARGING: state.activity == "Charge",
                    Phase.PASSING: state.holding is not None and math.dist((state.x, state.y), DOOR) < 1.5,
                    Phase.RIDING: state.holding is not None and LANDING < (state.z or 0.0) < UPPER - LANDING,
                }
                if is_there[phase]:
                    self.robot = name
            await asyncio.sleep(LOOK)

    async def granted(self) -> dict[str, tuple[RoadPoint, ...]]:
        """What traffic has granted to each robot, after where it is."""
        states, view = await self._operator.robots(), await self._operator.traffic()
        grants = {name: view.robots[name].granted if name in view.robots else () for name in ROBOTS}
        return {name: ((states[name].x, states[name].y, 0.0), *grants[name]) for name in ROBOTS}

    async def stand(self) -> str | None:
        """Wait until the robots stand. Returns what is wrong if they do not."""
        end, still_looks, states = time.monotonic() + STANDING_TIME, 0, await self._operator.robots()
        while still_looks < STILL_LOOKS:
            await asyncio.sleep(0.2)
            following = await self._operator.robots()
            moved = max(math.dist((states[name].x, states[name].y), (following[name].x, following[name].y)) for name in ROBOTS)
            still_looks, states = (still_looks + 1 if moved < STILL else 0), following
            if time.monotonic() > end:
                return f"a robot drives on {STANDING_TIME:.0f} s after the kill"
        return None

    async def beside(self, granted: Mapping[str, tuple[RoadPoint, ...]]) -> list[str]:
        """Which robots stand where they were not granted to drive."""
        states = await self._operator.robots()
        offsets = {name: _offset((states[name].x, states[name].y), granted[name]) for name in ROBOTS}
        return [f"{name} stands {offset:.2f} m beside what it was granted" for name, offset in offsets.items() if offset > MOST_OFFSET]


def _offset(position: tuple[float, float], way: tuple[RoadPoint, ...]) -> float:
    """How far a robot is beside its way, m."""
    points = [(point[0], point[1]) for point in way]
    lines = zip(points, points[1:] or points, strict=False)
    return min(point_distance(position, start, end) for start, end in lines)
