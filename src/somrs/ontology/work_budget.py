"""How much work the evaluation of a formula may take. Formulas come from others, and a short one can take years to evaluate."""

from __future__ import annotations

from somrs.entish.formula import Formula
from somrs.entish.normal_form import affirmed_variables
from somrs.errors import FormulaError

MOST_WORK = 400_000
"""The work that one evaluation may take, in steps: a binding that is extended, or an atom that is tested. A step takes microseconds."""


class ExcessiveWork(FormulaError):
    """The evaluation of a formula takes more work than it may."""


class WorkBudget:
    """The work that evaluations may still take together, in steps: no time, so that the same formula is refused on every machine,
    however busy."""

    def __init__(self, limit: int = MOST_WORK) -> None:
        self.limit = self.remaining = limit

    def spend(self, formula: Formula, steps: int = 1) -> None:
        """Count steps of the evaluation of a formula. Raises ExcessiveWork when there are more than may be."""
        self.remaining -= steps
        if self.remaining < 0:
            open_variables = [f"?{name}" for name in affirmed_variables(formula)]
            of_what = f", for {', '.join(open_variables)}" if open_variables else ""
            raise ExcessiveWork(
                str(formula),
                0,
                f"this formula takes more than {self.limit} steps on this map: too many objects would have to be tried{of_what}",
                "name objects or types in place of variables for any object (?x: Jar), add conditions, or ask with fewer variables",
            )
