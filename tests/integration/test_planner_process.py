"""The planner's process answers, and does so again after it was killed."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import textwrap
import time
from multiprocessing.connection import Connection
from pathlib import Path

import pytest
from msgspec.structs import replace

from somrs.entish.parse import parse
from somrs.errors import RemoteError
from somrs.kernel.codec import Codec, encode
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactRemoved, Object, ObjectAdded, ValueSet
from somrs.ontology.services import ServiceType
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner_service.engines import driver
from somrs.planner_service.problem_delta import Recipient, Sender
from somrs.planner_service.process import PlannerProcess
from somrs.planner_service.service import Planner
from tests.integration.test_planner_engine import tower
from tests.support.hang import HANG_TIME

SOLVED_PROBLEM = Problem(
    ontology=upper(),
    map=Map([Object(name="Jar1", type="Jar"), Object(name="Table1", type="Table")], [Fact("isOn", ("Jar1", "Table1"))]),
    goal=parse("Jar1 isOn Table1"),
    services=(),
)


def dies(questions: Connection) -> None:
    """What a process does that a question kills."""
    questions.recv_bytes()
    os._exit(1)


def test_who_was_killed_is_started_again_for_the_next_question() -> None:
    async def run() -> None:
        with PlannerProcess() as planner:
            assert await planner.plan(SOLVED_PROBLEM) == Plan(())
            first = planner.pid
            assert first is not None
            os.kill(first, signal.SIGKILL)
            assert await planner.plan(SOLVED_PROBLEM) == Plan(())
            assert planner.pid != first

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_a_question_that_kills_is_not_asked_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    async def run() -> None:
        with PlannerProcess() as planner:
            with monkeypatch.context() as patch:
                patch.setattr(planner.worker, "serve", dies)
                with pytest.raises(RemoteError, match="ended 2 times without an answer"):
                    await planner.plan(SOLVED_PROBLEM)
            assert await planner.plan(SOLVED_PROBLEM) == Plan(())

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_what_the_planner_raises_is_raised() -> None:
    async def run() -> None:
        broken = ServiceType(name="Work", effect="no formula at all")
        with PlannerProcess() as planner, pytest.raises(RemoteError, match="no formula at all"):
            await planner.plan(replace(SOLVED_PROBLEM, goal=parse("Table1 isOn Jar1"), services=(AvailableService(broken, ("Robot1",)),)))

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_nothing_is_left_when_whoever_asks_is_killed() -> None:
    program = """
        import asyncio, os, signal
        from somrs.planner_service.process import PlannerProcess
        from somrs.entish.parse import parse
        from somrs.ontology.files.loading import upper
        from somrs.ontology.map import Map
        from somrs.planner.model.problem import Problem

        if __name__ == "__main__":
            planner = PlannerProcess()
            asyncio.run(planner.plan(Problem(ontology=upper(), map=Map(), goal=parse("Jar1 isOn Table1"))))
            os.kill(os.getpid(), signal.SIGKILL)
    """
    # All have the same error output, which ends when the last of them does.
    ended = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=HANG_TIME, check=False)
    assert ended.returncode == -signal.SIGKILL
    assert ended.stderr == ""


def test_the_process_follows_the_map() -> None:
    """Each question is answered on the map that it came with, though only what changed is sent."""
    map_before = SOLVED_PROBLEM.map
    map_after = map_before.changed([FactRemoved(Fact("isOn", ("Jar1", "Table1"))), ObjectAdded(Object(name="Jar2", type="Jar"))])

    async def run() -> None:
        with PlannerProcess() as planner:
            for map, expected in (
                (map_before, True),
                (map_after, False),
                (map_before, True),
                (map_before, True),
                (Codec[Map](Map).decode(encode(map_after)), False),
            ):
                result = await planner.plan(replace(SOLVED_PROBLEM, map=map))
                assert isinstance(result, Plan) is expected, map.objects

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_little_is_sent_of_a_large_map_that_is_there_already() -> None:
    map = Map(Object(name=f"Jar{n}", type="Jar") for n in range(5_000))
    sender, recipient = Sender(), Recipient()
    problem, changed_problem = (
        replace(SOLVED_PROBLEM, map=map),
        replace(SOLVED_PROBLEM, map=map.changed([ValueSet("Jar7", "PositionX", 2.0)])),
    )
    assert recipient.unpack(sender.pack(problem)).map == problem.map
    delta = sender.pack(changed_problem)
    assert len(encode(delta)) < 5_000
    assert recipient.unpack(delta) == replace(changed_problem, ontology=problem.ontology)


def test_what_needs_no_search_needs_no_process() -> None:
    async def run() -> None:
        with PlannerProcess() as process:
            assert await Planner(process).plan(SOLVED_PROBLEM) == Plan(())
            assert process.pid is None

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def test_what_was_searched_is_not_searched_again() -> None:
    impossible = replace(SOLVED_PROBLEM, goal=parse("Table1 isOn Jar1"))

    async def run() -> None:
        with PlannerProcess() as process:
            planner = Planner(process)
            first = await planner.plan(impossible)
            assert isinstance(first, NoPlan)
            assert process.pid is not None
            os.kill(process.pid, signal.SIGKILL)
            killed = process.pid
            assert await planner.plan(impossible) == first
            assert process.pid == killed, "nobody was asked again"

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


def runs(pid: int) -> bool:
    """Whether it is there and is not only waiting for somebody to ask how it ended."""
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def children(pid: int) -> list[int]:
    return [int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()]


@pytest.mark.skipif(driver() is None or not Path("/proc/self/task").exists(), reason="needs an engine, and Linux to look at it")
def test_a_question_that_nobody_waits_for_ends_with_its_engines() -> None:
    engines: list[int] = []

    async def run() -> None:
        with PlannerProcess() as planner:
            question = asyncio.create_task(planner.plan(tower(30)))
            while not engines:
                await asyncio.sleep(0.05)
                engines.extend(children(planner.pid) if planner.pid is not None else [])
        with pytest.raises(RemoteError, match="stopped before it had an answer"):
            await question

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))  # nobody waits until there is a plan
    deadline = time.monotonic() + HANG_TIME
    while any(map(runs, engines)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [pid for pid in engines if runs(pid)]
