"""What a pursuit needs of the transaction that it belongs to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from somrs.protocol.messages.clients import EventKind, Submit
from somrs.task_manager.offered import Offered
from somrs.task_manager.participants import Participants
from somrs.task_manager.setting import Setting
from somrs.task_manager.work import Ledger
from somrs.task_manager.workflow import StepRun

if TYPE_CHECKING:
    from somrs.task_manager.pursuit import Pursuit


class Owner(Protocol):
    """The transaction that a pursuit belongs to."""

    id: str
    task: Submit
    submitted_at: float
    setting: Setting
    participants: Participants
    offered: Offered
    ledger: Ledger

    @property
    def latest(self) -> float | None:
        """When all has to be done."""

    def tell(self, now: float, text: str, run: StepRun | None = None, kind: EventKind = EventKind.NEWS) -> None: ...

    def proceed(self, now: float) -> None:
        """Do whatever comes next, in this pursuit or another."""

    def reached(self, pursuit: Pursuit, now: float) -> None: ...

    def failed(self, pursuit: Pursuit, why: str, now: float) -> None: ...

    def handled(self, run: StepRun, now: float) -> bool:
        """A step failed: whether a procedure that was laid down for that is begun. The step is recovered after it."""

    def unblocked(self, pursuit: Pursuit, why: str, now: float) -> bool:
        """There is no plan: whether what failures left is being undone. `again` is called after it, or it has failed."""
