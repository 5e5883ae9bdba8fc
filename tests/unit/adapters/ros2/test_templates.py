"""Field paths and templates of messages."""

from __future__ import annotations

import pytest

from somrs.adapters.ros2.templates import MISSING, differences, field_value, fill_in, path_steps, placeholders

MESSAGE = {"status": [{"level": 2, "name": "motor"}], "pose": {"pose": {"x": 1.5}}}


def test_a_path_leads_to_a_field() -> None:
    assert field_value(MESSAGE, "status[0].level") == 2
    assert field_value(MESSAGE, "pose.pose.x") == 1.5
    assert field_value(MESSAGE, "") is MESSAGE


@pytest.mark.parametrize("path", ["status[1].level", "status.level", "pose[0]", "pose.pose.x.y", "nothing"])
def test_a_path_that_leads_nowhere_has_no_value(path: str) -> None:
    assert field_value(MESSAGE, path) is MISSING


@pytest.mark.parametrize("path", [".a", "a..b", "a[x]", "a b", "3a", "a."])
def test_what_is_no_path_is_an_error(path: str) -> None:
    with pytest.raises(ValueError, match="is not a path of fields"):
        path_steps(path)


def test_a_placeholder_alone_keeps_its_kind_and_others_become_text() -> None:
    template = {"position": "{x}", "label": "{thing} at {x}", "poses": [{"x": "{x}"}], "mode": 3}
    assert fill_in(template, {"x": 1.5, "thing": "Jar1"}) == {
        "position": 1.5,
        "label": "Jar1 at 1.5",
        "poses": [{"x": 1.5}],
        "mode": 3,
    }
    assert {*placeholders(template)} == {"x", "thing"}


def test_a_result_that_is_not_as_expected_says_what_differs() -> None:
    assert differences({"stalled": True, "error.code": 0}, {"stalled": True, "error": {"code": 0}}) == []
    assert differences({"stalled": True, "code": 0}, {"stalled": False}) == ["stalled is False", "code is missing"]
