"""Work in a process beside this one, so that it does not block an event loop. A process that was killed is started again.

It uses a pipe, not a process pool: a pool is unusable once its process was killed, and leaks semaphores when this process is killed.
"""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Generic, Self, TypeVar

import setproctitle

from somrs.errors import RemoteError

PARENT_CHECK = 1.0
"""Seconds between two checks that the parent process still exists."""

MOST_STARTS = 2
"""The number of processes that try a question: one that kills two (by its memory, perhaps) would kill more."""

S = TypeVar("S")

_idle_processes: list[tuple[BaseProcess, Connection]] = []
"""Those that were forked ahead and have no work yet, each with this side of its pipe."""


def fork_ahead() -> None:
    """Fork a process for the first `WorkerProcess` of this program, which saves the start of an interpreter, and most imports.

    Call it before the program has sockets, which the process would keep open, and an event loop. It does nothing in a process with threads,
    whose locks might be held: then the process is spawned with the first question.
    """
    if thread_count() > 1:
        return
    forking = multiprocessing.get_context("fork")
    parent_end, child_end = forking.Pipe()
    process = forking.Process(target=_await_work, args=(child_end, parent_end), daemon=True)
    process.start()
    child_end.close()
    _idle_processes.append((process, parent_end))


def thread_count() -> int:
    """The number of threads of this process, including, on Linux, those not started by Python."""
    tasks = Path("/proc/self/task")
    return len(os.listdir(tasks)) if tasks.is_dir() else threading.active_count()


def _await_work(questions: Connection, parent_end: Connection) -> None:
    """The main function of a process that was forked ahead: its first message is the main function of its work."""
    _leave_terminal()
    setproctitle.setproctitle("somrs worker")
    parent_end.close()  # so that the pipe is closed when the parent process ends
    with contextlib.suppress(EOFError, OSError):
        serve: Callable[[Connection], None] = questions.recv()
        serve(questions)


class WorkerProcess(Generic[S]):
    """Has one question after the other answered. A context manager; the process starts with the first question.

    `name`: for messages to people. `serve`: the main function of the process, which calls `answer_questions`. `begin`: makes, for each
    process that is started, what this side has to remember about it.
    """

    def __init__(self, name: str, serve: Callable[[Connection], None], begin: Callable[[], S]) -> None:
        self.name, self.serve, self._begin = name, serve, begin
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix=name)
        self._running: tuple[BaseProcess, Connection, S] | None = None
        self._closed = False

    @property
    def pid(self) -> int | None:
        return self._running[0].pid if self._running is not None else None

    async def ask(self, pack: Callable[[S], bytes]) -> bytes:
        """The answer to the question that `pack` makes for the process. Raises RemoteError when the process ends repeatedly."""
        return await asyncio.get_running_loop().run_in_executor(self._executor, self._ask, pack)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._closed = True
        if self._running is not None:
            _kill_group(self._running[0])  # no caller waits for the result any more
        self._executor.shutdown(cancel_futures=True)
        self._end()

    def _ask(self, pack: Callable[[S], bytes]) -> bytes:
        for _ in range(MOST_STARTS):
            self._check_open()
            _, connection, session = self._running or self._start()
            self._check_open()  # who closed this meanwhile did not see the process that was starting
            try:
                connection.send_bytes(pack(session))
                return connection.recv_bytes()
            except (EOFError, OSError):  # the process has ended
                self._end()
                continue
            except BaseException:  # the process may lack what the session regards as sent
                self._end()
                raise
        raise RemoteError(f"the {self.name}'s process ended {MOST_STARTS} times without an answer")

    def _check_open(self) -> None:
        if self._closed:
            raise RemoteError(f"the {self.name} was stopped before it had an answer")

    def _start(self) -> tuple[BaseProcess, Connection, S]:
        process, connection = self._process_ahead() or self._spawned_process()
        self._running = process, connection, self._begin()
        return self._running

    def _process_ahead(self) -> tuple[BaseProcess, Connection] | None:
        """The process that was forked ahead; None if there is none left."""
        while _idle_processes:
            process, connection = _idle_processes.pop()
            try:
                connection.send(self.serve)
            except OSError:  # it was killed
                process.join()
            else:
                return process, connection
        return None

    def _spawned_process(self) -> tuple[BaseProcess, Connection]:
        # Not forked: a forked process would keep the sockets that this process has by now open when this process is killed.
        spawned = multiprocessing.get_context("spawn")
        parent_end, child_end = spawned.Pipe()
        process = spawned.Process(target=self.serve, args=(child_end,), daemon=True)
        process.start()
        child_end.close()
        return process, parent_end

    def _end(self) -> None:
        if self._running is not None:
            process, connection, _ = self._running
            connection.close()
            _kill_group(process)
            process.join()
            self._running = None


def _kill_group(process: BaseProcess) -> None:
    """Kill the process and those of its process group, including those that outlive it."""
    assert process.pid is not None, "it was started"
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.kill()  # it may not have its own process group yet


def answer_questions(questions: Connection, answer: Callable[[bytes], bytes]) -> None:
    """The main loop of the process: answer questions until the pipe is closed, or the parent process ends."""
    _leave_terminal()
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    with contextlib.suppress(EOFError, OSError):
        while True:
            questions.send_bytes(answer(questions.recv_bytes()))


def _leave_terminal() -> None:
    """Ignore Ctrl-C: the parent handles it, and ends this process with those of its group."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.setpgrp()


def _end_with_parent(parent: int) -> None:
    """Kill this process and its group, even during work, when the parent process has ended."""
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK)
    os.killpg(0, signal.SIGKILL)
