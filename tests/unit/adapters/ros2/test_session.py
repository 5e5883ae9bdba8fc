"""The conversation with the bridge, as recorded and as it goes wrong."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.ros2.lines import (
    CancelGoal,
    CancelRejected,
    Feedback,
    GoalEnded,
    GoalStatus,
    OpenAction,
    Replied,
    Request,
    SendGoal,
    Subscribe,
    Values,
    decode_report,
)
from somrs.adapters.ros2.session import Session
from somrs.errors import WireError

RECORDED = [
    b'{"say":"Ready","distribution":"kilted"}',
    b'{"say":"ActionPresence","id":2,"present":true}',
    b'{"say":"Message","id":1,"value":{"voltage":null,"percentage":0.42}}',
    b'{"say":"Feedback","id":3,"value":{"distance_remaining":1.5}}',
    b'{"say":"GoalEnded","id":3,"status":"aborted","value":{"error_code":9003,"error_msg":"no valid path"}}',
    b'{"say":"Message","id":99,"value":{}}',
    b'{"say":"GoalEnded","id":3,"status":"succeeded","value":{}}',
]
"""What a bridge said to an adapter that subscribed, opened an action, and sent a goal; then lines for which nobody waits."""


class _Conversation:
    def __init__(self) -> None:
        self.requests: list[Request] = []
        self.troubles: list[str] = []
        self.messages: list[Values] = []
        self.presence: list[bool] = []
        self.reports: list[Feedback | CancelRejected | GoalEnded] = []
        self.replies: list[Replied] = []
        self.session = Session(self.requests.append, self.troubles.append)
        self.topic = self.session.subscribe("/battery_state", "sensor_msgs/msg/BatteryState", self.messages.append)
        self.action = self.session.open_action("/navigate_to_pose", "nav2_msgs/action/NavigateToPose", self.presence.append)

    def hear(self, *lines: bytes) -> None:
        for line in lines:
            self.session.handle(decode_report(line))


def test_a_recorded_conversation_is_told_to_those_who_wait() -> None:
    conversation = _Conversation()
    conversation.hear(*RECORDED[:2])
    goal = conversation.session.send_goal(conversation.action, {"pose": {}}, conversation.reports.append)
    conversation.hear(*RECORDED[2:])
    assert conversation.presence == [True]
    assert conversation.messages == [{"voltage": None, "percentage": 0.42}]
    assert [type(report) for report in conversation.reports] == [Feedback, GoalEnded]
    assert conversation.reports[1] == GoalEnded(
        id=goal, status=GoalStatus.ABORTED, value={"error_code": 9003, "error_msg": "no valid path"}
    )
    assert conversation.troubles == []


def test_a_bridge_is_told_what_is_wanted_when_it_is_ready_and_so_is_the_next() -> None:
    conversation = _Conversation()
    assert conversation.requests == []
    conversation.hear(RECORDED[0])
    told = [
        Subscribe(id=1, topic="/battery_state", type="sensor_msgs/msg/BatteryState"),
        OpenAction(id=2, action="/navigate_to_pose", type="nav2_msgs/action/NavigateToPose"),
    ]
    assert conversation.requests == told
    conversation.session.disconnected("it has ended")
    conversation.hear(RECORDED[0])
    assert conversation.requests == told * 2


def test_a_bridge_that_ends_loses_goals_and_calls() -> None:
    conversation = _Conversation()
    conversation.hear(*RECORDED[:2])
    goal = conversation.session.send_goal(conversation.action, {}, conversation.reports.append)
    conversation.session.call_service("/charge", "std_srvs/srv/SetBool", {}, conversation.replies.append)
    conversation.session.disconnected("it has ended")
    assert conversation.reports == [GoalEnded(id=goal, status=GoalStatus.LOST)]
    assert [reply.problem for reply in conversation.replies] == ["the bridge to ROS 2 has ended"]
    assert conversation.presence == [True, False]


def test_without_a_bridge_goals_and_calls_end_at_once() -> None:
    conversation = _Conversation()
    goal = conversation.session.send_goal(conversation.action, {}, conversation.reports.append)
    conversation.session.publish("/speed_limit", "nav2_msgs/msg/SpeedLimit", {}, conversation.replies.append)
    assert conversation.reports == [GoalEnded(id=goal, status=GoalStatus.LOST)]
    assert [reply.problem for reply in conversation.replies] == ["the bridge to ROS 2 does not run"]


def test_a_goal_that_cannot_be_sent_is_rejected_with_the_reason() -> None:
    conversation = _Conversation()
    conversation.hear(*RECORDED[:2])
    conversation.session.send_goal(conversation.action, {"poze": {}}, conversation.reports.append)
    conversation.hear(b'{"say":"Trouble","id":3,"problem":"poze: NavigateToPose_Goal has no such field; it has pose"}')
    (report,) = conversation.reports
    assert isinstance(report, GoalEnded)
    assert (report.status, report.problem) == (GoalStatus.REJECTED, "poze: NavigateToPose_Goal has no such field; it has pose")


def test_trouble_with_a_topic_names_it() -> None:
    conversation = _Conversation()
    conversation.hear(RECORDED[0], b'{"say":"Trouble","id":1,"problem":"the type is not installed"}')
    assert conversation.troubles == ["/battery_state: the type is not installed"]


def test_goals_are_cancelled_while_they_are_under_way() -> None:
    conversation = _Conversation()
    conversation.hear(*RECORDED[:2])
    goal = conversation.session.send_goal(conversation.action, {}, conversation.reports.append)
    conversation.session.cancel_goal(goal)
    conversation.hear(b'{"say":"GoalEnded","id":3,"status":"canceled"}')
    conversation.session.cancel_goal(goal)
    assert conversation.requests[2:] == [SendGoal(id=goal, action=2, goal={}), CancelGoal(id=goal)]


@given(lines=st.lists(st.sampled_from(RECORDED[1:])))
def test_repeated_and_late_lines_end_a_goal_at_most_once(lines: list[bytes]) -> None:
    conversation = _Conversation()
    conversation.hear(RECORDED[0])
    conversation.session.send_goal(conversation.action, {}, conversation.reports.append)
    conversation.hear(*lines)
    assert sum(isinstance(report, GoalEnded) for report in conversation.reports) <= 1
    assert conversation.presence in ([], [True])


@given(line=st.binary(max_size=60) | st.sampled_from(RECORDED).flatmap(lambda line: st.integers(0, len(line) - 1).map(lambda n: line[:n])))
def test_a_torn_line_is_a_wire_error(line: bytes) -> None:
    with pytest.raises(WireError, match="not a line of the bridge"):
        decode_report(line)
