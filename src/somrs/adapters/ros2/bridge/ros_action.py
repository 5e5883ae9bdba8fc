"""The client of an action: whether its server can be used, and the goals that it has."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from somrs.adapters.ros2.bridge.ros_lifecycle import Lifecycle
    from somrs.adapters.ros2.bridge.ros_values import fill, interface, plain, write_line
else:
    from ros_lifecycle import Lifecycle
    from ros_values import fill, interface, plain, write_line

REPEATED = 5.0
"""After which time a server is asked again to cancel what goes on: it may have refused, and a request to one that is new can get lost.
Seconds."""
SETTLED = 0.5
"""How long the statuses that a server keeps for those that come later may take after its first answer; one that has had no goals has none.
Seconds."""
STATUS_NAMES = {4: "succeeded", 5: "canceled", 6: "aborted"}
"""action_msgs/msg/GoalStatus; 1 to 3 are goals that are under way."""
NOT_CANCELLED = "it goes on with a goal of an earlier client, which it does not cancel"


class Action:
    """The client of an action, and its open goals."""

    def __init__(self, node: Any, request: dict[str, Any]) -> None:
        from rclpy.action import ActionClient

        self.id, self.name, self.node = request["id"], request["action"], node
        self.type = interface(request["type"], "action")
        self.client = ActionClient(node, self.type, self.name)
        cancel_type = interface("action_msgs/srv/CancelGoal", "srv")
        self.cancelling = node.create_client(cancel_type, f"{self.name}/_action/cancel_goal")
        self.cancel_all = cancel_type.Request()
        self.lifecycle = Lifecycle(node)
        self.servers: frozenset[bytes] = frozenset()
        self.status: Any = None
        self.asked = self.answered = -math.inf
        self.is_present, self.problem = False, ""
        self.statuses: dict[bytes, int] | None = None
        """Those of the server's goals, by their ids; None until it has published them."""
        self.foreign: set[bytes] | None = None
        """The goals of an earlier client that are being cancelled; None until the server has answered."""
        self.goals: dict[int, Any] = {}
        """By their numbers; None until the server has accepted them."""
        self.cancelled: dict[int, float] = {}
        """When the server was asked to cancel a goal, and has not refused; infinity: it has yet to be asked."""

    # Whether the server can be used

    def look(self) -> None:
        """Find out whether there is a server, and whether it is another one: a node that is started again soon never seems to be away."""
        publishers = self.node.get_publishers_info_by_topic(f"{self.name}/_action/status")
        servers = frozenset(bytes(publisher.endpoint_gid) for publisher in publishers) if self.client.server_is_ready() else frozenset()
        if servers != self.servers:
            self.servers = servers
            self.lose()
            self.lifecycle.forget()
            self.meet()
        if not servers:
            return
        state = self.lifecycle.state(publishers[0])
        if state != "active":
            if self.is_present:
                self.lose()
            if state is not None:
                self.tell(False, f"its node is {state}")
            return
        if not self.is_present and time.monotonic() >= self.asked + REPEATED:
            # What an earlier client has left there is not this client's: the robot first comes to rest.
            self.asked = asked = time.monotonic()
            self.cancelling.call_async(self.cancel_all).add_done_callback(lambda done: self.cancelled_all(done.result(), asked))
        self.rest()
        for goal, asked in self.cancelled.items():
            if time.monotonic() >= asked + REPEATED:
                self.ask_to_cancel(goal)

    def meet(self) -> None:
        """Listen to a server that is new. The statuses that it keeps come to a new subscription only."""
        from rclpy.qos import qos_profile_action_status_default

        if self.status is not None:
            self.node.destroy_subscription(self.status)
        self.statuses = None
        status_type = interface("action_msgs/msg/GoalStatusArray", "msg")
        topic = f"{self.name}/_action/status"
        self.status = self.node.create_subscription(status_type, topic, self.take_status, qos_profile_action_status_default)

    def lose(self) -> None:
        self.foreign, self.asked = None, -math.inf
        for goal in [*self.goals]:
            self.end(goal, "lost")
        self.tell(False)

    def tell(self, present: bool, problem: str = "") -> None:
        """Say whether the server can be used, and why not although it is there: whenever this changes."""
        if (present, problem) != (self.is_present, self.problem):
            self.is_present, self.problem = present, problem
            write_line(say="ActionPresence", id=self.id, present=present, problem=problem)

    def cancelled_all(self, response: Any, asked: float) -> None:
        if asked != self.asked or not self.servers:
            return  # it has been asked again: what it is sent now would be cancelled, too
        self.answered = time.monotonic()
        self.foreign = (self.foreign or set()) | {bytes(goal.goal_id.uuid) for goal in response.goals_canceling}
        self.rest()

    def take_status(self, message: Any) -> None:
        self.statuses = {bytes(status.goal_info.goal_id.uuid): status.status for status in message.status_list}
        self.rest()

    def rest(self) -> None:
        """Count the server as present if it has ended the goals of an earlier client: in whatever order it says so.

        A server that refuses may say so, or only not name the goals that it does not cancel: their statuses tell.
        """
        if self.foreign is None or self.is_present:
            return
        if self.statuses is None:
            if not self.foreign and time.monotonic() >= self.answered + SETTLED:
                self.tell(True)
        elif self.foreign <= self.statuses.keys() and all(status in STATUS_NAMES for status in self.statuses.values()):
            self.tell(True)
        elif any(status not in STATUS_NAMES and goal not in self.foreign for goal, status in self.statuses.items()):
            self.tell(False, NOT_CANCELLED)

    # Goals

    def send(self, request: dict[str, Any]) -> None:
        id = request["id"]
        if not self.is_present:
            write_line(say="GoalEnded", id=id, status="lost")
            return
        goal = fill(self.type.Goal(), request["goal"])
        self.goals[id] = None
        future = self.client.send_goal_async(goal, feedback_callback=lambda feedback: self.feed(id, feedback.feedback))
        future.add_done_callback(lambda done: self.accepted(id, done.result()))

    def feed(self, id: int, feedback: Any) -> None:
        if id in self.goals:
            write_line(say="Feedback", id=id, value=plain(feedback))

    def accepted(self, id: int, handle: Any) -> None:
        if id not in self.goals:
            return
        if not handle.accepted:
            self.end(id, "rejected")
            return
        self.goals[id] = handle
        handle.get_result_async().add_done_callback(lambda done: self.ended(id, done.result()))
        if id in self.cancelled:
            self.ask_to_cancel(id)

    def cancel(self, id: int) -> None:
        if id in self.goals:
            self.cancelled[id] = math.inf
            if self.goals[id] is not None:
                self.ask_to_cancel(id)

    def cancel_all_goals(self) -> None:
        for id in [*self.goals]:
            self.cancel(id)

    def ask_to_cancel(self, id: int) -> None:
        self.cancelled[id] = math.inf
        self.goals[id].cancel_goal_async().add_done_callback(lambda done: self.cancel_answered(id, done.result()))

    def cancel_answered(self, id: int, response: Any) -> None:
        """A server that refuses says so, or only does not name the goal. One that has ended it, or is about to, has not refused."""
        if id in self.goals and not response.goals_canceling and response.return_code in (response.ERROR_NONE, response.ERROR_REJECTED):
            self.cancelled[id] = time.monotonic()
            write_line(say="CancelRejected", id=id)

    def ended(self, id: int, response: Any) -> None:
        if id in self.goals:
            self.end(id, STATUS_NAMES.get(response.status, "lost"), plain(response.result))

    def end(self, id: int, status: str, value: Any = None) -> None:
        del self.goals[id]
        self.cancelled.pop(id, None)
        write_line(say="GoalEnded", id=id, status=status, value=value or {})

    def close(self) -> None:
        if self.status is not None:
            self.node.destroy_subscription(self.status)
        self.node.destroy_client(self.cancelling)
        self.lifecycle.forget()
        self.client.destroy()
