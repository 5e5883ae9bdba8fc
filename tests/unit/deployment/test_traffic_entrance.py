"""The file with the places of robots that are not simulated."""

from __future__ import annotations

from pathlib import Path

import pytest

from somrs.deployment.traffic_entrance import ForeignPositions
from somrs.errors import SimulationError
from somrs.traffic.state import Position

POSITIONS = {"Cart1": (Position(x=1.0, y=2.0, level=4.0, radius=0.3, zone="Lift1"), Position(x=2.0, y=2.0, level=4.0, radius=0.3))}


def test_places_are_read_as_they_were_kept(tmp_path: Path) -> None:
    file = ForeignPositions(tmp_path / "foreign-robots.json")
    assert file.read() == {}
    file.store(POSITIONS)
    assert ForeignPositions(tmp_path / "foreign-robots.json").read() == POSITIONS


def test_places_that_cannot_be_kept_end_the_simulation_with_the_reason(tmp_path: Path) -> None:
    file = ForeignPositions(tmp_path / "gone" / "foreign-robots.json")
    with pytest.raises(SimulationError, match=r"foreign-robots.json: the places of robots in traffic cannot be kept: No such file"):
        file.store(POSITIONS)
