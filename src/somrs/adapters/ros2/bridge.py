"""The bridge to ROS 2: a program that runs with the Python of the installed ROS, and does what the adapter says on its standard input.

It needs `rclpy` and the standard library alone; `lines.py` has the lines that it reads and writes. It ends when its input ends. All of it
runs in one thread, but for reading the input.
"""

from __future__ import annotations

import base64
import importlib
import json
import math
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

POLLED = 0.2
"""How often it looks which servers there are: `rclpy` does not tell. Seconds."""
REPEATED = 5.0
"""After which time a server is asked again to cancel what goes on: a request to one that is new can get lost. Seconds."""
FLUSHED = 0.05
"""How often messages are sent that had to wait for the interval of their subscription. Seconds."""
PATIENCE = 5.0
"""How long a service or a subscriber is looked for, and how long the middleware has for its end, at which it can hang. Seconds."""
STATUS_NAMES = {4: "succeeded", 5: "canceled", 6: "aborted"}
"""action_msgs/msg/GoalStatus; 1 to 3 are goals that are under way."""


def interface(type_name: str, kind: str) -> Any:
    """The class of a ROS type, such as `std_msgs/msg/Bool`. Raises ValueError, which says what to do."""
    package, written_kind, name = [*type_name.split("/"), "", ""][:3]
    if not name or written_kind != kind:
        raise ValueError(f"{type_name!r} is not a type of this kind: write it as package/{kind}/Name")
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"the type {type_name} is not installed ({error}): source the set-up of the workspace that has it") from None


def plain(value: Any) -> Any:
    """A ROS value as JSON: messages as objects, bytes in base64, NaN and infinities as null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bool | int | str):
        return value
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes) or getattr(value, "typecode", None) in ("b", "B"):
        return base64.b64encode(bytes(value)).decode()
    if hasattr(value, "tolist"):
        value = value.tolist()
    return [plain(item) for item in value]


def fill(message: Any, values: Any, place: str = "") -> Any:
    """Set the fields of a ROS message from JSON, and return it. Raises ValueError, which names the field."""
    if not isinstance(values, dict):
        raise ValueError(f"{place or 'the message'} has fields, and is not {values!r}")
    types = message.get_fields_and_field_types()
    for name, value in values.items():
        path = f"{place}.{name}" if place else name
        if name not in types:
            raise ValueError(f"{path}: {type(message).__name__} has no such field; it has {', '.join(types)}")
        try:
            setattr(message, name, _converted(getattr(message, name), types[name], value, path))
        except (AssertionError, TypeError, OverflowError):
            raise ValueError(f"{path} is of the type {types[name]}, and cannot be {value!r}") from None
    return message


def _converted(current: Any, type_name: str, value: Any, path: str) -> Any:
    if hasattr(current, "get_fields_and_field_types"):
        return fill(current, value, path)
    if type_name.startswith("sequence<") or type_name.endswith("]"):
        element = type_name.removeprefix("sequence<").partition(",")[0].rstrip(">").partition("[")[0]
        if "/" in element:
            package, _, name = element.partition("/")
            return [fill(interface(f"{package}/msg/{name}", "msg")(), item, f"{path}[{index}]") for index, item in enumerate(value)]
        return [_number(item, element) for item in value]
    return _number(value, type_name)


def _number(value: Any, type_name: str) -> Any:
    """YAML does not tell 1.0 from 1: ROS does."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and type_name in ("float", "double"):
        return float(value)
    if is_number and "int" in type_name and float(value).is_integer():
        return int(value)
    return value


def write_line(**fields: Any) -> None:
    line = json.dumps(fields, allow_nan=False, separators=(",", ":")).encode() + b"\n"
    try:
        while line:
            line = line[os.write(sys.stdout.fileno(), line) :]
    except BrokenPipeError:
        os._exit(0)  # the adapter has ended


class Subscription:
    """A topic whose messages are sent, at most one in an interval."""

    def __init__(self, node: Any, request: dict[str, Any]) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        self.id, self.interval, self.pending, self.sent = request["id"], request["interval"], None, -math.inf
        # A subscriber that asks for less than a publisher offers gets its messages; one that asks for more does not.
        is_latched = request["latched"]
        durability = DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE
        reliability = ReliabilityPolicy.RELIABLE if is_latched else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=100 if not self.interval else 1, durability=durability, reliability=reliability)
        self.handle = node.create_subscription(interface(request["type"], "msg"), request["topic"], self.take, qos)

    def take(self, message: Any) -> None:
        self.pending = message
        self.flush()

    def flush(self) -> None:
        now = time.monotonic()
        if self.pending is not None and now - self.sent >= self.interval:
            message, self.pending, self.sent = self.pending, None, now
            write_line(say="Message", id=self.id, value=plain(message))


class Action:
    """The client of an action, and its open goals."""

    def __init__(self, node: Any, request: dict[str, Any]) -> None:
        from rclpy.action import ActionClient
        from rclpy.qos import qos_profile_action_status_default as qos

        self.id, self.name, self.node = request["id"], request["action"], node
        self.type = interface(request["type"], "action")
        self.client = ActionClient(node, self.type, self.name)
        cancel_type, status_type = interface("action_msgs/srv/CancelGoal", "srv"), interface("action_msgs/msg/GoalStatusArray", "msg")
        self.cancelling = node.create_client(cancel_type, f"{self.name}/_action/cancel_goal")
        self.cancel_all = cancel_type.Request()
        self.status = node.create_subscription(status_type, f"{self.name}/_action/status", self.take_status, qos)
        self.servers: frozenset[bytes] = frozenset()
        self.asked = -math.inf
        self.is_present = False
        self.statuses: dict[bytes, int] | None = None
        """Those of the server's goals, by their ids; None until it has published them."""
        self.foreign: set[bytes] | None = None
        """The goals of an earlier client that have to end before the server counts as present."""
        self.goals: dict[int, Any] = {}
        """By their numbers; None until the server has accepted them."""
        self.cancelled: set[int] = set()

    def look(self) -> None:
        """Find out whether there is a server, and whether it is another one: a node that is started again soon never seems to be away."""
        publishers = self.node.get_publishers_info_by_topic(f"{self.name}/_action/status")
        servers = frozenset(bytes(publisher.endpoint_gid) for publisher in publishers) if self.client.server_is_ready() else frozenset()
        is_changed, self.servers = servers != self.servers, servers
        if is_changed:
            self.lose()
        is_asking = self.is_present or self.foreign is not None or time.monotonic() < self.asked + REPEATED
        if servers and (is_changed or not is_asking):
            # What an earlier client has left there is not this client's: the robot first comes to rest.
            self.asked = asked = time.monotonic()
            self.cancelling.call_async(self.cancel_all).add_done_callback(lambda done: self.cancelled_all(done.result(), asked))

    def lose(self) -> None:
        was_present, self.is_present, self.foreign = self.is_present, False, None
        for goal in [*self.goals]:
            self.end(goal, "lost")
        if was_present:
            write_line(say="ActionPresence", id=self.id, present=False)

    def cancelled_all(self, response: Any, asked: float) -> None:
        if asked != self.asked or not self.servers:
            return  # it has been asked again: what it is sent now would be cancelled, too
        self.foreign = {bytes(goal.goal_id.uuid) for goal in response.goals_canceling}
        if not self.foreign and response.return_code != response.ERROR_REJECTED:
            self.appear()
        self.rest()

    def take_status(self, message: Any) -> None:
        self.statuses = {bytes(status.goal_info.goal_id.uuid): status.status for status in message.status_list}
        self.rest()

    def rest(self) -> None:
        """Count the server as present if it has ended the goals of an earlier client: in whatever order it says so."""
        if self.foreign is None or self.statuses is None or not self.foreign <= self.statuses.keys():
            return
        if all(status in STATUS_NAMES for status in self.statuses.values()):
            self.appear()

    def appear(self) -> None:
        self.is_present, self.foreign = True, None
        write_line(say="ActionPresence", id=self.id, present=True)

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
            handle.cancel_goal_async()

    def cancel(self, id: int) -> None:
        if id in self.goals:
            self.cancelled.add(id)
            if self.goals[id] is not None:
                self.goals[id].cancel_goal_async()

    def ended(self, id: int, response: Any) -> None:
        if id in self.goals:
            self.end(id, STATUS_NAMES.get(response.status, "lost"), plain(response.result))

    def end(self, id: int, status: str, value: Any = None) -> None:
        del self.goals[id]
        self.cancelled.discard(id)
        write_line(say="GoalEnded", id=id, status=status, value=value or {})

    def close(self) -> None:
        self.node.destroy_subscription(self.status)
        self.node.destroy_client(self.cancelling)
        self.client.destroy()


class Bridge:
    """Does what each line says."""

    def __init__(self, node: Any) -> None:
        self.node = node
        self.subscriptions: dict[int, Subscription] = {}
        self.actions: dict[int, Action] = {}
        self.publishers: dict[tuple[str, str], Any] = {}
        self.clients: dict[tuple[str, str], Any] = {}
        node.create_timer(POLLED, self.look)
        node.create_timer(FLUSHED, self.flush)

    def look(self) -> None:
        for action in self.actions.values():
            action.look()

    def flush(self) -> None:
        for subscription in self.subscriptions.values():
            subscription.flush()

    def do(self, request: dict[str, Any]) -> None:
        """Carry out a request; what cannot be done is reported. Fields that are left out have the defaults of `lines.py`."""
        request = {"latched": False, "interval": 0.0, **request}
        steps: dict[str, Callable[[dict[str, Any]], None]] = {
            "Subscribe": self.subscribe,
            "Unsubscribe": lambda line: self.unsubscribe(line["id"]),
            "OpenAction": self.open_action,
            "CloseAction": lambda line: self.close_action(line["id"]),
            "SendGoal": self.send_goal,
            "CancelGoal": self.cancel_goal,
            "CallService": self.call_service,
            "Publish": self.publish,
        }
        try:
            steps[request["do"]](request)
        except Exception as error:  # noqa: BLE001  rclpy raises many kinds of its own; one wrong line does not end the others
            write_line(say="Trouble", id=request.get("id"), problem=str(error) or type(error).__name__)

    def subscribe(self, request: dict[str, Any]) -> None:
        self.subscriptions[request["id"]] = Subscription(self.node, request)

    def unsubscribe(self, id: int) -> None:
        if id in self.subscriptions:
            self.node.destroy_subscription(self.subscriptions.pop(id).handle)

    def open_action(self, request: dict[str, Any]) -> None:
        self.actions[request["id"]] = Action(self.node, request)

    def close_action(self, id: int) -> None:
        if (action := self.actions.pop(id, None)) is not None:
            action.lose()
            action.close()

    def send_goal(self, request: dict[str, Any]) -> None:
        if (action := self.actions.get(request["action"])) is None:
            raise ValueError("there is no client for this action")
        action.send(request)

    def cancel_goal(self, request: dict[str, Any]) -> None:
        for action in self.actions.values():
            action.cancel(request["id"])

    def call_service(self, request: dict[str, Any]) -> None:
        id, name = request["id"], request["service"]
        kind = interface(request["type"], "srv")
        message = fill(kind.Request(), request["request"])
        key = name, request["type"]
        client = self.clients.setdefault(key, None) or self.node.create_client(kind, name)
        self.clients[key] = client

        def call() -> None:
            client.call_async(message).add_done_callback(lambda done: write_line(say="Replied", id=id, value=plain(done.result())))

        self.when(client.service_is_ready, call, id, f"there is no service {name}")

    def publish(self, request: dict[str, Any]) -> None:
        id, topic = request["id"], request["topic"]
        kind = interface(request["type"], "msg")
        message = fill(kind(), request["message"])
        key = topic, request["type"]
        publisher = self.publishers.setdefault(key, None) or self.node.create_publisher(kind, topic, 10)
        self.publishers[key] = publisher

        def publish() -> None:
            publisher.publish(message)
            write_line(say="Replied", id=id, value={})

        self.when(lambda: publisher.get_subscription_count() > 0, publish, id, f"nobody subscribes to {topic}")

    def when(self, is_ready: Callable[[], bool], act: Callable[[], None], id: int, problem: str) -> None:
        """Act as soon as the other side is there, which a client or publisher that is new does not know at once."""
        if is_ready():
            act()
            return
        end_time = time.monotonic() + PATIENCE

        def attempt() -> None:
            if is_ready():
                act()
            elif time.monotonic() > end_time:
                write_line(say="Trouble", id=id, problem=problem)
            else:
                return
            self.node.destroy_timer(timer)

        timer = self.node.create_timer(FLUSHED, attempt)


def main() -> None:
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the adapter, which closes the input
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(f"somrs_bridge_{os.getpid()}")
    bridge = Bridge(node)
    lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    is_over = threading.Event()

    def work() -> None:
        while not lines.empty():
            line = lines.get()
            if line:
                bridge.do(json.loads(line))
            else:
                is_over.set()

    guard = node.create_guard_condition(work)

    def read() -> None:
        while True:
            line = sys.stdin.buffer.readline()
            lines.put(line)
            guard.trigger()
            if not line:
                time.sleep(PATIENCE)
                os._exit(0)

    write_line(say="Ready", distribution=os.environ.get("ROS_DISTRO", ""))
    threading.Thread(target=read, daemon=True).start()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not is_over.is_set():
        executor.spin_once()
    for action in bridge.actions.values():
        action.close()  # what is left open keeps the shared memory of the middleware
    node.destroy_node()  # others learn at once that it is gone
    rclpy.shutdown()
    os._exit(0)  # threads of the middleware are not waited for


if __name__ == "__main__":
    main()
