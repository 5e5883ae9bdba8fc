"""The routine for each command: checks the command's preconditions, and carries it out."""

from __future__ import annotations

import numpy as np

from somrs.devices.simulator.battery import CHARGING
from somrs.devices.simulator.link.commands import (
    Approach,
    Charge,
    Close,
    Command,
    DriveAlong,
    DriveTo,
    Grip,
    Insert,
    LookAround,
    LookAt,
    ObjectState,
    Open,
    Place,
    PutDown,
    Stop,
    Velocity,
    Weigh,
)
from somrs.devices.simulator.motion.arm import let_go, withdraw
from somrs.devices.simulator.motion.driving import change_storey, drive_to
from somrs.devices.simulator.motion.handling import get_within_reach, pick, place, put_into, set_down, spots_on, top_of, weigh
from somrs.devices.simulator.motion.leaves import move_leaves
from somrs.devices.simulator.motion.outside import drive_along, move_at
from somrs.devices.simulator.motion.placement import outline_spots
from somrs.devices.simulator.motion.robot import GivenUp, Robot, Routine, stand
from somrs.devices.simulator.motion.searching import Sought, look_around, look_at
from somrs.devices.simulator.world.scene import Scene
from somrs.errors import UsageError
from somrs.space.distances import Array
from somrs.space.shafts import SAME_FLOOR
from somrs.space.solids import CARRYING, Role, Solid


def make_routine(command: Command, robot: Robot, scene: Scene, observations: dict[str, ObjectState]) -> Routine:
    """Make the routine for a command: it goes to the storey of what the command concerns, and carries the command out there.

    Commands that search add what they see to `observations`. Raises UsageError.
    """
    routine = _make_routine(command, robot, scene, observations)
    goal = _goal(command, scene) if not robot.is_outside else None
    return _on_storey(robot, goal, routine) if goal is not None else routine


def _goal(command: Command, scene: Scene) -> tuple[float, float, float] | None:
    """The point near which the robot has to be for a command; None if it does not matter, or is not known."""
    match command:
        case DriveTo(x=x, y=y, z=float() as z) | LookAt(x=x, y=y, z=z):
            return x, y, z
        case Approach(object=name) | Grip(object=name) | Weigh(object=name) | Open(object=name) | Close(object=name):
            return _foot(scene, name)
        case Place(support=name) | Insert(container=name):
            return _foot(scene, name)
    return None


def _foot(scene: Scene, name: str) -> tuple[float, float, float] | None:
    """The middle of an object's underside, or of a floor's top."""
    if name not in scene.world.solids:
        return None
    solid, (x, y, z, _) = scene.world.solids[name], scene.pose(name)
    return x, y, solid.top if solid.role is Role.FLOOR else z


def _on_storey(robot: Robot, goal: tuple[float, float, float], routine: Routine) -> Routine:
    """Go to the storey of a point first, if lifts lead to other ones."""
    levels = [level for level in robot.road.office.levels if level <= goal[2] + SAME_FLOOR]
    level = max(levels, default=robot.level)
    if abs(level - robot.level) > SAME_FLOOR:
        yield from withdraw(robot)
        yield from change_storey(robot, level, goal[:2])
    yield from routine


def _make_routine(command: Command, robot: Robot, scene: Scene, observations: dict[str, ObjectState]) -> Routine:
    match command:
        case DriveTo(x=x, y=y, yaw=yaw):
            return _drive(robot, x, y, yaw)
        case DriveAlong(points=points, yaw=yaw, speed=speed, backward=backward):
            return drive_along(robot, points, yaw, speed, backward=backward)
        case Velocity(forward=forward, turning=turning, lasts=lasts):
            return move_at(robot, forward, turning, lasts)
        case Approach(object=name):
            return _approach(robot, scene, name)
        case Grip(object=name):
            return _grip(robot, scene, name)
        case Weigh(object=name):
            return _weigh(robot, scene, name)
        case Place():
            return _place(robot, scene, command)
        case Insert(container=name):
            return _insert(robot, scene, name)
        case Open(object=name) | Close(object=name):
            return _move_leaves(robot, scene, name, opening=isinstance(command, Open))
        case Charge():
            return _charge(robot, scene)
        case LookAt(x=x, y=y, z=z, object=name, like=like, whole=whole):
            return look_at(robot, (x, y, z), Sought(name, like if not whole else None), observations)
        case LookAround(object=name, like=like, whole=whole):
            return look_around(robot, Sought(name, like if not whole else None), observations)
        case Stop():
            return _stop(robot)
        case PutDown():
            return _put_down_object(robot)
    raise UsageError(f"a simulated robot cannot carry out {command!r}")


def _stop(robot: Robot) -> Routine:
    yield from stand(robot)
    yield from let_go(robot)


def concerned_objects(command: Command, robot: Robot) -> tuple[str, ...]:
    """The objects whose states the robot reports at the end of a command."""
    match command:
        case Approach(object=name) | Grip(object=name) | Weigh(object=name) | Open(object=name) | Close(object=name):
            return (name,)
        case Place() | Insert() | PutDown() if robot.holding is not None:
            return (robot.holding,)
        case Stop() if (leaf := robot.scene.hands.pulled.get(robot.name)) is not None:
            return (leaf.split("/")[0],)
    return ()


def _drive(robot: Robot, x: float, y: float, yaw: float | None) -> Routine:
    yield from withdraw(robot)
    yield from drive_to(robot, (x, y), yaw)
    yield from stand(robot)


def _approach(robot: Robot, scene: Scene, name: str) -> Routine:
    solid = _solid(scene, name)
    if solid.role is Role.THING:
        yield from get_within_reach(robot, name, lambda: _spot_of(scene, name), scene.pose(name)[2], [name], _container_of(scene, name))
        return
    if solid.role in CARRYING:
        yield from get_within_reach(robot, name, spots_on(robot, solid, None), top_of(solid))
        return
    spots = outline_spots(solid)
    # The robot only has to be near: the arm does not reach into the object, so its height is no obstacle.
    yield from get_within_reach(robot, name, lambda: (spots, np.zeros(len(spots))), max(solid.top, 1.5), [name])


def _charge(robot: Robot, scene: Scene) -> Routine:
    x, y, _ = robot.pose()
    marks = scene.world.by_role(Role.MARK)
    if not any(mark.charger and abs(mark.z - robot.solid.z) < 0.1 and mark.distance(x, y) <= 0 for mark in marks):
        raise GivenUp("not-possible", f"{robot.name} does not stand at a charger")
    while True:
        robot.battery.add(CHARGING * robot.period)
        if robot.battery.charge == 100.0:
            return
        yield


def _grip(robot: Robot, scene: Scene, name: str) -> Routine:
    yield from _reach_for(robot, scene, name)
    yield from pick(robot, name)


def _weigh(robot: Robot, scene: Scene, name: str) -> Routine:
    yield from _reach_for(robot, scene, name)
    yield from weigh(robot, name)


def _reach_for(robot: Robot, scene: Scene, name: str) -> Routine:
    """Drive to where a thing that the robot could take is within reach. Raises GivenUp."""
    _need_a_gripper(robot)
    solid = _solid(scene, name)
    if robot.holding is not None:
        raise GivenUp("holding", f"{robot.name} holds {robot.holding} already")
    if solid.role is not Role.THING:
        raise GivenUp("not-possible", f"{name} is a {solid.type}, not a thing that can be carried")
    holder = scene.hands.holder(name)
    if holder is not None:
        raise GivenUp("not-possible", f"{name} is held by {holder}")
    robot.need_gripper()
    container = _container_of(scene, name)
    yield from get_within_reach(robot, name, lambda: _spot_of(scene, name), scene.pose(name)[2], [name], container)


def _place(robot: Robot, scene: Scene, command: Place) -> Routine:
    _need_a_gripper(robot)
    solid = _solid(scene, command.support)
    if robot.holding is None:
        raise GivenUp("not-holding", f"{robot.name} holds nothing that it could put on {command.support}")
    if solid.role not in CARRYING:
        raise GivenUp("not-possible", f"nothing can be put on {command.support}, which is a {solid.type}")
    robot.need_gripper()
    position = (command.x, command.y) if command.x is not None and command.y is not None else None
    yield from place(robot, solid, position)


def _insert(robot: Robot, scene: Scene, name: str) -> Routine:
    _need_a_gripper(robot)
    solid = _solid(scene, name)
    if robot.holding is None:
        raise GivenUp("not-holding", f"{robot.name} holds nothing that it could put into {name}")
    if not solid.container:
        raise GivenUp("not-possible", f"nothing can be put into {name}, which is a {solid.type}")
    _need_open(solid)
    robot.need_gripper()
    yield from put_into(robot, solid)


def _container_of(scene: Scene, thing: str) -> Solid | None:
    """The container in which a thing is. Raises GivenUp if that is shut."""
    x, y, z, _ = scene.pose(thing)
    container = scene.container_at(x, y, z) if scene.hands.holder(thing) is None else None
    if container is not None:
        _need_open(container)
    return container


def _need_open(container: Solid) -> None:
    if not container.open:
        raise GivenUp("shut", f"{container.name} is shut")


def _put_down_object(robot: Robot) -> Routine:
    _need_a_gripper(robot)
    if robot.holding is None:
        raise GivenUp("not-holding", f"{robot.name} holds nothing that it could put down")
    yield from set_down(robot)


def _move_leaves(robot: Robot, scene: Scene, name: str, *, opening: bool) -> Routine:
    _need_a_gripper(robot)
    solid = _solid(scene, name)
    if not scene.leaves(name):
        raise GivenUp("not-possible", f"{name} is a {solid.type} without doors that could move")
    if solid.powered:
        raise GivenUp("not-possible", f"{name} has a drive, which opens and closes it")
    if robot.holding is not None:
        raise GivenUp("holding", f"{robot.name} holds {robot.holding}, and needs its gripper for the door of {name}")
    yield from move_leaves(robot, name, opening=opening)


def _need_a_gripper(robot: Robot) -> None:
    if not robot.size.gripper:
        raise GivenUp("not-possible", f"{robot.name} has no gripper")


def _spot_of(scene: Scene, thing: str) -> tuple[Array, Array]:
    x, y, _, _ = scene.pose(thing)
    return np.array([[x, y]]), np.zeros(1)


def _solid(scene: Scene, name: str) -> Solid:
    if name not in scene.world.solids:
        raise GivenUp("unknown-object", f"{name} is not in the simulated world")
    return scene.world.solids[name]
