"""Path planning for mobile robots: paths around obstacles, and poses from which a robot reaches something.

It is independent of the physics. Static obstacles come from the map; the caller gives temporary ones (robots, things on the floor) as
discs. The ground is a grid whose cells hold the distance of their centres from the nearest obstacle (`clearance.py`). Distances on a
coarse grid guide A* on the fine grid, and lines of sight straighten its path (`wayfinding.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from somrs.ontology.objects import Map
from somrs.ontology.types import Ontology
from somrs.space.clearance import FAR, Disc, Field, Grid, clearances
from somrs.space.leaves import leaf_obstacles
from somrs.space.lines import point_distance
from somrs.space.shafts import shafts_of
from somrs.space.solids import STANDING, Point, Role, Solid, path_length, solid_of
from somrs.space.wayfinding import FreeGround

COMFORT = 0.25
"""Distance that robots keep from obstacles where there is space, m."""
ESCAPE = 0.8
"""Longest straight drive by which a robot may leave an obstacle that it is too close to, m."""
ARM = 0.05
"""Half the width of an arm, m."""
MOST_GROUNDS = 2
"""The number of combinations of a radius and discs for which what searches share is kept."""
SLACK = 0.01
"""Tolerance of clearances, for the error of interpolation between cells, m."""


@dataclass(frozen=True, slots=True)
class Pose:
    """The position and heading of a robot's base, and the point that the robot reaches from there."""

    x: float
    y: float
    yaw: float
    target: Point


class Navigator:
    """Plans paths on one level of a map. `height`: the height of the robots; solids above it are not obstacles.

    `leaf_positions`: where the leaves of doors and containers are, if not where the map says.
    """

    def __init__(
        self,
        map: Map,
        ontology: Ontology,
        *,
        level: float = 0.0,
        height: float = 1.85,
        leaf_positions: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        solids = [solid for object in map.objects.values() if (solid := solid_of(object, ontology)) is not None]
        self.solids = {solid.name: solid for solid in solids if _stands(solid) and solid.z < level + height and solid.top > level + 0.02}
        shafts = shafts_of(map, ontology)
        for fact in map.facts("leadsInto"):  # the doors of a lift are open for whoever may use it
            self.solids.pop(fact.arguments[0], None)
        floors = [solid for solid in solids if solid.role is Role.FLOOR and abs(solid.top - level) < 0.1]
        leaves = [leaf for solid in self.solids.values() for leaf in leaf_obstacles(solid, leaf_positions)]
        passages = [solid for solid in solids if ontology.is_subtype(solid.type, "Passage")]
        cabins = [part for shaft in shafts for part in shaft.ground(level)]
        walls = [wall for shaft in shafts for wall in shaft.obstacles(level)]
        self.grid = Grid.enclosing([*floors, *cabins] if floors else solids, margin=0.5 if floors else 4.0)
        self._clearance = clearances(self.grid, [*self.solids.values(), *leaves, *walls], floors, [*passages, *cabins] if floors else [])
        self._grounds: dict[tuple[float, tuple[Disc, ...]], FreeGround] = {}

    @property
    def field(self) -> Field:
        """The clearance of each cell of the grid, in metres."""
        return self._clearance

    def clearances(self, points: ArrayLike) -> Field:
        """Distance from each point to the nearest obstacle, as `clearance` says it."""
        return self.grid.sample(self._clearance, points)

    def is_clear(self, start: Point, end: Point, radius: float, discs: Sequence[Disc] = ()) -> bool:
        """Whether a robot of that radius can drive from one point to the other in a straight line."""
        return self._clear_line(self.grid.with_discs(self._clearance, discs), start, end, radius)

    def clearance(self, point: Point, discs: Sequence[Disc] = ()) -> float:
        """Distance from the point to the nearest obstacle, at most `FAR`; negative inside an obstacle or off the floor."""
        return min(float(self.grid.sample(self._clearance, [point])[0]), *(d.distance(point) for d in discs), FAR)

    def free(self, point: Point, radius: float, discs: Sequence[Disc] = ()) -> bool:
        """Whether a robot of that radius can stand there."""
        return self.clearance(point, discs) >= radius - SLACK

    def path(self, start: Point, goal: Point, radius: float, discs: Sequence[Disc] = ()) -> list[Point] | None:
        """Way points from start to goal, both included; None if there is no path.

        The start may be too close to an obstacle; the goal must be free.
        """
        if not self.free(goal, radius, discs):
            return None
        if self._clear_line(self._clearance, start, goal, radius + COMFORT) and all(
            point_distance((disc.x, disc.y), start, goal) - disc.radius >= radius + COMFORT - SLACK for disc in discs
        ):
            return [start, goal]  # without a field of its own, which takes a time that grows with the floor
        ground = self._free_ground(radius, discs)
        field, labels = ground.field, ground.labels
        start_cell, goal_cell = self._joining(field, labels, start, radius), self._joining(field, labels, goal, radius)
        if start_cell is None or goal_cell is None or labels[start_cell] != labels[goal_cell]:
            return [start, goal] if math.dist(start, goal) < ESCAPE and self._clear_line(field, start, goal, radius) else None
        cells = ground.search(start_cell, goal_cell)
        assert cells is not None, "cells of one component are connected by a path"
        return self._straightened(field, [start, *map(self.grid.centre, cells), goal], radius)

    def distance(self, start: Point, goal: Point, radius: float, discs: Sequence[Disc] = ()) -> float | None:
        """Length of the path, m; None if there is none."""
        path = self.path(start, goal, radius, discs)
        return None if path is None else path_length(path)

    def approach(
        self,
        start: Point,
        target: Point,
        radius: float,
        reach: tuple[float, float],
        discs: Sequence[Disc] = (),
        height: float = 0.0,
        limit: int = 8,
    ) -> list[Pose]:
        """Poses, best first, from which a gripper in front of the base reaches the target at `height`.

        `reach`: the smallest and the largest distance of the target from the middle of the base.
        """
        return self._ranked(start, self._poses_around(target, radius, reach, discs, height), radius, discs, limit)

    def approach_support(
        self,
        start: Point,
        support: Solid,
        radius: float,
        reach: tuple[float, float],
        discs: Sequence[Disc] = (),
        occupied_spots: Sequence[Disc] = (),
        room: float = 0.06,
        limit: int = 8,
    ) -> list[Pose]:
        """Poses, best first, from which something can be put on the support. The target of each is a point on its top near the edge.

        `occupied_spots`: the things on the top; `room`: the radius of the thing to be put there.
        """
        poses: list[Pose] = []
        for target, (nx, ny) in edge_targets(support, room + 0.04):
            if any(disc.distance(target) < room + 0.03 for disc in occupied_spots):
                continue
            poses += self._poses_around(target, radius, reach, discs, support.top, towards=math.atan2(-ny, -nx))
        return self._ranked(start, poses, radius, discs, limit)

    def _poses_around(
        self,
        target: Point,
        radius: float,
        reach: tuple[float, float],
        discs: Sequence[Disc],
        height: float,
        towards: float | None = None,
    ) -> list[Pose]:
        """Free poses that face the target; with `towards`, only those with a heading near it."""
        step = math.pi / 12
        yaws = [i * step for i in range(24)] if towards is None else [towards + i * step for i in (0, -1, 1, -2, 2)]
        bases = [
            (target[0] - r * math.cos(yaw), target[1] - r * math.sin(yaw), math.atan2(math.sin(yaw), math.cos(yaw)))
            for yaw in yaws
            for r in (reach[0] + (reach[1] - reach[0]) * i / 5 for i in range(6))
        ]
        room = self.grid.sample(self._clearance, [(x, y) for x, y, _ in bases])
        tall = [s for s in self.solids.values() if s.top > height + 0.02 and s.distance(*target) < reach[1] + ARM]
        return [
            Pose(x, y, yaw, target)
            for (x, y, yaw), clearance in zip(bases, room, strict=True)
            if min(float(clearance), *(disc.distance((x, y)) for disc in discs), FAR) >= radius and _arm_passes((x, y), target, tall)
        ]

    def _ranked(self, start: Point, poses: list[Pose], radius: float, discs: Sequence[Disc], limit: int) -> list[Pose]:
        """The reachable poses, ranked by the length of the path, the clearance and the extension of the arm."""
        if not poses:
            return []
        ground = self._free_ground(radius, discs)
        field, labels = ground.field, ground.labels
        start_cell = self._joining(field, labels, start, radius)
        costs = ground.costs_from(start_cell) if start_cell is not None else None
        rated: list[tuple[float, int]] = []
        for i, pose in enumerate(poses):
            cell = self._joining(field, labels, (pose.x, pose.y), radius)
            if costs is None or cell is None or start_cell is None or labels[cell] != labels[start_cell]:
                if not (math.dist(start, (pose.x, pose.y)) < ESCAPE and self._clear_line(field, start, (pose.x, pose.y), radius)):
                    continue
                way = math.dist(start, (pose.x, pose.y))
            else:
                way = max(costs.cost_to(cell), math.dist(start, (pose.x, pose.y)))
            room = min(self.clearance((pose.x, pose.y), discs) - radius, 0.1)
            rated.append((way - 5 * room + 2 * math.dist((pose.x, pose.y), pose.target), i))
        return list(_varied([poses[i] for _, i in sorted(rated)], limit))

    def _free_ground(self, radius: float, discs: Sequence[Disc]) -> FreeGround:
        """The free ground among the discs. The last ones are kept: a robot asks for many ways among the same obstacles."""
        key = radius, tuple(discs)
        if key not in self._grounds:
            while len(self._grounds) >= MOST_GROUNDS:
                del self._grounds[next(iter(self._grounds))]
            self._grounds[key] = FreeGround(self.grid.with_discs(self._clearance, discs), radius, COMFORT)
        return self._grounds[key]

    def _joining(self, field: np.ndarray, labels: np.ndarray, point: Point, radius: float) -> tuple[int, int] | None:
        """The nearest free cell to which a straight drive from the point does not come closer to an obstacle."""
        home = self.grid.cell(point)
        if home is not None and labels[home]:
            return home
        point_clearance = float(self.grid.sample(field, [point])[0])
        span = round((ESCAPE if point_clearance < radius - SLACK else 0.15) / self.grid.size)
        row, column = self.grid.clipped(point)
        rows, columns = slice(max(row - span, 0), row + span + 1), slice(max(column - span, 0), column + span + 1)
        near_cells = np.argwhere(labels[rows, columns] > 0) + np.array([rows.start, columns.start])
        order = np.argsort(np.hypot(*(self.grid.centres(near_cells) - point).T))
        for i in order[:60].tolist():
            cell = int(near_cells[i][0]), int(near_cells[i][1])
            if self._clear_line(field, point, self.grid.centre(cell), min(radius, point_clearance) - 0.02):
                return cell
        return None

    def _clear_line(self, field: np.ndarray, start: Point, end: Point, clearance: float) -> bool:
        count = max(2, math.ceil(2 * math.dist(start, end) / self.grid.size))
        share = np.linspace(0, 1, count)[:, None]
        return bool(self.grid.sample(field, np.asarray(start) * (1 - share) + np.asarray(end) * share).min() >= clearance - SLACK)

    def _straightened(self, field: np.ndarray, path: list[Point], radius: float) -> list[Point]:
        """The path with corners removed where the straight line keeps the clearance of the path."""
        room = np.minimum(self.grid.sample(field, path), radius + COMFORT)

        def is_visible(i: int, j: int) -> bool:
            least = float(room[i : j + 1].min())
            return j == i + 1 or self._clear_line(field, path[i], path[j], max(min(least, radius), least - self.grid.size / 2))

        corners, i, last_index = [path[0]], 0, len(path) - 1
        while i < last_index:
            step = 1
            while i + 2 * step <= last_index and is_visible(i, i + 2 * step):
                step *= 2
            low, high = i + step, min(i + 2 * step, last_index)
            if is_visible(i, high):
                low = high
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (middle, high) if is_visible(i, middle) else (low, middle)
            corners.append(path[low])
            i = low
        return corners


def edge_targets(solid: Solid, inset: float, spacing: float = 0.2) -> Iterator[tuple[Point, Point]]:
    """Points on a solid's top, `inset` from its edge or less where it is narrow, each with the outward normal of the edge."""
    for (start_x, start_y), (end_x, end_y) in _edges(solid):
        long = math.hypot(end_x - start_x, end_y - start_y)
        if long == 0:
            continue
        dx, dy = (end_x - start_x) / long, (end_y - start_y) / long
        count = max(1, int((long - 2 * inset) / spacing) + 1) if long > 2 * inset else 1
        for i in range(count):
            offset = long / 2 + (i - (count - 1) / 2) * min(spacing, max(long - 2 * inset, 0.0) / max(count - 1, 1) or spacing)
            depth, point = inset, solid.world(start_x + offset * dx - inset * dy, start_y + offset * dy + inset * dx)
            while depth > 0.03 and solid.distance(*point) > -0.9 * depth:
                depth *= 0.8
                point = solid.world(start_x + offset * dx - depth * dy, start_y + offset * dy + depth * dx)
            if depth > 0.03:
                c, s = math.cos(solid.yaw), math.sin(solid.yaw)
                yield point, (c * dy + s * dx, s * dy - c * dx)


def _edges(solid: Solid) -> list[tuple[Point, Point]]:
    """The edges of the outline in the solid's own frame, counter-clockwise: the inside is on the left."""
    corners = list(solid.corners(sides=16))
    ends = corners[1:] + corners[:1]
    if sum(start[0] * end[1] - end[0] * start[1] for start, end in zip(corners, ends, strict=True)) < 0:
        corners.reverse()
    return list(zip(corners, corners[1:] + corners[:1], strict=True))


def _arm_passes(base: Point, target: Point, tall: Sequence[Solid]) -> bool:
    """Whether none of the solids that are higher than the target's support is between the base and the target."""
    count = max(2, math.ceil(math.dist(base, target) / ARM))
    line = [(base[0] + (target[0] - base[0]) * i / count, base[1] + (target[1] - base[1]) * i / count) for i in range(count + 1)]
    return not any(solid.distance(*point) < ARM for solid in tall for point in line)


def _stands(solid: Solid) -> bool:
    return solid.role in STANDING or (solid.role is Role.DOOR and not solid.open)


def _varied(poses: list[Pose], limit: int) -> Iterator[Pose]:
    """The first poses that are at least 0.12 m apart, or have different targets."""
    selected: list[Pose] = []
    for pose in poses:
        if len(selected) == limit:
            return
        if all(
            math.hypot(pose.x - selected_pose.x, pose.y - selected_pose.y) > 0.12 or pose.target != selected_pose.target
            for selected_pose in selected
        ):
            selected.append(pose)
            yield pose
