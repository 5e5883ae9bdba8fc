"""`somrs up` without a terminal: it outlives whatever started it, and its log says why it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from somrs.deployment.programs import PARENT_CHECK
from tests.support.hang import HANG_TIME
from tests.support.paths import SCENARIO_1


def wait_until(condition: Callable[[], bool], output: Path) -> None:
    waited_until = time.monotonic() + HANG_TIME
    while not condition():
        assert time.monotonic() < waited_until, text(output)
        time.sleep(0.05)


def text(file: Path) -> str:
    """What is in a file, which a shell may not have created yet."""
    return file.read_text() if file.exists() else ""


def is_running(process_id: int) -> bool:
    try:
        state = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"  # ended, and nobody has asked how


def open_to_others(folder: Path) -> list[Path]:
    """The folder and what is in it, as far as other users may do anything with it."""
    return [file for file in (folder, *folder.rglob("*")) if not file.is_symlink() and file.stat().st_mode & 0o077]


def test_a_system_outlives_the_shell_that_started_it_and_logs_why_it_stops(tmp_path: Path) -> None:
    output, log = tmp_path / "output.txt", tmp_path / "data" / "logs" / "system.log"
    command = f"'{sys.executable}' -m somrs.cli.main up '{SCENARIO_1}' --data '{tmp_path / 'data'}' --speed max --world kinematic"
    script = f"nohup {command} > '{output}' 2>&1 & echo $!; read line"
    with subprocess.Popen(
        ["sh", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True, bufsize=1
    ) as shell:
        assert shell.stdout is not None
        system = int(shell.stdout.readline())
        try:
            wait_until(lambda: "Running." in text(output), output)
            assert open_to_others(tmp_path / "data") == []
            shell.communicate("\n")
            time.sleep(2 * PARENT_CHECK)
            assert is_running(system), text(output)
            os.kill(system, signal.SIGTERM)
            wait_until(lambda: not is_running(system), output)
            assert "the system stops: it received SIGTERM" in text(log)
            assert "the system stops: it received SIGTERM" in text(output)
        finally:
            if is_running(system):
                os.kill(system, signal.SIGKILL)


def test_a_system_in_the_background_of_a_script_stops_at_sigint(tmp_path: Path) -> None:
    """Shells let such programs ignore SIGINT, and so do their own programs."""
    output = tmp_path / "output.txt"
    command = f"'{sys.executable}' -m somrs.cli.main up '{SCENARIO_1}' --data '{tmp_path / 'data'}' --speed max --world kinematic"
    script = f"{command} > '{output}' 2>&1 & echo $!; wait"
    with subprocess.Popen(["sh", "-c", script], stdout=subprocess.PIPE, text=True, start_new_session=True, bufsize=1) as shell:
        assert shell.stdout is not None
        system = int(shell.stdout.readline())
        try:
            wait_until(lambda: "Services on offer" in text(output), output)  # it runs, and is about to say so
            os.kill(system, signal.SIGINT)
            wait_until(lambda: not is_running(system), output)
            assert "the system stops: it received SIGINT" in text(output)
        finally:
            if is_running(system):
                os.kill(system, signal.SIGKILL)
