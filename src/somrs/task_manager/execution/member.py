"""The participants of a transaction, as the coordinator sees them."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct, field

from somrs.protocol.frp.coordinator_session import CoordinatorSession
from somrs.protocol.frp.states import CONTRACTED, HOLDING_STATES, WORKING
from somrs.protocol.messages import frp
from somrs.protocol.messages.directory import Offer
from somrs.protocol.messages.frp import State
from somrs.task_manager.execution.bids import Bid

INTERRUPTED = (State.FAILED, State.STOPPED, State.UNREACHABLE)
"""The states of work that was begun and not completed."""


class Member(Struct, kw_only=True, eq=False):
    """A participant. `step` is the key of the step that it is asked for, `label` the name of that step for people."""

    id: str
    session: CoordinatorSession
    offer: Offer
    label: str
    step: str
    number: int = 0
    """Counts the participants of the transaction, in the order in which they were invited."""
    bid: Bid | None = None
    fraction: float = 0.0
    note: str = ""
    last_heard_time: float = field(default=0.0, name="heard_at")
    queried: bool = False
    last_order: frp.Execute | frp.Compensate | None = field(default=None, name="told")
    """The last order that the participant received."""
    last_order_time: float = 0.0
    """When it was last told to work or to compensate, in seconds since 1970."""
    last_news_time: float = 0.0
    """Since when the latest situation that it reported held, in seconds since 1970. What it did later is not known."""
    begins_by: float = 0.0
    """Until when it may begin the last order; 0 once its state has moved."""
    exit_reason: str = field(default="", name="last_word")
    lost_version: int | None = field(default=None, name="lost_at")
    """The version of the map when it was given up."""
    reported: bool = False
    """It has reported how its work ended."""
    reporting: bool = False
    """Its report is not on the map yet."""
    interruption: str | None = None
    """Why it was stopped through no fault of its own: what had to hold does not hold any more."""
    halting: bool = False
    """It received End during compensation, and its device may still be moving."""
    final_state: State | None = field(default=None, name="left_in")
    """Its state when the transaction ended."""
    change_number: int = field(default=0, name="changed")
    """The number of the last change of its contract, among all changes in the transaction."""

    @property
    def state(self) -> State:
        return self.session.state

    @property
    def is_awaited(self) -> bool:
        """Whether it has not reported how its work, or its compensation, ended. It may have been given up."""
        was_undoing = self.state is State.STRANDED and self.lost_version is not None and not self.reported
        return self.state in CONTRACTED or was_undoing

    @property
    def refusal(self) -> frp.Refuse | None:
        """Its refusal to do the step."""
        return self.session.refusal

    @property
    def tried_to_undo(self) -> bool:
        """Whether it tried to compensate and failed, so that the situation may have changed."""
        stranded = self.session.received_messages.get("Stranded")
        return stranded is not None and isinstance(stranded.body, frp.Stranded) and stranded.body.tried


class Members(Struct, kw_only=True):
    """The participants of a transaction, by id. `invited_count`: all that were invited; `change_count`: all changes of contracts."""

    by_id: dict[str, Member] = field(default_factory=dict)
    former: dict[str, Member] = field(default_factory=dict)
    """Those of an ended task that held the steps of its last plan."""
    invited_count: int = field(default=0, name="asked")
    change_count: int = field(default=0, name="changes")

    def __iter__(self) -> Iterator[Member]:
        return iter([*self.by_id.values()])

    def find_member(self, id: str | None) -> Member | None:
        return self.by_id.get(id or "")

    def is_interrupted(self, id: str | None) -> bool:
        """Whether the participant has reported that it was interrupted, so that it can be told to undo its work."""
        member = self.find_member(id)
        return member is not None and member.state in (State.FAILED, State.STOPPED)

    def is_awaited(self, id: str | None) -> bool:
        """Whether the participant has not reported how its work ended."""
        member = self.find_member(id)
        return member is not None and member.is_awaited

    def find_known_member(self, id: str | None) -> Member | None:
        """The participant with this id, or the former participant of an ended task."""
        return self.find_member(id) or self.former.get(id or "")

    def forget_uncommitted(self, first_number: int) -> None:
        """Drop the participants from this number on that left without a contract."""
        self.by_id = {
            id: member
            for id, member in self.by_id.items()
            if member.number < first_number or member.state is not State.ENDED or "Accept" in member.session.sent_messages
        }

    @property
    def working(self) -> list[Member]:
        """The participants whose devices may be moving."""
        return [member for member in self if member.state in WORKING or member.halting]

    def held(self, step: str) -> bool:
        """Whether a participant holds the step. This includes one that was given up, has returned, and is being stopped."""
        return any(member.step == step and member.state in HOLDING_STATES for member in self)

    def at_work(self, id: str) -> bool:
        """Whether the participant's device carries out its order, or its report is not on the map yet."""
        member = self.by_id.get(id)
        return member is not None and (member.state in WORKING or member.halting or member.reporting)
