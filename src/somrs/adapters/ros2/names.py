"""The names of topics, types and fields of ROS 2 in settings, and how they are written."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator

from somrs.adapters.ros2.templates import path_steps

_NAME = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*/?", re.ASCII)
_TYPES = {
    "msg": ("messages", "sensor_msgs/msg/BatteryState"),
    "srv": ("services", "std_srvs/srv/SetBool"),
    "action": ("actions", "nav2_msgs/action/NavigateToPose"),
}
"""What types are of, by the middles of their names, with an example."""


def _checked_path(path: str) -> str:
    path_steps(path)
    return path


def _checked_name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r} is no name of ROS 2: write letters, digits and _ between slashes, such as robot1/odom")
    return name


def checked_type(name: str, kind: str) -> str:
    """A name of a type. `kind`: msg, srv or action. Raises ValueError if it is none."""
    if not re.fullmatch(rf"[a-z]\w*/{kind}/[A-Z]\w*", name, re.ASCII):
        what, example = _TYPES[kind]
        raise ValueError(f"{name!r} is no type of {what}: write PACKAGE/{kind}/NAME, such as {example}")
    return name


FieldPath = Annotated[str, AfterValidator(_checked_path)]
RosName = Annotated[str, AfterValidator(_checked_name)]
MessageType = Annotated[str, AfterValidator(lambda name: checked_type(name, "msg"))]
ActionType = Annotated[str, AfterValidator(lambda name: checked_type(name, "action"))]
