"""Free spots where things can be put down, and stands from which a robot reaches a spot."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from somrs.devices.simulator.motion.approach import ranked
from somrs.devices.simulator.motion.driving import MARGIN, floor_things
from somrs.devices.simulator.motion.robot import ARM, Robot
from somrs.devices.simulator.motion.traffic import GAP, Capsule
from somrs.space.dimensions import Dimensions
from somrs.space.distances import Array, distances_from
from somrs.space.leaves import inside
from somrs.space.solids import Point, Role, Solid

EDGE = 0.02
"""Distance of a thing from the edge of its support, m."""
FINGERS = 0.05
"""Space that the open fingers and the palm need beside a thing, m."""
PALM = 0.1
"""Half the width of the palm, with some space, m."""
DOORWAY = 0.6
"""Distance of things on a floor from a door, so that robots can pass, m."""
EASIEST = 0.5
"""Distance from the middle of the base at which a spot is easiest to reach, m."""
WAY = 0.3
"""What a metre of the way to a stand costs."""
ASIDE, INSIDE = 3.0, 0.1
"""A robot that its own program drives puts things before it, near the edge: its program does not hear where they are, and takes them to be
there. What a metre aside costs, and the distance from the edge, m."""


class Clearances(Protocol):
    """The distance from points (n, 2) to the nearest static solid between two heights, without some."""

    def __call__(self, points: Array, low: float, high: float, ignored: Iterable[str] = (), /) -> Array: ...


@dataclass(frozen=True, slots=True)
class Stand:
    """A place for the base, the spot that is reached from it, and the cost of the two (less is better)."""

    base: Point
    spot: Point
    cost: float


def stands(
    robot: Robot,
    spots: Array,
    top: float,
    penalties: Array,
    ignored: Collection[str] = (),
    container: Solid | None = None,
    *,
    is_alone: bool = False,
) -> list[Stand]:
    """The stands from which the robot reaches one of the spots at height `top`, best first: those to which a way leads (see `ranked`).

    Robots that can make room are no obstacles. `container`: the container in which the spots are. `is_alone`: as if there were no other
    robots.
    """
    size, level = robot.size, robot.solid.z
    bases, target_spots, costs = reaching_bases(
        size,
        robot.scene.clearances,
        spots,
        top,
        penalties,
        lambda points: robot.scene.room(points, level),
        container,
    )
    obstacles = [Capsule((d.x, d.y), (d.x, d.y), d.radius) for d in floor_things(robot, ignored)]
    middle = (float(spots[:, 0].mean()), float(spots[:, 1].mean()))
    spread = float(np.hypot(spots[:, 0] - middle[0], spots[:, 1] - middle[1]).max()) + size.farthest + size.radius + 2 * MARGIN
    staying = [near_robot for near_robot in robot.fleet.near(robot, spread, middle) if near_robot.stays and not is_alone]
    claims = [claim for staying_robot in staying for claim in staying_robot.claims()]
    obstacles += claims
    ranked_stands: list[Stand] = []
    for i in ranked(robot, bases, costs, WAY):
        base = (float(bases[i][0]), float(bases[i][1]))
        footprint = Capsule(base, base, size.radius + MARGIN + GAP + 0.01)
        arm = Capsule(base, (float(target_spots[i][0]), float(target_spots[i][1])), ARM)
        if any(footprint.gap(o) < 0 for o in obstacles) or any(arm.gap(claim) < 0 for claim in claims):
            continue
        if robot.free_space.free(base, size.radius + MARGIN + 0.01):
            ranked_stands.append(Stand(base, (float(target_spots[i][0]), float(target_spots[i][1])), float(costs[i])))
            if len(ranked_stands) >= 40:
                break
    return ranked_stands


def reaching_bases(
    size: Dimensions,
    static: Clearances,
    spots: Array,
    top: float,
    penalties: Array,
    room: Callable[[Array], npt.NDArray[np.floating]],
    container: Solid | None = None,
) -> tuple[Array, Array, Array]:
    """Points for the base from which the arm reaches one of the spots at height `top`, if nothing but static solids is in the way.

    Each with its spot and its cost. `size`: of the robot. `static`: see `Clearances`. `room`: the distance from points to the nearest
    obstacle of the base. `container`: see `stands`.
    """
    reaches = np.linspace(size.nearest + 0.015, size.farthest - 0.015, 6)
    angles = np.arange(24) * (math.pi / 12)
    offsets = np.array([(r * math.cos(angle), r * math.sin(angle)) for r in reaches for angle in angles])
    bases = (spots[:, None, :] + offsets[None, :, :]).reshape(-1, 2)
    target_spots = np.repeat(spots, len(offsets), axis=0)
    costs = np.repeat(penalties, len(offsets)) + np.tile(np.abs(np.repeat(reaches, len(angles)) - EASIEST) * 0.5, len(spots))
    mask = room(bases) >= size.radius + MARGIN + 0.015
    bases, target_spots, costs = bases[mask], target_spots[mask], costs[mask]
    mask = _boom_clear(size, static, bases, target_spots, top, container)
    return bases[mask], target_spots[mask], costs[mask]


def _boom_clear(
    size: Dimensions, static: Clearances, bases: Array, spots: Array, top: float, container: Solid | None = None
) -> npt.NDArray[np.bool_]:
    """For each pair of base and spot, whether the boom passes above all static solids between them when the hand is at `top`.

    Into a container, it passes through the open front.
    """
    boom = top + size.hang - 0.05
    ignored = [container.name] if container is not None else []
    clear = np.ones(len(bases), dtype=bool)
    for share in (0.4, 0.6, 0.8, 1.0, 1.08):
        points = bases + share * (spots - bases)
        clear &= static(points, boom, boom + 0.1, ignored) > 0.05
    if container is not None:
        clear &= _through_front(container, bases, spots)
    return clear & (static(spots, top + 0.03, boom, ignored) > 0.03)


def _through_front(container: Solid, bases: Array, spots: Array) -> npt.NDArray[np.bool_]:
    """For each pair of base and spot, whether the line between them passes through the front of the container, away from its sides."""
    space, (c, s) = inside(container), (math.cos(container.yaw), math.sin(container.yaw))
    front, half = space.width / 2, space.depth / 2 - PALM
    (base_u, base_v), (spot_u, spot_v) = (
        (c * (p[:, 0] - space.x) + s * (p[:, 1] - space.y), c * (p[:, 1] - space.y) - s * (p[:, 0] - space.x)) for p in (bases, spots)
    )
    ahead = base_u > front
    share = np.where(ahead, (front - spot_u) / np.where(ahead, base_u - spot_u, 1.0), 0.0)
    return np.asarray(ahead & (np.abs(spot_v + share * (base_v - spot_v)) < half))


def thing_distances(robot: Robot, spots: Array, low: float, high: float, ignored: Collection[str]) -> Array:
    """Distance from each spot to the nearest thing between two heights."""
    distances = np.full(len(spots), 9.0)
    for thing in robot.scene.things():
        x, y, z, _ = robot.scene.pose(thing)
        solid = robot.scene.world.solids[thing]
        if thing not in ignored and z < high and z + solid.height > low and robot.scene.hands.holder(thing) is None:
            distances = np.minimum(distances, np.hypot(spots[:, 0] - x, spots[:, 1] - y) - solid.extent)
    return distances


def spots_inside(robot: Robot, container: Solid, radius: float) -> tuple[Array, Array]:
    """Spots on the bottom of a container where a thing of this radius can be put, with penalties for those near other things."""
    space, ignored = inside(container), [robot.holding] if robot.holding else []
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, 15) * space.width, np.linspace(-0.5, 0.5, 41) * space.depth)
    spots = np.array([space.world(float(x), float(y)) for x, y in zip(u.ravel(), v.ravel(), strict=True)])
    edge = -distances_from(space, spots) - radius
    room = thing_distances(robot, spots, space.z - 0.05, space.z + 0.4, ignored) - radius
    mask = (edge >= FINGERS) & (room >= FINGERS)
    return spots[mask], (1.5 * np.maximum(0.0, 0.15 - room) + np.maximum(0.0, 0.1 - edge))[mask]


def free_spots(robot: Robot, support: Solid, radius: float, position: Point | None = None) -> tuple[Array, Array]:
    """Spots on a support, a floor or a named place where a thing of this radius can be put.

    The second array has penalties for spots close to other things, the edge or walls.
    """
    spots = np.array([position]) if position is not None else _grid(support, robot.pose()[:2], robot.size.farthest)
    if not len(spots):
        return spots.reshape(0, 2), np.zeros(0)
    top, ignored = support.top if support.role is not Role.MARK else support.z, [robot.holding] if robot.holding else []
    edge = -distances_from(support, spots) - radius
    room = thing_distances(robot, spots, top - 0.05, top + 0.4, ignored) - radius
    standing = [support.name] if support.role is Role.SUPPORT else []
    walls = robot.scene.clearances(spots, top + 0.03, top + 0.4, standing) - radius
    bases = np.array([math.inf] * len(spots))
    for other_robot in robot.fleet.values():
        for claim in [other_robot.base_claim()] if other_robot is robot else other_robot.claims():
            bases = np.minimum(bases, _from_capsule(spots, claim) - radius)
    if support.role is Role.FLOOR and position is None:  # keep named places free
        edge = np.minimum(edge, _off_marks(robot, spots) - radius)
        edge = np.minimum(edge, _off_doorways(robot, spots) - DOORWAY)
    inset = EDGE if position is None else 0.0
    mask = (
        (edge >= inset - 1e-9)
        & (room >= (FINGERS if position is None else 0.005))
        & (walls >= 0.02)
        & (bases >= 0.03 if support.role is not Role.SUPPORT else True)
    )
    penalty = 1.5 * np.maximum(0.0, 0.15 - room) + np.maximum(0.0, 0.06 - edge) + 1.5 * np.maximum(0.0, 0.15 - walls)
    if robot.is_outside:
        penalty += ASIDE * _asides(robot, spots) + np.abs(edge + radius - INSIDE)
    return spots[mask], penalty[mask]


def _asides(robot: Robot, spots: Array) -> Array:
    """How far each spot is aside of where the robot looks, m; of one behind it, how far away."""
    x, y, yaw = robot.pose()
    dx, dy = spots[:, 0] - x, spots[:, 1] - y
    is_ahead = dx * math.cos(yaw) + dy * math.sin(yaw) > 0
    asides: Array = np.where(is_ahead, np.abs(dy * math.cos(yaw) - dx * math.sin(yaw)), np.hypot(dx, dy))
    return asides


def _off_marks(robot: Robot, spots: Array) -> Array:
    """Distance from each spot to the nearest named place on the robot's floor; negative inside it."""
    marks = [mark for mark in robot.scene.world.by_role(Role.MARK) if abs(mark.z - robot.solid.z) < 0.1]
    return np.min([distances_from(mark, spots) for mark in marks], axis=0) if marks else np.full(len(spots), 9.0)


def _off_doorways(robot: Robot, spots: Array) -> Array:
    """Distance from each spot to the nearest door on the robot's floor."""
    doors = [door for door in robot.scene.world.by_role(Role.DOOR) if abs(door.z - robot.solid.z) < 0.1]
    return np.min([distances_from(door, spots) for door in doors], axis=0) if doors else np.full(len(spots), 9.0)


def _from_capsule(points: Array, capsule: Capsule) -> Array:
    start, direction = np.array(capsule.start), np.array(capsule.end) - np.array(capsule.start)
    share = np.clip((points - start) @ direction / (float(direction @ direction) or 1.0), 0.0, 1.0)
    return np.asarray(np.hypot(*(points - start - share[:, None] * direction).T) - capsule.radius)


def _grid(support: Solid, robot_position: Point, reach: float) -> Array:
    """A grid of points on top of a solid; on a large solid in reach, only points around the robot."""
    extent = support.extent
    step = 0.06 if extent < 1.0 else 0.1
    if extent > 3.0 and support.distance(*robot_position) < reach:
        spread = np.arange(-1.0, 1.01, 0.1)
        points = np.array([(robot_position[0] + dx, robot_position[1] + dy) for dx in spread for dy in spread])
    else:
        count = min(40, int(extent / step))
        spread = np.linspace(-count * step, count * step, 2 * count + 1) if extent <= 2.4 else np.linspace(-extent, extent, 61)
        points = np.array([support.world(float(u), float(v)) for u in spread for v in spread])
    return np.asarray(points[distances_from(support, points) <= 0])


def spots_here(robot: Robot, radius: float) -> list[tuple[Point, float]]:
    """Spots around the robot where it can set a thing down without driving, with their heights; best first.

    It prefers the floor to furniture, spots that another robot can reach, and spots in front.
    """
    size, (x, y, yaw) = robot.size, robot.pose()
    reaches = [r for r in (0.56, 0.5, 0.44, 0.38) if size.nearest <= r <= size.farthest] or [size.farthest]
    angles = yaw + np.arange(-12, 12) * (math.pi / 12)
    spots = np.array([(x + r * math.cos(angle), y + r * math.sin(angle)) for r in reaches for angle in angles])
    # Prefer spots in front, and far from the base, so that there is space around them.
    ahead = np.tile(np.abs(np.arange(-12, 12)) * 0.02, len(reaches)) + np.repeat(size.farthest - np.array(reaches), 24)
    level = robot.solid.z
    held = [robot.holding] if robot.holding else []
    rated_spots: list[tuple[float, Point, float]] = []
    base = np.array([[x, y]])
    for spot, cost in zip(spots, ahead, strict=True):
        support = robot.scene.support_below(float(spot[0]), float(spot[1]), level + 1.3)
        if support is None or support.role is Role.STATIC:
            continue
        single_spot, on_floor = spot[None, :], support.role is Role.FLOOR
        edge = 1.0 if on_floor else float(-distances_from(support, single_spot)[0]) - radius - EDGE
        walls = float(robot.scene.clearances(single_spot, support.top + 0.03, support.top + 0.4)[0]) - radius
        room = float(thing_distances(robot, single_spot, support.top - 0.05, support.top + 0.4, held)[0]) - radius
        robots = min((float(_from_capsule(single_spot, c)[0]) - radius for o in robot.other_robots() for c in o.claims()), default=9.0)
        if (
            min(edge, walls - FINGERS, room - FINGERS, robots - 0.12) < 0
            or not _boom_clear(size, robot.scene.clearances, base, single_spot, support.top)[0]
        ):
            continue
        narrow = 0.4 * max(0.0, 0.5 - min(walls, room, robots))
        marked = 1 if on_floor and _off_marks(robot, single_spot)[0] < radius else 0
        rated_spots.append((float(cost) + narrow + (marked if on_floor else 2), (float(spot[0]), float(spot[1])), support.top))
    rated_spots.sort()
    ranked = [(spot, top) for _, spot, top in rated_spots]
    if robot.is_outside:  # its program takes the thing to be where it looks, as far away as its arm usually puts things
        points = np.array([spot for spot, _ in ranked]).reshape(-1, 2)
        off = _asides(robot, points) - 0.5 * np.hypot(points[:, 0] - x, points[:, 1] - y)
        return [ranked[number] for number in np.argsort(off, kind="stable").tolist()]
    reachable = next((i for i, (spot, _) in enumerate(ranked[:12]) if _others_can_reach(robot, spot)), 0)
    return ranked[reachable : reachable + 1] + ranked[:reachable] + ranked[reachable + 1 :]


def _others_can_reach(robot: Robot, spot: Point) -> bool:
    """Whether another robot of this size finds a place from which it can take a thing from the spot."""
    size, (x, y, _) = robot.size, robot.pose()
    ring = [(spot[0] + 0.55 * math.cos(angle), spot[1] + 0.55 * math.sin(angle)) for angle in np.arange(16) * math.pi / 8]
    min_clearance = size.radius + MARGIN + 0.02
    return any(math.dist(p, (x, y)) > min_clearance + size.radius + GAP and robot.free_space.free(p, min_clearance) for p in ring)


def outline_spots(solid: Solid) -> Array:
    """Points just inside an object's outline. A robot that reaches one of them is at the object."""
    ring = np.arange(48) * (math.pi / 24)
    far = [(solid.x + solid.extent * 1.5 * math.cos(angle), solid.y + solid.extent * 1.5 * math.sin(angle)) for angle in ring]
    points: list[Point] = []
    for x, y in far:
        shares = np.linspace(0, 1, 60)[:, None]
        line = np.array([[x, y]]) * (1 - shares) + np.array([[solid.x, solid.y]]) * shares
        inside_indices = np.flatnonzero(distances_from(solid, line) <= -0.01)
        if len(inside_indices):
            points.append((float(line[inside_indices[0]][0]), float(line[inside_indices[0]][1])))
    return np.array(points or [(solid.x, solid.y)])


def reachable_now(robot: Robot, spots: Array, top: float, container: Solid | None = None) -> int | None:
    """The index of the first spot that the arm reaches from the robot's current position; None if there is none."""
    x, y, _ = robot.pose()
    base = np.tile(np.array([[x, y]]), (len(spots), 1))
    distance = np.hypot(spots[:, 0] - x, spots[:, 1] - y)
    fine = (
        (distance >= robot.size.nearest)
        & (distance <= robot.size.farthest)
        & _boom_clear(robot.size, robot.scene.clearances, base, spots, top, container)
    )
    ready = np.flatnonzero(fine)
    return int(ready[0]) if len(ready) else None


def order(spots: Array, penalties: Array) -> tuple[Array, Array]:
    """Sort spots and penalties by penalty, smallest first."""
    best = np.argsort(penalties, kind="stable")
    return spots[best], penalties[best]
