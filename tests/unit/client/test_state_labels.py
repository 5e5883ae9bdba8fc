"""One vocabulary for the priorities of tasks."""

from __future__ import annotations

import pytest

from somrs.client.state_labels import PRIORITIES, parse_priority, priority_text
from somrs.errors import UsageError


@pytest.mark.parametrize(
    ("priority", "text"), [(-1, "Low"), (0, "Normal"), (1, "High"), (2, "Urgent"), (7, "Urgent (7)"), (-1000, "Low (-1000)")]
)
def test_every_priority_has_a_name(priority: int, text: str) -> None:
    assert priority_text(priority) == text


def test_what_is_shown_can_be_written() -> None:
    assert {parse_priority(priority_text(priority).lower()): priority for priority in PRIORITIES} == {p: p for p in PRIORITIES}
    assert parse_priority(" -7") == -7
    with pytest.raises(UsageError, match="'hi' is not a priority; write low, normal, high, urgent, or a whole number"):
        parse_priority("hi")
