"""The result of one problem."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(kw_only=True)
class Result:
    """The result of one problem. `trouble` is the reason why it did not pass, or empty. Times are seconds of wall-clock time; `makespan` is
    the duration of the execution in steps."""

    domain: str
    problem: str
    agents: int = 0
    importing: float = 0.0
    planning: float = 0.0
    """Until the first plan, from the start of the import."""
    coordinating: float = 0.0
    """Everything else: arrangement, execution, recovery."""
    steps: int | None = None
    """Of the first plan; None if there is none."""
    cost: float | None = None
    makespan: float | None = None
    mishaps: int = 0
    leaver: str | None = None
    plans: int = 0
    messages: int = 0
    accomplished: bool = False
    out_of_reach: bool = False
    """There is no plan from the final state of the world: the faults put the goal out of reach."""
    trouble: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        return f"{self.domain}/{self.problem}"
