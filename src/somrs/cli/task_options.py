"""The options that state a task, and the task that they state. Options of all commands are in `options.py`."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from somrs.cli.options import UnavailableOption

if TYPE_CHECKING:
    from somrs.protocol.messages.submission import Submit


class PolicyOption(StrEnum):
    """How services are chosen."""

    price = "price"
    time = "time"
    weighted = "weighted"


Precondition = Annotated[str | None, typer.Option(help="A formula that has to hold initially.")]
PolicyWanted = Annotated[PolicyOption, typer.Option(help="How services are chosen.")]
TimeValue = Annotated[float, typer.Option(help="With --policy weighted: what a second is worth, in EUR.")]
Deadline = Annotated[float | None, typer.Option(help="Seconds, in the world's time, within which the task has to be accomplished.")]


TaskManagerName = Annotated[
    str | None, typer.Option("--task-manager", help="The name of the Task Manager that is to have it; by default, any of them takes it.")
]


def stated_task(
    formula: str,
    precondition: str | None,
    policy: PolicyOption,
    time_value: float,
    deadline: float | None,
    priority: int,
    unavailable: UnavailableOption,
) -> Submit:
    """Return the task with these options."""
    from somrs.protocol.messages.submission import Policy, Submit

    return Submit(
        effect=formula,
        precondition=precondition,
        policy=Policy(policy.value),
        time_value=time_value,
        deadline=deadline,
        priority=priority,
        waits=unavailable is UnavailableOption.wait,
    )
