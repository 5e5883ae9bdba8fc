"""Errors as the API sends them: whoever asks gets the same again."""

from __future__ import annotations

import msgspec
import pytest

from somrs.client.refusals import Changed, ErrorReport, NotFound, Refused, error_report, refusal, status
from somrs.errors import FormulaError, InputError, ModelError, Problem, RemoteError, SomrsError, UsageError
from somrs.protocol.messages.knowledge import BrokenRule, Rejected
from somrs.runtime.wire import Unanswered

BROKEN = BrokenRule(section="objects", subject="Jar001", rule="weight", message="it is too heavy")
PROBLEM = Problem(file="a.yaml", line=3, subject="Jar", rule="types", message="there is no type Pot")


@pytest.mark.parametrize(
    "error",
    [
        FormulaError("Jar001 isOn\n  Nothing", 14, "there is no Nothing", "did you mean Table001?"),
        UsageError("that time is in the past; give a time in the future"),
        NotFound("there is no order 7"),
        ModelError([PROBLEM, Problem(file="b.yaml", line=None, subject="Box", rule="size", message="it has none")]),
        Refused(Rejected(problems=("Jar001: it is too heavy", "and so is Jar002"), broken=(BROKEN,))),
        Changed("somebody else changed it"),
        RemoteError("the Task Manager cannot"),
        Unanswered("nobody is there"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_comes_as_it_was_raised(error: SomrsError) -> None:
    encoded_report = msgspec.json.encode(error_report(error))
    restored_error = refusal(status(error), msgspec.json.decode(encoded_report, type=ErrorReport))
    assert type(restored_error) is type(error)
    assert str(restored_error) == str(error)
    assert error_report(restored_error) == error_report(error), "with all that is known of it"


def test_what_is_not_known_here_keeps_its_sort() -> None:
    class Odd(InputError):
        """Of a later version."""

    assert type(refusal(status(Odd("x")), error_report(Odd("x")))) is UsageError
    assert type(refusal(418, ErrorReport(problem="x"))) is RemoteError
