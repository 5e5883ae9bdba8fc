"""The settings of the adapter, and the file that binds the topics, actions and services of a robot to what SO-MRS knows of it.

Every name of a topic, an action or a service that does not begin with `/` is in the namespace of the robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from somrs.adapters.ros2.frames import Pose
from somrs.adapters.ros2.templates import path_steps, placeholders
from somrs.errors import InputError, ModelError, Problem, SettingsError
from somrs.ontology.files.nodes import Source
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


def _checked_path(path: str) -> str:
    path_steps(path)
    return path


FieldPath = Annotated[str, AfterValidator(_checked_path)]


class Model(BaseModel):
    """A part of the settings: a key that it does not have is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Topic(Model):
    """A topic, and the field of its messages that counts. `latched`: its publishers keep the last message for those that come later."""

    topic: str
    type: str
    field: FieldPath = ""
    latched: bool = False


class PoseTopic(Topic):
    """Where the robot is in the frame of its map: a geometry_msgs/Pose in a topic."""

    topic: str = "amcl_pose"
    type: str = "geometry_msgs/msg/PoseWithCovarianceStamped"
    field: FieldPath = "pose.pose"
    latched: bool = True


class PoseTransform(Model):
    """Where the robot is in the frame of its map: the transform of its base."""

    base: str = "base_link"
    tf: str = "/tf"
    tf_static: str = "/tf_static"
    type: str = "tf2_msgs/msg/TFMessage"


class Localization(Topic):
    """How sure the robot is of where it is: the covariance in a geometry_msgs/PoseWithCovariance. A robot that may be farther than `limit`
    from there, by the standard deviation in m, is not sent anywhere."""

    topic: str = "amcl_pose"
    type: str = "geometry_msgs/msg/PoseWithCovarianceStamped"
    field: FieldPath = "pose.covariance"
    latched: bool = True
    limit: float = Field(default=1.0, gt=0)


class OdometryTopic(Topic):
    """How fast the robot is: a geometry_msgs/Twist in a topic. Without it, a robot is taken to stand when its navigation has ended."""

    topic: str = "odom"
    type: str = "nav_msgs/msg/Odometry"
    field: FieldPath = "twist.twist"


class Attribute(Topic):
    """An attribute of the robot on the map. A number is multiplied by `scale`, and reported when it has changed by `dead_band`, at most
    once in `interval` seconds; `values` gives values of the field their names."""

    scale: float = 1.0
    dead_band: float = Field(default=0.0, ge=0)
    interval: float = Field(default=1.0, ge=0)
    values: dict[str | float | bool, Value] = {}


class FaultTopic(Topic):
    """The robot cannot drive while the field has this value, for the `reason`. Without the value: while it is not zero, false or empty."""

    equals: Value | None = None
    reason: str


class Navigation(Model):
    """The action that drives the robot to a pose; or around corners, if its goal has `{poses}` or `{path}`.

    `corridor`: how far from its way the robot may be, m; it is stopped there.
    """

    action: str = "navigate_to_pose"
    type: str = "nav2_msgs/action/NavigateToPose"
    goal: dict[str, Any] = {}
    problem: FieldPath = "error_msg"
    corridor: float = Field(default=0.5, gt=0)

    @property
    def template(self) -> Mapping[str, Any]:
        """The goal."""
        return self.goal or GOALS.get(self.type.rpartition("/")[2], NAVIGATION_GOAL)

    @property
    def turns(self) -> bool:
        """Whether a goal leads around corners."""
        return not AROUND_CORNERS.isdisjoint(placeholders(self.template))


class SpeedLimit(Model):
    """The topic by which the robot is told how fast it may drive, in m/s; `speed` is 0 where there is no limit, as Nav2 has it."""

    topic: str = "speed_limit"
    type: str = "nav2_msgs/msg/SpeedLimit"
    message: dict[str, Any] = {"speed_limit": "{speed}"}


class Step(Model):
    """A goal of an action, a call of a service, or a message on a topic: one of the three.

    `succeeds`: the fields, by path, that the result has when the step has succeeded; `otherwise`: what people are told if not.
    """

    action: str | None = None
    service: str | None = None
    topic: str | None = None
    type: str
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
        superfluous = [content for kind, content in contents.items() if kind != kinds[0] and getattr(self, content)]
        if superfluous:
            raise ValueError(f"a step with `{kinds[0]}` has `{contents[kinds[0]]}`, and no `{superfluous[0]}`")
        return self

    @property
    def template(self) -> Mapping[str, Any]:
        """What is sent."""
        return self.goal or self.request or self.message


class Charging(Model):
    """How the battery is charged: `begin`, at the charger; it is done when the attribute Charge is at `full` percent, which the
    map has as 100; then `end`."""

    begin: tuple[Step, ...] = ()
    full: float = Field(default=99.0, gt=0, le=100)
    end: tuple[Step, ...] = ()


class PuttingDown(Model):
    """How a thing is put down where the robot stands, because its task has ended. `ahead`: how far ahead of the robot it then is, m."""

    steps: tuple[Step, ...] = Field(min_length=1)
    ahead: float = 0.4


class Moves(Model):
    """How a robot moves, for its quotes: its largest speed in m/s (None: that of the map), its acceleration in m/s², its turning on the
    spot in rad/s, and how long it takes to pick a thing and to drop it, in seconds."""

    speed: float | None = Field(default=None, gt=0)
    acceleration: float = Field(default=0.5, gt=0)
    turning: float = Field(default=1.0, gt=0)
    handling: float = Field(default=20.0, ge=0)


class Binding(Model):
    """What the robots of one kind have: the content of a binding file. Where a robot is comes from `pose`, or else from `transform`."""

    pose: PoseTopic | None = None
    transform: PoseTransform = PoseTransform()
    localization: Localization | None = Localization()
    odometry: OdometryTopic | None = None
    navigate: Navigation = Navigation()
    speed_limit: SpeedLimit | None = None
    moves: Moves = Moves()
    pick: tuple[Step, ...] = ()
    drop: tuple[Step, ...] = ()
    put_down: PuttingDown | None = None
    charge: Charging | None = None
    attributes: dict[str, Attribute] = {}
    faults: tuple[FaultTopic, ...] = ()

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

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if bool(self.pick) != bool(self.drop):
            raise ValueError("a robot that carries things has `pick` and `drop`")
        if self.charge is not None and "Charge" not in self.attributes:
            raise ValueError("`charge` ends by the attribute Charge: bind it under `attributes`")
        _check_names(self.navigate.goal, POSE_NAMES | AROUND_CORNERS | {"robot"}, "navigate.goal")
        if self.speed_limit is not None:
            _check_names(self.speed_limit.message, frozenset({"speed"}), "speed_limit.message")
        put_down = self.put_down.steps if self.put_down is not None else ()
        for name, steps in (("pick", self.pick), ("drop", self.drop), ("put_down", put_down)):
            for step in steps:
                _check_names(step.template, POSE_NAMES | {"robot", "thing", "support"}, name)
        for step in (*self.charge.begin, *self.charge.end) if self.charge is not None else ():
            _check_names(step.template, POSE_NAMES | {"robot", "charger"}, "charge")
        return self


def _check_names(template: Mapping[str, Any], names: frozenset[str], place: str) -> None:
    for name in placeholders(template):
        if name not in names:
            raise ValueError(f"{place} has {{{name}}}; what it can have is {', '.join(f'{{{known}}}' for known in sorted(names))}")


class Level(Model):
    """The map that a robot has of a floor: where its origin is on the map of the building. `level`: the height of the floor, m; `enter`:
    what the robot is told when it comes to the floor in a lift."""

    level: float = 0.0
    frame: str = "map"
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    enter: tuple[Step, ...] = ()

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        for step in self.enter:
            _check_names(step.template, POSE_NAMES | {"robot"}, "enter")
        return self

    @property
    def origin(self) -> Pose:
        """The frame of the robot's map, on the map of the building."""
        return Pose(self.x, self.y, self.yaw)


class RobotSettings(Model):
    """A robot. `binding`: its binding file; `levels`: the first is the one on which it starts; `simulated`: it is a robot of the
    simulator, and its nodes are started with the system."""

    namespace: str = ""
    binding: str
    levels: tuple[Level, ...] = Field(default=(Level(),), min_length=1)
    simulated: bool = False


class Settings(Model):
    """What a site file has under `adapters: ros2:`. `python`: that of the installed ROS; `setup`: the file that is sourced before;
    `environment`: further variables, such as RMW_IMPLEMENTATION."""

    python: str = "python3"
    setup: str | None = None
    domain: int | None = Field(default=None, ge=0, le=232)
    discovery: Literal["OFF", "LOCALHOST", "SUBNET", "SYSTEM_DEFAULT"] | None = None
    environment: dict[str, str] = {}
    robots: dict[str, RobotSettings] = Field(min_length=1)


def read_settings(settings: Mapping[str, Any]) -> Settings:
    """The settings of a site file. Raises SettingsError."""
    try:
        return Settings.model_validate(dict(settings))
    except ValidationError as error:
        raise SettingsError("ros2", [(tuple(map(str, detail["loc"])), _text(detail)) for detail in error.errors()]) from None


def read_binding(file: Path) -> Binding:
    """The content of a binding file. Raises InputError, with the lines of all problems."""
    try:
        source = Source(str(file), file.read_text("utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{file}: the binding of a robot cannot be read: {reason}") from None
    if source.problems:
        raise ModelError(source.problems)
    try:
        return Binding.model_validate(source.data if source.data is not None else {})
    except ValidationError as error:
        raise ModelError([_problem(source, detail["loc"], _text(detail)) for detail in error.errors()]) from None


def _problem(source: Source, location: tuple[int | str, ...], text: str) -> Problem:
    return Problem(file=source.file, line=source.line(location), subject=_subject(location), rule="binding", message=text)


def _subject(location: tuple[int | str, ...]) -> str:
    return ".".join(str(step) for step in location) or "file"


def _text(detail: ErrorDetails) -> str:
    return "there is no such key" if detail["type"] == "extra_forbidden" else detail["msg"].removeprefix("Value error, ")


def full_name(name: str, namespace: str) -> str:
    """The absolute name of a topic, an action or a service."""
    return name if name.startswith("/") else f"/{namespace.strip('/')}/{name}".replace("//", "/")
