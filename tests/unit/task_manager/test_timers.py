"""Timers and questions are values that are read back as what they were."""

from __future__ import annotations

import pytest
from msgspec import Struct

from somrs.kernel.codec import Codec, encode
from somrs.kernel.replica import ReplicaDue
from somrs.task_manager.requests import ForLook, ForPlan, ForReport, RequestPurpose
from somrs.task_manager.timers import (
    AnswerDue,
    BidsDue,
    DeadlineDue,
    MapDue,
    NewsDue,
    OverdueDue,
    PlanWanted,
    PreviewDue,
    Question,
    RecordsWanted,
    SilenceDue,
    StopDue,
    Timer,
)


class StoredState(Struct):
    timer: Timer
    question: Question
    purpose: RequestPurpose


TIMERS: list[Timer] = [BidsDue("t", 1), SilenceDue("t", "p"), OverdueDue("t", "p"), DeadlineDue("t"), StopDue("t"), PreviewDue("t")]
REQUEST_TIMERS: list[Timer] = [AnswerDue("r"), MapDue("r"), NewsDue("r"), ReplicaDue()]
QUESTIONS: list[Question] = [PlanWanted("t", 1, 2, 3), RecordsWanted("r")]
PURPOSES: list[RequestPurpose] = [ForPlan("t", 1, 2), ForLook("t", 3), ForReport("t")]


@pytest.mark.parametrize(
    "stored",
    [
        *(StoredState(timer, QUESTIONS[0], PURPOSES[0]) for timer in (*TIMERS, *REQUEST_TIMERS)),
        StoredState(TIMERS[0], QUESTIONS[1], PURPOSES[1]),
        StoredState(TIMERS[0], QUESTIONS[1], PURPOSES[2]),
    ],
)
def test_what_is_kept_is_read_back(stored: StoredState) -> None:
    assert Codec[StoredState](StoredState).decode(encode(stored)) == stored
