"""Scenario 4, played by a whole system: a lift breaks while a robot is in it, and everything is delivered nevertheless."""

from __future__ import annotations

import asyncio
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from PIL import Image
from rich.console import Console

from somrs.demo import hotel
from somrs.demo.scenarios import play
from tests.support import warm

pytestmark = pytest.mark.long


def test_robots_deliver_across_storeys_although_a_lift_breaks_half_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hotel, "SPEED", "60")
    monkeypatch.setattr(hotel, "INTERVAL", 100.0)  # a film of few frames: those with a new caption, and hardly any other
    console, folder = Console(file=(tmp_path / "said.txt").open("w"), width=150), tmp_path / "out"
    code = asyncio.run(play("4", folder, None, console, launcher=warm.launcher()))
    output = (tmp_path / "said.txt").read_text()
    assert code == 0, output
    assert "NO" not in output.split("Checks")[1]
    ET.parse(folder / "messages.svg")
    assert "breaks half-way" in (folder / "timeline.svg").read_text()
    if "no pictures" not in output:
        assert sorted(picture.stem for picture in folder.glob("?.png")) == ["A", "B", "C", "D", "E", "F"]
        with Image.open(folder / "film.webp") as film:
            assert getattr(film, "n_frames", 1) >= 7
