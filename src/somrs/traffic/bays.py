"""Bays of corridors: niches and recesses in which a robot stands so far from the lanes of the corridor that others pass it.

Every free point of a floor sees a place, and a niche sees those of the corridor. So it gets a place of its own. As places at less than the
spacing exclude each other, the lanes past it get places at just that distance.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from somrs.space.free_space import FreeSpace
from somrs.traffic.coverage import Mask, Points
from somrs.traffic.planning.corridors import NOWHERE, find_corridors

CLEARANCE = math.sqrt(3) / 2
"""From how far from a lane on a robot is passed, by the spacing of places."""
JUST_APART = 1 + 5e-7
"""By what factor of the spacing places are apart that do not exclude each other, and that a lane may join."""
MOST_CELLS = 50
"""At how many points of a niche a place is tried."""

Lanes = NDArray[np.float64]
"""The ends of lanes (n, 2, 2)."""
AreClear = Callable[[Points, Points], Mask]
"""Whether a robot can drive in a straight line, for each pair of points (n, 2)."""


def find_bays(
    space: FreeSpace, free: Mask, points: Points, pairs: Sequence[tuple[int, int]], spacing: float, are_clear: AreClear
) -> Points:
    """Further points (n, 2), so that robots pass each other in the bays of corridors.

    `free`: the cells at which a robot has room; `pairs`: those of the `points` that lanes join.
    """
    in_corridor = _find_corridor_places(points, pairs, spacing)
    degrees = Counter(chain.from_iterable(pairs))
    through = [(start, end) for start, end in pairs if min(degrees[start], degrees[end]) > 1 and (points[start] != points[end]).any()]
    if not any(in_corridor[start] and in_corridor[end] for start, end in through):
        return np.zeros((0, 2))
    lanes = points[np.array(through)]
    middles, apart = cKDTree(lanes.mean(axis=1)), spacing * CLEARANCE
    labels, count = ndimage.label(free & (_distances_from(space, free, lanes) > apart - space.grid.size), structure=np.ones((3, 3)))
    bays: list[Points] = []
    for cells in _cells_of(labels, count):
        centres = space.grid.centres(cells)
        near_lanes = sorted({number for numbers in middles.query_ball_point(centres, 2 * spacing) for number in numbers})
        if any(in_corridor[through[number][0]] and in_corridor[through[number][1]] for number in near_lanes):
            bay = _bay(centres, lanes[near_lanes], spacing, are_clear)
            bays += [bay] if bay is not None else []
    return np.vstack(bays) if bays else np.zeros((0, 2))


def _find_corridor_places(points: Points, pairs: Sequence[tuple[int, int]], spacing: float) -> list[bool]:
    successors: list[list[int]] = [[] for _ in points]
    exclusions: list[list[int]] = [[] for _ in points]
    for start, end in pairs:
        successors[start].append(end)
        successors[end].append(start)
    for start, end in cKDTree(points).query_pairs(spacing * (1 - 1e-9)) if len(points) else ():
        exclusions[start].append(end)
        exclusions[end].append(start)
    return [corridor != NOWHERE for corridor in find_corridors(successors, exclusions)]


def _distances_from(space: FreeSpace, free: Mask, lanes: Lanes) -> NDArray[np.float64]:
    """By cell: about how far it is to the nearest lane, in metres."""
    grid, untouched = space.grid, np.ones(free.shape, dtype=bool)
    longest = float(np.hypot(*(lanes[:, 1] - lanes[:, 0]).T).max())
    for share in np.linspace(0, 1, math.ceil(longest / grid.size) + 1):
        samples = lanes[:, 0] * (1 - share) + lanes[:, 1] * share
        rows, columns = ((samples[:, axis] - start) // grid.size for axis, start in ((1, grid.y), (0, grid.x)))
        untouched[rows.astype(int).clip(0, free.shape[0] - 1), columns.astype(int).clip(0, free.shape[1] - 1)] = False
    return np.asarray(ndimage.distance_transform_edt(untouched) * grid.size)


def _cells_of(labels: NDArray[np.int32], count: int) -> Iterator[NDArray[np.int64]]:
    """The cells (n, 2) of each part."""
    for label, area in enumerate(ndimage.find_objects(labels, count), 1):
        if area is not None:
            yield np.argwhere(labels[area] == label) + np.array([area[0].start, area[1].start])


def _bay(centres: Points, lanes: Lanes, spacing: float, are_clear: AreClear) -> Points | None:
    """A place in a niche with these cells, and those on the lanes past it; None if no lane is in sight."""
    feet = _feet(centres, lanes)
    distances = np.hypot(*np.moveaxis(feet - centres[:, None], -1, 0))
    nearest = distances.min(axis=1)
    for number in np.argsort(nearest, kind="stable")[:MOST_CELLS]:
        if not spacing * CLEARANCE <= nearest[number] <= spacing:
            continue
        bay, own_feet = centres[number], feet[number]
        seen = are_clear(np.broadcast_to(bay, own_feet.shape), own_feet) & (distances[number] <= spacing)
        if seen.any():
            foot = own_feet[np.argmin(np.where(seen, distances[number], np.inf))]
            return np.vstack([bay, foot, *_crossings(bay, lanes, spacing * JUST_APART)])
    return None


def _feet(centres: Points, lanes: Lanes) -> Lanes:
    """The point of each lane that is nearest to each of the centres (n, lanes, 2)."""
    starts, along = lanes[:, 0], lanes[:, 1] - lanes[:, 0]
    shares = ((centres[:, None] - starts) * along).sum(axis=-1) / (along**2).sum(axis=-1)
    return np.asarray(starts + shares.clip(0, 1)[..., None] * along)


def _crossings(middle: Points, lanes: Lanes, radius: float) -> Iterator[Points]:
    """The points at which lanes cross a circle."""
    crossings: list[Points] = []
    for start, end in lanes:
        along, offset = end - start, start - middle
        square, half, rest = along @ along, along @ offset, offset @ offset - radius**2
        if (root := half**2 - square * rest) <= 0:
            continue
        for share in ((-half - math.sqrt(root)) / square, (-half + math.sqrt(root)) / square):
            point = start + share * along
            if 0 <= share <= 1 and all(np.abs(point - earlier).max() > 1e-3 for earlier in crossings):
                crossings.append(point)
    yield from crossings
