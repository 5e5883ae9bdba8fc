"""Buildings made of occupancy grids: walls, rooms, doors and obstacles, of floor plans that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.sites.occupancy.building import building_of
from somrs.sites.occupancy.grid import Cell, OccupancyGrid, coarser, without_margins
from somrs.sites.plan import Box, is_in_polygon
from tests.support.floor_plans import FloorPlan, grid_of, points_along, rooms_in_rows, share_within

_LENGTHS = st.lists(st.floats(2.6, 6.0), min_size=1, max_size=3)
_DOORS = st.lists(st.one_of(st.none(), st.tuples(st.floats(0.8, 1.3), st.floats(0, 1))), min_size=12, max_size=12)
PLANS = st.builds(rooms_in_rows, _LENGTHS, _LENGTHS, st.sampled_from([0.1, 0.2]), _DOORS)


@settings(deadline=None, max_examples=12)
@given(plan=PLANS, yaw=st.sampled_from([0.0, 0.2, -0.6]))
def test_walls_rooms_and_doors_of_a_floor_plan_are_found(plan: FloorPlan, yaw: float) -> None:
    building = building_of(grid_of(plan, yaw=yaw))
    true_points = np.vstack([points_along(wall) for wall in plan.walls])
    assert share_within(true_points, building.walls, 0.1) >= 0.95
    found_points = np.vstack([points_along(wall) for wall in building.walls])
    assert share_within(found_points, plan.walls, 0.1) >= 0.95
    assert len(building.rooms) == len(plan.rooms)
    for middle in plan.rooms:
        assert sum(is_in_polygon(middle, room.outline) for room in building.rooms) == 1
    assert len(building.doors) == len(plan.doors)
    for door in plan.doors:
        nearest = min(building.doors, key=lambda candidate: math.dist((candidate.box.x, candidate.box.y), (door.x, door.y))).box
        assert math.dist((nearest.x, nearest.y), (door.x, door.y)) <= 0.15
        assert nearest.width == pytest.approx(door.width, abs=0.2)
        assert abs(math.remainder(nearest.yaw - door.yaw, math.pi)) <= math.radians(5)


@pytest.mark.parametrize(("width", "rooms"), [(3.0, 2), (3.9, 2), (4.6, 1)])
def test_an_opening_between_the_ends_of_two_walls_parts_rooms_also_if_it_is_wide(width: float, rooms: int) -> None:
    plan = rooms_in_rows([8.0, 9.0], [7.0], 0.1, [(width, 0.4)])
    building = building_of(grid_of(plan, yaw=0.2))
    assert len(building.rooms) == rooms
    for door in building.doors:
        assert door.box.width == pytest.approx(width, abs=0.2)
        assert math.dist((door.box.x, door.box.y), (plan.doors[0].x, plan.doors[0].y)) <= 0.1
    assert len(building.doors) == rooms - 1


def test_an_opening_that_is_as_wide_as_the_rooms_beside_it_parts_none() -> None:
    plan = rooms_in_rows([4.0, 4.0], [4.6], 0.1, [(3.2, 0.5)])
    assert len(building_of(grid_of(plan)).rooms) == 1


def test_a_narrow_place_between_what_was_not_seen_parts_no_rooms() -> None:
    grid = grid_of(rooms_in_rows([7.0], [5.0], 0.1, []))
    x, y = grid.to_map(grid.centres(np.ones(grid.shape, dtype=bool))).reshape(*grid.shape, 2).transpose(2, 0, 1)
    grid.states[(abs(x - 3.5) < 0.6) & (abs(y - 2.5) > 0.5) & (grid.states == Cell.FREE)] = Cell.UNKNOWN
    assert len(building_of(grid).rooms) == 1


def test_a_known_door_parts_rooms_however_wide_it_is() -> None:
    plan = rooms_in_rows([8.0, 9.0], [7.0], 0.1, [(5.0, 0.4)])
    (door,) = plan.doors
    building = building_of(grid_of(plan, yaw=0.2), doors=plan.doors)
    assert len(building.rooms) == 2
    assert [(round(door.box.x, 3), round(door.box.y, 3), door.box.width) for door in building.doors] == [(door.x, door.y, door.width)]


@settings(deadline=None, max_examples=6)
@given(plan=PLANS, shade=st.sampled_from([0.06, 1.0]))
def test_the_same_walls_are_found_of_filled_and_of_hollow_ones(plan: FloorPlan, shade: float) -> None:
    walls = building_of(grid_of(plan, skin=shade)).walls
    assert share_within(np.vstack([points_along(wall) for wall in plan.walls]), walls, 0.1) >= 0.95


def test_a_table_in_a_room_is_an_obstacle_and_makes_no_room_of_its_own() -> None:
    table = Box(3.0, 2.5, 1.4, 0.8, 0.3)
    building = building_of(grid_of(rooms_in_rows([6.0], [5.0], 0.1, []), obstacles=[table]))
    (obstacle,) = building.obstacles
    assert math.dist((obstacle.x, obstacle.y), (3.0, 2.5)) <= 0.05
    assert sorted([obstacle.width, obstacle.depth]) == pytest.approx([0.8, 1.4], abs=0.12)
    assert len(building.rooms) == 1
    assert len(building.walls) == 4


def test_a_cupboard_against_a_wall_is_an_obstacle_and_the_wall_goes_on_behind_it() -> None:
    cupboard = Box(2.0, 0.4, 1.2, 0.5, 0.0)
    plan = rooms_in_rows([6.0], [5.0], 0.1, [])
    building = building_of(grid_of(plan, obstacles=[cupboard]))
    (obstacle,) = building.obstacles
    assert share_within(points_along(cupboard), [obstacle], 0.0) == 1.0
    assert obstacle.width * obstacle.depth == pytest.approx(1.2 * 0.6, rel=0.2)
    assert share_within(np.vstack([points_along(wall) for wall in plan.walls]), building.walls, 0.1) >= 0.95


def test_a_wall_that_is_not_along_the_others_is_found() -> None:
    slanted = Box(3.0, 2.5, 2.5, 0.1, 0.6)
    building = building_of(grid_of(rooms_in_rows([6.0], [5.0], 0.1, []), obstacles=[slanted]))
    assert share_within(points_along(slanted), building.walls, 0.1) >= 0.95


@pytest.mark.parametrize("state", [Cell.UNKNOWN, Cell.FREE, Cell.OCCUPIED])
def test_a_grid_that_shows_nothing_is_a_building_without_walls_or_rooms_that_were_not_seen(state: Cell) -> None:
    building = building_of(OccupancyGrid(states=np.full((40, 60), state, dtype=np.int8), resolution=0.05))
    assert building.doors == []
    assert len(building.rooms) == (1 if state is Cell.FREE else 0)


def test_known_furniture_makes_neither_walls_nor_obstacles_and_rooms_go_on_under_it() -> None:
    plan = rooms_in_rows([8.0], [6.0], 0.1, [])
    desks = [Box(2.0, 2.0, 1.6, 0.8, 0.0), Box(3.65, 2.0, 1.6, 0.8, 0.0), Box(2.0, 1.15, 1.6, 0.8, 0.0), Box(5.9, 5.3, 3.2, 0.6, 0.0)]
    grid = grid_of(plan, yaw=0.2, obstacles=desks)
    building = building_of(grid, desks)
    assert building.obstacles == []
    assert len(building.walls) == 4
    (room,) = building.rooms
    assert all(is_in_polygon((desk.x, desk.y), room.outline) for desk in desks)
    assert room.cells * grid.resolution**2 == pytest.approx(8.0 * 6.0, rel=0.06)
    assert len(building_of(grid).walls) + len(building_of(grid).obstacles) > 4


def _room_of_a_real_scanner() -> OccupancyGrid:
    """A room with what real scanners and SLAM add: a thing as specks, specks beside a wall, and rays through a gap of a wall."""
    states = grid_of(rooms_in_rows([6.0], [5.0], 0.1, [])).states.copy()
    rows, columns = np.nonzero(states == Cell.FREE)
    low, left, right = int(rows.min()), int(columns.min()), int(columns.max())
    for row, column in ((0, 0), (1, 2), (3, 1), (4, 3), (2, 4)):  # what is left of a post of 0.25 m
        states[low + 40 + row, left + 50 + column] = Cell.OCCUPIED
    for column in range(left + 10, left + 80, 10):
        states[low + 2, column : column + 3] = Cell.OCCUPIED
    width = states.shape[1]
    rays = np.pad(states, ((0, 0), (0, 100)), constant_values=Cell.UNKNOWN)
    for row in (30, 40, 50):
        rays[low + row : low + row + 3, right + 1 : width + 90] = Cell.FREE
    return OccupancyGrid(states=rays, resolution=0.05)


def test_specks_of_one_thing_are_one_obstacle_and_those_of_a_wall_are_none() -> None:
    (obstacle,) = building_of(_room_of_a_real_scanner()).obstacles
    assert max(obstacle.width, obstacle.depth) <= 0.35


def test_rays_through_gaps_of_a_wall_are_no_part_of_a_room() -> None:
    (room,) = building_of(_room_of_a_real_scanner()).rooms
    assert max(x for x, _ in room.outline) - min(x for x, _ in room.outline) <= 6.6


@given(
    states=st.lists(st.lists(st.sampled_from([-1, 0, 1]), min_size=4, max_size=4), min_size=3, max_size=9),
    yaw=st.floats(-3.0, 3.0),
    factor=st.integers(1, 3),
)
def test_a_grid_without_margins_and_with_larger_cells_has_everything_in_its_place(states: list[list[int]], yaw: float, factor: int) -> None:
    grid = OccupancyGrid(states=np.pad(np.array(states, dtype=np.int8), 4, constant_values=-1), resolution=0.02, x=3.0, y=-2.0, yaw=yaw)
    smaller = coarser(without_margins(grid), 0.02 * factor)
    assert smaller.resolution == pytest.approx(0.02 * factor)
    points = grid.to_map(grid.centres(grid.mask(Cell.OCCUPIED)))
    assert (smaller.state_at(smaller.to_local(points)) == Cell.OCCUPIED).all()
    known_points = grid.to_map(grid.centres(grid.mask(Cell.FREE)))
    assert (smaller.state_at(smaller.to_local(known_points)) != Cell.UNKNOWN).all()


def test_walls_meet_in_a_corner_that_something_hides() -> None:
    plan = rooms_in_rows([6.0], [5.0], 0.1, [])
    states = grid_of(plan).states.copy()
    grid = grid_of(plan)
    local = grid.centres(np.ones(grid.shape, dtype=bool))
    on_map = grid.to_map(local).reshape(*grid.shape, 2)
    is_hidden = (on_map[..., 0] > 5.0) & (on_map[..., 1] > 3.8)
    states[is_hidden] = Cell.UNKNOWN
    building = building_of(OccupancyGrid(states=states, resolution=grid.resolution, x=grid.x, y=grid.y, yaw=grid.yaw))
    assert share_within(np.vstack([points_along(wall) for wall in plan.walls]), building.walls, 0.1) >= 0.98
    assert len(building.walls) == 4


@pytest.mark.parametrize("is_hidden", [True, False])
def test_a_wall_that_bends_behind_something_goes_on_and_an_opening_stays(is_hidden: bool) -> None:
    states = np.full((160, 160), Cell.UNKNOWN, dtype=np.int8)
    for column in range(20, 140):
        row = 80 + max(0, round((column - 80) * math.tan(math.radians(12))))
        is_gap = 65 <= column < 95
        states[20:row, column] = Cell.FREE
        states[row : row + 2, column] = Cell.OCCUPIED
        if is_gap:
            states[60 : row + 2, column] = Cell.UNKNOWN if is_hidden else Cell.FREE
    walls = building_of(OccupancyGrid(states=states, resolution=0.05)).walls
    points = np.array([(column * 0.05, 4.05 + max(0.0, (column - 80) * 0.05 * math.tan(math.radians(12)))) for column in range(25, 135)])
    assert (share_within(points, walls, 0.2) > 0.98) is is_hidden
