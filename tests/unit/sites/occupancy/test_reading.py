"""Occupancy maps as files: the modes and fields of ROS' map_server, and files that are none."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from somrs.errors import InputError
from somrs.sites import importer_of
from somrs.sites.occupancy import is_occupancy_map
from somrs.sites.occupancy.grid import Cell
from somrs.sites.occupancy.reading import read_grid

U, F, X = Cell.UNKNOWN, Cell.FREE, Cell.OCCUPIED
SHADES = np.array([[0, 205, 254], [80, 100, 240]], dtype=np.uint8)


def write(folder: Path, description: str, shades: np.ndarray = SHADES, name: str = "floor.pgm") -> Path:
    Image.fromarray(shades).save(folder / name)
    path = folder / "map.yaml"
    path.write_text(f"image: {name}\nresolution: 0.05\n{description}\n", "utf-8")
    return path


@pytest.mark.parametrize(
    ("description", "upper", "lower"),
    [
        ("origin: [0, 0, 0]", [X, U, F], [X, U, F]),
        ("mode: trinary\nnegate: 1", [F, X, X], [U, U, X]),
        ("occupied_thresh: 0.5\nfree_thresh: 0.25", [X, U, F], [X, X, F]),
        ("mode: scale\noccupied_thresh: 0.9", [X, U, F], [U, U, F]),
        ("mode: raw", [F, U, U], [X, X, U]),
    ],
)
def test_the_first_row_of_the_image_is_the_last_one_of_the_grid(
    tmp_path: Path, description: str, upper: list[Cell], lower: list[Cell]
) -> None:
    assert read_grid(write(tmp_path, description)).states.tolist() == [lower, upper]


def test_transparent_pixels_are_unknown_in_the_mode_scale(tmp_path: Path) -> None:
    shades = np.array([[[255, 255, 255, 255], [255, 255, 255, 0], [0, 0, 0, 255]]], dtype=np.uint8)
    path = write(tmp_path, "mode: scale", shades, "floor.png")
    assert read_grid(path).states.tolist() == [[F, U, X]]


def test_the_origin_is_the_pose_of_the_lower_left_corner(tmp_path: Path) -> None:
    grid = read_grid(write(tmp_path, f"origin: [1.0, -2.0, {math.pi / 2}]"))
    assert grid.to_map([(0.1, 0.0)]).tolist() == [pytest.approx([1.0, -1.9])]
    assert grid.to_local(grid.to_map([(0.3, 0.7)])).tolist() == [pytest.approx([0.3, 0.7])]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("image: floor.pgm", "resolution"),
        ("image: floor.pgm\nresolution: 0", "resolution"),
        ("image: floor.pgm\nresolution: .inf", "finite"),
        ("image: floor.pgm\nresolution: 0.05\norigin: [1]", "origin"),
        ("image: floor.pgm\nresolution: 0.05\nmode: colour", "colour"),
        ("image: floor.pgm\nresolution: 0.05\nfree_thresh: 0.9", "free_thresh"),
        ("image: other.pgm\nresolution: 0.05", "other.pgm"),
        ("image: map.yaml\nresolution: 0.05", "PGM or PNG"),
        ("{image", "map_saver"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, text: str, problem: str) -> None:
    path = write(tmp_path, "")
    path.write_text(text, "utf-8")
    with pytest.raises(InputError, match=problem):
        read_grid(path)


def test_an_occupancy_map_is_recognised_by_what_is_in_it(tmp_path: Path) -> None:
    path = write(tmp_path, "")
    assert is_occupancy_map(path)
    assert importer_of(path) is not None
    site = tmp_path / "site.yaml"
    site.write_text("map: Hall\nobjects: {Hall: {type: Building}}\n", "utf-8")
    assert not is_occupancy_map(site)
    assert importer_of(site) is None
    assert not is_occupancy_map(tmp_path / "missing.yaml")
