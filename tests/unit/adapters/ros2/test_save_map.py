"""Maps of robots as files that other programs read."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import pytest

from somrs.adapters.ros2.save_map import map_files
from somrs.errors import InputError
from somrs.sites.occupancy.reading import read_grid

ORIGIN = {"position": {"x": -1.5, "y": 2.0, "z": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def _message(width: int, height: int, cells: bytes) -> dict[str, Any]:
    info = {"resolution": 0.05000000074505806, "width": width, "height": height, "origin": ORIGIN}
    return {"info": info, "data": base64.b64encode(cells).decode()}


def test_a_map_is_read_as_the_robot_has_it(tmp_path: Path) -> None:
    cells = bytes([0, 100, 255, 25, 65, 50])
    text, image = map_files(_message(3, 2, cells), "floor.pgm")
    (tmp_path / "floor.yaml").write_text(text)
    (tmp_path / "floor.pgm").write_bytes(image)
    grid = read_grid(tmp_path / "floor.yaml")
    assert grid.states.tolist() == [[0, 1, -1], [0, 1, -1]]
    assert (grid.resolution, grid.x, grid.y, grid.yaw) == (0.05, -1.5, 2.0, 0.0)


@pytest.mark.parametrize("message", [{}, {"info": {}, "data": ""}, _message(3, 2, b"\0"), _message(0, 0, b"")])
def test_what_is_no_map_is_refused(message: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        map_files(message, "floor.pgm")
