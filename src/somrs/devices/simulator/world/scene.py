"""The running world: its state, and observations of it. Robots read and drive it; it makes no decisions.

What moves it is in its two implementations: the physics of MuJoCo (`physics.py`), or motion without forces (`kinematics.py`). Objects can
be added and removed while it runs; all others keep their state.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from somrs.devices.simulator.link.commands import ObjectState
from somrs.devices.simulator.world.hands import Hands
from somrs.devices.simulator.world.joints import Joints
from somrs.devices.simulator.world.layout import Layout
from somrs.ontology.objects import Object
from somrs.space.dimensions import EVEN, ROBOT_HEIGHT, dimensions_of
from somrs.space.distances import Array, distances_from
from somrs.space.leaves import Leaf, inside, leaves_of
from somrs.space.solids import Role, Solid

FAR = 2.0
"""Largest distance from obstacles that is measured, m."""
RESTING = 1.0
"""Seconds without motion after which nothing moves again by itself: an object that tips over slowly has fallen by then."""


_SUPPORTS = (Role.FLOOR, Role.SUPPORT, Role.STATIC)

Place = tuple[float, float, float]


class Scene(ABC):
    """The state of a world. `hands`: what robots hold; `joints`: those of each robot; `period`: the control period of the robots, s.

    `disturbed`: simulated time at which an object was last added, removed, moved or released, so that objects at rest may move.
    `edition` grows whenever what can move, or where its state is kept, has changed.
    """

    period: float

    def __init__(self, world: Layout) -> None:
        self.world = world
        self.hands: Hands
        self.joints: Mapping[str, Joints] = {}
        self.time = self.disturbed = 0.0
        self.edition = 0

    @abstractmethod
    def step(self, periods: int = 1) -> None:
        """Let the world move for some control periods. Raises SimulationError if it cannot continue."""

    # Objects

    @abstractmethod
    def add(self, object: Object) -> Solid | None:
        """Add an object; everything else keeps its state. Returns None if the object takes up no space."""

    @abstractmethod
    def remove(self, name: str) -> None:
        """Remove an object; everything else keeps its state."""

    @abstractmethod
    def place_thing(self, thing: str, x: float, y: float, z: float, yaw: float) -> None:
        """Move a thing to another pose, upright and at rest. A robot that held it releases it."""

    @abstractmethod
    def set_weight(self, thing: str, weight: float) -> None:
        """Give a thing another weight, kg."""

    def _start(self, solid: Solid) -> None:
        """Set the joints of a robot, a door or a container that is added."""
        for leaf in leaves_of(solid):
            self.set_leaf(leaf, leaf.travel if solid.open else 0.0)
        if solid.role is not Role.ROBOT:
            return
        joints, size = self.joints[solid.name], dimensions_of(solid)
        joints.start("yaw", solid.yaw)
        if size.gripper:
            start = {"turret": 0.0, "lift": size.clear + size.hang, "reach": size.drawn_in, "wrist": 0.0, "left": 0.05, "right": 0.05}
            for joint, position in start.items():
                joints.start(joint, position)

    # Doors and containers

    def leaves(self, owner: str) -> tuple[Leaf, ...]:
        return leaves_of(self.world.solids[owner])

    @abstractmethod
    def leaf_position(self, leaf: Leaf) -> float:
        """The position of a leaf's joint, m or rad."""

    @abstractmethod
    def set_leaf(self, leaf: Leaf, position: float) -> None:
        """Set a leaf's joint without motion."""

    @abstractmethod
    def drive_leaf(self, leaf: Leaf, goal: float, speed: float) -> None:
        """Let the drive of a powered door move its leaf towards a position for one control period, m/s."""

    @abstractmethod
    def hold_leaf(self, leaf: Leaf, position: float) -> None:
        """Let the drive of a powered door hold its leaf at a position."""

    def note_leaves(self, owner: str) -> bool:
        """Record where the leaves of a door or container came to rest. Returns whether it is open now: whether all of them are."""
        leaves = self.leaves(owner)
        self.world.positions.update({leaf.name: self.leaf_position(leaf) for leaf in leaves})
        is_open = all(leaf.is_open(self.leaf_position(leaf)) for leaf in leaves)
        self.world.solids[owner] = replace(self.world.solids[owner], open=is_open)
        return is_open

    def container_at(self, x: float, y: float, z: float) -> Solid | None:
        """The container in which a point is."""
        return next((solid for solid in self.world.standing_near((x, y, x, y)) if solid.container and _is_inside(solid, x, y, z)), None)

    # Poses and contacts

    @abstractmethod
    def things(self) -> Iterable[str]:
        """The things that can be carried."""

    @abstractmethod
    def thing_pose(self, thing: str) -> tuple[float, float, float, float]:
        """The middle of a thing's underside, and its yaw: x, y, z, yaw."""

    @abstractmethod
    def upright(self, thing: str) -> bool:
        """Whether a thing stands upright."""

    @abstractmethod
    def are_at_rest(self, *things: str) -> bool:
        """Whether all the things are at rest."""

    @abstractmethod
    def supporters(self, thing: str) -> Iterable[str]:
        """The objects that touch a thing from below."""

    @abstractmethod
    def touching_fingers(self, robot: str, thing: str) -> set[str]:
        """The fingers of the robot that touch the thing: a subset of `left` and `right`."""

    @abstractmethod
    def fingers_at_handle(self, robot: str, leaf: Leaf) -> set[str]:
        """The fingers of the robot that touch a handle of the leaf."""

    @abstractmethod
    def robot_contacts(self) -> set[tuple[str, str]]:
        """The pairs of objects in contact of which at least one is a robot, without robots and the things that they hold."""

    @abstractmethod
    def is_unobstructed(self, start: Place, end: Place, ignored: Iterable[str]) -> bool:
        """Whether no solid except the ignored objects is between two points."""

    @abstractmethod
    def raise_object(self, name: str, z: float) -> Solid:
        """Move a robot, with what it holds, or the cabin of a lift to another height. Returns the object as it is then."""

    # For displays

    @abstractmethod
    def row_reader(self, arms: Sequence[str], bases: Sequence[str], leaves: Sequence[Leaf]) -> Callable[[], Array]:
        """Reads the numbers of robots with and without arms, of all things, and of leaves, as one row; valid for this `edition`."""

    @abstractmethod
    def drawing(self) -> tuple[Any, Any]:
        """A model of MuJoCo and its data, to draw the world as it is now."""

    def pose(self, name: str) -> tuple[float, float, float, float]:
        """The middle of an object's underside, and its yaw: x, y, z, yaw."""
        solid = self.world.solids[name]
        if solid.role is Role.THING:
            return self.thing_pose(name)
        if solid.role is Role.ROBOT:
            x, y, yaw = self.joints[name].pose()
            return x, y, solid.z, yaw
        return solid.x, solid.y, solid.z, solid.yaw

    def rests(self, thing: str) -> bool:
        """Whether something other than a robot supports the thing from below."""
        return any(name not in self.joints for name in self.supporters(thing))

    def observe(self, name: str) -> ObjectState:
        """The true state of an object. `support` is None while a robot holds it."""
        x, y, z, yaw = self.pose(name)
        container = self.container(name)
        if container is not None:
            return ObjectState(object=name, x=x, y=y, z=z, yaw=yaw, container=container)
        holder, is_open = self.hands.holder(name), self.world.solids[name].open if self.leaves(name) else None
        return ObjectState(object=name, x=x, y=y, z=z, yaw=yaw, support=self._carrier(name), held_by=holder, open=is_open)

    def container(self, name: str) -> str | None:
        """That in which a thing is; None if it is in nothing, or if a robot holds it."""
        if not self._is_thing(name) or self.hands.holder(name) is not None:
            return None
        container = self.container_at(*self.pose(name)[:3])
        return container.name if container is not None else None

    def _is_thing(self, name: str) -> bool:
        return self.world.solids[name].role is Role.THING

    def _carrier(self, name: str) -> str | None:
        """What the object stands on: an object that touches it from below or, if there is no contact, the solid directly below it.

        A thing on the floor at a named place stands on that place.
        """
        x, y, z, _ = self.pose(name)
        if self._is_thing(name):
            if self.hands.holder(name) is not None:
                return None
            support_tops = {
                body_name: self.world.solids[body_name].top for body_name in self.supporters(name) if body_name in self.world.solids
            }
            touching = [body_name for body_name in support_tops if self.world.solids[body_name].role is not Role.FLOOR]
            if touching:
                return max(touching, key=lambda body_name: support_tops[body_name])
        carrier = self.support_below(x, y, z + 0.02, name)
        if carrier is not None and abs(carrier.top - z) > 0.05:
            return None
        if carrier is not None and carrier.role is Role.FLOOR and self._is_thing(name):
            places = self.world.standing_near((x, y, x, y))
            marks = (mark for mark in places if mark.role is Role.MARK and abs(mark.z - z) < 0.1 and mark.distance(x, y) <= 0)
            return min(marks, key=lambda mark: math.hypot(mark.x - x, mark.y - y), default=carrier).name
        return None if carrier is None else carrier.name

    def clearances(self, points: Array, low: float, high: float, ignored: Iterable[str] = ()) -> Array:
        """Distance from each point to the nearest static solid between two heights, at most `FAR`; negative inside it."""
        skip, distances = set(ignored), np.full(len(points), FAR)
        if not len(points):
            return distances
        (left, bottom), (right, top) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        for block in self.world.blocks_near((left - FAR, bottom - FAR, right + FAR, top + FAR)):
            if block.z < high and block.top > low and block.name not in skip:
                distances = np.minimum(distances, distances_from(block, points))
        return distances

    def room(self, points: Array, level: float, ignored: Iterable[str] = ()) -> Array:
        """Distance from each point to the nearest static solid that a robot on the floor of this height would touch, as `clearances`."""
        return self.clearances(points, level + EVEN, level + ROBOT_HEIGHT, ignored)

    def support_below(self, x: float, y: float, z: float, name: str = "") -> Solid | None:
        """The highest support, obstacle or floor under a point."""
        standing = (solid for solid in self.world.standing_near((x, y, x, y)) if solid.role in _SUPPORTS and solid.name != name)
        candidates = (solid for solid in standing if solid.top <= z and solid.distance(x, y) <= 0)
        return max(candidates, key=lambda s: s.top, default=None)


def _is_inside(container: Solid, x: float, y: float, z: float) -> bool:
    space = inside(container)
    return space.z - 0.02 <= z < space.top and space.distance(x, y) < 0
