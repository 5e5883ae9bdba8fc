"""A Pioneer robot as a device: it drives where traffic lets it, picks and drops with its gripper, and charges."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from pathlib import Path

from somrs.adapters.arcos.driver import Driver
from somrs.adapters.arcos.events import (
    Action,
    ActionDone,
    ActionFailed,
    Advance,
    BatteryLevel,
    Broken,
    Effect,
    FillBattery,
    Follow,
    GaveUp,
    Halt,
    Halted,
    Heard,
    Holds,
    LineIsPoor,
    Located,
    MoveGripper,
    Passed,
    TurnTo,
)
from somrs.adapters.arcos.line import RobotLine
from somrs.adapters.arcos.messages import GripperCommand
from somrs.adapters.arcos.odometry import Pose
from somrs.adapters.arcos.parameters import Parameters
from somrs.adapters.arcos.settings import RobotSettings
from somrs.adapters.arcos.steering import motion_of
from somrs.adapters.arcos.stored_reckoning import Stored, load_reckoning, store_reckoning
from somrs.devices.road_robot import CarryingRobot, Motion, RobotFailed, Way
from somrs.errors import UsageError
from somrs.service_manager.sdk.values import number_of

log = logging.getLogger(__name__)

AWAY = 0.1
"""How far a robot backs up from what it has put down, m, at least."""
SPARE = 0.1
"""How much farther than the map has it a thing may be, m."""


class ArcosRobot(CarryingRobot):
    """A Pioneer P3-DX, or another robot with ARCOS."""

    def __init__(self, name: str, settings: RobotSettings, parameters: Parameters | None = None) -> None:
        super().__init__(name)
        self.settings = settings
        self.can_charge = settings.dock
        self.battery: float | None = None
        self._parameters = parameters
        self._line: RobotLine | None = None
        self._running: asyncio.Task[None] | None = None
        self._action: asyncio.Future[ActionDone] | None = None
        self._halted: asyncio.Future[None] | None = None
        self._stored: Stored | None = None
        self._start: Pose | None = None
        """Where the map had it when the program began."""

    async def open(self) -> None:
        stored, self._start = load_reckoning(self._file), self.settings.pose or await self._start_pose()
        is_put_elsewhere = stored is None or not stored.on_map.is_near(self._start)
        pose = self._start if stored is None or is_put_elsewhere else stored.reckoning.pose
        speed = self.settings.speed or await self._speed_on_map()
        earlier, motors_off = (stored.reckoning, stored.motors_off) if stored is not None else (None, None)
        driver = Driver(pose, self._parameters, self.settings.battery, speed, earlier, motors_off)
        self._line = RobotLine(driver, self.settings.port, self.settings.baud, self._take_effect)
        self.heard(False)
        self._running = asyncio.create_task(self._line.run())
        await super().open()
        if self.carries and self.holding is None:
            log.warning("%s: there is something between its paddles, and nobody knows what", self.name)

    async def close(self) -> None:
        await super().close()
        if self._running is not None:
            self._running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._running

    @property
    def motion(self) -> Motion:
        parameters = self._line.driver.parameters if self._line is not None else self._parameters
        return motion_of(parameters or Parameters())

    # What traffic and the services tell the robot

    async def follow(self, way: Way) -> None:
        self._open_line().give(Follow(way))

    async def halt(self) -> None:
        if self._halted is None or self._halted.done():
            self._halted = asyncio.get_running_loop().create_future()
            self._open_line().give(Halt())
        await asyncio.shield(self._halted)

    async def interrupt(self) -> None:
        await self.halt()

    async def pick(self, thing: str, support: str) -> None:
        self._need_gripper()
        if self.carries:
            raise RobotFailed(f"there is something between the paddles of {self.name} that nobody knows: take it out")
        distance = await self._face(thing)
        await self._act(MoveGripper(GripperCommand.DEPLOY))
        start = self._open_line().driver.pose
        approach = await self._act(Advance(distance=max(0.0, distance - self.settings.paddles + SPARE), until_beam=True))
        closing = await self._act(MoveGripper(GripperCommand.CLOSE)) if approach.is_occupied else approach
        if closing.is_occupied:
            self.holding = thing
            await self._act(MoveGripper(GripperCommand.LIFT_UP))
        await self._back_up(start)
        if not approach.is_occupied:
            raise RobotFailed(f"there is nothing between the paddles of {self.name} where {thing} should be", is_lost=True)
        if not closing.is_occupied:
            raise RobotFailed(f"{thing} slipped out of the paddles of {self.name}", is_lost=True)

    async def drop(self, thing: str, support: str) -> None:
        self._need_gripper()
        start = self._open_line().driver.pose
        if self.spot is not None:
            distance = math.dist(self.spot, (start.x, start.y)) - self.settings.paddles
            await self._act(Advance(distance=max(0.0, distance)))
        await self._let_go(start)

    async def put_down(self, thing: str) -> tuple[float, float, float, str]:
        self._need_gripper()
        start = self._open_line().driver.pose
        spot = start.moved(self.settings.paddles)
        await self._let_go(start)
        return spot.x, spot.y, self.road.level, ""

    async def charge_at(self, charger: str) -> None:
        """Charge the battery at the charger at which the robot stands. Returns when it is full. Raises RobotFailed."""
        await self._act(FillBattery())

    # What the driver says

    def _take_effect(self, effect: Effect) -> None:
        match effect:
            case Located(pose):
                self._store_reckoning()
                self.located(pose.x, pose.y, pose.yaw)
            case Passed(number):
                self.passed(number)
            case GaveUp(description):
                self.gave_up(f"{self.name} does not drive on: {description}")
            case Broken(reason):
                self.broken(reason)
            case Heard(is_connected, problem):
                self._note_problem(problem)
                if is_connected:
                    self._note_gripper()
                self.heard(is_connected, problem)
            case LineIsPoor(share):
                self._note_quality(share)
            case Holds(something):
                self.carries = something
            case BatteryLevel(charge):
                self.battery = float(charge)
            case Halted() if self._halted is not None and not self._halted.done():
                self._halted.set_result(None)
            case ActionDone() if self._action is not None and not self._action.done():
                self._action.set_result(effect)
            case ActionFailed(description=description) if self._action is not None and not self._action.done():
                self._action.set_exception(RobotFailed(f"{self.name} gave up: {description}"))

    def _note_problem(self, problem: str | None) -> None:
        """Log why the robot cannot be reached, once, with the beginning of what came."""
        if problem is not None:
            sample = self._open_line().driver.session.sample
            log.warning("%s cannot be reached: %s%s", self.name, problem, f" What came begins with {sample.hex(' ')}" if sample else "")

    def _note_gripper(self) -> None:
        """Offer to carry things if the robot has said that it has a gripper."""
        has_gripper = self._open_line().driver.has_gripper
        if has_gripper is not self.can_carry:
            self.can_carry = has_gripper
            self.services_changed()

    def _note_quality(self, share: float | None) -> None:
        """Say that much of what the robot sends is damaged, until it is not."""
        self.remark = None if share is None else f"{100 * share:.0f} % of what it sends arrives damaged: check its line"
        log.warning("%s: %s", self.name, self.remark or "what it sends arrives intact again")

    @property
    def _file(self) -> Path:
        return self.data / "arcos" / f"{self.name}.json"

    def _store_reckoning(self) -> None:
        """Store where the robot is, so that a program that is started anew while it drives goes on from there. At every report: while it
        turns, a heading of half a second ago leads it a metre astray."""
        driver, on_map = self._open_line().driver, self._pose_of_map()
        if driver.reckoning is None or on_map is None:
            return
        stored = Stored(reckoning=driver.reckoning, on_map=on_map, motors_off=driver.motors_off)
        if stored != self._stored:
            self._stored = stored
            store_reckoning(self._file, stored)

    def _pose_of_map(self) -> Pose | None:
        """Where the map has the robot: where it said last that it is, or where the map had it at first."""
        if self._reported_pose is None:
            return self._start
        x, y, yaw = self._reported_pose
        return Pose(x=x, y=y, yaw=yaw)

    # Parts of services

    async def _act(self, action: Action) -> ActionDone:
        """Have an action carried out. Raises RobotFailed. When it is cancelled, the robot stops."""
        future: asyncio.Future[ActionDone] = asyncio.get_running_loop().create_future()
        self._action = future
        self._open_line().give(action)
        try:
            return await future
        except asyncio.CancelledError:
            self._open_line().give(Halt())
            raise

    async def _face(self, name: str) -> float:
        """Turn to an object of the map, and return how far it is, m."""
        rows = await self.map.query(f"{name}.PositionX = ?X AND {name}.PositionY = ?Y", limit=1)
        if not rows:
            raise RobotFailed(f"the map does not say where {name} is")
        pose = self._open_line().driver.pose
        dx, dy = number_of(rows[0]["X"]) - pose.x, number_of(rows[0]["Y"]) - pose.y
        await self._act(TurnTo(math.atan2(dy, dx)))
        return math.hypot(dx, dy)

    async def _let_go(self, start: Pose) -> None:
        """Put what the robot holds down, and leave it: with a turn, the paddles would push it over. A robot that cannot drive stays."""
        await self._act(MoveGripper(GripperCommand.LIFT_DOWN))
        await self._act(MoveGripper(GripperCommand.OPEN))
        self.holding = None
        with contextlib.suppress(RobotFailed):
            await self._back_up(start, AWAY)

    async def _back_up(self, start: Pose, least: float = 0.0) -> None:
        """Drive straight back to where the robot was, or farther: at least so far, m."""
        pose = self._open_line().driver.pose
        travel = (pose.x - start.x) * math.cos(pose.yaw) + (pose.y - start.y) * math.sin(pose.yaw)
        await self._act(Advance(distance=-max(travel, least)))

    def _need_gripper(self) -> None:
        if not self._open_line().driver.has_gripper:
            raise RobotFailed(f"{self.name} has no gripper")

    def _open_line(self) -> RobotLine:
        assert self._line is not None, "the device is open"
        return self._line

    async def _speed_on_map(self) -> float:
        """The robot's Speed on the map, at most that of its parameters, m/s."""
        rows = await self.map.query(f"{self.name}.Speed = ?Speed", limit=1)
        return min([(self._parameters or Parameters()).speed, *(number_of(row["Speed"]) for row in rows)])

    async def _start_pose(self) -> Pose:
        """Where the map has the robot. Raises UsageError if it does not say."""
        rows = await self.map.query(f"{self.name}.PositionX = ?X AND {self.name}.PositionY = ?Y", limit=1)
        if not rows:
            raise UsageError(f"adapters: arcos: robots: {self.name}: the map does not say where it stands: give `start: [x, y, degrees]`")
        turned = await self.map.query(f"{self.name}.RotationZ = ?Yaw", limit=1)
        return Pose(x=number_of(rows[0]["X"]), y=number_of(rows[0]["Y"]), yaw=number_of(turned[0]["Yaw"]) if turned else 0.0)
