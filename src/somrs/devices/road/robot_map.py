"""The building as one robot sees it: from where it is, with its berths, and by the roadmap that it was located on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from somrs.devices.road.berth_memory import BerthMemory
from somrs.devices.road.building import Building, RoadDriver
from somrs.devices.road.hardware import Vehicle
from somrs.devices.road.waypoints import Way, Waypoint, with_slow_zones
from somrs.devices.road.whereabouts import Surroundings
from somrs.devices.simulator.link.commands import RobotState
from somrs.errors import RemoteError, UsageError
from somrs.traffic.robot_tasks import RoadmapRead, WayPlace


class RobotMap:
    """That of one robot. `roadmap`: None: the robot does not take part in traffic yet."""

    def __init__(self, robot: Vehicle) -> None:
        self._robot = robot
        self.roadmap: RoadmapRead | None = None
        self.berths = BerthMemory()

    async def building(self, *, is_current: bool = True) -> Building:
        """The building as it is on the map, or as it was lately. Raises RemoteError."""
        if self.roadmap is None:
            raise RemoteError(f"{self._robot.name} does not take part in traffic yet")
        return await self.building_with(self.roadmap, is_current=is_current)

    async def building_with(self, roadmap: RoadmapRead, *, is_current: bool) -> Building:
        """The same, with another roadmap."""
        map, ontology = await self._robot.whole_map(is_current=is_current)
        try:
            self._robot.building.update(map, ontology, roadmap)
        except UsageError as error:
            raise RemoteError(f"{self._robot.name} cannot use the roadmap of traffic, and reads it again: {error}") from None
        return self._robot.building

    def driver(self, state: RobotState, level: float) -> RoadDriver:
        """The robot where it is, on a floor. Raises RemoteError."""
        robot, solid = self._robot, self._robot.building.solids.get(self._robot.name)
        if solid is None:
            raise RemoteError(f"{robot.name} is not on the map, with a position and a shape")
        floor = robot.building.level_of(level)
        solid = replace(solid, speed=robot.motion.speed_on(solid.speed))
        return RoadDriver(robot.name, solid, (state.x, state.y, state.yaw), floor, robot.holding)

    def surroundings(self, level: float, *, is_driving: bool) -> Surroundings:
        """What is around the robot on a floor."""
        building = self._robot.building
        return Surroundings(is_driving, lambda point: building.is_free(point, level))

    def way(self, places: Iterable[WayPlace], level: float, workplace: str | None) -> Way:
        """The waypoints at places, as far as they are of this roadmap, and up to where the robot is to work. `level`: the height of the
        floor on which it is, where its berths are."""
        waypoints: list[Waypoint] = []
        for place in places:
            waypoint = self._waypoint(place, waypoints[-1].name if waypoints else None, level)
            if waypoint is None:
                break  # of an earlier roadmap
            waypoints.append(waypoint)
            if waypoint.name == workplace:
                break  # it stops there, whatever it was granted besides
        return with_slow_zones(waypoints, self._robot.building.zones)

    def _waypoint(self, place: WayPlace, start: str | None, level: float) -> Waypoint | None:
        building, berth, lane = self._robot.building, self.berths.berth(place.name), None
        if berth is not None:
            x, y = berth.x, berth.y
        elif place.name in building.roadmap.numbers:
            road_place, lane = building.place(place.name), building.lane(start, place.name) if start is not None else None
            x, y, level = road_place.x, road_place.y, road_place.level
        else:
            return None
        return Waypoint(
            number=place.number,
            name=place.name,
            mark=building.mark_at((x, y), level),
            x=x,
            y=y,
            level=level,
            released=place.released,
            speed_limit=lane.speed_limit if lane is not None else None,
            travel=lane.travel if lane is not None else None,
            yaw=self.berths.yaw(place.name),
        )
