"""One participant of a transaction, as the coordinator sees it."""

from __future__ import annotations

from msgspec import Struct

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
    heard_at: float = 0.0
    queried: bool = False
    told: frp.Execute | frp.Compensate | None = None
    """What it was told last to begin."""
    begins_by: float = 0.0
    """Until when it may begin with that, while it has not been heard to."""
    last_word: str = ""
    lost_at: int | None = None
    """The version of the map when it was given up."""
    reported: bool = False
    """It said how its work ended."""
    reporting: bool = False
    """What it said is on its way to the map."""
    halting: bool = False
    """It was sent home while it undid its work, and may be moving still."""
    left_in: State | None = None
    """Where it was when the transaction ended."""
    changed: int = 0
    """The number of the last change of its contract, among all in the transaction."""

    @property
    def state(self) -> State:
        return self.session.state

    @property
    def tried_to_undo(self) -> bool:
        """Whether things may be another way than before it was told to undo its work, which it could not."""
        said = self.session.received_messages.get("Stranded")
        return said is not None and isinstance(said.body, frp.Stranded) and said.body.tried
