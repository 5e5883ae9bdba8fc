"""A process beside this one, which is stopped at any moment."""

from __future__ import annotations

import asyncio
import threading
import time
from multiprocessing.connection import Connection

import pytest

from somrs.errors import RemoteError
from somrs.worker import WorkerProcess, answer_questions
from tests.support.hang import HANG_TIME


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
