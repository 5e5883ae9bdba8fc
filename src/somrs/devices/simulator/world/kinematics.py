"""The world moved without forces: joints are where they are driven to, things follow hands, and leaves follow the hands that pull them.

It is the world for many robots: only what moves costs time. Whatever touches, it does not push; that robots do not meet is left to their
claims. A thing that is put down stands on what is below it, and never tips over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from somrs.devices.simulator.world.attached_hands import AttachedHands, Pose
from somrs.devices.simulator.world.driven_joints import DrivenJoints
from somrs.devices.simulator.world.joints import ARM_SEEN
from somrs.devices.simulator.world.layout import Layout
from somrs.devices.simulator.world.opaque import opaque_parts, whole_leaf
from somrs.devices.simulator.world.scene import Place, Scene
from somrs.ontology.map import Map
from somrs.ontology.objects import Object, ObjectAdded, ObjectRemoved
from somrs.ontology.types import Ontology
from somrs.space.dimensions import FINGER, dimensions_of
from somrs.space.distances import Array
from somrs.space.leaves import HANDLE, HANDLE_LENGTH, Leaf, inside, leaves_of
from somrs.space.sightlines import Prisms
from somrs.space.solids import Role, Solid

if TYPE_CHECKING:
    from somrs.devices.simulator.world.physics import PhysicsScene

PERIOD = 0.1
"""Control period of the robots, s."""
STEP_UP = 0.02
"""Height by which something may be above the underside of a thing and still support it, m: more than a hand lowers a thing in a period."""
TOUCH = 0.002
"""Distance below which a thing stands on what is below it, m."""
FINGER_WIDTH = 0.014
"""Half the width of a finger, m."""
HOLDING_SPEED = 0.3
"""Speed at which a drive brings its leaf to the position at which it holds it, m/s."""


class KinematicScene(Scene):
    """The state of a world without forces."""

    period = PERIOD
    hands: AttachedHands
    joints: dict[str, DrivenJoints]

    def __init__(self, map: Map, ontology: Ontology) -> None:
        super().__init__(Layout(ontology))
        self._map = map
        self.joints, self._moving = {}, dict[DrivenJoints, None]()
        self._things: dict[str, Pose] = {}
        self._leaf_positions: dict[str, float] = {}
        self._driven: dict[str, tuple[Leaf, float, float]] = {}
        """The leaves that drives move, with their goals and speeds, by name."""
        self.hands = AttachedHands(self)
        self._changes = 0
        """Grows whenever something that hides what is behind it may have moved."""
        self._standing: tuple[int, Prisms] | None = None
        self._movable: tuple[int, int, Prisms] | None = None
        self._drawn: tuple[int, PhysicsScene] | None = None
        self.world.fill(map)
        for solid in self.world.solids.values():
            self._enter(solid)
        self._settle()

    def step(self, periods: int = 1) -> None:
        for _ in range(periods):
            for joints in [*self._moving]:
                if not joints.advance(self.period):
                    del self._moving[joints]
                self.hands.follow(joints.name)
                self._changes += 1
            for leaf, goal, speed in [*self._driven.values()]:
                self._advance_leaf(leaf, goal, speed)
            self.time += self.period

    def disturb(self) -> None:
        """Note that what is at rest may begin to move."""
        self.disturbed = self.time
        self._changes += 1

    # Objects

    def _enter(self, solid: Solid) -> None:
        """Begin to keep the state of an object."""
        if solid.role is Role.ROBOT:
            self.joints[solid.name] = DrivenJoints(solid, self._moving)
        elif solid.role is Role.THING:
            self._things[solid.name] = solid.x, solid.y, solid.z, solid.yaw
        self._start(solid)
        self.edition += 1

    def add(self, object: Object) -> Solid | None:
        solid = self.world.add(object)
        self._map = self._map.changed([ObjectAdded(object)])
        if solid is not None:
            self._enter(solid)
            self.disturb()
            if solid.role is Role.THING:
                self.settle(solid.name)
        return solid

    def remove(self, name: str) -> None:
        self.hands.remove(name)
        if name in self._things:
            self.hands.detach(name)
        solid = self.world.remove(name)
        self._map = self._map.changed([ObjectRemoved(name)])
        joints = self.joints.pop(name, None)
        if joints is not None:
            self._moving.pop(joints, None)
        self._things.pop(name, None)
        for leaf in leaves_of(solid):
            self._leaf_positions.pop(leaf.name, None)
            self._driven.pop(leaf.name, None)
        self.edition += 1
        self.disturb()
        self._settle()

    def place_thing(self, thing: str, x: float, y: float, z: float, yaw: float) -> None:
        holder = self.hands.holder(thing)
        if holder is not None:
            self.hands.release(holder)
        self.hands.detach(thing)
        self._things[thing] = x, y, z, yaw
        self.disturb()
        self._settle()

    def set_weight(self, thing: str, weight: float) -> None:
        self.world.set_weight(thing, weight)

    def carry_thing(self, thing: str, pose: Pose) -> None:
        """Move a thing with the hand that holds it."""
        self._things[thing] = pose
        self._changes += 1

    def _settle(self) -> None:
        """Let all things that nobody holds fall to what is below them, the lowest first."""
        for thing in sorted(self._things, key=lambda thing: self._things[thing][2]):
            if not self.hands.carries(thing):
                self.settle(thing)

    def settle(self, thing: str) -> None:
        """Let a thing fall to what is below it."""
        surface, (x, y, _, yaw) = self._surface_below(thing), self._things[thing]
        if surface is not None:
            self._things[thing] = x, y, surface[1], yaw
            self.hands.attach(thing, surface[0])

    def standing_on(self, carrier: str) -> list[str]:
        """The things that stand on another one."""
        top = self._things[carrier][2] + self.world.solids[carrier].height
        return [name for name, pose in self._things.items() if abs(pose[2] - top) < TOUCH and carrier in self.supporters(name)]

    def _surface_below(self, thing: str) -> tuple[str, float] | None:
        """The highest object below a thing, and the height of its surface."""
        x, y, z, _ = self._things[thing]
        own_top = z + self.world.solids[thing].height
        surfaces: list[tuple[str, float]] = []
        support, container = self.support_below(x, y, z + STEP_UP, thing), self.container_at(x, y, z)
        if support is not None:
            surfaces.append((support.name, support.top))
        if container is not None:
            surfaces.append((container.name, inside(container).z))
        for name, (lower_x, lower_y, lower_z, _) in self._things.items():
            solid = self.world.solids[name]
            top = lower_z + solid.height
            is_above = lower_z > own_top - TOUCH / 2  # a thin thing on it may be within `STEP_UP`
            if name != thing and not is_above and top <= z + STEP_UP and math.hypot(lower_x - x, lower_y - y) < solid.extent:
                surfaces.append((name, top))
        return max(surfaces, key=lambda surface: surface[1], default=None)

    # Doors and containers

    def leaf_position(self, leaf: Leaf) -> float:
        return self._leaf_positions[leaf.name]

    def set_leaf(self, leaf: Leaf, position: float) -> None:
        self._leaf_positions[leaf.name] = self.world.positions[leaf.name] = position
        self._driven.pop(leaf.name, None)
        self.disturb()

    def pull_leaf(self, leaf: Leaf, position: float) -> None:
        """Move a leaf with the hand that holds its handle."""
        self._leaf_positions[leaf.name] = position
        self._changes += 1

    def drive_leaf(self, leaf: Leaf, goal: float, speed: float) -> None:
        self._driven[leaf.name] = leaf, goal, speed

    def hold_leaf(self, leaf: Leaf, position: float) -> None:
        self._driven[leaf.name] = leaf, position, HOLDING_SPEED

    def _advance_leaf(self, leaf: Leaf, goal: float, speed: float) -> None:
        position, way = self._leaf_positions[leaf.name], speed * self.period
        self._leaf_positions[leaf.name] = position + min(max(goal - position, -way), way)
        self._changes += 1
        if abs(goal - position) <= way:
            del self._driven[leaf.name]

    # Poses and contacts

    def things(self) -> Iterable[str]:
        return self._things

    def thing_pose(self, thing: str) -> Pose:
        return self._things[thing]

    def upright(self, thing: str) -> bool:
        return True

    def are_at_rest(self, *things: str) -> bool:
        return True

    def supporters(self, thing: str) -> Iterable[str]:
        surface = self._surface_below(thing)
        return (surface[0],) if surface is not None and self._things[thing][2] - surface[1] < TOUCH else ()

    def hand(self, robot: str) -> Pose:
        """The middle between the tips of a robot's fingers, and the direction of its wrist."""
        joints, solid = self.joints[robot], self.world.solids[robot]
        x, y, yaw = joints.pose()
        angle, reach = yaw + joints["turret"], joints["reach"]
        tips = solid.z + joints["lift"] - dimensions_of(solid).hang
        return x + reach * math.cos(angle), y + reach * math.sin(angle), tips, angle + joints["wrist"]

    def touching_fingers(self, robot: str, thing: str) -> set[str]:
        solid, (x, y, z, yaw) = self.world.solids[thing], self._things[thing]
        turn = yaw - self.hand(robot)[3]
        return self._fingers_at(robot, (x, y, z), solid.height, _half_width(solid, turn + math.pi / 2), _half_width(solid, turn))

    def fingers_at_handle(self, robot: str, leaf: Leaf) -> set[str]:
        position, low = self._leaf_positions[leaf.name], leaf.handle_height - HANDLE_LENGTH / 2
        handles = [leaf.handle(position, side) for side in ((-1, 1) if leaf.slides else (1,))]
        return set().union(*(self._fingers_at(robot, (*handle, low), HANDLE_LENGTH, HANDLE, HANDLE) for handle in handles))

    def _fingers_at(self, robot: str, foot: Place, height: float, half_across: float, half_along: float) -> set[str]:
        """The fingers that touch something upright: on the line on which they close, it extends `half_across`."""
        joints, (x, y, tips, angle) = self.joints[robot], self.hand(robot)
        dx, dy = foot[0] - x, foot[1] - y
        along, across = dx * math.cos(angle) + dy * math.sin(angle), dy * math.cos(angle) - dx * math.sin(angle)
        if abs(along) > half_along + FINGER_WIDTH or not tips - height <= foot[2] <= tips + FINGER or abs(across) > 2 * half_across:
            return set()
        gaps = {"left": joints["left"] - across - half_across, "right": joints["right"] + across - half_across}
        return {finger for finger, gap in gaps.items() if gap <= 0}

    def robot_contacts(self) -> set[tuple[str, str]]:
        """The contacts of robots' bases; arms and leaves have none here."""
        return {(min(pair), max(pair)) for pair in self._overlaps()}

    def _overlaps(self) -> Iterator[tuple[str, str]]:
        bases = {name: self.pose(name) for name in self.joints}
        radii = {name: self.world.solids[name].extent for name in bases}
        for name, (x, y, z, _) in bases.items():
            for other_name, (other_x, other_y, other_z, _) in bases.items():
                touch = math.hypot(x - other_x, y - other_y) < radii[name] + radii[other_name]
                if name < other_name and touch and abs(z - other_z) < self.world.solids[name].height:
                    yield name, other_name
            reach = radii[name]
            for block in self.world.blocks_near((x - reach, y - reach, x + reach, y + reach)):
                if block.z < z + self.world.solids[name].height and block.top > z + STEP_UP and block.distance(x, y) < radii[name]:
                    yield name, block.name

    def is_unobstructed(self, start: Place, end: Place, ignored: Iterable[str]) -> bool:
        names = set(ignored)
        return not (self._standing_prisms().hide(start, end, names) or self._movable_prisms().hide(start, end, names))

    def _standing_prisms(self) -> Prisms:
        """What stands still and hides what is behind it."""
        if self._standing is None or self._standing[0] != self.edition:
            parts = [(solid.name, part) for solid in self.world.solids.values() for part in opaque_parts(solid)]
            self._standing = self.edition, Prisms([name for name, _ in parts], [part for _, part in parts])
        return self._standing[1]

    def _movable_prisms(self) -> Prisms:
        """The robots, the things and the leaves, where they are now."""
        solids, leaves = self.world.solids, [leaf for solid in self.world.solids.values() for leaf in leaves_of(solid)]
        names = [*self.joints, *self._things]
        if self._movable is None or self._movable[0] != self.edition:
            prisms = Prisms(
                [*names, *(leaf.owner.name for leaf in leaves)],
                [*(solids[name] for name in names), *(whole_leaf(leaf, self._leaf_positions[leaf.name]) for leaf in leaves)],
            )
            self._movable = self.edition, -1, prisms
        edition, changes, prisms = self._movable
        if changes != self._changes:
            panes = (whole_leaf(leaf, self._leaf_positions[leaf.name]) for leaf in leaves)
            prisms.place([*(self.pose(name) for name in names), *((pane.x, pane.y, pane.z, pane.yaw) for pane in panes)])
            self._movable = edition, self._changes, prisms
        return prisms

    def raise_object(self, name: str, z: float) -> Solid:
        solid = self.world.raise_object(name, z)
        if solid.role is Role.ROBOT:
            self.hands.follow(name)
        self._changes += 1
        return solid

    # For displays

    def row_reader(self, arms: Sequence[str], bases: Sequence[str], leaves: Sequence[Leaf]) -> Callable[[], Array]:
        def row() -> Array:
            numbers: list[float] = []
            for robot in arms:
                joints = self.joints[robot]
                numbers += [*self.pose(robot), *(joints[joint] for joint in ARM_SEEN)]
            for robot in bases:
                numbers += self.pose(robot)
            for pose in self._things.values():
                numbers += [*pose, 0.0, 0.0]
            numbers += [min(max(self._leaf_positions[leaf.name] / leaf.travel, 0.0), 1.0) for leaf in leaves]
            return np.array(numbers)

        return row

    def drawing(self) -> tuple[Any, Any]:
        from somrs.devices.simulator.world.physics import PhysicsScene

        if self._drawn is None or self._drawn[0] != self.edition:
            self._drawn = self.edition, PhysicsScene(self._map, self.world.ontology)
        self._drawn[1].show(self)
        return self._drawn[1].drawing()


def _half_width(solid: Solid, turn: float) -> float:
    """Half the width of a solid, seen from above, in a direction at this angle to its own x axis."""
    if solid.form != "Box":
        return solid.extent
    return abs(solid.width / 2 * math.cos(turn)) + abs(solid.depth / 2 * math.sin(turn))
