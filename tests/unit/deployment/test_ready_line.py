"""A program says that it is ready to whoever has started it, if anybody still listens."""

from __future__ import annotations

import os
import sys

import pytest

from somrs.deployment.programs import say_ready


def test_the_ready_line_is_one_line_of_json(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        say_ready("ros2", "http://127.0.0.1:8000")
    with os.fdopen(reading) as lines:
        (line,) = lines
    assert '"ready":"ros2"' in line


def test_a_program_that_nobody_listens_to_any_more_ends_without_a_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        say_ready("ros2", "http://127.0.0.1:8000")
