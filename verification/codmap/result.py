"""What came of one problem."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(kw_only=True)
class Result:
    """`trouble` says why it did not pass; empty when it did. Times are seconds of the wall's clock, but `makespan`, which is in steps:
    how many steps' time the execution took."""

    domain: str
    problem: str
    agents: int = 0
    importing: float = 0.0
    planning: float = 0.0
    """From the files to the first plan."""
    coordinating: float = 0.0
    """Everything else: arrangement, execution, recovery."""
    steps: int | None = None
    """Of the first plan; None: none was found."""
    cost: float | None = None
    makespan: float | None = None
    mishaps: int = 0
    leaver: str | None = None
    plans: int = 0
    messages: int = 0
    accomplished: bool = False
    out_of_reach: bool = False
    """What went wrong put the goal out of everyone's reach: from the world as it was left, there is no plan."""
    trouble: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        return f"{self.domain}/{self.problem}"
