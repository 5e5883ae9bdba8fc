"""Where a robot of another make is, and how it drives: what it says, its trips, and the ways that traffic grants it.

Its program in traffic (`traffic/robot_program.py`) is notified by `tell`, and gives work by `carry_out`.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import uuid
from collections.abc import Callable

from somrs.devices.road.building import Building, RoadDriver, standing
from somrs.devices.road.condition import Condition
from somrs.devices.road.gripper import Gripper
from somrs.devices.road.hardware import Vehicle
from somrs.devices.road.reach import UNHEARD
from somrs.devices.road.robot_map import RobotMap
from somrs.devices.road.vain_trips import Rest, VainTrips
from somrs.devices.road.waypoints import Way
from somrs.devices.road.whereabouts import DISPLACED
from somrs.devices.simulator.link.commands import RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.errors import RemoteError
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
        self.entered = asyncio.Event()
        """Set when the robot takes part in traffic for the first time."""
        self.level = 0.0
        """The height of its floor, m."""
        self._condition = Condition(robot)
        self._whereabouts, self.reach = self._condition.whereabouts, self._condition.reach
        self.connected = self.reach.connected
        self._map = RobotMap(robot)
        self._way: Way = ()
        self._told_way: Way = ()
        """The last way, also if it does not hold any more: the robot rolls on along it."""
        self._is_paused = False
        self._blocked: set[str] = set()  # the places to which the robot could not drive on
        self.vain_trips = VainTrips()
        self._rest = Rest(self.tell_mobility)
        """A robot that has given up does not make room for others, if it did so before where it stands."""
        self._is_abandoned = False
        """Whether it was told to drive by a command that has ended while it could not be reached."""
        self._stopping: asyncio.Task[None] | None = None
        self._halts = 0
        """How often it was told to stand still: ways from before are not followed any more."""
        self._trips: dict[str, asyncio.Future[TripOver]] = {}
        self._life, self._numbers = uuid.uuid4().hex[:6], itertools.count(1)

    # What the robot says

    def located(self, x: float, y: float, yaw: float, level: float | None) -> None:
        now, height = asyncio.get_running_loop().time(), self.level if level is None else level
        if self._whereabouts.take((x, y), height, now, self._map.surroundings(height, is_driving=self._is_driving)):
            if self.vain_trips.is_over((x, y)):
                self._rest.end()
            self.level = height
            self._say_state((x, y, yaw))
        if bool(self._whereabouts.problem) != self._condition.is_lost:
            self._renew_condition()
        elif self._was_moved(now):
            log.warning("%s is not where traffic has it, but at (%.2f, %.2f), and enters there", self.robot.name, x, y)
            self._way = ()
            self.tell(Astray())

    def _say_state(self, pose: tuple[float, float, float]) -> None:
        self._gripper.settle()
        now, condition, is_halted = asyncio.get_running_loop().time(), self._condition, self._is_paused or self._is_stopping
        may_drive = self._released > 1 and not is_halted and condition.trouble is None and self.robot.hindrance is None
        condition.standstill.update(may_drive=may_drive, rest_time=self._whereabouts.rest_time, now=now)
        self.state = condition.state(now, pose, self.level, self.activity)
        if not self.reach.is_reported:
            self._note_reach(None)
        self._on_state(self.state)

    @property
    def _is_driving(self) -> bool:
        return bool(self._trips) or self._released > 1 or self._is_stopping

    @property
    def _released(self) -> int:
        """How many places it has in traffic."""
        return sum(waypoint.released for waypoint in self._way)

    def _was_moved(self, now: float) -> bool:
        """Whether the robot stands elsewhere than at the only place that it has in traffic, where it does nothing."""
        if self._released != 1 or self._condition.is_lost or self._mobility is Mobility.BUSY or not self.connected.is_set():
            return False
        return now - self._whereabouts.rest_time >= REST and self._whereabouts.is_off(self._way, DISPLACED)

    def renew_state(self) -> None:
        if self.state is not None:
            self._say_state((self.state.x, self.state.y, self.state.yaw))

    def passed(self, number: int) -> None:
        if self._condition.is_lost:
            return  # it keeps what it has in traffic until it is known where it is
        ahead = [waypoint for waypoint in self._told_way if waypoint.number >= number and waypoint.released]
        if ahead and ahead[0].number == number and self._whereabouts.is_off(ahead, self.robot.deviation):
            self._deny(f"{self.robot.name} says that it has come to {ahead[0].mark or ahead[0].name}, but its pose is elsewhere")
            return
        self.stays = self.stays or any(waypoint.number == number and waypoint.name == self._workplace for waypoint in self._way)
        self.tell(PlacePassed(number, self._mobility))

    def _deny(self, description: str) -> None:
        """The robot is not where it should be: what it has in traffic is its own until it stands, and enters where it is."""
        if not self._is_stopping:
            log.warning("%s", description)
            self._begin_to_halt().add_done_callback(lambda _: self.tell(Astray()))
            self._fail_trips(description)

    def gave_up(self, description: str) -> None:
        """The robot stands, and cannot drive on."""
        ahead = next((waypoint for waypoint in self._way[1:] if waypoint.released), None)
        self._blocked = {ahead.name} if ahead is not None else set()
        if self.state is not None and (duration := self.vain_trips.add((self.state.x, self.state.y), description)) is not None:
            self._rest.begin(duration)
        self._give_up_trip()
        self.tell(Astray())
        self._fail_trips(description)

    def _fail_trips(self, description: str) -> None:
        trips, self._trips = [*self._trips.values()], {}
        for trip in trips:
            if not trip.done():
                trip.set_exception(RobotGaveUp("blocked", description, self.state))

    def broken(self, reason: str | None) -> None:
        self._condition.broken = reason
        self._renew_condition()

    def lost(self, reason: str | None) -> None:
        self._whereabouts.lose(reason)
        self._renew_condition()

    def confirm(self) -> None:
        """An operator has seen to the robot: it is where it says next."""
        self._whereabouts.confirm()

    def _renew_condition(self) -> None:
        """Find out whether the robot can drive. One that does not know where it is stands still, and keeps what it has in traffic."""
        condition = self._condition
        could_drive, was_lost = condition.trouble is None, condition.is_lost
        condition.renew()
        self.renew_state()
        has_changed = could_drive == (condition.trouble is not None)
        if has_changed:
            self.tell_mobility()
        if condition.is_lost and not was_lost:
            log.warning("%s does not know where it is: %s", self.robot.name, self._whereabouts.problem)
            self._begin_to_halt()
        elif not condition.is_lost and (was_lost or has_changed):
            self.tell(Astray())
        if has_changed and condition.trouble is not None:
            self._end_command("drive-dead", condition.trouble)

    def heard(self, is_connected: bool, reason: str | None) -> None:
        self.reach.is_reported = True
        if not self._note_reach(None if is_connected else reason or UNHEARD):
            return
        self.tell(SilenceChanged(not is_connected))
        if is_connected:
            self.on_return()
            if self._is_abandoned:
                self._is_abandoned = False
                self._begin_to_halt()
        else:
            self._end_command("link-lost", f"{self.robot.name} cannot be reached: {self.reach.silence}")

    async def wait_for_robot(self) -> None:
        """Wait until the robot can be reached; whoever waits for it is told why it cannot."""
        self._condition.tell_problem(is_new=True)
        await self.connected.wait()

    def _note_reach(self, silence: str | None) -> bool:
        """Note why the robot cannot be reached; None: it can. Returns whether it is lost or back by that."""
        has_changed = self.reach.note(silence)
        self._condition.tell_problem()
        return has_changed

    @property
    def _is_stopping(self) -> bool:
        return self._stopping is not None and not self._stopping.done()

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

    # Trips

    async def travel(self, stop: Berth | str, yaw: float | None = None, *, to_work: bool = False) -> TripOver:
        """Go to a place or a berth. Returns how that ended; when it is cancelled, the robot stands still. `to_work`: it stays there from
        when it has come there, until `end_stay`."""
        if self._condition.trouble is not None:
            raise RobotGaveUp("drive-dead", self._condition.trouble, self.state)
        trip = f"{self.robot.name}/trip-{self._life}-{next(self._numbers)}"
        if self._stopping is not None:
            await asyncio.wait({self._stopping})
        if isinstance(stop, Berth):
            self._map.berths.remember(stop, yaw)
        over: asyncio.Future[TripOver] = asyncio.get_running_loop().create_future()
        self._trips[trip] = over
        self._is_abandoned, self.stays = False, False
        self._workplace = (stop.name if isinstance(stop, Berth) else stop) if to_work else None
        try:
            self._rest.end()
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
            if self._condition.trouble is not None and not self._condition.is_lost:
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
        if self._condition.trouble is not None or self._rest.is_on:
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
                self._condition.held_up = reason
                self.renew_state()
            case Complaint(text=text):
                log.warning("%s does not take part in traffic: %s", self.robot.name, text)
                self._complain(text)
            case _:
                raise RemoteError(f"a robot cannot do {type(task).__name__}")
        return None

    async def _stands_still(self) -> None:
        """Wait until the robot stands, and knows where: it rolls on for some centimetres."""
        while (
            not self.connected.is_set() or self._condition.is_lost or asyncio.get_running_loop().time() - self._whereabouts.rest_time < REST
        ):
            await asyncio.sleep(REST / 3)

    async def _locate(self, roadmap: RoadmapRead) -> Standing:
        """Where the robot stands, as soon as it does."""
        self._halts += 1  # what it was to follow is from before it was lost
        await self._stands_still()
        building = await self._map.building_with(roadmap, is_current=False)
        self._map.roadmap = roadmap
        state = self.state
        assert state is not None, "it is connected when it was located"
        stop = building.stop_at(self.driver(), (state.x, state.y), self.new_name(), self._blocked)
        if stop is None:
            self._complain(f"it stands at ({state.x:.2f}, {state.y:.2f}), from where it sees no place of the roadmap")
            raise RemoteError(f"{self.robot.name} does not take part in traffic: {self._condition.complaint}")
        if isinstance(stop, Berth):
            self._map.berths.remember(stop, None)
        self._blocked, self._way, self._told_way = set(), (), ()
        self.entered.set()
        return standing(stop, halts=self._halts)

    def _complain(self, text: str | None) -> None:
        if text != self._condition.complaint:
            self._condition.complaint = text
            self._condition.tell_problem()
            self.renew_state()

    async def _follow(self, way: tuple[WayPlace, ...]) -> None:
        self._complain(None)
        await self.building(is_current=False)
        self._map.berths.use([place.name for place in way])
        self._way = self._told_way = self._map.way(way, self.level, self._workplace)
        if self._way and not self._is_paused and not self._condition.is_lost:
            await self.robot.follow(self._way)

    async def pause(self) -> None:
        """Have the robot stand still, and not drive until `resume`."""
        self._is_paused = True
        await self.robot.halt()

    async def resume(self) -> None:
        """Have the robot follow its way again, as it is now."""
        self._is_paused = False
        if self._way and not self._condition.is_lost:
            await self.robot.follow(self._way)

    async def building(self, *, is_current: bool = True) -> Building:
        """The building as it is on the map, or as it was lately. Raises RemoteError."""
        return await self._map.building(is_current=is_current)

    def driver(self, level: float | None = None) -> RoadDriver:
        """The robot where it is, on a floor. Raises RemoteError."""
        assert self.state is not None, "the robot was located"
        return self._map.driver(self.state, self.level if level is None else level)

    def new_name(self) -> str:
        return f"{self.robot.name}/{self._life}-{next(self._numbers)}"
