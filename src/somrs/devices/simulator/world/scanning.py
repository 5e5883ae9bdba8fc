"""What a laser scanner measures: the distances of what is around it in a horizontal plane."""

from __future__ import annotations

import random

import numpy as np

from somrs.devices.simulator.link.commands import Scan
from somrs.devices.simulator.world.opaque import opaque_parts, whole_leaf
from somrs.devices.simulator.world.scene import Scene
from somrs.space.leaves import leaves_of
from somrs.space.sightlines import Prisms
from somrs.space.solids import Role, Solid
from somrs.space.squares import box_around

RESOLUTION = 0.001
"""Distances are measured in steps of this size, m."""


def scanned(scene: Scene, robot: str, scan: Scan) -> tuple[float | None, ...]:
    """The distance along each ray, m; None: nothing is within range. The same scene gives the same noise.

    What cameras cannot see through, a scanner does not either: a table is a box, down to the floor. Neither the robot itself nor what it
    holds is measured.
    """
    x, y, z, yaw = scene.pose(robot)
    prisms = _prisms_around(scene, (x, y), scan.range)
    own_names = {robot, scene.hands.held.get(robot, robot)}
    noise, accuracy = random.Random(f"{robot} {scene.time:.2f}"), scene.world.solids[robot].accuracy
    angles = yaw - scan.view / 2 + (np.arange(scan.rays) + 0.5) * scan.view / scan.rays
    level = np.full(scan.rays, z + scan.height)
    ends = np.column_stack([x + scan.range * np.cos(angles), y + scan.range * np.sin(angles), level])
    ranges: list[float | None] = []
    for share in prisms.shares_until((x, y, z + scan.height), ends, own_names).tolist():
        distance = share * scan.range + noise.gauss(0.0, accuracy)
        ranges.append(round(max(distance, 0.0) / RESOLUTION) * RESOLUTION if share < 1.0 else None)
    return tuple(ranges)


def _prisms_around(scene: Scene, point: tuple[float, float], reach: float) -> Prisms:
    """The solids that may be within reach, where they are now."""
    solids = scene.world.solids
    standing = scene.world.standing_near(box_around(point, reach))
    parts = [(solid.name, part, (part.x, part.y, part.z, part.yaw)) for solid in standing for part in opaque_parts(solid)]
    moving: list[Solid] = [solid for solid in solids.values() if solid.role in (Role.ROBOT, Role.THING)]
    parts += [(solid.name, solid, scene.pose(solid.name)) for solid in moving]
    for leaf in (leaf for solid in standing for leaf in leaves_of(solid)):
        pane = whole_leaf(leaf, scene.leaf_position(leaf))
        parts.append((leaf.owner.name, pane, (pane.x, pane.y, pane.z, pane.yaw)))
    prisms = Prisms([name for name, _, _ in parts], [part for _, part, _ in parts])
    prisms.place([pose for _, _, pose in parts])
    return prisms
