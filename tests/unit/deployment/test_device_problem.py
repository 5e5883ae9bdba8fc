"""What becomes of the words of a device on their way to the map."""

from __future__ import annotations

import asyncio

import pytest

from somrs.deployment.device_problem import LONGEST, ProblemReporter
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import PROBLEM, Value
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from tests.support.virtual_devices import make_ask


def on_map(*problems: str | None, stored_problem: str | None = None) -> Value | None:
    """What the map has when a device has had problems one after the other, and has joined. `stored_problem`: what an earlier run has left
    there."""
    values: dict[str, Value] = {"PositionX": 0.0, "PositionY": 0.0, **({PROBLEM: stored_problem} if stored_problem is not None else {})}
    repository = Repository(
        "http://here/repository", Contents(ontology=upper(), map=Map([Object(name="Robot1", type="MobileRobot", values=values)]))
    )

    async def report() -> None:
        reporter = ProblemReporter("Robot1", make_ask(repository, lambda: 0.0))
        for problem in problems:
            reporter.take(problem)
        reporter.confirm()
        await reporter.close()

    asyncio.run(report())
    return repository.contents.map.objects["Robot1"].values.get(PROBLEM)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ('says "no" \\ at Tür 3 =', 'says "no" \\ at Tür 3 ='),
        ("two\nlines, and \x00\x1b[31m", "two lines, and ??[31m"),
        ("x" * 1000, f"{'x' * (LONGEST - 3)}..."),
    ],
)
def test_whatever_a_device_says_is_a_line_on_the_map(words: str, text: str) -> None:
    assert on_map(words) == text


def test_the_last_problem_counts() -> None:
    assert on_map("cannot drive: a", "cannot drive: b") == "cannot drive: b"
    assert on_map("cannot drive: a", None, stored_problem="cannot drive: c") == ""
    assert on_map(stored_problem="cannot drive: c") == "", "an earlier run has left it"
    assert on_map() is None
