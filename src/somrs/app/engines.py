"""Fast Downward (https://www.fast-downward.org) as a process of its own, for tasks that need more than a moment's search.

It is under the GPL: it is called, never imported, and everything but hard planning works without it.
"""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from somrs.app.numbers import there, tyr
from somrs.errors import RemoteError, UsageError
from somrs.planner.plan import NoPlan, Plan
from somrs.planner.planning import plan
from somrs.planner.problem import Problem

UNSOLVABLE = {11, 12}
"""Fast Downward's exit codes for: proved unsolvable; searched through without finding a solution. 12 comes from incomplete
searches too, but the one used here is complete."""
OUT_OF_TIME = {23, 256 - signal.SIGXCPU}
"""Its own exit code, and what its driver makes of the signal that ends a process at its limit."""
GRACE = 5.0
"""Seconds on top of the limit for the process to start and to write its answer."""


def plan_in_process(problem: object) -> Plan | NoPlan:
    """Carry out a Task Manager's Ask for a plan. To be called in a process that can be waited for."""
    if not isinstance(problem, Problem):
        raise TypeError(f"a planning problem was expected, not {type(problem).__name__}")
    return plan(problem, fast_downward if driver() is not None else None, numeric=tyr if there() else None)


def driver() -> Path | None:
    """Fast Downward's driver, if the `planner` extra is installed."""
    found = importlib.util.find_spec("up_fast_downward")  # looks for the package without running it
    if found is None or found.origin is None:
        return None
    path = Path(found.origin).parent / "downward" / "fast-downward.py"
    return path if path.exists() else None


def fast_downward(task: str, seconds: float) -> list[str] | None:
    """The names of the operators of a plan; None when there is no plan. Raises RemoteError when there is no answer in time."""
    path = driver()
    if path is None:
        raise UsageError("planning tasks of many steps needs Fast Downward: pip install 'somrs[planner]'")
    with tempfile.TemporaryDirectory(prefix="somrs-plan-") as place:
        folder = Path(place)
        (folder / "output.sas").write_text(task, encoding="ascii")
        code, said = _run([sys.executable, str(path), *_arguments(seconds)], folder, seconds + GRACE)
        answer = folder / "sas_plan"
        if answer.exists():
            lines = answer.read_text(encoding="ascii").splitlines()
            return [line.strip("()") for line in lines if not line.startswith(";")]
    if code in UNSOLVABLE:
        return None
    if code in OUT_OF_TIME:
        raise RemoteError(f"no plan was found in {seconds:g} s, nor that there is none")
    raise RemoteError(f"Fast Downward ended with code {code}: {said[-500:]}")


def _arguments(seconds: float) -> list[str]:
    return ["--alias", "lama-first", "--plan-file", "sas_plan", "--overall-time-limit", f"{max(1, round(seconds))}s", "output.sas"]


def _run(command: list[str], folder: Path, seconds: float) -> tuple[int, str]:
    """Run it in a process group of its own, so that the search ends with the driver that started it."""
    with subprocess.Popen(
        command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as process:
        over = False
        try:
            said, _ = process.communicate(timeout=seconds)
            over = True
        except subprocess.TimeoutExpired:
            return 256 - signal.SIGXCPU, ""
        finally:
            if not over:
                os.killpg(process.pid, signal.SIGKILL)
    return process.returncode, said
