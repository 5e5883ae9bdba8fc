"""A program that writes to a disk until it is killed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.support.paths import ROOT


def run_until_killed(program: str, path: Path, count: int) -> int:
    """Run the program, which prints a line for each thing that it has written, and kill it after `count` lines. Return their number.

    Its arguments are the path and the folder of the project.
    """
    child = subprocess.Popen([sys.executable, "-c", program, str(path), str(ROOT)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    try:
        for _ in range(count):
            child.stdout.readline()
    finally:
        child.kill()
    rest = child.stdout.read().splitlines()
    child.stdout.close()
    child.wait()
    return count + len([line for line in rest if line])
