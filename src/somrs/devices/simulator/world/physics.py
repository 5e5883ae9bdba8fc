"""The world moved by the physics of MuJoCo: forces, contacts and friction. It is the world for manipulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence

import mujoco
import numpy as np

from somrs.devices.simulator.world.chassis import HANDLE_BIT, ServoJoints
from somrs.devices.simulator.world.joints import ARM_JOINTS, ARM_SEEN, BASE_JOINTS
from somrs.devices.simulator.world.scene import RESTING, Place, Scene
from somrs.devices.simulator.world.welded_hands import WeldedHands
from somrs.devices.simulator.world.world import STEP, World, build
from somrs.errors import SimulationError
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology
from somrs.space.distances import Array
from somrs.space.leaves import Leaf, leaves_of
from somrs.space.solids import Role, Solid

PERIOD = 0.02
"""Control period of the robots, s."""
SETTLING = 40
"""Steps of physics before time starts, in which things come to rest on their supports."""
LEAD = 8
"""How many control periods the set point of a door's drive is ahead of its leaf, which follows like a spring."""
SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
"""MuJoCo's option to skip bodies at rest until a moving body touches them."""
DIVERGED = slice(int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQACC) + 1)
"""MuJoCo's warnings of positions, speeds or accelerations that are not finite, or huge."""


class PhysicsScene(Scene):
    """The compiled world and its state."""

    period = PERIOD
    world: World
    hands: WeldedHands

    def __init__(self, map: Map, ontology: Ontology) -> None:
        super().__init__(build(map, ontology))
        try:
            self.model: mujoco.MjModel = self.world.spec.compile()
        except ValueError as error:
            raise SimulationError(f"the world of this map cannot be built: {error}") from error
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        self.hands = WeldedHands(self._disturb)
        self._awake = True
        self._bind()
        for solid in self.world.solids.values():
            self._start(solid)
        self._settle()

    def _bind(self) -> None:
        """Look up all bodies and joints by name in the newly compiled model."""
        model = self.model
        self.edition += 1
        names = [model.body(int(body)).name for body in model.geom_bodyid]
        self.hands.bind(model, self.data)
        self._owner = [name.split("/")[0] for name in names]
        self._geom_body = names
        self._things = {solid.name: model.body(solid.name).id for solid in self.world.by_role(Role.THING)}
        self.joints = {s.name: ServoJoints(s.name, model, self.data, s.gripper) for s in self.world.by_role(Role.ROBOT)}
        # Views of the physics' memory: getting a view costs more than reading it.
        self._position, self._velocity = np.asarray(self.data.qpos), np.asarray(self.data.qvel)
        self._place, self._rotation = np.asarray(self.data.xpos), np.asarray(self.data.xmat)
        self._motion = {thing: int(model.body_dofadr[body]) for thing, body in self._things.items()}
        self._warnings = np.asarray(self.data.warning.number)
        self._asleep = np.asarray(self.data.tree_asleep)
        self._tree = {thing: int(model.body_treeid[body]) for thing, body in self._things.items()}
        self._leaves = {
            leaf.name: int(model.jnt_qposadr[model.joint(leaf.name).id])
            for solid in self.world.solids.values()
            for leaf in leaves_of(solid)
        }

    def _settle(self) -> None:
        for _ in range(SETTLING):
            mujoco.mj_step(self.model, self.data)
        self._check()

    def step(self, periods: int = 1) -> None:
        if self._awake and self.time - self.disturbed >= RESTING:
            self._awake = False
            self.model.opt.enableflags |= SLEEP
        steps = periods * round(self.period / STEP)
        mujoco.mj_step(self.model, self.data, steps)
        mujoco.mj_kinematics(self.model, self.data)  # without it, body poses are those before the last step
        self.time += steps * STEP
        self._check()

    def _check(self) -> None:
        if self._warnings[DIVERGED].any() or not math.isfinite(self._position.sum()):
            wrong = np.flatnonzero(~np.isfinite(self.data.qpos))
            joint = next(
                (self.model.joint(j).name for j in range(self.model.njnt) for i in wrong[:1] if self.model.jnt_qposadr[j] <= i), ""
            )
            raise SimulationError(
                f"the physics diverged at {self.time:.2f} s{f' near {joint}' if joint else ''}; the simulation cannot continue"
            )

    # Adding and removing objects

    def add(self, object: Object) -> Solid | None:
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
        holder = self.hands.holder(thing)
        if holder is not None:
            self.hands.release(holder)
        self._put(thing, x, y, z, yaw)
        self._disturb()
        mujoco.mj_forward(self.model, self.data)

    def _put(self, thing: str, x: float, y: float, z: float, yaw: float) -> None:
        body = self.model.body(self._things[thing])
        place, speed = int(self.model.jnt_qposadr[body.jntadr[0]]), int(body.dofadr[0])
        self.data.qpos[place : place + 7] = [x, y, z, math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)]
        self.data.qvel[speed : speed + 6] = 0

    def set_weight(self, thing: str, weight: float) -> None:
        if weight != self.world.solids[thing].weight:
            self.world.set_weight(thing, weight)
            self._recompile()
            mujoco.mj_forward(self.model, self.data)

    # Doors and containers

    def leaf_position(self, leaf: Leaf) -> float:
        return float(self._position[self._leaves[leaf.name]])

    def set_leaf(self, leaf: Leaf, position: float) -> None:
        self._position[self._leaves[leaf.name]] = self.world.positions[leaf.name] = position
        self._disturb()
        if leaf.owner.powered:
            self.hold_leaf(leaf, position)

    def drive_leaf(self, leaf: Leaf, goal: float, speed: float) -> None:
        lead = LEAD * speed * self.period
        position = self.leaf_position(leaf)
        self.hold_leaf(leaf, position + min(max(goal - position, -lead), lead))

    def hold_leaf(self, leaf: Leaf, position: float) -> None:
        self.data.ctrl[mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_ACTUATOR, leaf.name)] = position

    # Poses and contacts

    def thing_pose(self, thing: str) -> tuple[float, float, float, float]:
        body = self._things[thing]
        x, y, z = self._place[body].tolist()
        rotation = self._rotation[body]
        return x, y, z, math.atan2(rotation[3], rotation[0])

    def upright(self, thing: str) -> bool:
        return float(self._rotation[self._things[thing]][8]) > 0.97

    def are_at_rest(self, *things: str) -> bool:
        """Whether all the things are at rest, within tolerances for the noise of the physics."""
        first = np.array([self._motion[thing] for thing in things])
        velocity = np.abs(self._velocity[first[:, None] + np.arange(6)])
        return float(velocity[:, :3].max()) < 0.02 and float(velocity[:, 3:].max()) < 0.3

    def things(self) -> Iterable[str]:
        return self._things

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

    def supporters(self, thing: str) -> Iterable[str]:
        return (body_name for body_name, lower in self._contacts(thing) if lower)

    def touching_fingers(self, robot: str, thing: str) -> set[str]:
        return self._touching(robot, [geom for geom, owner in enumerate(self._owner) if owner == thing])

    def fingers_at_handle(self, robot: str, leaf: Leaf) -> set[str]:
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

    def is_unobstructed(self, start: Place, end: Place, ignored: Iterable[str]) -> bool:
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

    def raise_object(self, name: str, z: float) -> Solid:
        way = z - self.world.solids[name].z
        solid = self.world.raise_object(name, z)
        self.model.body(name).pos[2] = z
        held = self.hands.held.get(name)
        if held is not None:
            self._position[int(self.model.jnt_qposadr[self.model.body(self._things[held]).jntadr[0]]) + 2] += way
        self._disturb()
        return solid

    # For displays

    def row_reader(self, arms: Sequence[str], bases: Sequence[str], leaves: Sequence[Leaf]) -> Callable[[], Array]:
        robots, model, data = [*arms, *bases], self.model, self.data
        base_addresses = np.array([self._addresses(robot, BASE_JOINTS) for robot in robots], dtype=int).reshape(-1, 3)
        origins = np.array([model.body(robot).pos[:2] for robot in robots]).reshape(-1, 2)
        arm_addresses = np.array([self._addresses(robot, ARM_SEEN) for robot in arms], dtype=int).reshape(-1, len(ARM_SEEN))
        leaf_addresses = np.array([self._leaves[leaf.name] for leaf in leaves], dtype=int)
        travels = np.array([leaf.travel for leaf in leaves])
        things = np.array([*self._things.values()], dtype=int)

        def row() -> Array:
            position = np.asarray(data.qpos)
            base = position[base_addresses]
            poses = np.empty((len(base), 4))
            poses[:, :2] = base[:, :2] + origins
            poses[:, 2] = [self.world.solids[robot].z for robot in robots]
            poses[:, 3] = np.remainder(base[:, 2] + math.pi, math.tau) - math.pi
            armed = np.concatenate([poses[: len(arms)], position[arm_addresses]], axis=1)
            placed = np.concatenate([data.xpos[things], _angles(data.xquat[things])], axis=1)
            opened = np.clip(position[leaf_addresses] / travels, 0.0, 1.0)
            return np.concatenate([armed.ravel(), poses[len(arms) :].ravel(), placed.ravel(), opened])

        return row

    def _addresses(self, robot: str, joints: Sequence[str]) -> list[int]:
        return [int(self.model.jnt_qposadr[self.model.joint(f"{robot}/{joint}").id]) for joint in joints]

    def show(self, scene: Scene) -> None:
        """Take the poses of another scene of the same objects, to draw them."""
        for lift in self.world.by_role(Role.LIFT):
            self.raise_object(lift.name, scene.world.solids[lift.name].z)
        for name, joints in self.joints.items():
            self.raise_object(name, scene.world.solids[name].z)
            solid, shown = self.world.solids[name], scene.joints[name]
            x, y, yaw = shown.pose()
            joints.start("x", x - solid.x)
            joints.start("y", y - solid.y)
            joints.start("yaw", yaw)
            for joint in ARM_JOINTS if solid.gripper else ():
                joints.start(joint, shown[joint])
        for thing in self._things:
            self._put(thing, *scene.thing_pose(thing))
        for solid in self.world.solids.values():
            for leaf in leaves_of(solid):
                self._position[self._leaves[leaf.name]] = scene.leaf_position(leaf)
        mujoco.mj_forward(self.model, self.data)

    def drawing(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        return self.model, self.data


def _angles(turns: Array) -> Array:
    """Yaw, pitch and roll (n, 3), about z, then the new y, then the new x, of quaternions (n, 4)."""
    w, x, y, z = turns.T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return np.stack([yaw, pitch, roll], axis=1)
