"""One participant of a transaction, as the coordinator sees it."""

from __future__ import annotations

from msgspec import Struct, field

from somrs.protocol.frp.session import CoordinatorSession
from somrs.protocol.messages import frp
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import State
from somrs.task_manager.execution.bids import Bid


class Member(Struct, kw_only=True, eq=False):
    """`step` is the step that it is asked for, by its key; `label` what people call it."""

    id: str
    session: CoordinatorSession
    offer: Offer
    label: str
    step: str
    number: int = 0
    """In the order in which they were asked."""
    bid: Bid | None = None
    fraction: float = 0.0
    note: str = ""
    last_heard_time: float = field(default=0.0, name="heard_at")
    queried: bool = False
    last_order: frp.Execute | frp.Compensate | None = field(default=None, name="told")
    """What it was told last to begin."""
    begins_by: float = 0.0
    """Until when it may begin with that, while it has not been heard to."""
    exit_reason: str = field(default="", name="last_word")
    lost_version: int | None = field(default=None, name="lost_at")
    """The version of the map when it was given up."""
    reported: bool = False
    """It said how its work ended."""
    reporting: bool = False
    """What it said is on its way to the map."""
    halting: bool = False
    """It was sent home while it undid its work, and may be moving still."""
    final_state: State | None = field(default=None, name="left_in")
    """Where it was when the transaction ended."""
    change_number: int = field(default=0, name="changed")
    """The number of the last change of its contract, among all in the transaction."""

    @property
    def state(self) -> State:
        return self.session.state

    @property
    def tried_to_undo(self) -> bool:
        """Whether things may be another way than before it was told to undo its work, which it could not."""
        stranded = self.session.received_messages.get("Stranded")
        return stranded is not None and isinstance(stranded.body, frp.Stranded) and stranded.body.tried
