"""What a cognitive service tells in Entish of what a camera saw."""

from __future__ import annotations

from collections.abc import Mapping

from somrs.devices.simulator.drivers.simulated import is_a, plain
from somrs.devices.simulator.link.commands import Seen
from somrs.service_manager.sdk.device import Task


async def recognised(task: Task, object: str, seen: Mapping[str, Seen]) -> str:
    """Where the object is and how it is turned; who holds it, and what it holds; that it is not unknown any more."""
    one = seen[object]
    parts: list[str] = []
    if one.held_by is not None:
        parts.append(f"{object} isHeldBy {one.held_by}")
    elif one.on is not None and not await is_a(task, object, "MobileRobot"):
        parts.append(f"{object} isOn {one.on}")
    parts += [f"{object}.Position{axis} = {plain(value)}" for axis, value in zip("XYZ", (one.x, one.y, one.z), strict=True)]
    parts += [f"{object}.RotationZ = {plain(one.yaw)}", f"{object}.Unknown = FALSE"]
    if one.held_by is not None and (holder := seen.get(one.held_by)) is not None:
        pose = {"PositionX": holder.x, "PositionY": holder.y, "RotationZ": holder.yaw}
        parts += [f"{holder.object}.{path} = {plain(value)}" for path, value in pose.items()]
    parts += [f"{other.object} isHeldBy {object}" for other in seen.values() if other.held_by == object]
    return " AND ".join(parts)
