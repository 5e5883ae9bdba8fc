"""A process beside this one, which is stopped at any moment."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from somrs.errors import RemoteError
from somrs.worker import WorkerProcess, answer_questions
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT


def never_answer(questions: Connection) -> None:
    answer_questions(questions, lambda question: time.sleep(2 * HANG_TIME) or b"")  # type: ignore[func-returns-value]


def test_a_process_that_has_just_started_is_not_waited_for_when_it_is_to_stop() -> None:
    async def run() -> None:
        started, stopping = threading.Event(), threading.Event()

        def begin() -> None:
            started.set()
            stopping.wait()
            time.sleep(0.5)  # until the other thread waits for this one

        worker = WorkerProcess("worker", never_answer, begin)
        question = asyncio.create_task(worker.ask(lambda session: b"?"))
        await asyncio.to_thread(started.wait)
        end = asyncio.create_task(asyncio.to_thread(worker.__exit__))
        stopping.set()
        await end
        with pytest.raises(RemoteError, match="the worker was stopped before it had an answer"):
            await question

    asyncio.run(asyncio.wait_for(run(), HANG_TIME))


AHEAD = """
import asyncio, os, signal
from pathlib import Path
from somrs.worker import WorkerProcess, fork_ahead
from tests.integration.test_worker import reply_with_pid

async def answering_pids(count):
    with WorkerProcess("worker", reply_with_pid, lambda: None) as worker:
        for _ in range(count):
            yield int(await worker.ask(lambda session: b"?"))

async def main(idle):
    CASE

fork_ahead()
asyncio.run(main(int(Path(f"/proc/self/task/{os.getpid()}/children").read_text())))
"""
"""A program that forks a process ahead, whose number is `idle`."""

CASES = {
    "it has the first question, and another one the next after it was killed": """
    async for pid in answering_pids(2):
        assert (pid == idle) == (idle is not None)
        os.kill(pid, signal.SIGKILL)
        idle = None
""",
    "it is replaced when it was killed before the first question": """
    os.kill(idle, signal.SIGKILL)
    async for pid in answering_pids(1):
        assert pid != idle
""",
    "it ends with its parent, although it has had no work": "    os.kill(os.getpid(), signal.SIGKILL)",
    "it ends with its parent, which has had an answer": """
    async for pid in answering_pids(1):
        assert pid == idle
        os.kill(os.getpid(), signal.SIGKILL)
""",
}


def reply_with_pid(questions: Connection) -> None:
    answer_questions(questions, lambda question: str(os.getpid()).encode())


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="there is no /proc to find the process in")
@pytest.mark.parametrize("case", CASES)
def test_a_process_that_was_forked_ahead(case: str) -> None:
    """What it leaves is noticed by the check of every test for processes that remain."""
    result = subprocess.run([sys.executable, "-c", AHEAD.replace("    CASE", CASES[case])], cwd=ROOT, capture_output=True, text=True)
    assert not result.stderr
    assert result.returncode == (-signal.SIGKILL if "ends with" in case else 0)
