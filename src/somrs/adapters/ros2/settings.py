"""The settings of the adapter, and the file that binds the topics, actions and services of a robot to what SO-MRS knows of it.

Every name of a topic, an action or a service that does not begin with `/` is in the namespace of the robot.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from somrs.adapters.ros2.frames import Pose
from somrs.adapters.ros2.names import ActionType, FieldPath, MessageType, RosName, checked_type
from somrs.adapters.ros2.templates import placeholders
from somrs.adapters.settings import valid_settings
from somrs.errors import Mistake
from somrs.ontology.files.documents import Entry, Listed, WholeNumber
from somrs.ontology.files.nodes import Path
from somrs.ontology.types import Value

POSE_NAMES = frozenset({"x", "y", "yaw", "qz", "qw", "frame"})
"""What templates can say of a pose: `qz` and `qw` are those of its orientation, `frame` is the map frame of the robot's floor."""
NAVIGATION_GOAL = {
    "pose": {
        "header": {"frame_id": "{frame}"},
        "pose": {"position": {"x": "{x}", "y": "{y}"}, "orientation": {"z": "{qz}", "w": "{qw}"}},
    }
}
"""The goal of nav2_msgs/action/NavigateToPose."""
GOALS: dict[str, dict[str, Any]] = {
    "NavigateThroughPoses": {"poses": "{poses}"},
    "FollowPath": {"path": {"header": {"frame_id": "{frame}"}, "poses": "{path}"}},
}
"""Those of the actions of Nav2 that lead around corners, by the names of their types."""
AROUND_CORNERS = frozenset({"poses", "path"})
"""What templates of such goals have."""


class Topic(Entry):
    """A topic, and the field of its messages that counts. `latched`: its publishers keep the last message for those that come later."""

    topic: RosName = Field(min_length=1, examples=["battery_state"])
    type: MessageType = Field(examples=["sensor_msgs/msg/BatteryState"])
    field: FieldPath = ""
    latched: bool = False


class PoseTopic(Topic):
    """Where the robot is in the frame of its map: a geometry_msgs/Pose in a topic."""

    topic: RosName = "amcl_pose"
    type: MessageType = "geometry_msgs/msg/PoseWithCovarianceStamped"
    field: FieldPath = "pose.pose"
    latched: bool = True


class PoseTransform(Entry):
    """Where the robot is in the frame of its map: the transform of its base."""

    base: str = "base_link"
    tf: RosName = "/tf"
    tf_static: RosName = "/tf_static"
    type: MessageType = "tf2_msgs/msg/TFMessage"


class Localization(Topic):
    """How sure the robot is of where it is: the covariance in a geometry_msgs/PoseWithCovariance. A robot that may be farther than `limit`
    from there, by the standard deviation in m, is not sent anywhere."""

    topic: RosName = "amcl_pose"
    type: MessageType = "geometry_msgs/msg/PoseWithCovarianceStamped"
    field: FieldPath = "pose.covariance"
    latched: bool = True
    limit: float = Field(default=1.0, gt=0, json_schema_extra={"unit": "m"})


class OdometryTopic(Topic):
    """How fast the robot is: a geometry_msgs/Twist in a topic. Without it, a robot is taken to stand when its navigation has ended."""

    topic: RosName = "odom"
    type: MessageType = "nav_msgs/msg/Odometry"
    field: FieldPath = "twist.twist"


class Attribute(Topic):
    """An attribute of the robot on the map. A number is multiplied by `scale`, and reported when it has changed by `dead_band`, at most
    once in `interval` seconds; `values` gives values of the field their names."""

    scale: float = 1.0
    dead_band: float = Field(default=0.0, ge=0)
    interval: float = Field(default=1.0, ge=0, json_schema_extra={"unit": "s"})
    values: dict[str | float | bool, Value] = {}


class FaultTopic(Topic):
    """The robot cannot drive while the field has this value, for the `reason`. Without the value: while it is not zero, false or empty."""

    equals: Value | None = None
    reason: str = Field(min_length=1, examples=["its emergency stop is pressed"])


class Navigation(Entry):
    """The action that drives the robot to a pose; or around corners, if its goal has `{poses}` or `{path}`.

    `corridor`: how far from its way the robot may be, m; it is stopped there.
    """

    action: RosName = "navigate_to_pose"
    type: ActionType = "nav2_msgs/action/NavigateToPose"
    goal: dict[str, Any] = {}
    problem: FieldPath = "error_msg"
    corridor: float = Field(default=0.5, gt=0, json_schema_extra={"unit": "m"})

    @property
    def template(self) -> Mapping[str, Any]:
        """The goal."""
        return self.goal or GOALS.get(self.type.rpartition("/")[2], NAVIGATION_GOAL)

    @property
    def turns(self) -> bool:
        """Whether a goal leads around corners."""
        return not AROUND_CORNERS.isdisjoint(placeholders(self.template))


class SpeedLimit(Entry):
    """The topic by which the robot is told how fast it may drive, in m/s; `speed` is 0 where there is no limit, as Nav2 has it."""

    topic: RosName = "speed_limit"
    type: MessageType = "nav2_msgs/msg/SpeedLimit"
    message: dict[str, Any] = {"speed_limit": "{speed}"}


class Step(Entry):
    """A goal of an action, a call of a service, or a message on a topic: one of the three.

    `succeeds`: the fields, by path, that the result has when the step has succeeded; `otherwise`: what people are told if not.
    """

    action: RosName | None = None
    service: RosName | None = None
    topic: RosName | None = None
    type: str = Field(examples=["control_msgs/action/GripperCommand"])
    goal: dict[str, Any] = {}
    request: dict[str, Any] = {}
    message: dict[str, Any] = {}
    succeeds: dict[FieldPath, Any] = {}
    otherwise: str = ""

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        contents = {"action": "goal", "service": "request", "topic": "message"}
        kinds = [kind for kind in contents if getattr(self, kind) is not None]
        if len(kinds) != 1:
            raise ValueError("a step has one of `action`, `service` and `topic`")
        checked_type(self.type, {"action": "action", "service": "srv", "topic": "msg"}[kinds[0]])
        superfluous = [content for kind, content in contents.items() if kind != kinds[0] and getattr(self, content)]
        if superfluous:
            raise ValueError(f"a step with `{kinds[0]}` has `{contents[kinds[0]]}`, and no `{superfluous[0]}`")
        return self

    @property
    def template(self) -> Mapping[str, Any]:
        """What is sent."""
        return self.goal or self.request or self.message


class Charging(Entry):
    """How the battery is charged: `begin`, at the charger; it is done when the attribute Charge is at `full` percent, which the
    map has as 100; then `end`."""

    begin: Listed[Step] = ()
    full: float = Field(default=99.0, gt=0, le=100, json_schema_extra={"unit": "percent"})
    end: Listed[Step] = ()


class PuttingDown(Entry):
    """How a thing is put down where the robot stands, because its task has ended. `ahead`: how far ahead of the robot it then is, m."""

    steps: Listed[Step] = Field(min_length=1)
    ahead: float = Field(default=0.4, ge=0, json_schema_extra={"unit": "m"})


class Moves(Entry):
    """How a robot moves, for its quotes: its largest speed in m/s (None: that of the map), its acceleration in m/s², its turning on the
    spot in rad/s, and how long it takes to pick a thing and to drop it, in seconds."""

    speed: float | None = Field(default=None, gt=0, json_schema_extra={"unit": "m/s"})
    acceleration: float = Field(default=0.5, gt=0, json_schema_extra={"unit": "m/s²"})
    turning: float = Field(default=1.0, gt=0, json_schema_extra={"unit": "rad/s"})
    handling: float = Field(default=20.0, ge=0, json_schema_extra={"unit": "s"})


class Binding(Entry):
    """What the robots of one kind have: the content of a binding file. Where a robot is comes from `pose`, or else from `transform`."""

    pose: PoseTopic | None = None
    transform: PoseTransform = PoseTransform()
    localization: Localization | None = Localization()
    odometry: OdometryTopic | None = None
    navigate: Navigation = Navigation()
    speed_limit: SpeedLimit | None = None
    moves: Moves = Moves()
    pick: Listed[Step] = ()
    drop: Listed[Step] = ()
    put_down: PuttingDown | None = None
    charge: Charging | None = None
    attributes: dict[str, Attribute] = {}
    faults: Listed[FaultTopic] = ()

    @property
    def covariance(self) -> Localization | None:
        """The topic with the covariance of the pose: that of the pose, if it has one, and no other is named."""
        pose, localization = self.pose, self.localization
        if localization is None or pose is None or "localization" in self.model_fields_set or pose.type != localization.type:
            return localization
        return localization.model_copy(update={"topic": pose.topic, "latched": pose.latched})

    @property
    def has_covariance(self) -> bool:
        """Whether the messages with the pose have the covariance, too."""
        pose, covariance = self.pose, self.covariance
        return pose is not None and covariance is not None and (pose.topic, pose.type) == (covariance.topic, covariance.type)


class Level(Entry):
    """The map that a robot has of a floor: where its origin is on the map of the building. `level`: the height of the floor, m; `enter`:
    what the robot is told when it comes to the floor in a lift."""

    level: float = Field(default=0.0, json_schema_extra={"unit": "m"})
    frame: str = "map"
    x: float = Field(default=0.0, json_schema_extra={"unit": "m"})
    y: float = Field(default=0.0, json_schema_extra={"unit": "m"})
    yaw: float = Field(default=0.0, ge=-6.3, le=6.3, json_schema_extra={"unit": "rad"})
    enter: Listed[Step] = ()

    @property
    def origin(self) -> Pose:
        """The frame of the robot's map, on the map of the building."""
        return Pose(self.x, self.y, self.yaw)


class RobotSettings(Entry):
    """A robot. `binding`: its binding file; `levels`: the first is the one on which it starts; `simulated`: it is a robot of the
    simulator, and its nodes are started with the system."""

    namespace: RosName | Literal[""] = ""
    binding: str = Field(examples=["robot.yaml"])
    levels: Listed[Level] = Field(default=(Level(),), min_length=1)
    simulated: bool = False


class Settings(Entry):
    """What a site file has under `adapters: ros2:`. `python`: that of the installed ROS; `setup`: the file that is sourced before;
    `environment`: further variables, such as RMW_IMPLEMENTATION."""

    python: str = "python3"
    setup: str | None = None
    domain: WholeNumber | None = Field(default=None, ge=0, le=232)
    discovery: Literal["OFF", "LOCALHOST", "SUBNET", "SYSTEM_DEFAULT"] | None = None
    environment: dict[str, str] = {}
    robots: dict[str, RobotSettings] = Field(min_length=1, examples=["{Robot1: {binding: robot.yaml}}"])


def read_settings(settings: Mapping[str, Any]) -> Settings:
    """The settings of a site file. Raises SettingsError."""
    return valid_settings("ros2", settings, Settings, _mistakes)


def _mistakes(settings: Settings) -> Iterator[Mistake]:
    for name, robot in settings.robots.items():
        for index, level in enumerate(robot.levels):
            yield from unknown_in_steps(level.enter, POSE_NAMES | {"robot"}, ("robots", name, "levels", index, "enter"))


def unknown_in_steps(steps: Sequence[Step], names: frozenset[str], place: Path) -> Iterator[Mistake]:
    """The steps with `{...}` for which there is no value."""
    for index, step in enumerate(steps):
        yield from unknown_names(step.template, names, (*place, index))


def unknown_names(template: Mapping[str, Any], names: frozenset[str], place: Path) -> Iterator[Mistake]:
    """What a template has as `{...}`, and is none of these names."""
    for name in placeholders(template):
        if name not in names:
            yield place, f"has {{{name}}}, for which there is no value; there are {', '.join(f'{{{name}}}' for name in sorted(names))}"


def full_name(name: str, namespace: str) -> str:
    """The absolute name of a topic, an action or a service."""
    return name if name.startswith("/") else f"/{namespace.strip('/')}/{name}".replace("//", "/")
