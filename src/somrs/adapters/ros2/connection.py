"""The connection to a robot with ROS 2: what it is told becomes goals, calls and messages, and what its topics say is told to `Robot`."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import math
from collections.abc import Mapping, Sequence

from somrs.adapters.ros2.driving import (
    CancelNavigation,
    CancelRefused,
    Disabled,
    DoesNotHeed,
    Driving,
    EnterLevel,
    GoalUnderWay,
    HaltWanted,
    HasGivenUp,
    HasHalted,
    HasPassed,
    Input,
    LevelEntered,
    MotionKnown,
    Navigate,
    NavigationEnded,
    NavigatorPresent,
    PoseKnown,
    RetryDue,
    RetryLater,
    WayChanged,
)
from somrs.adapters.ros2.frames import Pose, TransformTree, pose_of
from somrs.adapters.ros2.lines import CancelRejected, Feedback, GoalEnded, GoalStatus, Replied, Values
from somrs.adapters.ros2.observer import Robot
from somrs.adapters.ros2.pose_stream import PoseStream
from somrs.adapters.ros2.poses import goal_values, pose_values
from somrs.adapters.ros2.reachability import Reachability
from somrs.adapters.ros2.readings import AttributeReading, FaultReadings
from somrs.adapters.ros2.session import MessageObserver, Session
from somrs.adapters.ros2.settings import Binding, RobotSettings, Step, Topic, full_name
from somrs.adapters.ros2.steps import Steps
from somrs.adapters.ros2.templates import field_value, fill_in
from somrs.devices.road_robot import RobotFailed, Way, Waypoint

log = logging.getLogger(__name__)

RETRY = 3.0
"""Seconds after which a goal is sent again that was rejected."""
POSES = 0.1
"""Seconds between two poses and speeds of a robot."""
STANDS = 0.02
"""Speed below which a robot stands, m/s and rad/s."""
COVARIANCES = 36
"""How many numbers the covariance of a pose has: 6 rows; those of x and y come first."""
LOST = "it does not know where it is; tell it, for example with 2D Pose Estimate of RViz"
SAME_FLOOR = 0.1
"""Difference in height up to which two heights are those of the same floor, m."""


class RobotConnection:
    """Connects one robot, as its settings and its binding say."""

    def __init__(self, name: str, settings: RobotSettings, binding: Binding, session: Session, robot: Robot) -> None:
        self.name, self._robot = name, robot
        self._settings, self._binding, self._session = settings, binding, session
        self._level = settings.levels[0]
        self._driving = Driving(name, binding.navigate.corridor, self._level.level, turns=binding.navigate.turns)
        self._steps = Steps(name, session, settings.namespace, robot.hindered)
        self._transforms = TransformTree()
        self._readings = {attribute: AttributeReading(topic) for attribute, topic in binding.attributes.items()}
        self._faults = FaultReadings(binding.faults)
        self._is_lost = False
        action, poses = full_name(binding.navigate.action, settings.namespace), f"{self._pose_topic} (frame {self._level.frame})"
        self._reachability = Reachability(name, action, poses, session, robot)
        self._poses = PoseStream()
        self._fixed_frames: set[str] = set()
        """Those of /tf_static."""
        self._reported_fault: str | None = None
        self._reported_loss: str | None = None
        self._subscriptions: list[int] = []
        self._navigation = 0
        self._goals: dict[int, int] = {}
        """The numbers of the session, by those of `Driving`."""
        self._speed_limit: float | None = None
        """What the robot has been told, and still knows."""
        self._is_telling = False
        self._unsent: Navigate | None = None
        """The goal that is sent when the robot has been told its speed limit."""
        self._retry: asyncio.TimerHandle | None = None
        self._halted = asyncio.Event()
        self._changed = asyncio.Event()
        self._entering: asyncio.Task[None] | None = None
        self._busy = asyncio.Lock()
        self._charger: tuple[str, Pose] | None = None
        """The charger at which it is charged."""
        self._is_interrupted = False
        self._located_at = -math.inf

    def open(self) -> None:
        """Subscribe to the robot's topics, and connect to its actions."""
        binding, levels = self._binding, self._settings.levels
        self._driving = Driving(self.name, binding.navigate.corridor, self._level.level, turns=binding.navigate.turns)
        if binding.pose is not None:
            self._subscribe(binding.pose, self._take_pose, POSES)
        else:
            for topic, is_static in ((binding.transform.tf, False), (binding.transform.tf_static, True)):
                observer = functools.partial(self._take_transforms, is_static)
                self._subscribe(Topic(topic=topic, type=binding.transform.type, latched=is_static), observer, 0.0)
        if binding.covariance is not None and not binding.has_covariance:
            self._subscribe(binding.covariance, self._take_covariance, POSES)
        if binding.odometry is not None:
            self._subscribe(binding.odometry, self._take_odometry, POSES)
        for attribute, bound in binding.attributes.items():
            self._readings[attribute].forget()
            self._subscribe(bound, functools.partial(self._take_attribute, attribute), bound.interval)
        for index, fault in enumerate(binding.faults):
            self._subscribe(fault, functools.partial(self._take_fault, index), 0.0)
        charging = [*binding.charge.begin, *binding.charge.end] if binding.charge is not None else []
        put_down = binding.put_down.steps if binding.put_down is not None else ()
        self._steps.open([*binding.pick, *binding.drop, *put_down, *charging, *(step for level in levels for step in level.enter)])
        name = full_name(binding.navigate.action, self._settings.namespace)
        self._navigation = self._session.open_action(name, binding.navigate.type, self._take_presence)

    def close(self) -> None:
        """Disconnect from the robot, which does not learn it."""
        for id in self._subscriptions:
            self._session.unsubscribe(id)
        self._subscriptions.clear()
        self._session.close_action(self._navigation)
        self._steps.close()
        self._take_presence(False)
        if self._entering is not None:
            self._entering.cancel()
        if self._retry is not None:
            self._retry.cancel()

    def follow(self, way: Way) -> None:
        """Drive along the released waypoints of a way."""
        self._handle(WayChanged(way))

    async def halt(self) -> None:
        """Stand still. Returns when the robot stands."""
        self._halted.clear()
        self._handle(HaltWanted())
        await self._halted.wait()

    async def pick(self, thing: str, support: str, pose: Pose) -> None:
        """Take a thing, which is at a pose. Raises RobotFailed."""
        async with self._busy:
            await self._carry_out(self._binding.pick, pose, {"thing": thing, "support": support})

    async def drop(self, thing: str, support: str, pose: Pose) -> None:
        """Put a thing on a support, which is at a pose. Raises RobotFailed."""
        async with self._busy:
            await self._carry_out(self._binding.drop, pose, {"thing": thing, "support": support})

    async def put_down(self, thing: str) -> tuple[float, float, float]:
        """Put a thing down where the robot stands. Returns the point, m. Raises RobotFailed."""
        bound, pose = self._binding.put_down, self._driving.pose
        if bound is None or pose is None:
            raise RobotFailed(f"the binding of {self.name} does not say how it puts {thing} down where it stands: `put_down`")
        place = pose.apply(Pose(bound.ahead, 0.0, 0.0))
        async with self._busy:
            await self._carry_out(bound.steps, place, {"thing": thing, "support": ""})
        return place.x, place.y, self._level.level

    async def charge(self, charger: str, pose: Pose) -> None:
        """Charge the battery at a charger, which is at a pose, until it is full. Raises RobotFailed."""
        charging = self._binding.charge
        if charging is None:
            raise RobotFailed(f"the binding of {self.name} does not say how it is charged")
        async with self._busy:
            self._is_interrupted = False
            await self._carry_out(charging.begin, pose, {"charger": charger})
            self._charger = charger, pose
            while not self._is_interrupted and not self._has_charge(charging.full):
                self._changed.clear()
                await self._changed.wait()
            await self._leave_charger()
            if self._is_interrupted:
                raise RobotFailed("charging was interrupted")
            if (charge := self._readings["Charge"].value) is not None:
                self._robot.measured("Charge", charge)  # however little it has changed

    async def interrupt(self) -> None:
        """End what the robot does besides driving. Returns when it does nothing."""
        self._is_interrupted = True
        self._changed.set()
        await self._steps.interrupt()
        async with self._busy:
            with contextlib.suppress(RobotFailed):
                await self._leave_charger()

    async def _leave_charger(self) -> None:
        if self._charger is not None and self._binding.charge is not None:
            (charger, pose), self._charger = self._charger, None
            await self._carry_out(self._binding.charge.end, pose, {"charger": charger})

    def _has_charge(self, full: float) -> bool:
        charge = self._readings["Charge"].value
        return isinstance(charge, int | float) and charge >= full

    async def _carry_out(self, steps: Sequence[Step], pose: Pose, values: Mapping[str, float | str]) -> None:
        """Carry out steps at a pose on the map of the building, which templates have as `{x}`, `{y}` and so on. Raises RobotFailed."""
        await self._steps.carry_out(steps, {"robot": self.name, **pose_values(pose, self._level), **values})

    def _handle(self, input: Input) -> None:
        for effect in self._driving.handle(input):
            match effect:
                case Navigate():
                    self._navigate(effect)
                case CancelNavigation(goal=goal):
                    self._cancel(goal)
                case EnterLevel(waypoint=waypoint):
                    self._entering = asyncio.create_task(self._enter(waypoint))
                case RetryLater():
                    self._retry = asyncio.get_running_loop().call_later(RETRY, self._handle, RetryDue())
                case HasPassed(number=number):
                    self._robot.passed(number)
                case HasGivenUp(description=description):
                    self._robot.gave_up(description)
                case HasHalted():
                    self._halted.set()
                case DoesNotHeed(description=reason):
                    self._robot.hindered(reason)

    def _navigate(self, effect: Navigate) -> None:
        replaced, self._unsent = self._unsent, effect
        if replaced is not None:
            self._handle(NavigationEnded(replaced.goal, GoalStatus.CANCELED, ""))
        if not self._is_telling:
            self._send_goal()

    def _send_goal(self) -> None:
        """Send the goal, after the speed limit of its way: messages on two wires do not arrive in the order in which they are sent."""
        if (effect := self._unsent) is None:
            return
        navigation = self._binding.navigate
        limit, bound = effect.waypoint.speed_limit or 0.0, self._binding.speed_limit
        if bound is not None and limit != self._speed_limit:
            self._speed_limit, self._is_telling = limit, True
            name, message = full_name(bound.topic, self._settings.namespace), fill_in(bound.message, {"speed": limit})
            self._session.publish(name, bound.type, message, self._take_reply)
            return
        self._unsent = None
        points = [Pose(waypoint.x, waypoint.y, yaw) for waypoint, yaw in zip(effect.way, effect.yaws, strict=True)]
        values = goal_values((effect.start.x, effect.start.y), points, self._level)
        goal = fill_in(navigation.template, {"robot": self.name, **values})

        def observe(report: Feedback | CancelRejected | GoalEnded) -> None:
            if isinstance(report, Feedback):
                self._miss_pose()
                self._handle(GoalUnderWay())
            elif isinstance(report, CancelRejected):
                self._handle(CancelRefused(effect.goal))
            elif isinstance(report, GoalEnded):
                self._goals.pop(effect.goal, None)
                problem = report.problem or field_value(report.value, navigation.problem)
                self._handle(NavigationEnded(effect.goal, report.status, problem if isinstance(problem, str) else ""))

        self._goals[effect.goal] = 0
        id = self._session.send_goal(self._navigation, goal, observe)
        if effect.goal in self._goals:
            self._goals[effect.goal] = id

    def _take_reply(self, reply: Replied) -> None:
        if reply.problem:
            log.warning("%s: the speed limit: %s", self.name, reply.problem)
        self._is_telling = False
        self._send_goal()

    def _cancel(self, goal: int) -> None:
        if self._unsent is not None and self._unsent.goal == goal:
            self._unsent = None
            self._handle(NavigationEnded(goal, GoalStatus.CANCELED, ""))
        else:
            self._session.cancel_goal(self._goals.get(goal, 0))

    async def _enter(self, waypoint: Waypoint) -> None:
        """Have the robot use its map of another floor."""
        level = next((level for level in self._settings.levels if abs(level.level - waypoint.level) < SAME_FLOOR), None)
        problem: str | None = None
        if level is None:
            problem = f"{self.name} has no map of the floor at {waypoint.level:g} m: give it one under `levels`"
        else:
            pose = self._driving.pose
            values = pose_values(Pose(waypoint.x, waypoint.y, pose.yaw if pose is not None else 0.0), level)
            try:
                await self._steps.carry_out(level.enter, {"robot": self.name, **values})
                self._level = level
            except RobotFailed as error:
                problem = f"{self.name} does not use its map of the floor at {waypoint.level:g} m: {error.description}"
        self._handle(LevelEntered(waypoint.level, problem))

    def _subscribe(self, bound: Topic, observer: MessageObserver, interval: float) -> None:
        name = full_name(bound.topic, self._settings.namespace)
        self._subscriptions.append(self._session.subscribe(name, bound.type, observer, latched=bound.latched, interval=interval))

    def _take_presence(self, present: bool) -> None:
        self._speed_limit = None  # another node may be behind it, which knows nothing
        self._reachability.note_presence(is_present=present)
        self._handle(NavigatorPresent(present))

    def _take_transforms(self, is_static: bool, message: Values) -> None:
        transforms, base, frame = message.get("transforms"), self._binding.transform.base, self._level.frame
        frames = self._transforms.add(transforms) if isinstance(transforms, list) else set()
        if is_static:
            self._fixed_frames |= frames
        elif (line := self._transforms.line(base, frame)) is not None:
            self._poses.add_part(frames, set(line) - self._fixed_frames, is_driving=bool(self._goals))
            self._tell_fault()
        now = asyncio.get_running_loop().time()
        if frames and now >= self._located_at + POSES:
            self._located_at = now
            self._locate(self._transforms.pose(base, frame))

    def _take_pose(self, message: Values) -> None:
        assert self._binding.pose is not None, "poses come by the bound topic"
        if self._binding.has_covariance:  # a pose is not to be believed before its covariance is seen
            self._take_covariance(message)
        pose = pose_of(field_value(message, self._binding.pose.field))
        if pose is not None:
            self._poses.add(is_driving=bool(self._goals))
            self._tell_fault()
        self._locate(pose)

    def _miss_pose(self, speed: float | None = None) -> None:
        """Something else than a pose has come. Transforms come whether the robot moves or not; in a topic, poses may come as it moves."""
        amount = 1.0 if self._binding.pose is None else speed
        if self._goals and amount:
            self._poses.wait(amount)
            self._tell_fault()

    def _locate(self, pose: Pose | None) -> None:
        is_entering = self._entering is not None and not self._entering.done()  # its map, or where that is, is not sure
        if pose is not None and self._reported_loss is None and not is_entering:
            on_map = self._level.origin.apply(pose)
            self._robot.located(on_map.x, on_map.y, on_map.yaw, self._level.level)
            self._handle(PoseKnown(on_map))
            self._reachability.note_pose()

    def _take_odometry(self, message: Values) -> None:
        assert self._binding.odometry is not None, "odometry comes by the bound topic"
        paths = [f"{self._binding.odometry.field}.{axis}".lstrip(".") for axis in ("linear.x", "linear.y", "angular.z")]
        speeds = [field_value(message, path) for path in paths]
        if all(isinstance(speed, int | float) for speed in speeds):
            self._handle(MotionKnown(any(abs(speed) > STANDS for speed in speeds)))
            self._miss_pose(sum(abs(speed) for speed in speeds))

    def _take_attribute(self, attribute: str, message: Values) -> None:
        self._miss_pose()
        if (value := self._readings[attribute].take(message)) is not None:
            self._robot.measured(attribute, value)
        self._changed.set()

    def _take_covariance(self, message: Values) -> None:
        bound = self._binding.covariance
        assert bound is not None, "the covariance comes by the bound topic"
        covariance = field_value(message, bound.field)
        variances = [covariance[0], covariance[7]] if isinstance(covariance, list) and len(covariance) == COVARIANCES else []
        if variances:  # NaN comes as None
            self._is_lost = any(variance is None or variance > bound.limit**2 for variance in variances)
            self._tell_fault()

    def _take_fault(self, index: int, message: Values) -> None:
        self._faults.take(index, message)
        self._tell_fault()

    def _tell_fault(self) -> None:
        reason, loss = self._faults.reason, self._loss
        if (reason, loss) == (self._reported_fault, self._reported_loss):
            return
        if reason is not None and reason != self._reported_fault:
            log.warning("%s cannot drive: %s", self.name, reason)
        if loss != self._reported_loss:
            self._robot.lost(loss)
        if reason != self._reported_fault:
            self._robot.broken(reason)
        self._reported_fault, self._reported_loss = reason, loss
        self._handle(Disabled(reason is not None or loss is not None))

    @property
    def _loss(self) -> str | None:
        """Why nobody knows where the robot is."""
        if self._is_lost:
            return LOST
        return f"its pose on {self._pose_topic} does not come any more" if self._poses.is_missing else None

    @property
    def _pose_topic(self) -> str:
        source = self._binding.pose.topic if self._binding.pose is not None else self._binding.transform.tf
        return full_name(source, self._settings.namespace)
