"""What to try when a step has lost its service, and how often."""

from __future__ import annotations

import pytest

from somrs.task_manager.recovery.ladder import MOST_REPLANS, RecoveryStep, Replans, next_recovery_step
from tests.unit.task_manager.execution.test_participants import OFFER


@pytest.mark.parametrize(
    ("alternatives", "possible", "outcome_known", "rung"),
    [
        (True, True, True, RecoveryStep.REPLACE),
        (False, True, True, RecoveryStep.REPLAN),
        (True, False, True, RecoveryStep.REPLAN),
        (True, True, False, RecoveryStep.REPLAN),
    ],
)
def test_the_cheapest_rung_that_can_help(alternatives: bool, possible: bool, outcome_known: bool, rung: RecoveryStep) -> None:
    assert next_recovery_step([OFFER] if alternatives else [], possible, outcome_known) is rung


def test_nothing_is_planned_anew_for_ever_without_anything_done() -> None:
    replans = Replans()
    replans.planned(5)
    for _ in range(MOST_REPLANS):
        assert not replans.is_exhausted
        replans.count()
    assert replans.is_exhausted
    assert str(replans) == "replanned 8 times without a completed step"
    replans.step_completed()
    assert not replans.is_exhausted


def test_nothing_is_planned_anew_for_ever_though_much_is_done() -> None:
    replans = Replans()
    for steps in (2, 3, 1):
        replans.planned(steps)
    for _ in range(MOST_REPLANS + 3):
        assert not replans.is_exhausted
        replans.count()
        replans.step_completed()
    assert replans.is_exhausted
    assert str(replans) == "replanned 11 times"
