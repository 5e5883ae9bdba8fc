"""The planner in a process beside the Task Manager's, so that planning holds nothing up. One that was killed is started again."""

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
"""Seconds between two looks whether the parent process is still there."""

MOST_STARTS = 2
"""So many processes try a question: what kills two of them (its memory, perhaps) would kill more."""


class Defect(Struct, frozen=True, tag=True):
    """What the planner raised, in words."""

    text: str


_DELTA_CODEC: Codec[ProblemDelta] = Codec(ProblemDelta)
_ANSWER_CODEC: Codec[Plan | NoPlan | Defect] = Codec(Plan | NoPlan | Defect)


class PlannerProcess:
    """Answers one question after the other. A context manager; the process is there from the first question on.

    A pipe, and no process pool: a pool is of no use any more once its process was killed, and leaves semaphores behind when this one is.
    """

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planner")
        self._running: tuple[SpawnProcess, Connection, Sender] | None = None
        self._closed = False

    @property
    def pid(self) -> int | None:
        return self._running[0].pid if self._running is not None else None

    async def plan(self, problem: Problem) -> Plan | NoPlan:
        """Raises RemoteError with what the planner raised, and when its process ends again and again."""
        return await asyncio.get_running_loop().run_in_executor(self._executor, self._ask, problem)

    def __enter__(self) -> PlannerProcess:
        return self

    def __exit__(self, *exception: object) -> None:
        self._closed = True
        if self._running is not None:
            _kill_with_engines(self._running[0])  # whatever it is at; nobody waits for the answer any more
        self._executor.shutdown(cancel_futures=True)
        self._end()

    def _ask(self, problem: Problem) -> Plan | NoPlan:
        for _ in range(MOST_STARTS):
            if self._closed:
                raise RemoteError("the planner was ended before it had an answer")
            _, connection, sender = self._running or self._start()
            try:
                connection.send_bytes(encode(sender.pack(problem)))
                answer = _ANSWER_CODEC.decode(connection.recv_bytes())
            except (EOFError, OSError):  # it has ended
                self._end()
                continue
            except BaseException:  # what could not be sent is not what it has
                self._end()
                raise
            if isinstance(answer, Defect):
                raise RemoteError(answer.text)
            return answer
        raise RemoteError(f"the planner's process ended {MOST_STARTS} times without an answer")

    def _start(self) -> tuple[SpawnProcess, Connection, Sender]:
        # Spawned, not forked: a fork would keep the sockets of this process open when it is killed.
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
    """End the process with the engines that it started, which are of its group; those too that it left behind."""
    assert process.pid is not None, "it was started"
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.kill()  # it may have no group yet


def _serve(questions: Connection) -> None:
    """What the process does, until nobody can ask it any more."""
    os.setpgrp()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in a terminal is for the Task Manager, which ends this process, too
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    recipient = Recipient()
    with contextlib.suppress(EOFError, OSError):
        while True:
            question = questions.recv_bytes()
            answer: Plan | NoPlan | Defect
            try:
                answer = plan_in_process(recipient.unpack(_DELTA_CODEC.decode(question)))
            except Exception as error:  # noqa: BLE001  # whatever went wrong is the answer; the Task Manager says what it means
                answer = Defect(str(error) or type(error).__name__)
            questions.send_bytes(encode(answer))


def _end_with_parent(parent: int) -> None:
    """End amid a question, too, when the process that started this one is gone, however that came."""
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK)
    os.killpg(0, signal.SIGKILL)  # with the engines
