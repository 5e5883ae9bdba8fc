"""What a person reads of a message, in one line."""

from __future__ import annotations

from somrs.client.message_chart import describe_message
from somrs.client.trace import Line


def message(type: str, **body: object) -> Line:
    return Line(
        at=0.0,
        sender="Task Manager",
        recipient="Robot1",
        type=type,
        transaction="task-1",
        participant="p",
        message_id="m",
        relates_to=None,
        body=body,
    )


def test_an_arrange_shows_what_is_asked_for_and_then_its_condition() -> None:
    arrange = message("Arrange", effect="Jar002 isOn Table2", precondition="Jar002 isOn Table1")
    assert describe_message(arrange) == "Jar002 isOn Table2 when Jar002 isOn Table1"
    assert describe_message(message("Arrange", effect="Jar002 isOn Table2")) == "Jar002 isOn Table2"


def test_an_execute_shows_its_present_situation_as_such() -> None:
    assert describe_message(message("Execute", precondition="Jar002 isOn Table1")) == "when Jar002 isOn Table1"
