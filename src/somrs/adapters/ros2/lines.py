"""What the adapter and its bridge to ROS 2 (`bridge/`) say to each other: one JSON object a line.

The bridge runs in a process of its own, with the Python of the installed ROS; it knows these lines by their fields only. Names of topics,
actions and services are absolute; types are written as in ROS: `nav2_msgs/action/NavigateToPose`. Values are ROS messages as JSON: bytes in
base64, NaN and infinities as null.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import msgspec
from msgspec import Struct

from somrs.errors import WireError

Values = dict[str, Any]
"""The fields of a ROS message by name, or some of them: the others have their defaults."""


class Subscribe(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Send the messages of a topic. `latched`: its publishers keep the last message for later subscribers. `interval`: at most one message
    in so many seconds, and the newest in the end."""

    id: int
    topic: str
    type: str
    latched: bool = False
    interval: float = 0.0


class Unsubscribe(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Send no more messages of a subscription."""

    id: int


class OpenAction(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Connect to the server of an action, whenever there is one. Its goals of earlier clients are cancelled before it counts as present."""

    id: int
    action: str
    type: str


class CloseAction(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Disconnect from the server of an action."""

    id: int


class SendGoal(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Send a goal to the action that was opened as `action`. The answers are `Feedback` and, in the end, `GoalEnded` or `Trouble`."""

    id: int
    action: int
    goal: Values


class CancelGoal(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Cancel a goal. `GoalEnded` comes when the server has ended it, in whatever way."""

    id: int


class CallService(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Call a service. The answer is `Replied` or `Trouble`."""

    id: int
    service: str
    type: str
    request: Values


class Publish(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Publish a message, as soon as there is a subscriber. The answer is `Replied`, without values, or `Trouble`."""

    id: int
    topic: str
    type: str
    message: Values


class EndpointKind(StrEnum):
    """What a robot and its adapter say to each other by."""

    TOPIC = "topic"
    """The robot publishes it."""
    PUBLICATION = "publication"
    """A topic to which the robot subscribes."""
    SERVICE = "service"
    ACTION = "action"


class Examine(Struct, frozen=True, kw_only=True, tag=True, tag_field="do"):
    """Find out whether something is there, of this type. Nothing is sent to it. `template`: what would be sent; `fields`: the paths of
    fields that are read of what comes. The answer is `Examined`."""

    id: int
    kind: EndpointKind
    name: str
    type: str
    template: Values = {}
    fields: tuple[str, ...] = ()


class Ready(Struct, frozen=True, kw_only=True, tag=True, tag_field="say"):
    """The bridge runs. `distribution`: of ROS, such as jazzy; empty if it does not say."""

    distribution: str = ""


class Message(Struct, frozen=True, kw_only=True, tag=True, tag_field="say"):
    """A message of a subscription."""

    id: int
    value: Values


class ActionPresence(Struct, frozen=True, kw_only=True, tag=True, tag_field="say"):
    """Whether the server of an action can be used. `problem`: why not, although it is there."""

    id: int
    present: bool
    problem: str = ""


class Feedback(Struct, frozen=True, kw_only=True, tag=True, tag_field="say"):
    """Feedback of a goal."""

    id: int
    value: Values


class CancelRejected(Struct, frozen=True, kw_only=True, tag=True, tag_field="say"):
    """The server does not cancel a goal, which goes on. It is asked again now and then."""

    id: int


class GoalStatus(StrEnum):
    """How a goal ended."""

    SUCCEEDED = "succeeded"
    ABORTED = "aborted"
    """The server gave it up."""
    CANCELED = "canceled"
    REJECTED = "rejected"
    """The server did not accept it, or it cannot be sent."""
    LOST = "lost"
    """The server, or the bridge, has ended; what became of the goal is not known."""


class GoalEnded(Struct, frozen=True, kw_only=True, tag=True, tag_field="say"):
    """A goal has ended. `value`: the result. `problem`: why it cannot be sent."""

    id: int
    status: GoalStatus
    value: Values = {}
    problem: str = ""


class Replied(Struct, frozen=True, kw_only=True, tag=True, tag_field="say"):
    """The response of a service, or that a message is published; or why there is none."""

    id: int
    value: Values | None = None
    problem: str = ""


class Examined(Struct, frozen=True, kw_only=True, tag=True, tag_field="say"):
    """What is wrong with what was examined; empty if nothing is. `may_pass`: it may come right when more of the robot is there."""

    id: int
    problem: str = ""
    may_pass: bool = False


class Trouble(Struct, frozen=True, kw_only=True, tag=True, tag_field="say"):
    """What was asked for as `id` cannot be done: its type is not installed, for example."""

    id: int | None = None
    problem: str


Request = Subscribe | Unsubscribe | OpenAction | CloseAction | SendGoal | CancelGoal | CallService | Publish | Examine
Report = Ready | Message | ActionPresence | Feedback | CancelRejected | GoalEnded | Replied | Examined | Trouble

_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(Report)


def encode_request(request: Request) -> bytes:
    """The line of a request, with its end."""
    return _encoder.encode(request) + b"\n"


def decode_report(line: bytes) -> Report:
    """What the bridge says. Raises WireError if the line is none of its."""
    try:
        report: Report = _decoder.decode(line)
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        raise WireError("malformed", f"not a line of the bridge to ROS 2: {error}") from None
    return report
