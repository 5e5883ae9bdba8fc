"""Standing orders: tasks that are stated again and again by themselves, and what came of each time."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.frp import Outcome
from somrs.scheduling.recurrence import When


class RunState(StrEnum):
    """What became of one time at which an order was due."""

    SUBMITTING = "submitting"
    """Its task is being stated; the Task Manager may not be there."""
    SUBMITTED = "submitted"
    """Its task runs, or is over: then there is an outcome."""
    SKIPPED = "skipped"
    """The task before still ran."""
    MISSED = "missed"
    """Nobody was there to state it; it is not made up for."""
    REFUSED = "refused"
    """It could not be stated; `note` says why."""


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """One time at which an order was due. `times`: of those that were missed, so many are told of here together, and this was the last."""

    due: float
    state: RunState
    at: float
    task: str | None = None
    outcome: Outcome | None = None
    ended_at: float | None = None
    note: str = ""
    times: int = 1

    @property
    def open(self) -> bool:
        """Whether its task may be under way."""
        return self.state in (RunState.SUBMITTING, RunState.SUBMITTED) and self.ended_at is None


class StandingOrder(msgspec.Struct, frozen=True, kw_only=True):
    """A task that is stated whenever it is due: its own, or a template's, with the blanks filled in. `next`: when it is due next (None:
    never again, or it is paused). `version` counts its changes, not its runs."""

    id: str
    name: str
    when: When
    task: Submit | None = None
    template: str | None = None
    values: dict[str, str] = {}
    enabled: bool = True
    skip: bool = True
    """If the task before still runs, this time is skipped; otherwise both run."""
    next: float | None = None
    last: Run | None = None
    version: int = 0
    changed_at: float = 0.0
    """Times that were before this do not count."""
    changed_by: str = ""


class StandingOrders(msgspec.Struct, frozen=True, kw_only=True):
    orders: tuple[StandingOrder, ...]


class OrderSaved(msgspec.Struct, frozen=True, kw_only=True):
    """A standing order as it is to be: with a `task`, or a `template` and its `values`. `expected_version`: see templates."""

    name: str
    when: When
    task: Submit | None = None
    template: str | None = None
    values: dict[str, str] = {}
    enabled: bool = True
    skip: bool = True
    by: str = ""
    expected_version: int | None = None


class Runs(msgspec.Struct, frozen=True, kw_only=True):
    """The times at which an order was due, the latest first."""

    runs: tuple[Run, ...]
