"""Plans judged by others: unified-planning's validator, and VAL where it is found on the machine."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import warnings
from pathlib import Path

VAL = ("Validate", "validate", "VAL")
"""What VAL's program is called, by how it was built."""
VAL_TIME = 60.0
"""Seconds that it may take."""


def objections(domain: str, problem: str, plan: str) -> list[str]:
    """What is wrong with a plan for the problem, as others see it; empty when they all accept it. All three are PDDL."""
    with tempfile.TemporaryDirectory(prefix="somrs-codmap-") as place:
        folder = Path(place)
        files = [folder / name for name in ("domain.pddl", "problem.pddl", "plan.txt")]
        for file, text in zip(files, (domain, problem, plan), strict=True):
            file.write_text(text, encoding="utf-8")
        return [*_unified_planning(*files), *_val(*files)]


def _unified_planning(domain: Path, problem: Path, plan: Path) -> list[str]:
    from unified_planning.engines import SequentialPlanValidator, ValidationResultStatus
    from unified_planning.environment import get_environment
    from unified_planning.io import PDDLReader

    get_environment().error_used_name = False  # an object may be called as its type is; its grounder knows this environment only
    reader = PDDLReader()
    with warnings.catch_warnings(action="ignore"):
        read = reader.parse_problem(str(domain), str(problem))
    validator = SequentialPlanValidator()
    validator.skip_checks = True  # it minds static functions in costs, and can do them
    found = validator.validate(read, reader.parse_plan(read, str(plan)))
    return [] if found.status is ValidationResultStatus.VALID else [f"unified-planning: {found.reason or found.status}"]


def _val(domain: Path, problem: Path, plan: Path) -> list[str]:
    program = next((path for name in VAL if (path := shutil.which(name))), None)
    if program is None:
        return []
    said = subprocess.run([program, domain, problem, plan], capture_output=True, text=True, timeout=VAL_TIME, check=False)
    return [] if "Plan valid" in said.stdout else [f"VAL: {said.stdout.strip()[-300:]}"]
