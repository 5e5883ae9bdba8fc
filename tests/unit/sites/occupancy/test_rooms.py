"""The division into rooms, against a plain twin that goes cell by cell, and outlines."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy import ndimage

from somrs.sites.occupancy.rooms import find_rooms, is_door, outline_of, segmented
from somrs.sites.plan import is_in_polygon

Place = tuple[int, int]


def around(place: Place) -> list[Place]:
    return [(place[0] + row, place[1] + column) for row, column in product((-1, 0, 1), repeat=2) if (row, column) != (0, 0)]


def plainly_segmented(distances: np.ndarray, step: float) -> dict[Place, int]:
    """The same as `segmented`, cell by cell."""
    cells = {(int(row), int(column)): float(distances[row, column]) for row, column in np.argwhere(distances > 0)}
    labels: dict[Place, int] = {}
    peaks: list[float] = [math.inf]
    separate: set[tuple[int, int]] = set()
    for number in range(math.floor(distances.max() / step), 0, -1):
        level = number * step
        cells_at_level = {place for place, distance in cells.items() if distance >= level - 1e-9}
        visited: set[Place] = set()
        for start in sorted(cells_at_level):
            part, stack = set[Place](), [start]
            while stack:
                place = stack.pop()
                if place not in part and place in cells_at_level:
                    part.add(place)
                    stack += around(place)
            if start not in visited and not any(place in labels for place in part):
                peaks.append(level)
                labels |= dict.fromkeys(part, len(peaks) - 1)
            visited |= part
        while reached := {
            place: max(labels[neighbour] for neighbour in around(place) if neighbour in labels)
            for place in cells_at_level
            if place not in labels and any(neighbour in labels for neighbour in around(place))
        }:
            labels |= reached
        while undecided := sorted(
            {
                (labels[place], labels[neighbour])
                for place in labels
                for neighbour in around(place)
                if neighbour in labels and labels[place] < labels[neighbour] and (labels[place], labels[neighbour]) not in separate
            }
        ):
            first, second = undecided[0]
            if is_door(level, peaks[first], peaks[second]):
                separate.add((first, second))
                continue
            larger, dropped = (first, second) if peaks[first] >= peaks[second] else (second, first)
            labels = {place: larger if label == dropped else label for place, label in labels.items()}
            renamed = ((larger if one == dropped else one, larger if two == dropped else two) for one, two in separate)
            separate = {(min(pair), max(pair)) for pair in renamed}
    return labels


@settings(deadline=None, max_examples=30)
@given(walls=arrays.arrays(bool, (12, 15), elements=st.sampled_from([False] * 9 + [True])))
def test_the_division_is_that_of_the_plain_twin(walls: np.ndarray) -> None:
    distances = ndimage.distance_transform_edt(np.pad(~walls, 1)) * 0.25
    labels = segmented(distances, 0.25)
    twin = np.zeros_like(labels)
    for (row, column), label in plainly_segmented(distances, 0.25).items():
        twin[row, column] = label
    assert labels.tolist() == twin.tolist()


def test_two_rooms_with_a_door_are_two_and_a_room_with_a_niche_is_one() -> None:
    free = np.zeros((60, 130), dtype=bool)
    free[5:55, 5:60] = free[5:55, 65:125] = True
    free[25:43, 60:65] = True  # 0.9 m wide
    rooms = find_rooms(free, 0.05)
    assert len(rooms.numbers) == 2
    (doorway,) = rooms.doorways
    assert math.dist(doorway.middle, (62.5 * 0.05, 34 * 0.05)) < 0.2
    free[:, 60:] = False
    free[20:40, 60:70] = True
    assert len(find_rooms(free, 0.05).numbers) == 1


@settings(deadline=None, max_examples=60)
@given(mask=arrays.arrays(bool, (12, 12)))
def test_an_outline_has_just_the_cells_of_the_largest_part_inside(mask: np.ndarray) -> None:
    outline = outline_of(mask, 1.0, 0.0)
    if not mask.any():
        assert outline == []
        return
    is_in_outline = np.array([[is_in_polygon((column + 0.5, row + 0.5), outline) for column in range(12)] for row in range(12)])
    labels, _ = ndimage.label(mask)
    sizes = np.bincount(labels.ravel())[1:]
    largest = ndimage.binary_fill_holes(labels == int(sizes.argmax()) + 1)
    assert is_in_outline.tolist() == largest.tolist()
