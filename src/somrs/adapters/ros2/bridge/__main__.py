"""The bridge to ROS 2: a program that runs with the Python of the installed ROS, and does what the adapter says on its standard input.

Its folder needs `rclpy` and the standard library alone; `../lines.py` has the lines that it reads and writes. When its input ends, it
cancels all goals and ends. All of it runs in one thread, but for reading the input.
"""

from __future__ import annotations

import json
import math
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from somrs.adapters.ros2.bridge.ros_action import Action
    from somrs.adapters.ros2.bridge.ros_examination import examine
    from somrs.adapters.ros2.bridge.ros_values import fill, interface, plain, write_line
else:
    from ros_action import Action
    from ros_examination import examine
    from ros_values import fill, interface, plain, write_line

POLLED = 0.2
"""How often it looks which servers there are: `rclpy` does not tell. Seconds."""
FLUSHED = 0.05
"""How often messages are sent that had to wait for the interval of their subscription. Seconds."""
PATIENCE = 5.0
"""How long a service or a subscriber is looked for, how long goals have for their ends when the adapter is gone, and then the middleware
for its own, at which it can hang. Seconds."""


class Subscription:
    """A topic whose messages are sent, at most one in an interval."""

    def __init__(self, node: Any, request: dict[str, Any]) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        self.id, self.interval, self.pending, self.sent = request["id"], request["interval"], None, -math.inf
        # A subscriber that asks for less than a publisher offers gets its messages; one that asks for more gets none. Only who asks for the
        # last message gets it, so that it takes a second one for publishers that do not keep it.
        qualities = [(ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE)]
        if request["latched"]:
            qualities.append((ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL))
        depth = 100 if not self.interval else 1
        profiles = [QoSProfile(depth=depth, reliability=reliability, durability=durability) for reliability, durability in qualities]
        type = interface(request["type"], "msg")
        self.handles = [node.create_subscription(type, request["topic"], self.take, profile) for profile in profiles]

    def take(self, message: Any) -> None:
        self.pending = message
        self.flush()

    def flush(self) -> None:
        now = time.monotonic()
        if self.pending is not None and now - self.sent >= self.interval:
            message, self.pending, self.sent = self.pending, None, now
            write_line(say="Message", id=self.id, value=plain(message))


class Bridge:
    """Does what each line says."""

    def __init__(self, node: Any) -> None:
        self.node = node
        self.subscriptions: dict[int, Subscription] = {}
        self.actions: dict[int, Action] = {}
        self.closing: list[Action] = []
        """Those that are closed when their last goals have ended."""
        self.publishers: dict[tuple[str, str], Any] = {}
        self.clients: dict[tuple[str, str], Any] = {}
        node.create_timer(POLLED, self.look)
        node.create_timer(FLUSHED, self.flush)

    def look(self) -> None:
        for action in self.actions.values():
            action.look()
        for action in [action for action in self.closing if not action.goals]:
            self.closing.remove(action)
            action.close()

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
            "Examine": self.examine,
        }
        try:
            steps[request["do"]](request)
        except Exception as error:  # noqa: BLE001  rclpy raises many kinds of its own; one wrong line does not end the others
            write_line(say="Trouble", id=request.get("id"), problem=str(error) or type(error).__name__)

    def subscribe(self, request: dict[str, Any]) -> None:
        self.subscriptions[request["id"]] = Subscription(self.node, request)

    def unsubscribe(self, id: int) -> None:
        if id in self.subscriptions:
            for handle in self.subscriptions.pop(id).handles:
                self.node.destroy_subscription(handle)

    def open_action(self, request: dict[str, Any]) -> None:
        self.actions[request["id"]] = Action(self.node, request)

    def close_action(self, id: int) -> None:
        if (action := self.actions.pop(id, None)) is not None:
            action.cancel_all_goals()
            self.closing.append(action)

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

    def examine(self, request: dict[str, Any]) -> None:
        problem, may_pass = examine(self.node, request)
        write_line(say="Examined", id=request["id"], problem=problem, may_pass=may_pass)

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


def stop(actions: Collection[Action], executor: Any) -> None:
    """Cancel all goals, and wait for their ends: nobody follows the robots any more."""
    for action in actions:
        action.cancel_all_goals()
    end_time = time.monotonic() + PATIENCE
    while any(action.goals for action in actions) and time.monotonic() < end_time:
        executor.spin_once(timeout_sec=FLUSHED)


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
        line = b"\n"
        while line:
            line = sys.stdin.buffer.readline()
            lines.put(line)
            guard.trigger()
        signal.alarm(int(2 * PATIENCE))  # the middleware may hang with the lock of the interpreter

    write_line(say="Ready", distribution=os.environ.get("ROS_DISTRO", ""))
    threading.Thread(target=read, daemon=True).start()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not is_over.is_set():
        executor.spin_once()
    actions = [*bridge.actions.values(), *bridge.closing]
    stop(actions, executor)
    for action in actions:
        action.close()  # what is left open keeps the shared memory of the middleware
    node.destroy_node()  # others learn at once that it is gone
    rclpy.shutdown()
    os._exit(0)  # threads of the middleware are not waited for


if __name__ == "__main__":
    main()
