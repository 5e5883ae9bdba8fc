"""A robot of the simulator that makes a map of an unknown floor: the service ExploreFloor.

What it finds comes to the map while it goes: rooms, walls, doors and furniture as objects that follow what it knows, things as sightings,
which the Repository identifies.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterable
from pathlib import Path

import msgspec

from somrs.adapters.mapping.doors import DoorTasks
from somrs.adapters.mapping.expected import ExpectedThings
from somrs.adapters.mapping.exploring import explore
from somrs.adapters.mapping.floor_map import FloorMap, Shown
from somrs.adapters.mapping.reporting import situation_of, things_on
from somrs.adapters.mapping.survey import Survey
from somrs.atomic_files import write_atomically
from somrs.devices.simulator.drivers.simulated import SimulatedDevice
from somrs.devices.simulator.drivers.watching import MIDDLE
from somrs.devices.simulator.link.commands import CommandDone, Point
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.entish.formula import Formula
from somrs.errors import RemoteError
from somrs.ontology.objects import Object
from somrs.ontology.services import Parameter, ServiceType
from somrs.ontology.types import PART_OF, RelationType
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.service_manager.sdk.device import Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.service_manager.sdk.values import number_of
from somrs.sites.occupancy.building import building_of
from somrs.sites.occupancy.importing import WALL_HEIGHT
from somrs.sites.plan import Box

log = logging.getLogger(__name__)

WAS_EXPLORED_BY = RelationType(
    name="wasExploredBy", joins=("Storey", "MobileRobot"), functional=True, doc="The robot has made the map of the storey"
)
EXPLORE_FLOOR = ServiceType(
    name="ExploreFloor",
    inputs=(Parameter(name="Storey", type="Storey"),),
    effect="?Storey wasExploredBy ?Provider",
    doc="Drive through all of a storey that can be reached, and put on the map what is there",
)
_USUAL_RADIUS = 0.3
"""Radius of a robot of which the map does not say it, m."""
DURATION = 900.0
"""How long it takes to explore a floor, s: nobody knows before."""
LOOKS_PER_REPORT = 3
"""After so many looks, the map is brought up to date."""
ON_FLOOR = 0.2
"""How far the height of a robot's floor may be from the elevation of its storey, m."""
_FOLLOWED = ("Wall", "Door", "Furniture")


async def _able(device: MappingRobot, task: Task) -> None:
    state, elevation = await device.check_working(), await device.elevation(task)
    if state.z is not None and abs(state.z - elevation) > ON_FLOOR:
        raise Refusal(f"{device.name} is on another storey than {task.inputs['Storey']}, and explores only its own")


class MappingRobot(SimulatedDevice):
    """A mobile robot in the simulator with a laser scanner and a camera. Its own program drives it, by what it has seen."""

    type = "MobileRobot"
    types = (WAS_EXPLORED_BY,)
    features = ("OperationRange", "Speed", "Price")
    driven_outside = True
    _doors: DoorTasks | None = None
    """The doors of the storey that it explores, or has explored last."""

    async def elevation(self, task: Task) -> float:
        """The height of the storey that is to be explored, m."""
        rows = await task.map.query(f"{task.inputs['Storey']}.Elevation = ?Z", limit=1)
        return number_of(rows[0]["Z"]) if rows else 0.0

    @service(EXPLORE_FLOOR, price=SimulatedDevice.price, duration=DURATION, able=_able, inputs=("Storey",))
    async def explore_floor(self, task: Task) -> Situation:
        survey = Survey(await self._radius(task))
        floor_map = await self._floor_map(task)
        things = ExpectedThings(await self._things(task, floor_map.elevation))
        findings = _Findings(self, task, survey, floor_map, things)
        self._doors = doors = DoorTasks(self.name, self.map, self.tasks, floor_map.elevation, ON_FLOOR, _box_of)
        try:
            state = await self.retry_when_link_lost(lambda: explore(self._link, survey, findings.note, lambda: things.points, doors))
        except RobotGaveUp as failure:
            await doors.leave()
            await findings.publish()
            raise ServiceFailed(failure.description, self.failure_situation(failure)) from failure
        await findings.publish(is_last=True)
        if doors.failed:
            await task.progress(1.0, note=f"cannot have opened: {', '.join(doors.failed)}. What is behind stays unknown")
        return " AND ".join([f"{task.inputs['Storey']} wasExploredBy {self.name}", *self.own_pose(state)])

    @explore_floor.stopping
    async def stand_still(self, task: Task) -> Situation:
        if self._doors is not None:
            await self._doors.leave()
        try:
            return " AND ".join(self.own_pose((await self.retry_when_link_lost(self._link.stop)).state))
        except RobotGaveUp as failure:
            raise ServiceFailed(failure.description, self.failure_situation(failure)) from failure

    @explore_floor.compensation
    async def keep_map(self, task: Task, situation: Formula) -> Situation:
        """What was seen is so, whoever asked for it; report where the robot is."""
        return await self.stand_still(task)

    async def _radius(self, task: Task) -> float:
        rows = await task.map.query(f"{self.name}.Shape.Radius = ?Radius", limit=1)
        return number_of(rows[0]["Radius"]) if rows else _USUAL_RADIUS

    async def _things(self, task: Task, elevation: float) -> dict[str, Point]:
        """The things that the map has on the storey, as far as they stand on something."""
        pose = "?It.PositionX = ?X AND ?It.PositionY = ?Y AND ?It.PositionZ = ?Z AND NOT ?It.Unknown = TRUE"
        rows = await task.map.query(f"?It: Graspable isOn ?Place AND {pose}")
        points = {str(row["It"]): Point(x=number_of(row["X"]), y=number_of(row["Y"]), z=number_of(row["Z"]) + MIDDLE) for row in rows}
        return {name: point for name, point in points.items() if 0.0 <= point.z - elevation <= WALL_HEIGHT}

    async def _floor_map(self, task: Task) -> FloorMap:
        """What the map has of the storey already."""
        storey, earlier_names = str(task.inputs["Storey"]), self.read_surveyed()
        names = [str(row["It"]) for row in await task.map.query("?It: Object = ?It")]
        driven_doors = {str(row["It"]) for row in await task.map.query("?It: PoweredDoor = ?It")}
        floor_map = FloorMap(storey, await self.elevation(task), names)
        for kind in _FOLLOWED:
            for row in await task.map.query(f"?It: {kind}.PositionX = ?X AND ?It.PositionY = ?Y AND ?It.PositionZ = ?Z"):
                object = await task.map.object(str(row["It"]))
                if object is not None and abs(number_of(row["Z"]) - floor_map.elevation) <= ON_FLOOR:
                    rooms = await task.map.query(f"connects({object.name}, ?First, ?Second)", limit=1) if kind == "Door" else []
                    connects = tuple(str(row[side]) for row in rooms for side in ("First", "Second"))
                    is_earlier = object.name in earlier_names
                    shown = _shown_as(object, kind)
                    floor_map.add_foreign(object.name, shown, None, connects, is_earlier=is_earlier, is_device=object.name in driven_doors)
        for row in await task.map.query(f"?Room: Room = ?Room AND ?Floor: Floor {PART_OF} ?Room"):
            floor, room = await task.map.object(str(row["Floor"])), str(row["Room"])
            if floor is not None:
                floor_map.add_foreign(room, _room_shown(floor), floor.name, is_earlier=room in earlier_names)
        return floor_map

    @property
    def _surveyed_file(self) -> Path:
        return self.data / "surveys" / f"{self.name}.json"

    def read_surveyed(self) -> set[str]:
        """The objects that surveys of this robot have brought to the map."""
        try:
            return msgspec.json.decode(self._surveyed_file.read_bytes(), type=set[str])
        except (OSError, msgspec.DecodeError):
            return set()

    def write_surveyed(self, names: Iterable[str]) -> None:
        """Keep the names of the objects that surveys have brought, for the next one."""
        try:
            self._surveyed_file.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._surveyed_file, msgspec.json.encode(sorted(names)))
        except OSError as error:
            log.warning("%s: what it found cannot be kept (%s): the next survey takes it as found by others", self.name, error)


def _shown_as(object: Object, kind: str) -> Shown:
    return Shown(kind=kind if kind != "Furniture" else object.type, box=_box_of(object), values=object.values)


def _box_of(object: Object) -> Box:
    def number(path: str) -> float:
        value = object.values.get(path)
        return float(value) if isinstance(value, int | float) else 0.0

    radius = number("Shape.Radius")
    width, depth = number("Shape.Width") or 2 * radius, number("Shape.Depth") or 2 * radius
    return Box(number("PositionX"), number("PositionY"), width, depth, number("RotationZ"))


def _room_shown(floor: Object) -> Shown:
    """A room by its floor, which the map has as a box or a polygon."""
    box, text = _box_of(floor), str(floor.values.get("Shape.Outline") or "")
    corners = [(float(x), float(y)) for x, _, y in (corner.partition(",") for corner in text.split())]
    outline = [box.world(corner) for corner in corners] if corners else box.corners()
    x, y = (sum(values) / len(outline) for values in zip(*outline, strict=True))
    return Shown(kind="Room", box=Box(x, y, 0.0, 0.0), outline=outline, floor=floor.values)


class _Findings:
    """Brings what a robot finds to the map."""

    def __init__(self, device: MappingRobot, task: Task, survey: Survey, floor_map: FloorMap, expected: ExpectedThings) -> None:
        self._device, self._task, self._survey, self._floor_map, self._expected = device, task, survey, floor_map, expected
        self._looks = 0

    async def note(self, view: CommandDone) -> None:
        """Note a look, and bring the map up to date now and then."""
        seen_at = time.time()
        self._looks += 1
        if self._looks % LOOKS_PER_REPORT == 1:
            await self.publish()
            rooms = self._floor_map.room_count
            note = f"has looked {self._looks} times, and found {rooms} room{'s' if rooms != 1 else ''}"
            await self._task.progress(1 - 1 / (1 + self._looks / 50), " AND ".join(self._device.own_pose(view.state)), note)
        await self._report_things(view, seen_at)

    async def publish(self, *, is_last: bool = False) -> None:
        """Bring the map up to date with the survey. `is_last`: all that can be seen was seen."""
        seen_at, grid = time.time(), self._survey.grid()
        building = await asyncio.to_thread(building_of, grid, self._survey.furniture(), self._floor_map.known_doors)
        parts, missed = self._floor_map.observed(grid)
        if is_last:
            self._floor_map.adopt_earlier(grid)
        changes = self._floor_map.follow(building, self._survey.pieces, self._survey.robots)
        try:
            if changes:
                self._device.write_surveyed({*self._device.read_surveyed(), *self._floor_map.surveyed_names})
                await self._device.map.report(UpdateMap(changes=tuple(changes), author=self._device.name))
            if parts or missed:
                await self._device.report(" AND ".join(parts) or None, Observation(as_of=seen_at, missed=tuple(missed)))
        except RemoteError as error:
            log.warning("%s: what it found cannot be put on the map: %s", self._device.name, error)

    async def _report_things(self, view: CommandDone, seen_at: float) -> None:
        gone = self._expected.gone(view)
        things = things_on(self._floor_map, [sighting for sighting in view.sightings if not (sighting.robot or sighting.furniture)])
        if not (things or gone):
            return
        try:
            await self._device.report(situation_of(things) or None, Observation(as_of=seen_at, missed=tuple(gone)))
        except RemoteError as error:
            log.warning("%s: what it saw cannot be put on the map: %s", self._device.name, error)
