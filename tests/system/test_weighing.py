"""The tutorial docs/tutorials/weigh-before-carrying.md, with the files that it is about."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.command import CommandResult, program
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT

SERVICES = ("Scale001.WeighParcel", "ShelfProgram001.PickShelf", "Porter001.CarryParcel", "Porter002.CarryParcel")


@pytest.fixture
def data(tmp_path: Path) -> Iterator[Path]:
    """The data folder of the running site, whose devices have all joined."""
    folder = tmp_path / "run"
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "examples")}
    command = [sys.executable, "-m", "somrs.cli.main", "up", str(ROOT / "examples" / "weighing.yaml"), "--data", str(folder)]
    with (tmp_path / "up.log").open("wb") as log:
        system = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
    try:
        deadline = time.monotonic() + HANG_TIME
        while "Running." not in (tmp_path / "up.log").read_text():
            assert system.poll() is None, (tmp_path / "up.log").read_text()
            assert time.monotonic() < deadline, (tmp_path / "up.log").read_text()
            time.sleep(0.1)
        assert all(name in program("services", "--json", "--data", folder).stdout for name in SERVICES)
        yield folder
    finally:
        system.send_signal(signal.SIGINT)
        system.wait(HANG_TIME)


@pytest.mark.slow
def test_the_tutorial(data: Path) -> None:
    def run(command: str, formula: str) -> CommandResult:
        return program(command, formula, "--data", data)

    tutorial = (ROOT / "docs" / "tutorials" / "weigh-before-carrying.md").read_text()
    (goal,) = re.findall(r'somrs plan "(.+)"', tutorial)
    plan = run("plan", goal).stdout
    assert plan.index("WeighParcel") < plan.index("CarryParcel")
    first, second = (run("do", goal) for goal in re.findall(r'^somrs do "(.+)"', tutorial, re.MULTILINE))
    assert "Scale001.WeighParcel found out: Parcel001.Weight = 1.2" in " ".join(first.stdout.split())
    assert "Porter001.CarryParcel completed: Parcel001 isOn Shelf002" in " ".join(first.stdout.split())
    assert "Porter002.CarryParcel completed: Parcel002 isOn Shelf003" in " ".join(second.stdout.split()), "2 kg are too little"
    assert (first.returncode, second.returncode) == (0, 0)
    assert "WeighParcel" not in run("plan", "Parcel003 isOn Shelf002").stdout, "it was weighed before"
    (question,) = re.findall(r'somrs look "(.+?)"', tutorial)
    answer = run("look", question)
    assert answer.returncode == 1
    assert "nobody can look now" in " ".join(answer.stdout.split())
    assert "Parcel001.Weight = 1.2 kg" in answer.stdout
