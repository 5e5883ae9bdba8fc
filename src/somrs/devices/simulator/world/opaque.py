"""The solids behind which nobody sees anything: those of what stands still, and those of leaves."""

from __future__ import annotations

import math
from dataclasses import replace

from somrs.space.leaves import JAMB, Leaf, leaves_of, panels
from somrs.space.sightlines import hull
from somrs.space.solids import Role, Solid

_OPAQUE = (Role.WALL, Role.SUPPORT, Role.STATIC, Role.CAMERA)


def opaque_parts(solid: Solid) -> list[Solid]:
    """The boxes and cylinders of what stands still behind which nobody sees anything."""
    leaves = leaves_of(solid)
    if solid.container and leaves:
        boards = []
        for panel in panels(solid):
            x, y = solid.world(panel.x, panel.y)
            boards.append(replace(solid, x=x, y=y, z=solid.z + panel.z, width=panel.width, depth=panel.depth, height=panel.height))
        return boards
    if solid.role is Role.DOOR:
        return [] if leaves or solid.open else [solid]
    if solid.role is Role.FLOOR:
        return [hull(solid)]
    return [solid] if solid.role in _OPAQUE and solid.form != "Polygon" else []


def whole_leaf(leaf: Leaf, position: float) -> Solid:
    """A leaf with the strip that stays in the doorway, through which nobody sees either."""
    pane = leaf.solid(position)
    if not leaf.slides:
        return pane
    x, y = pane.x + JAMB / 2 * math.cos(pane.yaw), pane.y + JAMB / 2 * math.sin(pane.yaw)
    return replace(pane, x=x, y=y, width=pane.width + JAMB)
