"""The nodes of a simulated robot: navigation like that of Nav2, a gripper, an arm, odometry, localisation, battery and emergency stop."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from control_msgs.action import GripperCommand
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import FollowPath, NavigateThroughPoses, NavigateToPose
from nav2_msgs.msg import SpeedLimit
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from somrs.adapters.ros2.simulated.body import Body, BodyFailed

try:
    from manipulation_msgs.action import MoveObject
except ImportError:  # types that the tests bring: robots elsewhere have others
    MoveObject = None

PUBLISHED = 0.05
"""Seconds between two messages of a topic, and two looks at whether a goal is cancelled."""
UNKNOWN, FAILED = 9000, 9003
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CLOSED = 0.02
"""A gripper that is told to be narrower than this closes, m."""


class SimulatedRobot:
    """Has the node of a robot do what its body can. Callbacks of ROS run in threads; the body lives in the event loop.

    `behaviour`: `normal`; `reject`: goals are not accepted; `abort`: they are accepted, and given up at once; `stubborn`: nothing is
    cancelled; `slow`: its arm moves until it is cancelled; `lost`: it does not know where it is.
    """

    def __init__(self, node: Any, namespace: str, body: Body, loop: asyncio.AbstractEventLoop, grid: tuple[int, int] | None = None) -> None:
        self.node, self.body, self.loop = node, body, loop
        self.behaviour = "normal"
        self.is_active = True
        self._prefix = namespace.strip("/")
        self._group = ReentrantCallbackGroup()
        self._speed: float | None = None
        self._current: Any = None
        self._servers: list[Any] = []
        self._odometry = node.create_publisher(Odometry, self._name("odom"), 10)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, self._name("amcl_pose"), LATCHED)
        self._tf = node.create_publisher(TFMessage, self._name("tf"), 10)
        self._battery = node.create_publisher(BatteryState, self._name("battery_state"), 10)
        self._emergency = node.create_publisher(Bool, self._name("emergency_stop"), LATCHED)
        self._map = node.create_publisher(OccupancyGrid, self._name("map"), LATCHED)
        node.create_subscription(SpeedLimit, self._name("speed_limit"), self._limit, 10, callback_group=self._group)
        node.create_service(SetBool, self._name("charge"), self._charge, callback_group=self._group)
        self._serve(NavigateToPose, "navigate_to_pose", lambda goal: self._navigate(goal, NavigateToPose, [goal.request.pose]))
        through = NavigateThroughPoses
        self._serve(through, "navigate_through_poses", lambda goal: self._navigate(goal, through, goal.request.poses.goals))
        self._serve(FollowPath, "follow_path", lambda goal: self._navigate(goal, FollowPath, goal.request.path.poses))
        self._serve(GripperCommand, "gripper_cmd", self._grip)
        if MoveObject is not None:
            self._serve(MoveObject, "move_object", self._move_object)
        self.press(False)
        if grid is not None:
            self._map.publish(_room(*grid))

    def manage(self) -> None:
        """Have a life cycle, as the nodes of Nav2 do: goals are rejected until the node is active."""
        self.is_active = False
        self.node.create_service(GetState, "~/get_state", self._get_state, callback_group=self._group)

    def _get_state(self, _: Any, response: Any) -> Any:
        response.current_state.id = State.PRIMARY_STATE_ACTIVE if self.is_active else State.PRIMARY_STATE_INACTIVE
        return response

    def close(self) -> None:
        """Take the robot's actions away."""
        for server in self._servers:
            server.destroy()

    def _name(self, name: str) -> str:
        return f"/{self._prefix}/{name}" if self._prefix else f"/{name}"

    def press(self, is_pressed: bool) -> None:
        """Press the emergency stop, or release it."""
        self._emergency.publish(Bool(data=is_pressed))

    async def publish(self) -> None:
        """Publish the robot's state, until it is cancelled."""
        while True:
            x, y, yaw = self.body.pose
            stamp = self.node.get_clock().now().to_msg()
            odometry, pose, transform = Odometry(), PoseWithCovarianceStamped(), TransformStamped()
            for message, frame in ((odometry, "odom"), (pose, "map"), (transform, "map")):
                message.header.frame_id, message.header.stamp = frame, stamp
            for place in (odometry.pose.pose, pose.pose.pose):
                place.position.x, place.position.y = x, y
                place.orientation.z, place.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
            pose.pose.covariance[0] = pose.pose.covariance[7] = 4.0 if self.behaviour == "lost" else 0.01
            odometry.twist.twist.linear.x = 0.5 if self.body.moves else 0.0
            transform.child_frame_id = "base_link"
            transform.transform.translation.x, transform.transform.translation.y = x, y
            transform.transform.rotation = pose.pose.pose.orientation
            self._odometry.publish(odometry)
            self._pose.publish(pose)
            self._tf.publish(TFMessage(transforms=[transform]))
            self._battery.publish(BatteryState(percentage=float(self.body.battery), voltage=math.nan))
            await asyncio.sleep(PUBLISHED)

    def _limit(self, message: Any) -> None:
        self._speed = message.speed_limit or None

    def _charge(self, request: Any, response: Any) -> Any:
        asyncio.run_coroutine_threadsafe(self.body.charge() if request.data else self.body.stop(), self.loop)
        response.success = True
        return response

    def _serve(self, kind: Any, name: str, work: Callable[[Any], Coroutine[Any, Any, Any]]) -> None:
        def goal(_: Any) -> Any:
            return GoalResponse.ACCEPT if self.is_active and self.behaviour != "reject" else GoalResponse.REJECT

        def cancel(_: Any) -> Any:
            return CancelResponse.REJECT if self.behaviour == "stubborn" else CancelResponse.ACCEPT

        def execute(handle: Any) -> Any:
            return asyncio.run_coroutine_threadsafe(work(handle), self.loop).result()

        server = ActionServer(
            self.node, kind, self._name(name), execute, goal_callback=goal, cancel_callback=cancel, callback_group=self._group
        )
        self._servers.append(server)

    async def _navigate(self, handle: Any, kind: Any, poses: Sequence[Any]) -> Any:
        """Drive through poses. As with Nav2, a new goal takes the place of the one in progress, which is then aborted, and a speed limit
        holds at once."""
        self._current, result, ahead = handle, kind.Result(), [*poses]
        drive, speed = asyncio.create_task(self._drive(ahead)), self._speed
        while not drive.done():
            await asyncio.wait([drive], timeout=PUBLISHED)
            if self._speed != speed and not drive.done():
                drive.cancel()
                drive, speed = asyncio.create_task(self._drive(ahead)), self._speed
            handle.publish_feedback(kind.Feedback())
            if self._current is not handle:
                drive.cancel()
                return self._aborted(handle, result, UNKNOWN, "preempted")
            if handle.is_cancel_requested or self.behaviour == "abort":
                drive.cancel()
                await self.body.stop()
                if handle.is_cancel_requested:
                    handle.canceled()
                    return result
                return self._aborted(handle, result, FAILED, "no valid path")
        if (error := drive.exception()) is not None:
            return self._aborted(handle, result, FAILED, str(error))
        handle.succeed()
        return result

    async def _drive(self, ahead: list[Any]) -> None:
        """Drive through poses, and remove each when the robot has come to it."""
        while ahead:
            place, turn = ahead[0].pose.position, ahead[0].pose.orientation
            await self.body.drive(place.x, place.y, 2 * math.atan2(turn.z, turn.w), self._speed)
            del ahead[0]

    def _aborted(self, handle: Any, result: Any, code: int, message: str) -> Any:
        result.error_code, result.error_msg = code, message
        handle.abort()
        return result

    async def _grip(self, handle: Any) -> Any:
        """Close or open the gripper. What is between its fingers stops it before it is closed."""
        result = GripperCommand.Result()
        is_closing = handle.request.command.position < CLOSED
        with contextlib.suppress(BodyFailed):  # the fingers move all the same
            await (self.body.take(None) if is_closing else self.body.put(None))
        result.stalled = is_closing and self.body.holding is not None
        result.reached_goal = not result.stalled and (is_closing or self.body.holding is None)
        result.position = handle.request.command.position
        handle.succeed()
        return result

    async def _move_object(self, handle: Any) -> Any:
        request, result = handle.request, MoveObject.Result()
        if self.behaviour == "slow":
            while not handle.is_cancel_requested:
                await asyncio.sleep(PUBLISHED)
            handle.canceled()
            return result
        try:
            await (self.body.take(request.object) if request.pick else self.body.put(request.support))
        except BodyFailed as error:
            result.message = error.description
        result.success = not result.message
        handle.succeed()
        return result


def _room(width: int, height: int) -> Any:
    """The grid of a room with walls around it, in cells of 0.5 m."""
    grid = OccupancyGrid()
    grid.header.frame_id = "map"
    grid.info.resolution, grid.info.width, grid.info.height = 0.5, width, height
    grid.info.origin.orientation.w = 1.0
    border = {(x, y) for x in range(width) for y in range(height) if x in (0, width - 1) or y in (0, height - 1)}
    grid.data = [100 if (x, y) in border else -1 if (x, y) == (1, 1) else 0 for y in range(height) for x in range(width)]
    return grid


async def obey(robot: SimulatedRobot, lines: asyncio.StreamReader) -> None:
    """Do what tests say, one JSON text a line: a behaviour, or what happens to the robot. `done` on the output says that it is so."""
    async for line in lines:
        match json.loads(line):
            case "press":
                robot.press(True)
            case "release":
                robot.press(False)
            case "activate" | "deactivate" as transition:
                robot.is_active = transition == "activate"
            case behaviour:
                robot.behaviour = behaviour
        print("done", flush=True)
