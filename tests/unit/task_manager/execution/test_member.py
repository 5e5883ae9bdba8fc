"""One participant as the coordinator sees it."""

from __future__ import annotations

import pytest

from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import FrpBody
from somrs.protocol.messages.frp import State
from tests.unit.task_manager.execution.test_participants import OFFER, TransactionHarness


def test_of_one_that_was_not_asked_nothing_is_known() -> None:
    member = TransactionHarness().participants.make_member(OFFER, "step1", "1.1/step1")
    assert (member.state, member.bid, member.last_order, member.lost_version, member.final_state) == (State.NEW, None, None, None, None)
    assert (member.fraction, member.last_heard_time, member.begins_by, member.change_number) == (0.0, 0.0, 0.0, 0)
    assert (member.note, member.exit_reason) == ("", "")
    assert (member.queried, member.reported, member.reporting, member.halting, member.tried_to_undo) == (False,) * 5


@pytest.mark.parametrize(
    ("body", "tried_to_undo"),
    [
        (frp.Stranded(description="stuck"), True),
        (frp.Stranded(description="stuck", tried=False), False),
        (frp.Compensated(situation="Jar1.Clean = FALSE"), False),
    ],
)
def test_things_may_be_another_way_when_it_tried_to_undo_its_work_in_vain(body: FrpBody, tried_to_undo: bool) -> None:
    transaction = TransactionHarness()
    member = transaction.in_state(State.COMPENSATING)
    transaction.member_says(member, body, 200.0)
    assert member.tried_to_undo is tried_to_undo
