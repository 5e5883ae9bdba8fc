"""The running physics: the compiled world, its state, and observations of it (poses and contacts).

Controllers read and drive it; it makes no decisions. Objects can be added and removed while it runs; all others keep their state.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import replace

import mujoco
import numpy as np

from somrs.devices.simulator.link.commands import ObjectState
from somrs.devices.simulator.world.chassis import HANDLE_BIT, Joints
from somrs.devices.simulator.world.hands import Hands
from somrs.devices.simulator.world.world import STEP, World, build
from somrs.errors import SimulationError
from somrs.ontology.objects import Map, Object
from somrs.ontology.types import Ontology
from somrs.space.dimensions import dimensions_of
from somrs.space.distances import Array, distances_from
from somrs.space.leaves import Leaf, inside, leaves_of
from somrs.space.solids import Role, Solid

PERIOD = 0.02
"""Control period of the robots, s."""
SETTLING = 40
"""Steps of physics before time starts, in which things come to rest on their supports."""
LEAD = 8
"""How many control periods the set point of a door's drive is ahead of its leaf, which follows like a spring."""
RESTING = 1.0
"""Seconds without motion after which nothing moves again by itself: an object that tips over slowly has fallen by then."""
SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
"""MuJoCo's option to skip bodies at rest until a moving body touches them."""


class Scene:
    """The state of the world. `hands`: what robots hold; `period`: the control period of the robots, s.

    `disturbed`: simulated time at which an object was last added, removed, moved or released, so that objects at rest may move.
    """

    def __init__(self, map: Map, ontology: Ontology) -> None:
        self.world: World = build(map, ontology)
        try:
            self.model: mujoco.MjModel = self.world.spec.compile()
        except ValueError as error:
            raise SimulationError(f"the world of this map cannot be built: {error}") from error
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        self.joints: dict[str, Joints] = {}
        self.hands = Hands(self._disturb)
        self.time, self.period = 0.0, PERIOD
        self.disturbed, self._awake = 0.0, True
        self._bind()
        for solid in self.world.solids.values():
            self._start(solid)
        self._settle()

    def _bind(self) -> None:
        """Look up all bodies and joints by name in the newly compiled model."""
        model = self.model
        names = [model.body(int(body)).name for body in model.geom_bodyid]
        self.hands.bind(model, self.data)
        self._owner = [name.split("/")[0] for name in names]
        self._geom_body = names
        self._things = {solid.name: model.body(solid.name).id for solid in self.world.by_role(Role.THING)}
        self.joints = {s.name: Joints(s.name, model, self.data, s.gripper) for s in self.world.by_role(Role.ROBOT)}
        # Views of the physics' memory: getting a view costs more than reading it.
        self._position, self._velocity = np.asarray(self.data.qpos), np.asarray(self.data.qvel)
        self._place, self._rotation = np.asarray(self.data.xpos), np.asarray(self.data.xmat)
        self._motion = {thing: int(model.body_dofadr[body]) for thing, body in self._things.items()}
        self._asleep = np.asarray(self.data.tree_asleep)
        self._tree = {thing: int(model.body_treeid[body]) for thing, body in self._things.items()}
        self._leaves = {
            leaf.name: int(model.jnt_qposadr[model.joint(leaf.name).id])
            for solid in self.world.solids.values()
            for leaf in leaves_of(solid)
        }

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

    def _settle(self) -> None:
        for _ in range(SETTLING):
            mujoco.mj_step(self.model, self.data)
        self._check()

    def step(self, periods: int = 1) -> None:
        """Run the physics for some control periods. Raises SimulationError if it diverges."""
        if self._awake and self.time - self.disturbed >= RESTING:
            self._awake = False
            self.model.opt.enableflags |= SLEEP
        steps = periods * round(self.period / STEP)
        mujoco.mj_step(self.model, self.data, steps)
        mujoco.mj_kinematics(self.model, self.data)  # without it, body poses are those before the last step
        self.time += steps * STEP
        self._check()

    def _check(self) -> None:
        warnings = self.data.warning
        bad = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
        if any(warnings[kind].number for kind in bad) or not math.isfinite(float(self._position.sum())):
            wrong = np.flatnonzero(~np.isfinite(self.data.qpos))
            joint = next(
                (self.model.joint(j).name for j in range(self.model.njnt) for i in wrong[:1] if self.model.jnt_qposadr[j] <= i), ""
            )
            raise SimulationError(
                f"the physics diverged at {self.time:.2f} s{f' near {joint}' if joint else ''}; the simulation cannot continue"
            )

    # Adding and removing objects

    def add(self, object: Object) -> Solid | None:
        """Add an object; everything else keeps its state. Returns None if the object takes up no space."""
        solid = self.world.add(object)
        if solid is not None:
            self._recompile()
            self._start(solid)
            mujoco.mj_forward(self.model, self.data)
        return solid

    def remove(self, name: str) -> None:
        self.hands.remove(name)
        self.world.remove(name)
        self._recompile()
        mujoco.mj_forward(self.model, self.data)

    def _disturb(self) -> None:
        """Wake all bodies from the next step on."""
        self.disturbed, self._awake = self.time, True
        self.model.opt.enableflags &= ~SLEEP

    def _recompile(self) -> None:
        self._disturb()
        controls = {self.model.actuator(i).name: float(self.data.ctrl[i]) for i in range(self.model.nu)}
        constraints = self.hands.constraints()
        self.model, self.data = self.world.spec.recompile(self.model, self.data)
        for i in range(self.model.nu):
            self.data.ctrl[i] = controls.get(self.model.actuator(i).name, 0.0)
        self._bind()
        self.hands.restore(constraints)

    def place_thing(self, thing: str, x: float, y: float, z: float, yaw: float) -> None:
        """Move a thing to another pose, upright and at rest. A robot that held it releases it."""
        holder = self.hands.holder(thing)
        if holder is not None:
            self.hands.release(holder)
        body = self.model.body(self._things[thing])
        place, speed = int(self.model.jnt_qposadr[body.jntadr[0]]), int(body.dofadr[0])
        self.data.qpos[place : place + 7] = [x, y, z, math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)]
        self.data.qvel[speed : speed + 6] = 0
        self._disturb()
        mujoco.mj_forward(self.model, self.data)

    def set_weight(self, thing: str, weight: float) -> None:
        """Give a thing another weight, kg."""
        if weight != self.world.solids[thing].weight:
            self.world.set_weight(thing, weight)
            self._recompile()
            mujoco.mj_forward(self.model, self.data)

    # Doors and containers

    def leaves(self, owner: str) -> tuple[Leaf, ...]:
        return leaves_of(self.world.solids[owner])

    def leaf_position(self, leaf: Leaf) -> float:
        """The position of a leaf's joint, m or rad."""
        return float(self._position[self._leaves[leaf.name]])

    def set_leaf(self, leaf: Leaf, position: float) -> None:
        """Set a leaf's joint without motion."""
        self._position[self._leaves[leaf.name]] = self.world.positions[leaf.name] = position
        self._disturb()
        if leaf.owner.powered:
            self.hold_leaf(leaf, position)

    def drive_leaf(self, leaf: Leaf, goal: float, speed: float) -> None:
        """Let the drive of a powered door move its leaf towards a position for one control period, m/s."""
        lead = LEAD * speed * self.period
        position = self.leaf_position(leaf)
        self.hold_leaf(leaf, position + min(max(goal - position, -lead), lead))

    def hold_leaf(self, leaf: Leaf, position: float) -> None:
        """Set the position at which the drive of a powered door holds its leaf."""
        self.data.ctrl[mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_ACTUATOR, leaf.name)] = position

    def note_leaves(self, owner: str) -> bool:
        """Record where the leaves of a door or container came to rest. Returns whether it is open now: whether all of them are."""
        leaves = self.leaves(owner)
        self.world.positions.update({leaf.name: self.leaf_position(leaf) for leaf in leaves})
        is_open = all(leaf.is_open(self.leaf_position(leaf)) for leaf in leaves)
        self.world.solids[owner] = replace(self.world.solids[owner], open=is_open)
        return is_open

    def container_at(self, x: float, y: float, z: float) -> Solid | None:
        """The container in which a point is."""
        return next((solid for solid in self.world.by_role(Role.SUPPORT) if solid.container and _is_inside(solid, x, y, z)), None)

    # Poses and contacts

    def pose(self, name: str) -> tuple[float, float, float, float]:
        """The middle of an object's underside, and its yaw: x, y, z, yaw."""
        body = self._things.get(name)
        if body is not None:
            x, y, z = self._place[body].tolist()
            rotation = self._rotation[body]
            return x, y, z, math.atan2(rotation[3], rotation[0])
        solid = self.world.solids[name]
        if solid.role is Role.ROBOT:
            x, y, yaw = self.joints[name].pose()
            return x, y, solid.z, yaw
        return solid.x, solid.y, solid.z, solid.yaw

    def upright(self, thing: str) -> bool:
        return float(self._rotation[self._things[thing]][8]) > 0.97

    def are_at_rest(self, *things: str) -> bool:
        """Whether all the things are at rest, within tolerances for the noise of the physics."""
        first = np.array([self._motion[thing] for thing in things])
        velocity = np.abs(self._velocity[first[:, None] + np.arange(6)])
        return float(velocity[:, :3].max()) < 0.02 and float(velocity[:, 3:].max()) < 0.3

    def things(self) -> Iterable[str]:
        return self._things

    def observe(self, name: str) -> ObjectState:
        """The true state of an object. `support` is None while a robot holds it."""
        x, y, z, yaw = self.pose(name)
        holder, container = self.hands.holder(name), self.container_at(x, y, z) if name in self._things else None
        if container is not None and holder is None:
            return ObjectState(object=name, x=x, y=y, z=z, yaw=yaw, container=container.name)
        is_open = self.world.solids[name].open if self.leaves(name) else None
        return ObjectState(object=name, x=x, y=y, z=z, yaw=yaw, support=self._carrier(name), held_by=holder, open=is_open)

    def _carrier(self, name: str) -> str | None:
        """What the object stands on: an object that touches it from below or, if there is no contact, the solid directly below it.

        A thing on the floor at a named place stands on that place.
        """
        x, y, z, _ = self.pose(name)
        if name in self._things:
            if self.hands.holder(name) is not None:
                return None
            support_tops = {
                body_name: self.world.solids[body_name].top
                for body_name, lower in self._contacts(name)
                if lower and body_name in self.world.solids
            }
            touching = [body_name for body_name in support_tops if self.world.solids[body_name].role is not Role.FLOOR]
            if touching:
                return max(touching, key=lambda body_name: support_tops[body_name])
        carrier = self.support_below(x, y, z + 0.02, name)
        if carrier is not None and abs(carrier.top - z) > 0.05:
            return None
        if carrier is not None and carrier.role is Role.FLOOR and name in self._things:
            marks = (mark for mark in self.world.by_role(Role.MARK) if abs(mark.z - z) < 0.1 and mark.distance(x, y) <= 0)
            return min(marks, key=lambda mark: math.hypot(mark.x - x, mark.y - y), default=carrier).name
        return None if carrier is None else carrier.name

    def clearances(self, points: Array, low: float, high: float, ignored: Iterable[str] = ()) -> Array:
        """Distance from each point to the nearest static solid between two heights; negative inside it."""
        skip, distances = set(ignored), np.full(len(points), 9.0)
        for block in self.world.blocks():
            if block.z < high and block.top > low and block.name not in skip:
                distances = np.minimum(distances, distances_from(block, points))
        return distances

    def support_below(self, x: float, y: float, z: float, name: str = "") -> Solid | None:
        """The highest support, obstacle or floor under a point."""
        candidates = (
            s for s in self.world.by_role(Role.FLOOR, Role.SUPPORT, Role.STATIC) if s.name != name and s.top <= z and s.distance(x, y) <= 0
        )
        return max(candidates, key=lambda s: s.top, default=None)

    def _contacts(self, thing: str) -> Iterable[tuple[str, bool]]:
        """The objects that touch the thing, each with whether it does so from below."""
        if self._asleep[self._tree[thing]] >= 0:  # a step does not compute the contacts of sleeping bodies
            flags = self.model.opt.enableflags
            self.model.opt.enableflags = flags & ~SLEEP
            mujoco.mj_collision(self.model, self.data)
            self.model.opt.enableflags = flags
        contact, middle = self.data.contact, self.pose(thing)[2] + 0.4 * self.world.solids[thing].height
        for i, (first_geom, second_geom) in enumerate(contact.geom):
            if thing in (self._owner[first_geom], self._owner[second_geom]):
                body_name = self._owner[second_geom] if self._owner[first_geom] == thing else self._owner[first_geom]
                yield body_name, abs(float(contact.frame[i][2])) > 0.7 and float(contact.pos[i][2]) < middle

    def touches(self, thing: str, objects: Iterable[str]) -> bool:
        """Whether the thing touches one of the objects."""
        object_names = set(objects)
        return any(body_name in object_names for body_name, _ in self._contacts(thing))

    def rests(self, thing: str) -> bool:
        """Whether something other than a robot supports the thing from below."""
        return any(lower and body_name not in self.joints for body_name, lower in self._contacts(thing))

    def touching_fingers(self, robot: str, thing: str) -> set[str]:
        """The fingers of the robot that touch the thing: a subset of `left` and `right`."""
        return self._touching(robot, [geom for geom, owner in enumerate(self._owner) if owner == thing])

    def fingers_at_handle(self, robot: str, leaf: Leaf) -> set[str]:
        """The fingers of the robot that touch a handle of the leaf."""
        body = leaf.name
        handles = [geom for geom, name in enumerate(self._geom_body) if name == body and self.model.geom_contype[geom] == HANDLE_BIT]
        return self._touching(robot, handles)

    def _touching(self, robot: str, geoms: Collection[int]) -> set[str]:
        fingers = set()
        for first_geom, second_geom in self.data.contact.geom:
            for finger_geom, touched_geom in ((first_geom, second_geom), (second_geom, first_geom)):
                if touched_geom in geoms and self._geom_body[finger_geom] in (f"{robot}/left", f"{robot}/right"):
                    fingers.add(self._geom_body[finger_geom].rsplit("/", 1)[1])
        return fingers

    def robot_contacts(self) -> set[tuple[str, str]]:
        """The pairs of objects in contact of which at least one is a robot, without robots and the things that they hold."""
        contacts = set()
        for first_geom, second_geom in self.data.contact.geom:
            first_name, second_name = sorted((self._owner[first_geom], self._owner[second_geom]))
            if (
                first_name != second_name
                and HANDLE_BIT not in (self.model.geom_contype[first_geom], self.model.geom_contype[second_geom])
                and (first_name in self.joints or second_name in self.joints)
                and self.hands.held.get(first_name) != second_name
                and self.hands.held.get(second_name) != first_name
            ):
                contacts.add((first_name, second_name))
        return contacts

    def is_unobstructed(self, start: tuple[float, float, float], end: tuple[float, float, float], ignored: Iterable[str]) -> bool:
        """Whether no solid except the ignored objects is between two points."""
        vector = np.array(end) - np.array(start)
        length = float(np.linalg.norm(vector))
        groups, skip = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8), set(ignored)
        origin, remaining = np.array(start), length
        for _ in range(20):
            hit = np.zeros(1, dtype=np.int32)
            distance = mujoco.mj_ray(self.model, self.data, origin, vector / length, groups, 1, -1, hit)
            if distance < 0 or distance >= remaining:
                return True
            if self._owner[int(hit[0])] not in skip:
                return False
            origin, remaining = origin + vector / length * (distance + 1e-4), remaining - distance - 1e-4
        return False


def _is_inside(container: Solid, x: float, y: float, z: float) -> bool:
    space = inside(container)
    return space.z - 0.02 <= z < space.top and space.distance(x, y) < 0
