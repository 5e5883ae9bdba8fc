"""Where a robot of another make is, and how it drives: what it says, its trips, and the ways that traffic grants it.

Its program in traffic (`traffic/robot_program.py`) is notified by `tell`, and gives work by `carry_out`.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import uuid
from collections.abc import Callable
from dataclasses import replace

from somrs.devices.road.berth_memory import BerthMemory
from somrs.devices.road.building import Building, RoadDriver, standing
from somrs.devices.road.gripper import Gripper
from somrs.devices.road.hardware import Vehicle
from somrs.devices.road.vain_trips import VainTrips
from somrs.devices.road.waypoints import Waypoint, with_slow_zones
from somrs.devices.simulator.link.commands import Fault, RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages.traffic import Berth, Mobility
from somrs.traffic.robot_tasks import (
    Astray,
    Complaint,
    Follow,
    HeldUp,
    Locate,
    MobilityChanged,
    PlacePassed,
    RoadmapRead,
    SilenceChanged,
    Standing,
    TripGivenUp,
    TripOver,
    TripWanted,
    WayPlace,
)

log = logging.getLogger(__name__)

REST = 0.3
"""Seconds between two states with the same pose from which on a robot stands."""
STILL = 0.01
"""How far a robot that stands seems to move, m."""

EndCommand = Callable[[str, str], None]
"""Ends the command that is carried out, for a reason and with a description as of `RobotGaveUp`."""


def _do_nothing() -> None:
    """Do nothing: no link is there yet."""


def _tell_nobody(notice: object) -> None:
    """Do nothing: no program takes part in traffic for the robot."""


class Traveller:
    """One robot on its ways. `on_state`: is told every state; `end_command`: ends the command in progress, because the robot cannot go
    on."""

    def __init__(self, robot: Vehicle, gripper: Gripper, on_state: Callable[[RobotState], None], end_command: EndCommand) -> None:
        self.robot, self._gripper, self._on_state, self._end_command = robot, gripper, on_state, end_command
        self.tell: Callable[[object], None] = _tell_nobody
        self.on_return: Callable[[], None] = _do_nothing
        """Called when the robot can be reached again."""
        self.state: RobotState | None = None
        """The last one that the robot reported."""
        self.activity: str | None = None
        """The command that is carried out."""
        self.stays = False
        """Whether it is where it is to work: nobody asks it to make room."""
        self._workplace: str | None = None
        """The place or berth at which it is to work, if it drives to one."""
        self.connected = asyncio.Event()
        self.entered = asyncio.Event()
        """Set when the robot takes part in traffic for the first time."""
        self._says_whether_heard = False
        self._lost_at = self._still_since = 0.0
        self.level = 0.0
        """The height of its floor, m."""
        self._last_point: tuple[float, float] | None = None
        self._faults: set[Fault] = set()
        self._trouble: str | None = None
        """Why it cannot drive, as a sentence."""
        self._roadmap: RoadmapRead | None = None
        self._berths = BerthMemory()
        self._way: tuple[Waypoint, ...] = ()
        self._is_paused = False
        self._held_up: str | None = None  # for what in traffic it waits, for people
        self._blocked: set[str] = set()  # the places to which the robot could not drive on
        self.vain_trips = VainTrips()
        self._rest: asyncio.TimerHandle | None = None
        """The timer until whose end it is not asked to make room for others."""
        self._is_abandoned = False
        """Whether it was told to drive by a command that has ended while it could not be reached."""
        self._stopping: asyncio.Task[None] | None = None
        self._halts = 0
        """How often it was told to stand still: ways from before are not followed any more."""
        self._trips: dict[str, asyncio.Future[TripOver]] = {}
        self._life, self._numbers = uuid.uuid4().hex[:6], itertools.count(1)

    # What the robot says

    def located(self, x: float, y: float, yaw: float, level: float | None) -> None:
        now = asyncio.get_running_loop().time()
        if self._last_point is None or max(abs(x - self._last_point[0]), abs(y - self._last_point[1])) > STILL:
            self._last_point, self._still_since = (x, y), now
        if self.vain_trips.is_over((x, y)):
            self._end_rest()
        self.level = self.level if level is None else level
        self._gripper.settle()
        self.state = RobotState(
            time=now,
            x=x,
            y=y,
            yaw=yaw,
            holding=self.robot.holding,
            activity=self.activity,
            faults=tuple(sorted(self._faults)),
            z=self.level,
            charge=self.robot.battery,
            hindrance=self.robot.hindrance or self._held_up,
            trouble=self._trouble,
            remark=self.robot.remark,
        )
        if not self._says_whether_heard:
            self.connected.set()
        self._on_state(self.state)

    def renew_state(self) -> None:
        if self.state is not None:
            self.located(self.state.x, self.state.y, self.state.yaw, None)

    def passed(self, number: int) -> None:
        self.stays = self.stays or any(waypoint.number == number and waypoint.name == self._workplace for waypoint in self._way)
        self.tell(PlacePassed(number, self._mobility))

    def gave_up(self, description: str) -> None:
        """The robot stands, and cannot drive on."""
        ahead = next((waypoint for waypoint in self._way[1:] if waypoint.released), None)
        self._blocked = {ahead.name} if ahead is not None else set()
        trips, self._trips = [*self._trips.values()], {}
        self._begin_rest(description)
        self._give_up_trip()
        self.tell(Astray())
        for trip in trips:
            if not trip.done():
                trip.set_exception(RobotGaveUp("blocked", description, self.state))

    def _begin_rest(self, reason: str) -> None:
        """A robot that has given up does not make room for others, if it did so before where it stands."""
        duration = self.vain_trips.add((self.state.x, self.state.y), reason) if self.state is not None else None
        if duration is not None:
            self._end_rest()
            self._rest = asyncio.get_running_loop().call_later(duration, self._end_rest)
            self.tell_mobility()

    def _end_rest(self) -> None:
        if self._rest is not None:
            self._rest.cancel()
            self._rest = None
            self.tell_mobility()

    def broken(self, reason: str | None) -> None:
        was_broken = bool(self._faults)
        self._faults, self._trouble = set(), None
        if reason is not None:
            self._faults, self._trouble = {Fault.DRIVE}, f"{self.robot.name} cannot drive: {reason}"
        self.renew_state()
        if was_broken == bool(self._faults):
            return
        self.tell_mobility()
        self.tell(Astray())
        if self._trouble is not None:
            self._end_command("drive-dead", self._trouble)

    def heard(self, is_connected: bool) -> None:
        self._says_whether_heard = True
        if is_connected == self.connected.is_set():
            return
        self.tell(SilenceChanged(not is_connected))
        if is_connected:
            self.connected.set()
            self.on_return()
            if self._is_abandoned:
                self._is_abandoned = False
                self._begin_to_halt()
        else:
            self.connected.clear()
            self._lost_at = asyncio.get_running_loop().time()
            self._end_command("link-lost", f"{self.robot.name} cannot be reached")

    def _begin_to_halt(self) -> asyncio.Task[None]:
        """Have the robot stand still, because what it was told is not wanted any more, and give up its trip when it stands. What traffic
        grants meanwhile is given back as well, so that it is not followed."""
        if self._stopping is None or self._stopping.done():
            self._halts, self._way = self._halts + 1, ()
            self._stopping = asyncio.create_task(self._halt())
        return self._stopping

    async def _halt(self) -> None:
        await self.robot.halt()
        self.tell(TripGivenUp(self._halts))

    def _give_up_trip(self) -> None:
        """Give up the trip of a robot that stands."""
        self._halts, self._way = self._halts + 1, ()
        self.tell(TripGivenUp(self._halts))

    async def wait_reconnected(self, timeout: float) -> bool:
        remaining = self._lost_at + timeout - asyncio.get_running_loop().time()
        if not self.connected.is_set() and remaining > 0:
            try:
                async with asyncio.timeout(remaining):
                    await self.connected.wait()
            except TimeoutError:
                pass
        return self.connected.is_set()

    # Trips

    async def travel(self, stop: Berth | str, yaw: float | None = None, *, to_work: bool = False) -> TripOver:
        """Go to a place or a berth. Returns how that ended; when it is cancelled, the robot stands still. `to_work`: it stays there from
        when it has come there, until `end_stay`."""
        if self._trouble is not None:
            raise RobotGaveUp("drive-dead", self._trouble, self.state)
        trip = f"{self.robot.name}/trip-{self._life}-{next(self._numbers)}"
        if self._stopping is not None:
            await asyncio.wait({self._stopping})
        if isinstance(stop, Berth):
            self._berths.remember(stop, yaw)
        over: asyncio.Future[TripOver] = asyncio.get_running_loop().create_future()
        self._trips[trip] = over
        self._is_abandoned, self.stays = False, False
        self._workplace = (stop.name if isinstance(stop, Berth) else stop) if to_work else None
        try:
            self._end_rest()
            self.tell_mobility()
            self.tell(TripWanted(trip, stop))
            ended = await over
            await self._stands_still()
            if to_work:
                self.stays = True
                self.tell_mobility()
            return ended
        except asyncio.CancelledError:
            if not self.connected.is_set():
                self._is_abandoned = True  # nobody knows how far it drives: it keeps what it was granted
                raise
            if self._faults:
                self._give_up_trip()
            else:
                await asyncio.shield(self._begin_to_halt())
            raise
        finally:
            self._workplace = None
            self._trips.pop(trip, None)

    def tell_mobility(self) -> None:
        self.tell(MobilityChanged(self._mobility))

    @property
    def _mobility(self) -> Mobility:
        if self._faults or self._rest is not None:
            return Mobility.IMMOBILE
        is_busy = self.stays or self.activity in ("Grip", "Place", "PutDown", "Charge")
        return Mobility.BUSY if is_busy else Mobility.FREE

    def end_stay(self) -> None:
        """The robot does not work where it stands, any more."""
        if self.stays:
            self.stays = False
            self.tell_mobility()

    # The program in traffic

    async def carry_out(self, task: object) -> object:
        """Do what the robot's program in traffic asks for. Raises RemoteError."""
        match task:
            case Locate(roadmap=roadmap):
                return await self._locate(roadmap)
            case Follow(way=way, halts=halts) if halts == self._halts:
                await self._follow(way)
            case Follow():
                pass
            case TripOver(trip=trip):
                over = self._trips.get(trip)
                if over is not None and not over.done():
                    over.set_result(task)
            case HeldUp(reason=reason):
                self._held_up = reason
                self.renew_state()
            case Complaint(text=text):
                log.warning("%s does not take part in traffic: %s", self.robot.name, text)
            case _:
                raise RemoteError(f"a robot cannot do {type(task).__name__}")
        return None

    async def _stands_still(self) -> None:
        """Wait until the robot stands: it rolls on for some centimetres."""
        while not self.connected.is_set() or asyncio.get_running_loop().time() - self._still_since < REST:
            await asyncio.sleep(REST / 3)

    async def _locate(self, roadmap: RoadmapRead) -> Standing:
        """Where the robot stands, as soon as it does."""
        self._halts += 1  # what it was to follow is from before it was lost
        await self._stands_still()
        building = await self._building_with(roadmap, is_current=False)
        self._roadmap = roadmap
        state = self.state
        assert state is not None, "it is connected when it was located"
        stop = building.stop_at(self.driver(), (state.x, state.y), self.new_name(), self._blocked)
        if stop is None:
            raise RemoteError(f"{self.robot.name} stands at ({state.x:.2f}, {state.y:.2f}), from where it sees no place of the roadmap")
        if isinstance(stop, Berth):
            self._berths.remember(stop, None)
        self._blocked, self._way = set(), ()
        self.entered.set()
        return standing(stop, halts=self._halts)

    async def _follow(self, way: tuple[WayPlace, ...]) -> None:
        building = await self.building(is_current=False)
        self._berths.use([place.name for place in way])
        waypoints: list[Waypoint] = []
        for place in way:
            waypoint = self._waypoint(building, place, waypoints[-1].name if waypoints else None)
            if waypoint is None:
                break  # of an earlier roadmap
            waypoints.append(waypoint)
            if waypoint.name == self._workplace:
                break  # it stops there, whatever it was granted besides
        self._way = with_slow_zones(waypoints, building.zones)
        if waypoints and not self._is_paused:
            await self.robot.follow(self._way)

    async def pause(self) -> None:
        """Have the robot stand still, and not drive until `resume`."""
        self._is_paused = True
        await self.robot.halt()

    async def resume(self) -> None:
        """Have the robot follow its way again, as it is now."""
        self._is_paused = False
        if self._way:
            await self.robot.follow(self._way)

    def _waypoint(self, building: Building, place: WayPlace, start: str | None) -> Waypoint | None:
        berth, lane = self._berths.berth(place.name), None
        if berth is not None:
            x, y, level = berth.x, berth.y, self.level
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
            yaw=self._berths.yaw(place.name),
        )

    async def building(self, *, is_current: bool = True) -> Building:
        """The building as it is on the map, or as it was lately. Raises RemoteError."""
        if self._roadmap is None:
            raise RemoteError(f"{self.robot.name} does not take part in traffic yet")
        return await self._building_with(self._roadmap, is_current=is_current)

    async def _building_with(self, roadmap: RoadmapRead, *, is_current: bool) -> Building:
        map, ontology = await self.robot.whole_map(is_current=is_current)
        try:
            self.robot.building.update(map, ontology, roadmap)
        except UsageError as error:
            raise RemoteError(f"{self.robot.name} cannot use the roadmap of traffic, and reads it again: {error}") from None
        return self.robot.building

    def driver(self, level: float | None = None) -> RoadDriver:
        state, solid = self.state, self.robot.building.solids.get(self.robot.name)
        if solid is None:
            raise RemoteError(f"{self.robot.name} is not on the map, with a position and a shape")
        assert state is not None, "the robot was located"
        floor = self.robot.building.level_of(self.level if level is None else level)
        solid = replace(solid, speed=self.robot.motion.speed_on(solid.speed))
        return RoadDriver(self.robot.name, solid, (state.x, state.y, state.yaw), floor, self.robot.holding)

    def new_name(self) -> str:
        return f"{self.robot.name}/{self._life}-{next(self._numbers)}"
