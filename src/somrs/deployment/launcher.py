"""Starts the programs of a system by forking a launcher process that has imported the modules that they share.

A fork saves each program most of the CPU time of its start, and most of the memory for code, which it shares with the launcher. The
launcher has neither threads nor an event loop, so that it can fork. When the process that uses it ends, the launcher and all programs end.

The launcher receives requests through a Unix socket, with the file descriptors for a program's output. It reports which processes
it has started, and how each has ended.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import gc
import importlib
import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import msgspec
import setproctitle

from somrs.errors import RemoteError
from somrs.worker import thread_count

COMMON = (
    "_strptime",  # read by `ssl` for the times of certificates
    "somrs.cli.main",
    "somrs.deployment.device_host",
    "somrs.deployment.components",
    "somrs.deployment.programs",
    "somrs.ontology.files.loading",
    "somrs.storage.journal",
    "somrs.trust.certificates",
    "uvicorn.lifespan.off",
    "uvicorn.protocols.http.auto",
    "uvloop",
)
"""Modules that several programs import."""

SHARED_OBJECTS = ("somrs.cli.main:command", "somrs.ontology.files.loading:upper")
"""Cached functions whose results several programs use and never change: the command line, and the upper ontology with its grammar."""

_CHUNK = 1 << 16


class Start(msgspec.Struct, frozen=True, kw_only=True):
    """Request to run `somrs` with these arguments and environment. Two file descriptors come with it: for output and for errors."""

    arguments: tuple[str, ...]
    environment: dict[str, str]


class Started(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The process has started."""

    pid: int


class Ended(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The process has ended. `code` is its exit code, or minus the number of the signal that ended it."""

    pid: int
    code: int


class Process:
    """A process that a launcher has started, with the interface of `asyncio.subprocess.Process`."""

    def __init__(self, pid: int, stdout: asyncio.StreamReader) -> None:
        self.pid, self.stdout = pid, stdout
        self.returncode: int | None = None
        self._end_event = asyncio.Event()

    async def wait(self) -> int:
        """Wait for the end, and return the exit code, or minus the number of the signal that ended the process."""
        await self._end_event.wait()
        assert self.returncode is not None, "set before the event"
        return self.returncode

    def send_signal(self, signal_number: int) -> None:
        """Send a signal. Raises ProcessLookupError when the process has ended."""
        if self.returncode is not None:
            raise ProcessLookupError(f"process {self.pid} has ended")
        os.kill(self.pid, signal_number)

    def kill(self) -> None:
        """Kill the process, unless it has ended."""
        with contextlib.suppress(ProcessLookupError):
            self.send_signal(signal.SIGKILL)

    def ended(self, code: int) -> None:
        self.returncode = code
        self._end_event.set()


@dataclass(slots=True)
class LauncherProcess:
    """A running launcher."""

    channel: socket.socket
    pid: int
    reap: Callable[[], object]
    """Waits for the process. Call it when the launcher has closed its end of the channel, so that no zombie remains."""


def spawn_launcher() -> LauncherProcess:
    """Start a launcher in a new Python interpreter."""
    own_end, other_end = socket.socketpair()
    with other_end:
        line = [sys.executable, "-m", "somrs.deployment.launcher"]
        program = subprocess.Popen(line, stdin=other_end.fileno(), stdout=subprocess.DEVNULL, start_new_session=True)
    return LauncherProcess(own_end, program.pid, program.wait)


def fork_launcher() -> LauncherProcess:
    """Fork a launcher from this process, which must not have an event loop yet; spawn it if this process has threads.

    A fork saves the start of another interpreter and the imports that both need.
    """
    if thread_count() > 1:
        return spawn_launcher()
    import_common()
    own_end, other_end = socket.socketpair()
    pid = os.fork()
    if pid == 0:
        own_end.close()
        os.setsid()  # Ctrl-C goes to the parent only
        null_file = os.open(os.devnull, os.O_RDWR)
        for standard in (0, 1):
            os.dup2(null_file, standard)
        launch(other_end)
    other_end.close()
    return LauncherProcess(own_end, pid, lambda: os.waitpid(pid, 0))


class Launcher:
    """The client of a launcher: starts the launcher when it is needed, and again after it was killed.

    `launcher_process`: a launcher that runs already.
    """

    def __init__(self, launcher_process: LauncherProcess | None = None) -> None:
        self._lock = asyncio.Lock()
        self._launcher_process = launcher_process
        self._end_event: asyncio.Event | None = None
        """Set when the launcher has ended; None while its channel is not read."""
        self._buffer = b""
        self._stdout: asyncio.StreamReader | None = None
        self._started: asyncio.Queue[Process | None] = asyncio.Queue()
        self._running: dict[int, Process] = {}

    @property
    def pid(self) -> int | None:
        """The process id of the launcher; None while none runs."""
        return self._launcher_process.pid if self._launcher_process is not None else None

    async def start(self, arguments: Sequence[str], log: Path, environment: Mapping[str, str]) -> Process:
        """Start `somrs` with the arguments; errors go to the log. Raises RemoteError when the launcher is killed before it answers."""
        request = msgspec.json.encode(Start(arguments=tuple(arguments), environment=dict(environment))) + b"\n"
        async with self._lock:
            channel = self._ensure_listening().channel
            self._stdout = stdout = asyncio.StreamReader()
            read, write = os.pipe()
            await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdout), os.fdopen(read, "rb"))
            with os.fdopen(write, "wb") as output, log.open("ab") as errors, contextlib.suppress(ConnectionError):  # the queue gets None
                sent_count = socket.send_fds(channel, [request], [output.fileno(), errors.fileno()])
                channel.sendall(request[sent_count:])
            process = await self._started.get()
        if process is None:
            raise RemoteError(f"somrs {' '.join(arguments)} was not started: the process that starts programs was killed")
        return process

    async def stop(self) -> None:
        """End the launcher and all processes that it has started."""
        if self._launcher_process is not None:
            launcher_process, end_event = self._ensure_listening(), self._end_event
            with contextlib.suppress(OSError):  # it has ended
                launcher_process.channel.shutdown(socket.SHUT_WR)
            assert end_event is not None, "made by _ensure_listening"
            await end_event.wait()

    def _ensure_listening(self) -> LauncherProcess:
        """The launcher, started if necessary, with a reader on its channel."""
        if self._launcher_process is None:
            self._launcher_process = spawn_launcher()
        if self._end_event is None:
            self._end_event, self._buffer, self._started = asyncio.Event(), b"", asyncio.Queue()
            asyncio.get_running_loop().add_reader(
                self._launcher_process.channel, self._read_channel, self._launcher_process, self._end_event
            )
        return self._launcher_process

    def _read_channel(self, launcher_process: LauncherProcess, end_event: asyncio.Event) -> None:
        try:
            chunk = launcher_process.channel.recv(_CHUNK)
        except ConnectionError:
            chunk = b""
        *lines, self._buffer = (self._buffer + chunk).split(b"\n")
        for line in lines:
            match _ANSWERS.decode(line):
                case Started(pid=pid):
                    assert self._stdout is not None, "made before the request is sent"
                    process = self._running[pid] = Process(pid, self._stdout)
                    self._started.put_nowait(process)
                case Ended(pid=pid, code=code):
                    self._running.pop(pid).ended(code)
        if not chunk:
            self._ended(launcher_process)
            end_event.set()

    def _ended(self, launcher_process: LauncherProcess) -> None:
        asyncio.get_running_loop().remove_reader(launcher_process.channel)
        launcher_process.channel.close()
        launcher_process.reap()
        for process in self._running.values():
            process.kill()
            process.ended(-signal.SIGKILL)
        self._running.clear()
        self._launcher_process = self._end_event = None
        self._started.put_nowait(None)


_ANSWERS = msgspec.json.Decoder(Started | Ended)


# In the launcher


def import_common() -> None:
    """Import the common modules and make the shared objects, so that forked processes share their memory."""
    for name in COMMON:
        with contextlib.suppress(ImportError):  # of an extra that is not installed
            importlib.import_module(name)
    for reference in SHARED_OBJECTS:
        module, _, function = reference.partition(":")
        getattr(importlib.import_module(module), function)()
    gc.collect()
    gc.freeze()  # the collector would write to these objects, and so unshare their memory pages


def launch(channel: socket.socket) -> NoReturn:
    """Run as the launcher until the channel is closed. In each forked process, run the requested program instead."""
    setproctitle.setproctitle("somrs launcher")
    request_with_files = _serve(channel)
    if request_with_files is not None:
        _run_request(*request_with_files)
    os._exit(0)  # there is nothing to clean up


def _serve(channel: socket.socket) -> tuple[Start, list[int]] | None:
    """Fork a process for each request. Return the request and its files in the forked process, and None when the channel is closed."""
    wakes, woken = socket.socketpair()
    wakes.setblocking(False)
    launcher = os.getpid()
    with channel, wakes, woken, selectors.DefaultSelector() as selector:
        signal.set_wakeup_fd(wakes.fileno())
        signal.signal(signal.SIGCHLD, lambda *_: None)
        selector.register(channel, selectors.EVENT_READ)
        selector.register(woken, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fileobj is woken:
                    woken.recv(_CHUNK)
                    _report_ended(channel)
                    continue
                text, files = _request(channel)
                if not text:
                    return None
                if (pid := os.fork()) == 0:
                    _follow(launcher)
                    signal.set_wakeup_fd(-1)
                    return msgspec.json.decode(text, type=Start), files
                for file in files:
                    os.close(file)
                _send_event(channel, Started(pid=pid))


def _follow(launcher: int) -> None:
    """Have this process end with the launcher, also if that ends while it starts."""
    programs = importlib.import_module("somrs.deployment.programs")
    programs.parent_process.cache_clear()
    if programs.parent_process() != launcher:
        os._exit(0)


def _run_request(request: Start, files: list[int]) -> NoReturn:
    """Run the requested program in this process, and end it."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    os.setsid()
    for number, file in enumerate([os.open(os.devnull, os.O_RDONLY), *files]):
        os.dup2(file, number)
        os.close(file)
    os.environ.clear()
    os.environ.update(request.environment)
    setproctitle.setproctitle(f"somrs {' '.join(request.arguments)}")
    sys.argv = ["somrs", *request.arguments]
    _end(_exit_code(importlib.import_module("somrs.cli.main").main))


def _exit_code(main: Callable[[], object]) -> int:
    """Run the main function of a program, and return the exit code that Python would end with. An error is printed as Python prints it."""
    try:
        main()
    except SystemExit as ending:
        if ending.code is None or isinstance(ending.code, int):
            return ending.code or 0
        print(ending.code, file=sys.stderr)
        return 1
    except BaseException:  # noqa: BLE001  # as the interpreter does
        sys.excepthook(*sys.exc_info())
        return 1
    return 0


def _end(code: int) -> NoReturn:
    """End this process as `multiprocessing` ends its own. Python would free each object, and so copy all memory that is shared with the
    launcher, which takes as much CPU time as a whole start."""
    threading._shutdown()  # type: ignore[attr-defined]  # waits for threads, such as those that write
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # nobody reads it any more, or the program has closed it
            stream.flush()
    os._exit(code)


def _request(channel: socket.socket) -> tuple[bytes, list[int]]:
    """Read a line, and the file descriptors that came with it. The line is empty when the other end is closed."""
    try:
        text, files, _, _ = socket.recv_fds(channel, _CHUNK, 2)
        while text and not text.endswith(b"\n"):
            chunk = channel.recv(_CHUNK)
            text = text + chunk if chunk else b""
    except ConnectionError:  # the other end was killed before it had read everything
        return b"", []
    return text, files


def _report_ended(channel: socket.socket) -> None:
    with contextlib.suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            _send_event(channel, Ended(pid=ended[0], code=os.waitstatus_to_exitcode(ended[1])))


def _send_event(channel: socket.socket, event: Started | Ended) -> None:
    with contextlib.suppress(ConnectionError):  # the receiver has ended
        channel.sendall(msgspec.json.encode(event) + b"\n")


if __name__ == "__main__":
    import_common()
    launch(socket.socket(fileno=os.dup(sys.stdin.fileno())))
