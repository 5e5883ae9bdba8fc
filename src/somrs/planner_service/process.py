"""The planner in a process beside the Task Manager's, so that planning does not block the Task Manager. A killed process is restarted."""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess

from msgspec import Struct

from somrs.errors import RemoteError
from somrs.kernel.codec import Codec, encode
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.planner_service.engines import plan_in_process
from somrs.planner_service.problem_delta import ProblemDelta, Recipient, Sender

PARENT_CHECK = 1.0
"""Seconds between two checks that the parent process still exists."""

MOST_STARTS = 2
"""The number of processes that try a problem: a problem that kills two (by its memory, perhaps) would kill more."""


class Defect(Struct, frozen=True, tag=True):
    """The message of an exception that the planner raised."""

    text: str


_DELTA_CODEC: Codec[ProblemDelta] = Codec(ProblemDelta)
_ANSWER_CODEC: Codec[Plan | NoPlan | Defect] = Codec(Plan | NoPlan | Defect)


class PlannerProcess:
    """Plans one problem after the other. A context manager; the process starts with the first problem.

    It uses a pipe, not a process pool: a pool is unusable once its process was killed, and leaks semaphores when this process is killed.
    """

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planner")
        self._running: tuple[SpawnProcess, Connection, Sender] | None = None
        self._closed = False

    @property
    def pid(self) -> int | None:
        return self._running[0].pid if self._running is not None else None

    async def plan(self, problem: Problem) -> Plan | NoPlan:
        """A plan, or why there is none. Raises RemoteError when the planner raises an exception or its process ends repeatedly."""
        return await asyncio.get_running_loop().run_in_executor(self._executor, self._ask, problem)

    def __enter__(self) -> PlannerProcess:
        return self

    def __exit__(self, *exception: object) -> None:
        self._closed = True
        if self._running is not None:
            _kill_with_engines(self._running[0])  # no caller waits for the result any more
        self._executor.shutdown(cancel_futures=True)
        self._end()

    def _ask(self, problem: Problem) -> Plan | NoPlan:
        for _ in range(MOST_STARTS):
            if self._closed:
                raise RemoteError("the planner was stopped before it had an answer")
            _, connection, sender = self._running or self._start()
            try:
                connection.send_bytes(encode(sender.pack(problem)))
                answer = _ANSWER_CODEC.decode(connection.recv_bytes())
            except (EOFError, OSError):  # the process has ended
                self._end()
                continue
            except BaseException:  # the process may lack what `sender` regards as sent
                self._end()
                raise
            if isinstance(answer, Defect):
                raise RemoteError(answer.text)
            return answer
        raise RemoteError(f"the planner's process ended {MOST_STARTS} times without an answer")

    def _start(self) -> tuple[SpawnProcess, Connection, Sender]:
        # Spawned, not forked: a forked process would keep the sockets of this process open when this process is killed.
        spawned = multiprocessing.get_context("spawn")
        parent_end, child_end = spawned.Pipe()
        process = spawned.Process(target=_serve, args=(child_end,), daemon=True)
        process.start()
        child_end.close()
        self._running = process, parent_end, Sender()
        return self._running

    def _end(self) -> None:
        if self._running is not None:
            process, connection, _ = self._running
            connection.close()
            _kill_with_engines(process)
            process.join()
            self._running = None


def _kill_with_engines(process: SpawnProcess) -> None:
    """Kill the process and the engines of its process group, including engines that outlive it."""
    assert process.pid is not None, "it was started"
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.kill()  # it may not have its own process group yet


def _serve(questions: Connection) -> None:
    """The main loop of the process: solve problems until the pipe is closed."""
    os.setpgrp()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the Task Manager handles Ctrl-C, and ends this process
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    recipient = Recipient()
    with contextlib.suppress(EOFError, OSError):
        while True:
            question = questions.recv_bytes()
            answer: Plan | NoPlan | Defect
            try:
                answer = plan_in_process(recipient.unpack(_DELTA_CODEC.decode(question)))
            except Exception as error:  # noqa: BLE001  # any defect becomes the reply; the Task Manager reports it
                answer = Defect(str(error) or type(error).__name__)
            questions.send_bytes(encode(answer))


def _end_with_parent(parent: int) -> None:
    """Kill this process and its engines, even during a search, when the parent process has ended."""
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK)
    os.killpg(0, signal.SIGKILL)  # the whole group, engines included
