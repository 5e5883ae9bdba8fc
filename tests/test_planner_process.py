"""The planner's process answers, and does so again after it was killed."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import textwrap

import pytest

from somrs.app.planner_process import PlannerProcess
from somrs.entish.parse import parse
from somrs.errors import RemoteError
from somrs.ontology.files import upper
from somrs.ontology.objects import Fact, Map, Object
from somrs.planner.plan import Plan
from somrs.planner.problem import Problem

SO_ALREADY = Problem(
    ontology=upper(),
    map=Map([Object(name="Jar1", type="Jar"), Object(name="Table1", type="Table")], [Fact("isOn", ("Jar1", "Table1"))]),
    goal=parse("Jar1 isOn Table1"),
    services=(),
)


class Deadly:
    """Ends the process that reads it."""

    def __reduce__(self) -> tuple[object, ...]:
        return os._exit, (1,)


def test_who_was_killed_is_started_again_for_the_next_question() -> None:
    async def run() -> None:
        with PlannerProcess() as planner:
            assert await planner.plan(SO_ALREADY) == Plan(())
            first = planner.pid
            assert first is not None
            os.kill(first, signal.SIGKILL)
            assert await planner.plan(SO_ALREADY) == Plan(())
            assert planner.pid != first

    asyncio.run(asyncio.wait_for(run(), 60))


def test_a_question_that_kills_is_not_asked_for_ever() -> None:
    async def run() -> None:
        with PlannerProcess() as planner:
            with pytest.raises(RemoteError, match="ended 2 times without an answer"):
                await planner.plan(Deadly())
            assert await planner.plan(SO_ALREADY) == Plan(())

    asyncio.run(asyncio.wait_for(run(), 60))


def test_what_the_planner_raises_is_raised() -> None:
    async def run() -> None:
        with PlannerProcess() as planner, pytest.raises(TypeError, match="a planning problem was expected, not str"):
            await planner.plan("a wish")

    asyncio.run(asyncio.wait_for(run(), 60))


def test_nothing_is_left_when_whoever_asks_is_killed() -> None:
    program = """
        import asyncio, os, signal
        from somrs.app.planner_process import PlannerProcess

        if __name__ == "__main__":
            planner = PlannerProcess()
            try:
                asyncio.run(planner.plan("a wish"))
            except TypeError:
                pass
            os.kill(os.getpid(), signal.SIGKILL)
    """
    # All have the same error output, which ends when the last of them does.
    ended = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == -signal.SIGKILL
    assert ended.stderr == ""
