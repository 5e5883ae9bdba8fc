"""Scenario 5, played by two whole systems on three hosts: one of the hosts is lost for good, and every task ends as wanted."""

from __future__ import annotations

import asyncio
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from rich.console import Console

from somrs.demo import organisations
from somrs.demo.scenarios import play
from tests.support import warm


@pytest.mark.slow
def test_every_task_of_two_organisations_ends_as_wanted_although_a_host_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(organisations, "SPEED", "6")
    console, folder = Console(file=(tmp_path / "said.txt").open("w"), width=150), tmp_path / "out"
    code = asyncio.run(play("5", folder, None, console, launcher=warm.launcher()))
    output = (tmp_path / "said.txt").read_text()
    assert code == 0, output
    assert "NO" not in output.split("Checks")[1]
    ET.parse(folder / "messages.svg")
    assert "is lost for good" in (folder / "timeline.svg").read_text()
    assert "goes on as the task-manager of the bakery" in output
    if "no pictures" not in output:
        assert sorted(picture.stem for picture in folder.glob("?.png")) == ["A", "B", "C"]
