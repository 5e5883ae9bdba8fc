"""What is near a place, found by squares and by looking at everything."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from somrs.space.squares import Box, Squares, box_around

coordinate = st.floats(-20, 20)
boxes = st.builds(box_around, st.tuples(coordinate, coordinate), st.floats(0, 6))


def meet(box: Box, near_box: Box) -> bool:
    return box[0] <= near_box[2] and near_box[0] <= box[2] and box[1] <= near_box[3] and near_box[1] <= box[3]


@given(st.lists(boxes, max_size=8), boxes, st.sampled_from((0.3, 1.0, 7.0)))
def test_all_that_a_rectangle_meets_is_found_and_nothing_that_is_farther_than_two_squares(places: list[Box], box: Box, size: float) -> None:
    squares = Squares[int](size)
    for number, place in enumerate(places):
        squares.add(number, place)
    found = {*squares.near(box)}
    assert {number for number, place in enumerate(places) if meet(place, box)} <= found
    wide = box[0] - 2 * size, box[1] - 2 * size, box[2] + 2 * size, box[3] + 2 * size
    assert all(meet(places[number], wide) for number in found)
    assert squares.count(box) == len([*squares._met(box)])
