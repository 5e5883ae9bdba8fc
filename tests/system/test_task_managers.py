"""`somrs up --task-managers 2`: tasks stated at none in particular are spread, and go on when a Task Manager is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from somrs.client.addresses import Addresses
from tests.support import warm
from tests.support.command import somrs
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1
from tests.support.signed_in import authorization

pytestmark = pytest.mark.long


@contextmanager
def up(data: Path, *options: str) -> Iterator[Callable[[], str]]:
    """Run a system, and yield a function that returns its output."""
    log = data.parent / "output.txt"
    arguments = ["up", str(SCENARIO_1), "--data", str(data), "--world", "kinematic", "--speed", "8", *options]
    program = warm.Program(arguments, log)

    def output() -> str:
        return log.read_text(errors="replace")

    try:
        wait_until(lambda: "Running." in output() or program.ended, output)
        yield output
    finally:
        program.send_signal(signal.SIGTERM)
        program.wait()


def wait_until(condition: Callable[[], bool], output: Callable[[], str]) -> None:
    end = time.monotonic() + HANG_TIME
    while not condition():
        assert time.monotonic() < end, output()
        time.sleep(0.1)


def call(data: Path, path: str, body: object = None) -> Any:
    content = json.dumps(body).encode() if body is not None else None
    headers = {"Content-Type": "application/json"} | authorization(data)
    request = urllib.request.Request(f"{Addresses.read(data).api}{path}", content, headers)
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def kill_task_manager(data: Path, number: int) -> None:
    pattern = f"run task-manager .*--number {number} .*--data {data}"
    processes = subprocess.run(["pgrep", "-f", pattern], capture_output=True, text=True, check=True)
    for id in processes.stdout.split():
        os.kill(int(id), signal.SIGKILL)


def test_tasks_of_two_task_managers_are_done_though_one_is_killed(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with up(data, "--task-managers", "2") as output:
        tasks = [call(data, "/tasks", {"effect": f"{jar} isOn Platform001"})["task"] for jar in ("Jar002", "Jar003")]
        owners = {row["task"]: row["task_manager"] for row in call(data, "/tasks")["rows"]}
        assert sorted(owners.values()) == ["TaskManager1", "TaskManager2"]
        (second,) = (task for task, owner in owners.items() if owner == "TaskManager2")
        wait_until(lambda: call(data, f"/tasks/{second}")["view"]["phase"] in ("executing", "ended"), output)
        kill_task_manager(data, 2)
        wait_until(lambda: "task-manager-2 is back" in output(), output)
        for task in tasks:
            wait_until(lambda task=task: call(data, f"/tasks/{task}")["view"]["phase"] == "ended", output)  # type: ignore[misc]
            assert call(data, f"/tasks/{task}")["view"]["outcome"] == "accomplished"
        submitted = somrs("do", "Jar002 isOn Table001", "--no-wait", "--data", data)
        assert submitted.returncode == 0, submitted.stderr
        assert somrs("cancel", submitted.stdout.strip(), "--data", data).returncode == 0
        wait_until(lambda: call(data, f"/tasks/{submitted.stdout.strip()}")["view"]["phase"] == "ended", output)
        listed = somrs("tasks", "--history", "--data", data).stdout
        assert "TaskManager1" in listed
        assert "TaskManager2" in listed
        assert len(somrs("export", "--data", data).stdout.splitlines()) == 3
    assert len(somrs("export", "--data", data).stdout.splitlines()) == 3, "also of the system that is stopped"
