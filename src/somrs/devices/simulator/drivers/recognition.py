"""Translates what a camera saw into a situation in Entish, for cognitive services."""

from __future__ import annotations

from collections.abc import Mapping

from somrs.devices.simulator.drivers.simulated import format_number, is_of_type
from somrs.devices.simulator.link.commands import ObjectState
from somrs.service_manager.sdk.device import Task


async def describe_recognition(task: Task, object: str, observations: Mapping[str, ObjectState]) -> str:
    """The situation of the object: its pose, its holder, what it holds, and that its position is known."""
    object_state = observations[object]
    parts: list[str] = []
    if object_state.held_by is not None:
        parts.append(f"{object} isHeldBy {object_state.held_by}")
    elif object_state.support is not None and not await is_of_type(task, object, "MobileRobot"):
        parts.append(f"{object} isOn {object_state.support}")
    elif object_state.container is not None:
        parts.append(f"{object} isIn {object_state.container}")
    parts += [
        f"{object}.Position{axis} = {format_number(value)}"
        for axis, value in zip("XYZ", (object_state.x, object_state.y, object_state.z), strict=True)
    ]
    parts += [f"{object}.RotationZ = {format_number(object_state.yaw)}", f"{object}.Unknown = FALSE"]
    if object_state.held_by is not None and (holder := observations.get(object_state.held_by)) is not None:
        pose = {"PositionX": holder.x, "PositionY": holder.y, "RotationZ": holder.yaw}
        parts += [f"{holder.object}.{path} = {format_number(value)}" for path, value in pose.items()]
    parts += [f"{state.object} isHeldBy {object}" for state in observations.values() if state.held_by == object]
    return " AND ".join(parts)
