"""The adapter's side of the conversation with the bridge, without I/O: what is subscribed, opened and under way.

A bridge that ends loses the goals that are under way, and its successor is told everything anew.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

from msgspec import structs

from somrs.adapters.ros2.lines import (
    ActionPresence,
    CallService,
    CancelGoal,
    CancelRejected,
    CloseAction,
    Examine,
    Examined,
    Feedback,
    GoalEnded,
    GoalStatus,
    Message,
    OpenAction,
    Publish,
    Ready,
    Replied,
    Report,
    Request,
    SendGoal,
    Subscribe,
    Trouble,
    Unsubscribe,
    Values,
)

MessageObserver = Callable[[Values], None]
PresenceObserver = Callable[[bool], None]
GoalObserver = Callable[[Feedback | CancelRejected | GoalEnded], None]
ReplyObserver = Callable[[Replied], None]
ExaminationObserver = Callable[[Examined], None]
TroubleObserver = Callable[[str], None]


class Session:
    """Sends requests to the bridge, and hands its reports to those who wait for them.

    `send` takes a request to the bridge; it is called only while one runs. `on_trouble` is told, for people, what cannot be done.
    """

    def __init__(self, send: Callable[[Request], None], on_trouble: TroubleObserver) -> None:
        self._send, self._on_trouble = send, on_trouble
        self._numbers = itertools.count(1)
        self.is_connected = False
        self.problem = "the bridge to ROS 2 does not run yet"
        """Why there is no bridge, for people, while there is none."""
        self.bridge_observers: list[Callable[[], None]] = []
        """Are called whenever the bridge has begun or ended."""
        self._subscriptions: dict[int, tuple[Subscribe, MessageObserver]] = {}
        self._actions: dict[int, tuple[OpenAction, PresenceObserver]] = {}
        self._present: set[int] = set()
        self._goals: dict[int, GoalObserver] = {}
        self._calls: dict[int, ReplyObserver] = {}
        self._examinations: dict[int, tuple[Examine, ExaminationObserver]] = {}

    def subscribe(self, topic: str, type: str, observer: MessageObserver, *, latched: bool = False, interval: float = 0.0) -> int:
        """Receive the messages of a topic. Returns the number of the subscription."""
        request = Subscribe(id=next(self._numbers), topic=topic, type=type, latched=latched, interval=interval)
        self._subscriptions[request.id] = (request, observer)
        self._tell(request)
        return request.id

    def unsubscribe(self, id: int) -> None:
        if self._subscriptions.pop(id, None) is not None:
            self._tell(Unsubscribe(id=id))

    def open_action(self, action: str, type: str, observer: PresenceObserver) -> int:
        """Connect to an action. The observer is told whether its server is present, whenever that changes; it is not at first."""
        request = OpenAction(id=next(self._numbers), action=action, type=type)
        self._actions[request.id] = (request, observer)
        self._tell(request)
        return request.id

    def close_action(self, id: int) -> None:
        if self._actions.pop(id, None) is not None:
            self._present.discard(id)
            self._tell(CloseAction(id=id))

    def send_goal(self, action: int, goal: Values, observer: GoalObserver) -> int:
        """Send a goal. The observer gets its feedback, that it is not cancelled, and in any case its end: at once without a bridge."""
        id = next(self._numbers)
        if self.is_connected:
            self._goals[id] = observer
            self._send(SendGoal(id=id, action=action, goal=goal))
        else:
            observer(GoalEnded(id=id, status=GoalStatus.LOST))
        return id

    def cancel_goal(self, id: int) -> None:
        """Cancel a goal, if it has not ended."""
        if id in self._goals:
            self._tell(CancelGoal(id=id))

    def call_service(self, service: str, type: str, request: Values, observer: ReplyObserver) -> None:
        """Call a service. The observer gets the response, or why there is none: at once, if there is no bridge."""
        self._ask(CallService(id=next(self._numbers), service=service, type=type, request=request), observer)

    def publish(self, topic: str, type: str, message: Values, observer: ReplyObserver) -> None:
        """Publish a message. The observer learns that it is published, or why not: at once, if there is no bridge."""
        self._ask(Publish(id=next(self._numbers), topic=topic, type=type, message=message), observer)

    def examine(self, request: Examine, observer: ExaminationObserver) -> None:
        """Have something examined, now or as soon as there is a bridge. Its number is given here."""
        request = structs.replace(request, id=next(self._numbers))
        self._examinations[request.id] = request, observer
        self._tell(request)

    def handle(self, report: Report) -> None:
        """Take what the bridge says. What nobody waits for any more is ignored."""
        match report:
            case Ready():
                self.is_connected = True
                for subscribe, _ in self._subscriptions.values():
                    self._send(subscribe)
                for open_action, _ in self._actions.values():
                    self._send(open_action)
                self._tell_of_bridge()
                for examination, _ in self._examinations.values():
                    self._send(examination)
            case Message(id=id, value=value) if id in self._subscriptions:
                self._subscriptions[id][1](value)
            case ActionPresence(id=id, present=present, problem=problem) if id in self._actions:
                if problem:
                    self._on_trouble(f"{self._actions[id][0].action}: {problem}")
                if present != (id in self._present):
                    (self._present.add if present else self._present.discard)(id)
                    self._actions[id][1](present)
            case Feedback(id=id) | CancelRejected(id=id) if id in self._goals:
                self._goals[id](report)
            case GoalEnded(id=id) if id in self._goals:
                self._goals.pop(id)(report)
            case Replied(id=id) if id in self._calls:
                self._calls.pop(id)(report)
            case Examined(id=id) if id in self._examinations:
                self._examinations.pop(id)[1](report)
            case Trouble(id=int() as id, problem=problem) if id in self._examinations:
                self._examinations.pop(id)[1](Examined(id=id, problem=problem))
            case Trouble(id=int() as id, problem=problem) if id in self._goals:
                self._goals.pop(id)(GoalEnded(id=id, status=GoalStatus.REJECTED, problem=problem))
            case Trouble(id=int() as id, problem=problem) if id in self._calls:
                self._calls.pop(id)(Replied(id=id, problem=problem))
            case Trouble(problem=problem):
                self._on_trouble(self._named(report) + problem)
            case _:
                pass

    def disconnected(self, problem: str) -> None:
        """The bridge has ended, or could not be started; why, for people."""
        self.is_connected, self.problem = False, problem
        goals, self._goals = self._goals, {}
        for id, goal_observer in goals.items():
            goal_observer(GoalEnded(id=id, status=GoalStatus.LOST))
        calls, self._calls = self._calls, {}
        for id, reply_observer in calls.items():
            reply_observer(Replied(id=id, problem="the bridge to ROS 2 has ended"))
        present, self._present = self._present, set()
        for id in present & self._actions.keys():
            self._actions[id][1](False)
        self._tell_of_bridge()

    def _tell_of_bridge(self) -> None:
        for observer in self.bridge_observers:
            observer()

    def _ask(self, request: CallService | Publish, observer: ReplyObserver) -> None:
        if self.is_connected:
            self._calls[request.id] = observer
            self._send(request)
        else:
            observer(Replied(id=request.id, problem="the bridge to ROS 2 does not run"))

    def _tell(self, request: Request) -> None:
        if self.is_connected:
            self._send(request)

    def _named(self, trouble: Trouble) -> str:
        if trouble.id in self._subscriptions:
            return f"{self._subscriptions[trouble.id][0].topic}: "
        if trouble.id in self._actions:
            return f"{self._actions[trouble.id][0].action}: "
        return ""
