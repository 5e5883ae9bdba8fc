"""The leaves of doors and containers: where they and their handles are, for every position of their joints.

The door of a room slides along its wall, so that no place beside it has to be kept free. The leaves of a container are hinged at its
sides, and swing out in front of it. Both have upright handles, which a gripper takes from above. A joint's position is 0 when the leaf is
shut; its unit is metres for a sliding leaf, and radians for a hinged one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from somrs.space.solids import Point, Role, Solid

STANDOFF = 0.045
"""Distance of a handle from the surface of its leaf, or from the wall, m: space for the fingers."""
HANDLE = 0.008
"""Radius of a handle, m."""
HANDLE_LENGTH = 0.12
"""Length of a handle, m."""
JAMB = 0.14
"""Width of the strip at the edge of a sliding door that has the handle, m. It stays in the doorway when the door is open."""
EDGE = 0.05
"""Distance of a handle from the free edge of a hinged leaf, m."""
THICKNESS = 0.02
"""Thickness of a hinged leaf, m."""
PLINTH, BOARD = 0.06, 0.03
"""Height of the bottom of a container's inside, and thickness of its boards, m; less for a low container."""
SWING = math.pi / 2
"""Angle by which the leaves of a container open, rad: they stay in front of the container."""
LARGEST_LEAF = 0.7
"""Width above which the front of a container has two leaves, m."""
HIGHEST_HANDLE = 0.95
"""Largest height of the middle of a handle above the floor, m: robots reach it."""
OPENED_DOOR, OPENED_LEAF = 0.95, 0.75
"""Part of its travel from which on a sliding and a hinged leaf count as open. Beside a wall, a robot cannot open a hinged leaf further."""
SHUT = 0.03
"""Part of its travel up to which a leaf counts as shut."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf:
    """A leaf in the frame of its owner. `end`: its edge at the hinge, or the edge that leads when a sliding leaf opens; `along`: the
    direction from there to the free edge, rad; `turn`: the sign of the joint's rotation about z."""

    owner: Solid
    number: int
    slides: bool
    end: Point
    along: float
    turn: int
    width: float
    thickness: float
    bottom: float
    top: float

    @property
    def name(self) -> str:
        """The name of its body and of its joint."""
        return f"{self.owner.name}/leaf{self.number}"

    @property
    def travel(self) -> float:
        """The position of the joint when the leaf is open."""
        return self.width - JAMB if self.slides else SWING

    @property
    def radius(self) -> float:
        """Distance that the handle moves per unit of the joint's position, m."""
        return 1.0 if self.slides else self.width - EDGE

    @property
    def handle_height(self) -> float:
        """Height of the middle of the handle on the map, m."""
        return self.owner.z + min(1.0 if self.slides else 0.65 * self.owner.height, HIGHEST_HANDLE)

    def is_open(self, position: float) -> bool:
        return position >= (OPENED_DOOR if self.slides else OPENED_LEAF) * self.travel

    def is_shut(self, position: float) -> bool:
        return position <= SHUT * self.travel

    def direction(self, position: float) -> float:
        """The direction from `end` to the free edge, in the owner's frame, rad."""
        return self.along if self.slides else self.along + self.turn * position

    def foot(self, position: float) -> Point:
        """The position of `end` in the owner's frame."""
        if not self.slides:
            return self.end
        return self.end[0] - position * math.cos(self.along), self.end[1] - position * math.sin(self.along)

    def front(self, position: float, side: int = 1) -> float:
        """The direction in which the handle of a side stands off from the leaf, on the map, rad. Only sliding leaves have side -1."""
        return self.owner.yaw + self.direction(position) + side * self.turn * math.pi / 2

    def handle(self, position: float, side: int = 1) -> Point:
        """The position of a handle on the map."""
        angle, (x, y) = self.direction(position), self.foot(position)
        distance = self.width - (JAMB * 0.6 if self.slides else EDGE)
        stand_off = side * self.turn * (self.thickness / 2 + STANDOFF)
        return self.owner.world(
            x + distance * math.cos(angle) - stand_off * math.sin(angle),
            y + distance * math.sin(angle) + stand_off * math.cos(angle),
        )

    @property
    def sides(self) -> tuple[int, ...]:
        """The sides that have a handle."""
        return (1, -1) if self.slides else (1,)

    def nearer_side(self, point: Point) -> int:
        """The side of the leaf, 1 or -1, from which a robot at that point uses it."""
        if not self.slides:
            return 1
        angle = self.front(0.0)
        return 1 if (point[0] - self.owner.x) * math.cos(angle) + (point[1] - self.owner.y) * math.sin(angle) >= 0 else -1

    def solid(self, position: float) -> Solid:
        """The leaf as an obstacle, at a position of its joint."""
        angle, (x, y) = self.direction(position), self.foot(position)
        width = self.width - JAMB if self.slides else self.width
        middle = self.owner.world(x + width / 2 * math.cos(angle), y + width / 2 * math.sin(angle))
        return replace(
            self.owner, name=self.name, role=Role.STATIC, x=middle[0], y=middle[1], z=self.owner.z + self.bottom,
            yaw=self.owner.yaw + angle, width=width, depth=self.thickness, height=self.top - self.bottom,
        )  # fmt: skip


def leaves_of(solid: Solid) -> tuple[Leaf, ...]:
    """The leaves of a door or container; none for other solids, and for those that are not boxes."""
    if solid.form != "Box":
        return ()
    if solid.role is Role.DOOR:
        return (_sliding(solid),)
    return _hinged(solid) if solid.container else ()


def leaf_obstacles(solid: Solid, positions: Mapping[str, float]) -> list[Solid]:
    """The obstacles that the leaves of a container are while they are not shut. Those of a door are in its wall, or in the doorway.

    `positions`: the known positions of joints, by name; by default they are as the container says.
    """
    hinged = [(leaf, positions.get(leaf.name, leaf.travel if solid.open else 0.0)) for leaf in leaves_of(solid) if not leaf.slides]
    return [leaf.solid(position) for leaf, position in hinged if not leaf.is_shut(position)]


def _sliding(door: Solid) -> Leaf:
    """The leaf of a door, which opens against the direction of its own longer axis."""
    along_y = door.depth >= door.width
    width, thickness = (door.depth, door.width) if along_y else (door.width, door.depth)
    end = (0.0, -width / 2) if along_y else (-width / 2, 0.0)
    return Leaf(
        owner=door, number=0, slides=True, end=end, along=math.pi / 2 if along_y else 0.0, turn=-1 if along_y else 1,
        width=width, thickness=thickness, bottom=0.0, top=door.height,
    )  # fmt: skip


def _hinged(container: Solid) -> tuple[Leaf, ...]:
    """One leaf hinged at the left of the front, or two at both sides."""
    plinth, board = boards(container)
    count = 1 if container.depth <= LARGEST_LEAF else 2
    hinge_x = container.width / 2 - THICKNESS / 2
    return tuple(
        Leaf(
            owner=container, number=i, slides=False, end=(hinge_x, side * container.depth / 2), along=-side * math.pi / 2, turn=side,
            width=container.depth / count - 0.002, thickness=THICKNESS, bottom=plinth, top=container.height - board,
        )
        for i, side in enumerate((-1, 1)[:count])
    )  # fmt: skip


def boards(container: Solid) -> tuple[float, float]:
    """The height of the bottom of a container's inside, and the thickness of its top, m."""
    return min(PLINTH, container.height / 6), min(BOARD, container.height / 6)


def inside(container: Solid) -> Solid:
    """The space inside a container, as a box."""
    plinth, board = boards(container)
    depth = container.width - board - THICKNESS
    x, y = container.world(board / 2 - THICKNESS / 2, 0.0)
    return replace(
        container,
        x=x,
        y=y,
        z=container.z + plinth,
        width=depth,
        depth=container.depth - 2 * board,
        height=container.height - plinth - board,
    )


@dataclass(frozen=True, slots=True)
class Panel:
    """A board of a container, in the container's frame: the middle of its underside, and its sizes, m."""

    x: float
    y: float
    z: float
    width: float
    depth: float
    height: float


def panels(container: Solid) -> tuple[Panel, ...]:
    """The bottom, the top, the sides and the back of a container; its leaves close the front."""
    plinth, board = boards(container)
    width, depth, height = container.width, container.depth, container.height
    body = width - THICKNESS
    upright = height - plinth - board
    sides = [Panel(-THICKNESS / 2, side * (depth - board) / 2, plinth, body, board, upright) for side in (-1, 1)]
    return (
        Panel(-THICKNESS / 2, 0.0, 0.0, body, depth, plinth),
        Panel(0.0, 0.0, height - board, width, depth, board),
        *sides,
        Panel(-(width - board) / 2, 0.0, plinth, board, depth, upright),
    )
