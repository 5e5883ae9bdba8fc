"""Hands that hold without forces: what a hand holds keeps its place in the hand, and so does what stands on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from somrs.devices.simulator.world.hands import Hands
from somrs.devices.simulator.world.joints import wrapped
from somrs.space.leaves import Leaf

Pose = tuple[float, float, float, float]
"""x, y, z and yaw, m and rad."""


class HandScene(Protocol):
    """What hands need of their scene."""

    def disturb(self) -> None:
        """Note that what is at rest may begin to move."""

    def hand(self, robot: str) -> Pose:
        """The middle between the tips of a robot's fingers, and the direction of its wrist."""

    def thing_pose(self, thing: str) -> Pose:
        """The middle of a thing's underside, and its yaw."""

    def carry_thing(self, thing: str, pose: Pose) -> None:
        """Move a thing with the hand that holds it."""

    def settle(self, thing: str) -> None:
        """Let a thing fall to what is below it."""

    def standing_on(self, carrier: str) -> Sequence[str]:
        """The things that stand on another one."""

    def leaves(self, owner: str) -> Sequence[Leaf]:
        """The leaves of a door or container."""

    def leaf_position(self, leaf: Leaf) -> float:
        """The position of a leaf's joint, m or rad."""

    def pull_leaf(self, leaf: Leaf, position: float) -> None:
        """Move a leaf with the hand that holds its handle."""


@dataclass(frozen=True, slots=True)
class _Grip:
    """A thing that follows a hand: where it is in the frame of the hand."""

    thing: str
    along: float
    across: float
    up: float
    turn: float


class AttachedHands(Hands):
    """Hands to which things are attached: what a hand holds keeps its place in the hand, and so does what stands on it."""

    def __init__(self, scene: HandScene) -> None:
        super().__init__(scene.disturb)
        self._scene = scene
        self._grips: dict[str, list[_Grip]] = {}
        self._pulls: dict[str, tuple[Leaf, float]] = {}
        """The leaf that each robot pulls, and how far its position is from that of the hand."""

    def carries(self, thing: str) -> bool:
        """Whether a hand holds the thing, or what it stands on."""
        return any(grip.thing == thing for grips in self._grips.values() for grip in grips)

    def attach(self, thing: str, carrier: str) -> None:
        """Let a thing that comes to stand on another one follow the hand that carries that one, if one does."""
        for robot, grips in self._grips.items():
            if any(grip.thing == carrier for grip in grips):
                grips.append(self._grip(robot, thing))
                return

    def detach(self, thing: str) -> None:
        """Let a thing, and what stands on it, follow no hand any more."""
        stack = self._stack(thing)
        for grips in self._grips.values():
            grips[:] = [grip for grip in grips if grip.thing not in stack]

    def follow(self, robot: str) -> None:
        """Let what a robot holds follow its hand."""
        if robot in self._grips:
            x, y, z, angle = self._scene.hand(robot)
            c, s = math.cos(angle), math.sin(angle)
            for grip in self._grips[robot]:
                place = x + c * grip.along - s * grip.across, y + s * grip.along + c * grip.across, z + grip.up
                self._scene.carry_thing(grip.thing, (*place, angle + grip.turn))
        if robot in self._pulls:
            leaf, lead = self._pulls[robot]
            position = self._scene.leaf_position(leaf)
            way = self._along(leaf, robot) + lead - position
            moved = position + (way if leaf.slides else wrapped(way))
            self._scene.pull_leaf(leaf, min(max(moved, 0.0), leaf.travel))

    def _take(self, robot: str, thing: str) -> None:
        self.detach(thing)
        self._grips[robot] = [self._grip(robot, name) for name in self._stack(thing)]

    def _stack(self, thing: str) -> list[str]:
        """A thing, and what stands on it."""
        stack = [thing]
        for carrier in stack:
            stack += [name for name in self._scene.standing_on(carrier) if name not in stack]
        return stack

    def _grip(self, robot: str, thing: str) -> _Grip:
        x, y, z, angle = self._scene.hand(robot)
        thing_x, thing_y, thing_z, yaw = self._scene.thing_pose(thing)
        c, s, dx, dy = math.cos(angle), math.sin(angle), thing_x - x, thing_y - y
        return _Grip(thing, c * dx + s * dy, c * dy - s * dx, thing_z - z, yaw - angle)

    def _drop(self, robot: str) -> None:
        for grip in self._grips.pop(robot):
            self._scene.settle(grip.thing)

    def _take_handle(self, robot: str, leaf: str) -> None:
        owner, number = leaf.split("/leaf")
        pulled_leaf = self._scene.leaves(owner)[int(number)]
        self._pulls[robot] = pulled_leaf, self._scene.leaf_position(pulled_leaf) - self._along(pulled_leaf, robot)

    def _drop_handle(self, robot: str) -> None:
        del self._pulls[robot]

    def _along(self, leaf: Leaf, robot: str) -> float:
        """The position of a robot's hand on the way of the leaf's joint, m or rad from some point of it."""
        owner, (x, y, _, _) = leaf.owner, self._scene.hand(robot)
        c, s = math.cos(owner.yaw), math.sin(owner.yaw)
        u, v = c * (x - owner.x) + s * (y - owner.y) - leaf.end[0], c * (y - owner.y) - s * (x - owner.x) - leaf.end[1]
        if leaf.slides:
            return -(u * math.cos(leaf.along) + v * math.sin(leaf.along))
        return leaf.turn * math.atan2(v, u)
