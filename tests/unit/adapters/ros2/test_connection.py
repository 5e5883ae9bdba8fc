"""What a robot is told, and what becomes of its answers: the lines of the bridge, without a bridge."""

from __future__ import annotations

import asyncio
import itertools
import math
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from msgspec import structs

from somrs.adapters.ros2.connection import RobotConnection
from somrs.adapters.ros2.frames import Pose
from somrs.adapters.ros2.lines import (
    ActionPresence,
    CallService,
    CancelGoal,
    CancelRejected,
    GoalEnded,
    GoalStatus,
    Message,
    OpenAction,
    Publish,
    Ready,
    Replied,
    Request,
    SendGoal,
    Subscribe,
)
from somrs.adapters.ros2.robot import Ros2Robot
from somrs.adapters.ros2.session import Session
from somrs.adapters.ros2.settings import Binding, RobotSettings
from somrs.devices.road_robot import RobotFailed
from tests.support.ros2.robots import Witness, way

ARM = {"action": "arm", "type": "x/action/Pick", "goal": {"object": "{thing}", "x": "{x}"}, "succeeds": {"success": True}}
CHARGE = {"topic": "battery", "type": "sensor_msgs/msg/BatteryState", "field": "percentage", "scale": 100}
LOAD = {"service": "map_server/load_map", "type": "nav2_msgs/srv/LoadMap", "request": {"map_url": "first.yaml"}, "succeeds": {"result": 0}}
INITIAL = {"topic": "initialpose", "type": "x/msg/Pose", "message": {"x": "{x}", "y": "{y}", "frame": "{frame}"}}
FLOORS: list[dict[str, Any]] = [{"level": 0.0}, {"level": 3.0, "x": 100.0, "frame": "map1", "enter": [LOAD, INITIAL]}]


def in_event_loop(test: Callable[[], Coroutine[Any, Any, None]]) -> Callable[[], None]:
    def run() -> None:
        asyncio.run(test())

    return run


class Conversation:
    """A robot whose bridge the test plays."""

    def __init__(self, binding: dict[str, Any], levels: list[dict[str, Any]] | None = None) -> None:
        self.requests: list[Request] = []
        self.session = Session(self.requests.append, lambda problem: None)
        self.witness = Witness()
        settings = RobotSettings.model_validate({"binding": "x.yaml", "namespace": "r1", "levels": levels or [{}]})
        bound = Binding.model_validate({"pose": {}, **binding})
        self.connection = RobotConnection("Robot1", settings, bound, self.session, self.witness)
        self.session.handle(Ready())
        self.connection.open()
        for opened in [request for request in self.requests if isinstance(request, OpenAction)]:
            self.session.handle(ActionPresence(id=opened.id, present=True))
        self.requests_before = len(self.requests)

    def subscription(self, topic: str) -> int:
        return next(request.id for request in self.requests if isinstance(request, Subscribe) and request.topic == topic)

    def be_at(self, x: float, y: float, variance: float | None = 0.01, seconds: int = 0) -> None:
        pose = {"position": {"x": x, "y": y}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
        header = {"stamp": {"sec": seconds, "nanosec": 0}, "frame_id": "map"}
        value = {"header": header, "pose": {"pose": pose, "covariance": [variance, *[0.0] * 6, variance, *[0.0] * 28]}}
        self.session.handle(Message(id=self.subscription("/r1/amcl_pose"), value=value))

    async def request(self) -> Request:
        """The next request."""
        while len(self.requests) == self.requests_before:
            await asyncio.sleep(0)
        self.requests_before += 1
        return self.requests[self.requests_before - 1]

    async def goal(self) -> SendGoal:
        request = await self.request()
        assert isinstance(request, SendGoal)
        return request

    def end(self, goal: SendGoal, status: GoalStatus = GoalStatus.SUCCEEDED, **result: Any) -> None:
        self.session.handle(GoalEnded(id=goal.id, status=status, value=result))


@in_event_loop
async def test_goals_are_in_the_map_of_the_robot() -> None:
    conversation = Conversation({}, [{"x": 10.0, "y": 5.0, "yaw": math.pi / 2, "frame": "hall"}])
    conversation.connection.follow(way((10, 5), (10, 7)))
    pose = (await conversation.goal()).goal["pose"]
    assert pose["header"]["frame_id"] == "hall"
    assert pose["pose"]["position"] == pytest.approx({"x": 2.0, "y": 0.0})
    assert pose["pose"]["orientation"] == pytest.approx({"z": 0.0, "w": 1.0})


@in_event_loop
async def test_a_robot_arrives_with_the_heading_that_it_is_to_have() -> None:
    conversation = Conversation({})
    there = way((0, 0), (1, 0))
    conversation.connection.follow((there[0], structs.replace(there[1], yaw=math.pi)))
    assert (await conversation.goal()).goal["pose"]["pose"]["orientation"] == pytest.approx({"z": 1.0, "w": 0.0})


@in_event_loop
async def test_a_robot_is_sent_when_it_has_been_told_its_speed_limit() -> None:
    conversation = Conversation({"speed_limit": {}})
    there = [structs.replace(waypoint, speed_limit=0.5) for waypoint in way((0, 0), (1, 0), (2, 0), (2, 1))]
    conversation.connection.follow(tuple(there[:2]))
    limit = await conversation.request()
    assert isinstance(limit, Publish)
    assert limit.message == {"speed_limit": 0.5}
    conversation.connection.follow(tuple(there))  # farther, meanwhile
    await asyncio.sleep(0)
    assert len(conversation.requests) == conversation.requests_before
    conversation.session.handle(Replied(id=limit.id, value={}))
    first = await conversation.goal()
    assert first.goal["pose"]["pose"]["position"] == {"x": 2.0, "y": 0.0}
    conversation.end(first)
    second = await conversation.goal()
    action = next(request for request in conversation.requests if isinstance(request, OpenAction))
    for present in (False, True):  # another node, which does not know the limit
        conversation.session.handle(ActionPresence(id=action.id, present=present))
    assert isinstance(await conversation.request(), Publish)
    assert second.goal["pose"]["pose"]["position"] == {"x": 2.0, "y": 1.0}


@in_event_loop
async def test_a_robot_that_halts_while_it_is_told_its_speed_limit_is_not_sent() -> None:
    conversation = Conversation({"speed_limit": {}})
    conversation.be_at(0, 0)
    conversation.connection.follow(tuple(structs.replace(waypoint, speed_limit=0.5) for waypoint in way((0, 0), (1, 0))))
    limit = await conversation.request()
    await conversation.connection.halt()
    conversation.session.handle(Replied(id=limit.id, value={}))
    await asyncio.sleep(0)
    assert len(conversation.requests) == conversation.requests_before


@in_event_loop
async def test_a_robot_in_a_lift_gets_the_map_of_the_other_floor() -> None:
    conversation = Conversation({}, FLOORS)
    conversation.be_at(4, 0)
    conversation.connection.follow((*way((4, 0)), *way((4, 0), (4, 2), first=1, level=3.0)))
    load = await conversation.request()
    assert isinstance(load, CallService)
    assert (load.service, load.request) == ("/r1/map_server/load_map", {"map_url": "first.yaml"})
    conversation.session.handle(Replied(id=load.id, value={"result": 0}))
    start = await conversation.request()
    assert isinstance(start, Publish)
    assert start.message == {"x": -96.0, "y": 0.0, "frame": "map1"}
    conversation.session.handle(Replied(id=start.id, value={}))
    goal = await conversation.goal()
    assert conversation.witness.passed_numbers == [1]
    assert goal.goal["pose"]["pose"]["position"] == {"x": -96.0, "y": 2.0}
    conversation.be_at(-96, 1)
    assert conversation.witness.pose == (4, 1, 0, 3.0)


@in_event_loop
async def test_a_robot_that_does_not_load_a_map_gives_up() -> None:
    conversation = Conversation({}, FLOORS)
    conversation.connection.follow((*way((4, 0)), *way((4, 0), first=1, level=3.0)))
    load = await conversation.request()
    assert isinstance(load, CallService)
    conversation.session.handle(Replied(id=load.id, value={"result": 1}))
    await conversation.witness.until(lambda: bool(conversation.witness.reasons))
    assert conversation.witness.reasons == ["Robot1 does not use its map of the floor at 3 m: map_server/load_map: result is 1"]


@in_event_loop
async def test_a_thing_is_picked_where_the_map_has_it_as_the_robot_sees_it() -> None:
    conversation = Conversation({"pick": [ARM], "drop": [ARM]}, [{"x": 1.0}])
    picking = asyncio.create_task(conversation.connection.pick("Jar1", "Table1", Pose(5, 0, 0)))
    goal = await conversation.goal()
    assert goal.goal == {"object": "Jar1", "x": 4.0}
    conversation.end(goal, success=True)
    await picking


@pytest.mark.parametrize(
    ("status", "result", "is_lost"),
    [
        (GoalStatus.ABORTED, {}, True),
        (GoalStatus.LOST, {}, True),
        (GoalStatus.REJECTED, {}, False),
        (GoalStatus.SUCCEEDED, {"success": False}, True),
    ],
)
def test_a_thing_that_an_arm_may_have_moved_is_lost(status: GoalStatus, result: dict[str, Any], is_lost: bool) -> None:
    @in_event_loop
    async def pick() -> None:
        conversation = Conversation({"pick": [ARM], "drop": [ARM]})
        picking = asyncio.create_task(conversation.connection.pick("Jar1", "Table1", Pose(5, 0, 0)))
        conversation.end(await conversation.goal(), status, **result)
        with pytest.raises(RobotFailed) as info:
            await picking
        assert info.value.is_lost == is_lost

    pick()


@in_event_loop
async def test_an_interrupted_arm_is_waited_for_until_it_rests() -> None:
    conversation = Conversation({"pick": [ARM, ARM], "drop": [ARM]})
    picking = asyncio.create_task(conversation.connection.pick("Jar1", "Table1", Pose(5, 0, 0)))
    goal = await conversation.goal()
    picking.cancel()
    await asyncio.wait({picking})
    interruption = asyncio.create_task(conversation.connection.interrupt())
    assert await conversation.request() == CancelGoal(id=goal.id)
    assert not interruption.done()
    conversation.end(goal, GoalStatus.CANCELED)
    await interruption
    assert len(conversation.requests) == conversation.requests_before


@in_event_loop
async def test_a_robot_leaves_the_charger_when_it_is_interrupted() -> None:
    dock = {"action": "dock", "type": "x/action/Dock", "goal": {"dock_id": "{charger}"}}
    undock = {"action": "undock", "type": "x/action/Undock"}
    conversation = Conversation({"charge": {"begin": [dock], "end": [undock]}, "attributes": {"Charge": CHARGE}})
    charging = asyncio.create_task(conversation.connection.charge("Charger1", Pose(0, 0, 0)))
    docking = await conversation.goal()
    assert docking.goal == {"dock_id": "Charger1"}
    conversation.end(docking)
    interruption = asyncio.create_task(conversation.connection.interrupt())
    conversation.end(await conversation.goal())
    await interruption
    with pytest.raises(RobotFailed, match="charging was interrupted"):
        await charging


@in_event_loop
async def test_a_robot_whose_battery_is_full_says_so() -> None:
    """Seen: its charge was full within the dead band, and the map had it at 97 %; it was charged again without an end."""
    step = {"service": "charge", "type": "x/srv/SetBool"}
    charge = CHARGE | {"dead_band": 5}
    conversation = Conversation({"charge": {"begin": [step], "end": [step], "full": 96}, "attributes": {"Charge": charge}})
    topic = conversation.subscription("/r1/battery")
    conversation.session.handle(Message(id=topic, value={"percentage": 0.94}))
    charging = asyncio.create_task(conversation.connection.charge("Charger1", Pose(0, 0, 0)))
    conversation.session.handle(Replied(id=(await conversation.request()).id, value={}))
    conversation.session.handle(Message(id=topic, value={"percentage": 0.97}))
    conversation.session.handle(Replied(id=(await conversation.request()).id, value={}))
    await charging
    assert conversation.witness.values == {"Charge": [94.0, 97.0]}


@in_event_loop
async def test_a_battery_that_is_charged_no_further_is_full() -> None:
    settings = RobotSettings.model_validate({"binding": "x.yaml"})
    binding = Binding.model_validate({"pose": {}, "charge": {"full": 80}, "attributes": {"Charge": CHARGE}})
    robot = Ros2Robot("Robot1", settings, binding, Session(list[Request]().append, lambda problem: None))
    levels: list[float | None] = []
    for level in (40.0, 80.0, 85.0, 9000.0):
        robot.measured("Charge", level)
        levels.append(robot.battery)
    assert levels == [50.0, 100.0, 100.0, None]
    assert robot.remark is not None
    assert "cannot have a charge of 9000 %, so that it is not known: correct the `scale` of attributes.Charge" in robot.remark


@in_event_loop
async def test_a_speed_limit_is_published_when_it_changes() -> None:
    conversation = Conversation({"speed_limit": {}})
    slow, fast = way((0, 0), (1, 0)), way((1, 0), (2, 0), first=1)
    conversation.connection.follow((slow[0], structs.replace(slow[1], speed_limit=0.3), fast[1]))
    limit = await conversation.request()
    assert isinstance(limit, Publish)
    assert (limit.topic, limit.message) == ("/r1/speed_limit", {"speed_limit": 0.3})
    conversation.session.handle(Replied(id=limit.id, value={}))
    goal = await conversation.goal()
    conversation.end(goal)
    limit = await conversation.request()
    assert isinstance(limit, Publish)
    assert limit.message == {"speed_limit": 0.0}


@in_event_loop
async def test_a_bridge_that_ends_is_a_robot_that_cannot_be_reached() -> None:
    conversation = Conversation({})
    assert (conversation.witness.absence or "").endswith("nothing on /r1/amcl_pose (frame map) has said yet where it is")
    conversation.be_at(0.0, 0.0)
    conversation.connection.follow(way((0, 0), (1, 0)))
    goal = await conversation.goal()
    conversation.session.disconnected("it has ended")
    assert conversation.witness.presence == [True, False]
    assert conversation.witness.absence == "it has ended"
    conversation.session.handle(Ready())
    assert conversation.witness.absence == "no node serves its action /r1/navigate_to_pose"
    opened = next(request for request in reversed(conversation.requests) if isinstance(request, OpenAction))
    conversation.session.handle(ActionPresence(id=opened.id, present=True))
    again = conversation.requests[-1]
    assert isinstance(again, SendGoal)
    assert (again.goal, again.id != goal.id) == (goal.goal, True)
    assert conversation.witness.reasons == []


@in_event_loop
async def test_a_robot_that_does_not_cancel_is_said_not_to_stop_and_is_waited_for() -> None:
    conversation = Conversation({})
    conversation.connection.follow(way((0, 0), (1, 0)))
    goal = await conversation.goal()
    halting = asyncio.create_task(conversation.connection.halt())
    assert isinstance(await conversation.request(), CancelGoal)
    conversation.session.handle(CancelRejected(id=goal.id))
    await asyncio.sleep(0)
    assert not halting.done()
    assert conversation.witness.hindrances == ["Robot1 does not stop: it does not cancel its goal P1, and is expected there"]
    conversation.end(goal)
    await halting
    assert conversation.witness.hindrances[-1] is None
    assert conversation.witness.passed_numbers == [1]


@in_event_loop
async def test_a_robot_that_does_not_know_where_it_is_is_stopped_and_not_located() -> None:
    conversation = Conversation({})
    conversation.be_at(0, 0)
    conversation.connection.follow(way((0, 0), (5, 0)))
    goal = await conversation.goal()
    conversation.be_at(3, 3, variance=1.1)
    assert await conversation.request() == CancelGoal(id=goal.id)
    assert conversation.witness.pose[:2] == (0, 0)
    conversation.be_at(3, 3, variance=None)
    conversation.be_at(2, 0)
    (reason, mended) = conversation.witness.losses
    assert reason is not None
    assert reason.startswith("it does not know where it is")
    assert mended is None
    conversation.end(goal, GoalStatus.CANCELED)
    assert conversation.witness.reasons == []


@in_event_loop
async def test_the_clock_of_a_robot_does_not_count() -> None:
    conversation = Conversation({})
    for x, seconds in ((1.0, 4_000_000_000), (2.0, 0), (3.0, 17)):
        conversation.be_at(x, 0, seconds=seconds)
        assert conversation.witness.pose[0] == x


@in_event_loop
async def test_goals_through_poses_and_along_paths_lead_around_corners() -> None:
    corner = way((10, 5), (10, 7), (9, 7))
    for type, field in (("NavigateThroughPoses", "poses"), ("FollowPath", "path")):
        binding = {"navigate": {"action": "drive", "type": f"nav2_msgs/action/{type}"}}
        conversation = Conversation(binding, [{"x": 10.0, "y": 5.0, "yaw": math.pi / 2, "frame": "hall"}])
        conversation.connection.follow(corner)
        value = (await conversation.goal()).goal[field]
        poses = value if isinstance(value, list) else value["poses"]
        points = [(pose["pose"]["position"]["x"], pose["pose"]["position"]["y"]) for pose in poses]
        assert points[-1] == pytest.approx((2.0, 1.0))
        assert poses[-1]["header"] == {"frame_id": "hall"}
        assert poses[-1]["pose"]["orientation"] == pytest.approx({"z": math.sin(math.pi / 4), "w": math.cos(math.pi / 4)})
        assert any(point == pytest.approx((2.0, 0.0)) for point in points)
        if field == "path":
            assert points[0] == pytest.approx((0.0, 0.0))
            assert max(math.dist(one, two) for one, two in itertools.pairwise(points)) <= 0.05 + 1e-9
        else:
            assert len(points) == 2


@in_event_loop
async def test_a_step_that_is_not_cancelled_is_said_and_waited_for() -> None:
    conversation = Conversation({"pick": [ARM], "drop": [ARM]})
    picking = asyncio.create_task(conversation.connection.pick("Jar1", "Table1", Pose(5, 0, 0)))
    goal = await conversation.goal()
    interrupting = asyncio.create_task(conversation.connection.interrupt())
    assert isinstance(await conversation.request(), CancelGoal)
    conversation.session.handle(CancelRejected(id=goal.id))
    await asyncio.sleep(0)
    assert not interrupting.done()
    assert conversation.witness.hindrances == ["Robot1 goes on with arm: it does not cancel it"]
    conversation.end(goal, success=True)
    await interrupting
    await picking
    assert conversation.witness.hindrances[-1] is None


@in_event_loop
async def test_a_robot_whose_pose_does_not_come_any_more_is_stopped_until_it_comes() -> None:
    """Seen with a robot whose /tf ended in mid-drive: it was driven on, and got new goals."""
    conversation = Conversation({"pose": None, "odometry": {}})
    tf, odometry = conversation.subscription("/tf"), conversation.subscription("/r1/odom")

    def drive(x: float, *, is_located: bool = True) -> None:
        speed = {"linear": {"x": 0.5, "y": 0.0}, "angular": {"z": 0.0}}
        conversation.session.handle(Message(id=odometry, value={"twist": {"twist": speed}}))
        if is_located:
            pose = {"translation": {"x": x, "y": 0.0}, "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
            transform = {"header": {"frame_id": "map"}, "child_frame_id": "base_link", "transform": pose}
            conversation.session.handle(Message(id=tf, value={"transforms": [transform]}))

    conversation.connection.follow(way((0, 0), (5, 0)))
    goal = await conversation.goal()
    for step in range(20):
        drive(0.05 * step)
    assert conversation.witness.losses == []
    for _ in range(20):
        drive(1.0, is_located=False)
    assert conversation.witness.losses == ["its pose on /tf does not come any more"]
    assert await conversation.request() == CancelGoal(id=goal.id)
    conversation.end(goal, GoalStatus.CANCELED)
    drive(2.0)
    assert conversation.witness.losses[1:] == [None]


@in_event_loop
async def test_a_robot_that_stands_before_something_is_not_missed() -> None:
    """AMCL says where a robot is when it has moved."""
    conversation = Conversation({"odometry": {}})
    conversation.connection.follow(way((0, 0), (5, 0)))
    await conversation.goal()
    speeds = [0.5] * 60 + [0.0] * 1000
    for index, speed in enumerate(speeds):
        twist = {"linear": {"x": speed, "y": 0.0}, "angular": {"z": 0.0}}
        conversation.session.handle(Message(id=conversation.subscription("/r1/odom"), value={"twist": {"twist": twist}}))
        if speed and index % 5 == 0:
            conversation.be_at(0.05 * index, 0.0)
    assert conversation.witness.losses == []
