"""The driver of a simulated patrol robot, which finds objects whose position is unknown.

It searches the robot that holds the object according to the map, the object's last known position, other robots that may have taken it,
the furniture, and last the floors, each nearest first. The search ends as soon as the robot sees the object, wherever that is.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from somrs.devices.simulator.drivers.looking import LOOK_HEIGHT
from somrs.devices.simulator.drivers.mobile_robot import MobileRobot
from somrs.devices.simulator.drivers.recognition import Search
from somrs.devices.simulator.drivers.simulated import is_of_type
from somrs.devices.simulator.drivers.watching import WatchingDevice
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.entish.formula import Formula
from somrs.errors import RemoteError, UsageError
from somrs.ontology.types import Value
from somrs.service_manager.sdk.device import Result, Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.service_manager.sdk.values import number_of

LOOKING_TIME = 15.0
"""Time to look around at one place, s."""
MOST_PLACES, MOST_FLOOR = 12, 16
"""Numbers of places, and of spots on floors, that are searched before the object counts as not found."""
SPACING = 2.5
"""Distance between the spots at which floors are searched, m."""
SKIP_REASONS = ("blocked", "unreachable")
"""Reasons of failure for which the robot skips a place and goes to the next."""


@dataclass(frozen=True, slots=True)
class _Spot:
    """A place to search, in metres on the map; `label` describes it for people."""

    label: str
    x: float
    y: float
    z: float


async def _able(device: PatrolRobot, task: Task) -> None:
    await device.check_able(task)
    if task.inputs["Object"] == device.name:
        raise Refusal(f"{device.name} cannot look at itself")


async def _price(device: PatrolRobot, task: Task) -> float | str:
    return await device.price(task, await device.way(task) if device.price_per_metre else 0.0)


async def _duration(device: PatrolRobot, task: Task) -> float:
    return round(LOOKING_TIME + await device.driving_time(task, await device.way(task)), 1)


class PatrolRobot(WatchingDevice, MobileRobot):
    """A mobile robot with a camera in the simulator."""

    type = "PatrolRobot"
    features = ("OperationRange", "FieldOfView", "Speed", "Price")

    async def way(self, task: Task) -> float:
        """Driving distance to the first place to search, m."""
        first = next(iter(await self._spots(task, str(task.inputs["Object"]))), None)
        if first is None:
            return 0.0
        try:
            legs = await self.legs_through(task, (first.x, first.y))
            state = (await self.retry_when_link_lost(self._link.status)).state
        except (RemoteError, UsageError) as error:
            raise Refusal(f"{self.name} does not answer: {error}", not_now=True) from None
        (length,) = legs.lengths
        return length if length is not None else 2 * math.dist((state.x, state.y), (first.x, first.y))

    @service("RecognizeSituation", price=_price, duration=_duration, able=_able, inputs=("Object",))
    async def recognize(self, task: Task) -> Result:
        search = await Search.begin(self, task)
        try:
            searched_places, missed_places = await self.retry_when_link_lost(lambda: self._search(search))
            state = (await self.retry_when_link_lost(self._link.status)).state
        except RobotGaveUp as failure:
            raise ServiceFailed(failure.description, self.failure_situation(failure)) from failure
        pose = self.own_pose(state)
        if search.situation is None:
            raise ServiceFailed(_failure_text(self.name, search.object, searched_places, missed_places), " AND ".join(pose))
        return Result(situation=" AND ".join([search.situation, *pose]), observation=search.observation)

    async def _search(self, search: Search) -> tuple[list[str], list[str]]:
        """Search until the object is found. Return the labels of the searched and of the unreachable places."""
        task, object = search.task, search.object
        searched_places: list[str] = []
        missed_places: list[str] = []
        await self._look_around(search)
        spots = await self._spots(task, object)
        for i, spot in enumerate(spots):
            if search.situation is not None:
                break
            begin, end = 0.9 * i / len(spots), 0.9 * (i + 1) / len(spots)
            try:
                look = self._link.look_at(spot.x, spot.y, spot.z, search.landmark, search.like, whole=search.mistaken)
                view = await self._driving(task, look, begin, end, f"looks for {object} at {spot.label}")
                looked_at = time.time()  # the drive ends with the look
                await search.note(view, looked_at, looked_at)
                if search.situation is None:
                    await self._look_around(search)
            except RobotGaveUp as failure:
                if failure.reason not in SKIP_REASONS:
                    raise
                missed_places.append(spot.label)
            else:
                searched_places.append(spot.label)
        return searched_places, missed_places

    @recognize.stopping
    async def stand_still(self, task: Task) -> Situation:
        try:
            return " AND ".join(self.own_pose((await self.retry_when_link_lost(self._link.stop)).state))
        except RobotGaveUp as failure:
            raise ServiceFailed(failure.description, self.failure_situation(failure)) from failure

    @recognize.compensation
    async def compensate_recognition(self, task: Task, situation: Formula) -> Situation:
        """An observation leaves nothing to undo; report where the robot is."""
        return await self.stand_still(task)

    async def _look_around(self, search: Search) -> None:
        whole, began_at = search.mistaken, time.time()
        view = await self._link.look_around(search.landmark, search.like, whole=whole)
        await search.note(view, began_at, began_at if whole else time.time())

    # Places to search

    async def _spots(self, task: Task, object: str) -> list[_Spot]:
        """Places where the object may be, the most likely first."""
        last_spot = await self._find_last_spot(task, object)
        robots = [spot for spot in await self._places(task, "MobileManipulator", height=False) if spot.label not in (self.name, object)]
        supports = [] if await is_of_type(task, object, "MobileRobot") else await self._supports(task)
        holders = {str(row["Robot"]) for row in await task.map.query(f"{object} isHeldBy ?Robot")}
        if last_spot is not None:
            x, y = last_spot.x, last_spot.y
        else:
            state = (await self._link.status()).state
            x, y = state.x, state.y

        def far(spot: _Spot) -> float:
            return math.dist((x, y), (spot.x, spot.y))

        likely = [spot for spot in robots if spot.label in holders]
        rest = [spot for spot in sorted(robots, key=far) if spot.label not in holders]
        places = [*likely, *([last_spot] if last_spot is not None else []), *rest, *sorted(supports, key=far)][:MOST_PLACES]
        return places + sorted(await self._floor_spots(task), key=far)[:MOST_FLOOR]

    async def _find_last_spot(self, task: Task, object: str) -> _Spot | None:
        rows = await task.map.query(f"{object}.PositionX = ?X AND {object}.PositionY = ?Y AND {object}.PositionZ = ?Z", limit=1)
        return _spot(f"the last known position of {object}", rows[0]) if rows else None

    async def _floor_spots(self, task: Task) -> list[_Spot]:
        """Spots that cover the floors; assumes that floors are boxes parallel to the axes, as most are."""
        size = "?It.Shape.Width = ?Width AND ?It.Shape.Depth = ?Depth AND ?It.Shape.Height = ?Height"
        place = "?It.PositionX = ?X AND ?It.PositionY = ?Y AND ?It.PositionZ = ?Z"
        spots: list[_Spot] = []
        for row in await task.map.query(f"?It: Floor = ?It AND {place} AND {size}"):
            middle, width, depth = _spot(f"the floor {row['It']}", row), number_of(row["Width"]), number_of(row["Depth"])
            xs, ys = (_spread(length) for length in (width, depth))
            spots += [replace(middle, x=middle.x + dx, y=middle.y + dy) for dx in xs for dy in ys]
        return spots

    async def _supports(self, task: Task) -> list[_Spot]:
        """The positions on top of the furniture on which things can be put."""
        try:
            return await self._places(task, "Furniture", height=True, state=" AND ?It.Supporting = TRUE")
        except RemoteError:  # the ontology of an earlier version does not state it
            return await self._places(task, "Support", height=True)

    async def _places(self, task: Task, kind: str, *, height: bool, state: str = "") -> list[_Spot]:
        """The positions of the objects of a type in this state; with `height`, the positions on top of them."""
        place = "?It.PositionX = ?X AND ?It.PositionY = ?Y AND ?It.PositionZ = ?Z"
        rows = await task.map.query(f"?It: {kind} = ?It AND {place}" + (" AND ?It.Shape.Height = ?Height" if height else "") + state)
        return [_spot(str(row["It"]), row) for row in rows]


def _spot(label: str, row: dict[str, Value]) -> _Spot:
    x, y, z = (number_of(row[axis]) for axis in "XYZ")
    return _Spot(label, x, y, z + number_of(row.get("Height", 0.0)) + LOOK_HEIGHT)


def _spread(length: float) -> list[float]:
    """Offsets from the middle at which a floor of this length is searched."""
    count = max(1, math.ceil(length / SPACING))
    return [(i + 0.5) * length / count - length / 2 for i in range(count)]


def _failure_text(robot: str, object: str, searched_places: list[str], missed_places: list[str]) -> str:
    """Describe for people where an object was searched in vain."""
    searched_text = f"; it searched {', '.join(dict.fromkeys(searched_places))}" if searched_places else ""
    missed_text = f"; it found no path to {', '.join(dict.fromkeys(missed_places))}" if missed_places else ""
    return f"{robot} did not find {object}{searched_text}{missed_text}"
