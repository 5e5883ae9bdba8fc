"""`somrs ros2 check` as a user meets it, without robots."""

from __future__ import annotations

from pathlib import Path

import pytest

from somrs.cli.ros2 import check

BOUND = "adapters: {ros2: {python: no-such-python, robots: {Robot1: {binding: robot.yaml}}}}\n"


@pytest.mark.parametrize(
    ("site", "binding", "problem"),
    [
        ("{}\n", "", "there is no `adapters: ros2:`; name the robots there, with their bindings"),
        (BOUND, "navigate: {acton: go}\n", "robot.yaml:1: navigate.acton: unknown key acton; did you mean action?"),
        (BOUND, "", "there is no no-such-python; name the Python of your ROS, or its `setup` file"),
    ],
)
def test_what_cannot_be_checked_says_where_what_and_what_next(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], site: str, binding: str, problem: str
) -> None:
    (tmp_path / "site.yaml").write_text(site)
    (tmp_path / "robot.yaml").write_text(binding)
    with pytest.raises(SystemExit) as exit:
        check([tmp_path / "site.yaml"])
    assert exit.value.code == 2
    assert problem in capsys.readouterr().err
