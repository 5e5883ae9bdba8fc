"""Waiting until the program of a person has accepted what the person entered: a reply to an assignment, or the answer to a question."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from somrs.devices.person.assignments import Assignment
from somrs.devices.person.questions import Question
from somrs.errors import RemoteError, UsageError

PATIENCE = 10.0
"""Seconds within which the program of a person processes a reply, if it runs."""

T = TypeVar("T", Assignment, Question)


def wait_until_accepted(read: Callable[[], T | None], is_accepted: Callable[[T], bool], *, reply: str, still_open: str) -> None:
    """Wait until what `read` returns is accepted. `reply` names what was entered; `still_open` says how to enter it again.

    Raises:
        UsageError: the reply is unsuitable or too late.
        RemoteError: the program of the person did not process it within `PATIENCE`.
    """
    end, person = time.monotonic() + PATIENCE, ""
    while time.monotonic() < end:
        request = read()
        assert request is not None, "assignments and questions are not deleted"
        person = request.person
        if is_accepted(request):
            return
        if request.ended is not None:
            raise UsageError(f"the {reply} came too late: {request.ended}")
        if request.problem:
            raise UsageError(f"{request.problem}\n{still_open}")
        time.sleep(0.1)
    raise RemoteError(f"the {reply} was not accepted within {PATIENCE:.0f} s; is the program of {person} running?")
