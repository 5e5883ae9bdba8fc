"""Carries out the commands of a driver with a robot of another make: it drives where traffic grants it, and picks and drops things.

The driver is the same as that of simulated robots; so are its services, its quotes, and what it does when something fails.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable
from types import TracebackType
from typing import Self

from somrs.devices.road.building import Building, RoadDriver, Stand
from somrs.devices.road.gripper import Gripper
from somrs.devices.road.handling import Handling
from somrs.devices.road.hardware import Vehicle
from somrs.devices.road.traveller import Traveller
from somrs.devices.simulator.link.command_link import CommandLink
from somrs.devices.simulator.link.commands import (
    Approach,
    Charge,
    Command,
    CommandDone,
    DriveTo,
    Grip,
    ObjectState,
    Place,
    PutDown,
    RobotState,
    Status,
    Stop,
)
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.lines import Legs, PathStop, StandAt, Stops
from somrs.devices.simulator.motion.driving import why_not_arrived
from somrs.devices.simulator.motion.legs import find_legs
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages.traffic import Berth, TripResult
from somrs.space.solids import Point, Role
from somrs.traffic.robot_tasks import TripOver

log = logging.getLogger(__name__)

PATIENCE, PAUSE = 45.0, 2.0
"""For how long a robot waits for others that are in the way to where it is to work, and the pause between two attempts, in seconds."""
ENTRY = 30.0
"""For how long a robot whose program has just started waits for its part in traffic before it gives up a command, s."""
LOST = "link-lost"
"""The reason for which a command ends of a robot that cannot be reached."""
RETRYING = 12.0
"""For how long a robot asks again for a trip that traffic refuses, s: whoever supervises it tries some times more."""
REACHED = 0.15
"""A robot that is this near to where it is to work stands there, m."""
MARK_HEIGHT = 0.1
"""Difference in height up to which a charger is on the robot's floor, m."""


class TripRefused(RobotGaveUp):
    """Traffic has no way for a trip now. That may change: what is in the way is moved, or a door is mended."""


class RoadLink(CommandLink):
    """The link to one robot. `on_state`: is told every state of it."""

    def __init__(self, robot: Vehicle, on_state: Callable[[RobotState], None]) -> None:
        self.robot, self.silent = robot, False
        self.gripper = Gripper(robot)
        self.traveller = Traveller(robot, self.gripper, on_state, self._end_at_once)
        self._handling = Handling(robot, self.gripper, self.traveller, self._reach)
        self._current: asyncio.Task[CommandDone] | None = None
        self._reason_of_end = "stopped", "the command was ended"
        self._stand: Stand | None = None
        """Where the robot stands to work, if it does."""
        self._reached = ""
        """What is within reach from there."""

    def _end_at_once(self, reason: str, description: str) -> None:
        """End the command. One that is being ended waits until the robot does nothing, unless that cannot be heard of any more."""
        if self._current is not None and not self._current.done() and (not self._current.cancelling() or reason == LOST):
            self._reason_of_end = reason, description
            self._current.cancel()

    # The link

    async def __aenter__(self) -> Self:
        await self.traveller.wait_for_robot()
        return self

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        await self._end_current("stopped", f"the program of {self.robot.name} ends")

    @property
    def state(self) -> RobotState | None:
        return self.traveller.state

    @property
    def connected(self) -> bool:
        return self.traveller.connected.is_set()

    async def wait_reconnected(self, timeout: float) -> bool:
        return await self.traveller.reach.wait_reconnected(timeout)

    async def legs(self, *stops: PathStop, situation: str | None = None) -> Legs:
        return self._legs(await self.traveller.building(), stops, situation)

    def _legs(self, building: Building, stops: Stops, situation: str | None = None) -> Legs:
        driver, motion = self.traveller.driver(), self.robot.motion
        return find_legs(building, driver, stops, situation, lambda way: motion.detour(way.points, driver.solid.speed))

    async def command(self, command: Command) -> CommandDone:
        if self.state is None or not self.connected:
            raise RobotGaveUp(LOST, f"{self.robot.name} cannot be reached", self.state)
        if self._current is None or self._current.done():
            await self._handling.settled()
        if isinstance(command, Status):
            self.traveller.renew_state()
            return self._done()
        await self._end_current("stopped", f"{self.robot.name} received another command")
        if isinstance(command, Stop):
            self.traveller.end_stay()
            self.traveller.renew_state()  # what its gripper holds may only just be known
            return self._done(*await self._known_places())
        self.traveller.activity, self._handling.is_lost = type(command).__name__, False
        self._current = task = asyncio.create_task(self._carry_out(command))
        await asyncio.wait({task})
        try:
            return task.result()
        except asyncio.CancelledError:
            reason, description = self._reason_of_end
            raise RobotGaveUp(reason, description, self.state, self._untouched(command)) from None
        except RobotGaveUp as failure:
            states = failure.object_states or self._untouched(command)
            raise RobotGaveUp(failure.reason, failure.description, self.state, states) from None
        except RemoteError as error:  # it does not take part in traffic yet, or the Repository does not answer
            raise RobotGaveUp("not-possible", str(error), self.state, self._untouched(command)) from None

    async def _known_places(self) -> list[ObjectState]:
        """Where the thing is with which the robot had to do: as the map has it, or, where that has forgotten it, as the robot remembers."""
        place = self.gripper.place
        if place is None:
            return []
        with contextlib.suppress(RemoteError):
            await self.traveller.building()
            on_map = self._place_on_map(place.object)
            place = on_map if on_map is not None and on_map.support is not None else place
        return [place]

    def _untouched(self, command: Command) -> tuple[ObjectState, ...]:
        """The thing that the robot was to take and has not touched: it is where the map has it. Empty if the command was for none."""
        if self.robot.holding is not None or self._handling.is_lost or not isinstance(command, Approach | Grip):
            return ()
        place = self._place_on_map(command.object)
        return (place,) if place is not None else ()

    def _place_on_map(self, name: str) -> ObjectState | None:
        """Where the map has a thing; None if it does not, or if it is no thing that robots carry."""
        building = self.robot.building
        if name not in building.solids or building.solids[name].role is not Role.THING:
            return None
        (x, y, z, yaw), support = building.pose(name), building.support_of(name)
        return ObjectState(object=name, x=x, y=y, z=z, yaw=yaw, support=support)

    async def _end_current(self, reason: str, description: str) -> None:
        task = self._current
        if task is not None and not task.done():
            if not task.cancelling():
                self._reason_of_end = reason, description
                task.cancel()
            await asyncio.wait({task})

    async def _carry_out(self, command: Command) -> CommandDone:
        is_ready = False
        try:
            await self._enter_traffic()
            match command:
                case DriveTo(x=x, y=y, z=z):
                    await self._drive_to((x, y), z)
                    return self._done()
                case Approach(object=name):
                    await self._approach(name)
                    is_ready = True
                    return self._done()
                case Grip(object=name):
                    return self._done(await self._handling.grip(name))
                case Place(support=name):
                    return self._done(await self._handling.place(name))
                case PutDown():
                    return self._done(await self._handling.put_down())
                case Charge():
                    return await self._charge()
            raise RobotGaveUp("not-possible", f"{self.robot.name} cannot do {type(command).__name__}", self.state)
        finally:
            self.traveller.activity = None
            if not is_ready:  # the command to work where it stands is next otherwise
                self.traveller.end_stay()
            self.traveller.renew_state()

    async def _enter_traffic(self) -> None:
        """Wait until the robot takes part in traffic: what a program that was started anew is told first is to undo what was begun."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(ENTRY):
                await self.traveller.entered.wait()

    def _done(self, *object_states: ObjectState) -> CommandDone:
        assert self.state is not None, "a command is carried out when the robot was located"
        return CommandDone(state=self.state, object_states=object_states)

    # Driving

    async def _drive_to(self, goal: Point, height: float | None) -> None:
        """Drive to a point. A trip that traffic refuses is asked for again for a while."""
        loop = asyncio.get_running_loop()
        end = loop.time() + RETRYING
        while True:
            try:
                return await self._driven_to(goal, height)
            except TripRefused:
                if loop.time() >= end:
                    raise
            await asyncio.sleep(PAUSE)

    async def _driven_to(self, goal: Point, height: float | None) -> None:
        building = await self.traveller.building()
        level = building.level_of(self.traveller.level if height is None else height)
        stop = building.stop_at(self.traveller.driver(level), goal, self.traveller.new_name())
        if stop is None:
            description = f"{self.robot.name} sees no place of the roadmap from ({goal[0]:.2f}, {goal[1]:.2f})"
            raise RobotGaveUp("unreachable", description, self.state)
        await self._travel(stop, goal)

    async def _travel(self, stop: Berth | str, goal: Point, yaw: float | None = None, *, to_work: bool = False) -> None:
        """Go there, and learn how long that takes."""
        loop, driver = asyncio.get_running_loop(), self.traveller.driver()
        (way,) = self._legs(self.robot.building, (StandAt(x=goal[0], y=goal[1], z=driver.level),)).lengths
        start_time = loop.time()
        self._check(await self.traveller.travel(stop, yaw, to_work=to_work), goal)
        self.robot.experience.learn((way or 0.0) / driver.solid.speed, loop.time() - start_time)

    async def _approach(self, name: str) -> None:
        """Drive to where a thing or a support is within reach: to another stand if others stand in the way to one. Robots that move may go
        away: they are waited for a while."""
        self._stand, self.traveller.activity = None, Approach.__name__
        await self.traveller.building()
        if (place := self._place_on_map(name)) is not None:
            self.gripper.note(place)
        loop = asyncio.get_running_loop()
        start_time = loop.time()
        while True:
            problem = await self._approached(name)
            if problem is None:
                return
            patience = RETRYING if isinstance(problem, TripRefused) else PATIENCE if problem.reason == "blocked" else 0.0
            if loop.time() >= start_time + patience:
                raise problem
            await asyncio.sleep(PAUSE)

    async def _approached(self, name: str) -> RobotGaveUp | None:
        """Try some stands. Returns why none can be reached; None when the robot stands at one."""
        building = await self.traveller.building()
        level = building.level_of(building.pose(name)[2]) if name in building.solids else None
        driver = self.traveller.driver(level)
        stands = self._stands(building, driver, name)
        reason = "there is no room for it, or something is in between"
        problem = RobotGaveUp("unreachable", f"{self.robot.name} can stand nowhere from where it could reach {name}: {reason}", self.state)
        for stand in dict.fromkeys((*stands[:1], *stands[len(stands) // 3 :][:1], *stands[2 * len(stands) // 3 :][:1], *stands[-1:])):
            stop = building.stop_at(driver, stand.base, self.traveller.new_name())
            if stop is None:
                continue
            try:
                await self._travel(stop, stand.base, stand.yaw, to_work=True)
            except RobotGaveUp as failure:
                if failure.reason not in ("blocked", "unreachable"):
                    raise
                problem = failure
            else:
                self._stand, self._reached = stand, name
                return None
        return problem

    def _stands(self, building: Building, driver: RoadDriver, name: str) -> list[Stand]:
        try:
            return [*building.stands(driver, name)]
        except UsageError as error:
            raise RobotGaveUp("unknown-object", str(error), self.state) from None

    def _check(self, over: TripOver, goal: Point) -> None:
        """Raise RobotGaveUp if a trip did not end at its goal."""
        if over.refusal:
            description = f"{self.robot.name} finds no path to ({goal[0]:.2f}, {goal[1]:.2f}): {over.refusal}"
            raise TripRefused("unreachable", description, self.state)
        problem = why_not_arrived(self.robot.name, goal, over.ended) if over.ended is not None else None
        if problem is not None:
            cannot_move = over.ended is not None and over.ended.result is TripResult.IMMOBILE
            reason = self.traveller.vain_trips.reason if cannot_move else ""  # that it cannot move is known from these
            raise RobotGaveUp(problem.reason, reason or problem.description, self.state)

    # Things

    async def _reach(self, name: str) -> Stand:
        """Stand where an object is within reach. Raises RobotGaveUp."""
        building = await self.traveller.building()
        stand = self._stand if self._reached == name and self._stands_there() else None
        if stand is None or not building.has_room(name, stand.spot, self.robot.holding):
            await self._approach(name)
        assert self._stand is not None, "who has not come there has given up"
        return self._stand

    def _stands_there(self) -> bool:
        state, stand = self.state, self._stand
        return state is not None and stand is not None and max(abs(state.x - stand.base[0]), abs(state.y - stand.base[1])) < REACHED

    async def _charge(self) -> CommandDone:
        building, state = await self.traveller.building(), self.state
        assert state is not None, "the robot was located"
        chargers = (solid for solid in building.solids.values() if solid.charger and abs(solid.z - self.traveller.level) < MARK_HEIGHT)
        charger = next((solid.name for solid in chargers if solid.distance(state.x, state.y) <= REACHED), None)
        if charger is None:
            raise RobotGaveUp("not-possible", f"{self.robot.name} does not stand at a charger", state)
        await self._handling.work(Charge.__name__, self.robot.charge_at(charger))
        return self._done()
