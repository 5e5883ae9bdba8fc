"""Starts the programs of a system, each a process of its own, out of one that has imported what they have in common.

That saves each program most of the CPU of its start and, as a forked process shares memory with the one that it came from, most of the
memory for code. The launcher has neither threads nor an event loop, so that it can be forked. It ends, and with it all programs, when
whoever started it is gone.

Requests come through a Unix socket, with the file descriptors for a program's output. Back go which processes it has started, and how
they have ended.
"""

from __future__ import annotations

import asyncio
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

COMMON = (
    "somrs.cli.main",
    "somrs.deployment.device",
    "somrs.deployment.programs",
    "somrs.ontology.files.loading",
    "somrs.storage.journal",
    "uvicorn.lifespan.off",
    "uvicorn.protocols.http.auto",
    "uvloop",
)
"""What several programs import."""

MADE = ("somrs.cli.main:command", "somrs.ontology.files.loading:upper")
"""What several programs make, and never change: the command line, and the upper ontology with the grammar of its formulas."""

CHUNK = 1 << 16


class Start(msgspec.Struct, frozen=True, kw_only=True):
    """Run `somrs` with these arguments and in this environment. Two file descriptors come with it: for its output, and for errors."""

    arguments: tuple[str, ...]
    environment: dict[str, str]


class Started(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The process is there."""

    pid: int


class Ended(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The process has ended, with an exit code, or minus the number of the signal that ended it."""

    pid: int
    code: int


class Process:
    """A process that a launcher has started, to be used like one of asyncio.subprocess."""

    def __init__(self, pid: int, stdout: asyncio.StreamReader) -> None:
        self.pid, self.stdout = pid, stdout
        self.returncode: int | None = None
        self._over = asyncio.Event()

    async def wait(self) -> int:
        """Its exit code, or minus the number of the signal that ended it."""
        await self._over.wait()
        assert self.returncode is not None, "known when it is over"
        return self.returncode

    def send_signal(self, what: int) -> None:
        """Raises ProcessLookupError when the process has ended."""
        if self.returncode is not None:
            raise ProcessLookupError(f"process {self.pid} has ended")
        os.kill(self.pid, what)

    def kill(self) -> None:
        """End it at once, unless it has ended."""
        with contextlib.suppress(ProcessLookupError):
            self.send_signal(signal.SIGKILL)

    def ended(self, code: int) -> None:
        self.returncode = code
        self._over.set()


@dataclass(slots=True)
class Begun:
    """A launcher that runs."""

    channel: socket.socket
    pid: int
    over: Callable[[], object]
    """To be called when its end of the channel is closed: it is at its end, and somebody has to ask how it ended."""


def spawned() -> Begun:
    """A launcher that is a Python of its own."""
    here, there = socket.socketpair()
    with there:
        line = [sys.executable, "-m", "somrs.deployment.launcher"]
        program = subprocess.Popen(line, stdin=there.fileno(), stdout=subprocess.DEVNULL, start_new_session=True)
    return Begun(here, program.pid, program.wait)


def forked() -> Begun:
    """A launcher that comes out of this process, which has no event loop yet; where it has threads, one that is spawned. It saves to start
    another Python, and what both import."""
    if _threads() > 1:
        return spawned()
    import_common()
    here, there = socket.socketpair()
    pid = os.fork()
    if pid == 0:
        here.close()
        os.setsid()  # Ctrl-C is for who started it
        nothing = os.open(os.devnull, os.O_RDWR)
        for standard in (0, 1):
            os.dup2(nothing, standard)
        launch(there)
    there.close()
    return Begun(here, pid, lambda: os.waitpid(pid, 0))


class Launcher:
    """The launcher as whoever uses it has it: started when it is needed, and again when somebody has killed it.

    `begun`: one that runs already.
    """

    def __init__(self, begun: Begun | None = None) -> None:
        self._lock = asyncio.Lock()
        self._begun = begun
        self._over: asyncio.Event | None = None
        """Set when the launcher that is listened to has ended."""
        self._heard = b""
        self._stdout: asyncio.StreamReader | None = None
        self._started: asyncio.Queue[Process | None] = asyncio.Queue()
        self._running: dict[int, Process] = {}

    @property
    def pid(self) -> int | None:
        """The process of the launcher; None while there is none."""
        return self._begun.pid if self._begun is not None else None

    async def start(self, arguments: Sequence[str], log: Path, environment: Mapping[str, str]) -> Process:
        """Start `somrs` with the arguments; errors go to the log. Raises RemoteError when the launcher is killed meanwhile."""
        request = msgspec.json.encode(Start(arguments=tuple(arguments), environment=dict(environment))) + b"\n"
        async with self._lock:
            channel = self._listened_to().channel
            self._stdout = stdout = asyncio.StreamReader()
            read, write = os.pipe()
            await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdout), os.fdopen(read, "rb"))
            with os.fdopen(write, "wb") as output, log.open("ab") as errors, contextlib.suppress(ConnectionError):  # the queue tells
                sent = socket.send_fds(channel, [request], [output.fileno(), errors.fileno()])
                channel.sendall(request[sent:])
            process = await self._started.get()
        if process is None:
            raise RemoteError(f"somrs {' '.join(arguments)} was not started: the process that starts programs was killed")
        return process

    async def stop(self) -> None:
        """End the launcher, and all that it has started and that has not ended."""
        if self._begun is not None:
            begun, over = self._listened_to(), self._over
            with contextlib.suppress(OSError):  # it has ended
                begun.channel.shutdown(socket.SHUT_WR)
            assert over is not None, "made when it is listened to"
            await over.wait()

    def _listened_to(self) -> Begun:
        """A launcher that is there, and is listened to."""
        if self._begun is None:
            self._begun = spawned()
        if self._over is None:
            self._over, self._heard, self._started = asyncio.Event(), b"", asyncio.Queue()
            asyncio.get_running_loop().add_reader(self._begun.channel, self._hear, self._begun, self._over)
        return self._begun

    def _hear(self, begun: Begun, over: asyncio.Event) -> None:
        try:
            more = begun.channel.recv(CHUNK)
        except ConnectionError:
            more = b""
        *lines, self._heard = (self._heard + more).split(b"\n")
        for line in lines:
            match _ANSWERS.decode(line):
                case Started(pid=pid):
                    assert self._stdout is not None, "made before it is asked for"
                    process = self._running[pid] = Process(pid, self._stdout)
                    self._started.put_nowait(process)
                case Ended(pid=pid, code=code):
                    self._running.pop(pid).ended(code)
        if not more:
            self._ended(begun)
            over.set()

    def _ended(self, begun: Begun) -> None:
        asyncio.get_running_loop().remove_reader(begun.channel)
        begun.channel.close()
        begun.over()
        for process in self._running.values():
            process.kill()
            process.ended(-signal.SIGKILL)
        self._running.clear()
        self._begun = self._over = None
        self._started.put_nowait(None)


_ANSWERS = msgspec.json.Decoder(Started | Ended)


def _threads() -> int:
    """Those of this process, also those that Python does not know."""
    tasks = Path("/proc/self/task")
    return len(os.listdir(tasks)) if tasks.is_dir() else threading.active_count()


# In the launcher


def import_common() -> None:
    """Have what programs have in common, as it is to be shared by all that come out of this process."""
    for name in COMMON:
        with contextlib.suppress(ImportError):  # of an extra that is not installed
            importlib.import_module(name)
    for made in MADE:
        module, _, function = made.partition(":")
        getattr(importlib.import_module(module), function)()
    gc.collect()
    gc.freeze()  # what is there is not looked at again, and stays shared


def launch(channel: socket.socket) -> NoReturn:
    """Be a launcher, until nobody is there any more who wants it."""
    setproctitle.setproctitle("somrs launcher")
    begun = serve(channel)
    if begun is not None:
        become(*begun)
        sys.exit()
    os._exit(0)  # there is nothing to be put in order


def serve(channel: socket.socket) -> tuple[Start, list[int]] | None:
    """Start a process for each request. Returns in each of them, with the request; and None when nobody is there any more."""
    wakes, woken = socket.socketpair()
    wakes.setblocking(False)
    with channel, wakes, woken, selectors.DefaultSelector() as selector:
        signal.set_wakeup_fd(wakes.fileno())
        signal.signal(signal.SIGCHLD, lambda *_: None)
        selector.register(channel, selectors.EVENT_READ)
        selector.register(woken, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fileobj is woken:
                    woken.recv(CHUNK)
                    _tell_ended(channel)
                    continue
                text, files = _request(channel)
                if not text:
                    return None
                if (pid := os.fork()) == 0:
                    signal.set_wakeup_fd(-1)
                    return msgspec.json.decode(text, type=Start), files
                for file in files:
                    os.close(file)
                _say(channel, Started(pid=pid))


def become(request: Start, files: list[int]) -> None:
    """Be the program."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    os.setsid()
    for number, file in enumerate([os.open(os.devnull, os.O_RDONLY), *files]):
        os.dup2(file, number)
        os.close(file)
    os.environ.clear()
    os.environ.update(request.environment)
    setproctitle.setproctitle(f"somrs {' '.join(request.arguments)}")
    sys.argv = ["somrs", *request.arguments]
    importlib.import_module("somrs.cli.main").main()


def _request(channel: socket.socket) -> tuple[bytes, list[int]]:
    """A line, and the file descriptors that came with it. Nothing when the other end is closed."""
    try:
        text, files, _, _ = socket.recv_fds(channel, CHUNK, 2)
        while text and not text.endswith(b"\n"):
            more = channel.recv(CHUNK)
            text = text + more if more else b""
    except ConnectionError:  # it was killed before it had read all
        return b"", []
    return text, files


def _tell_ended(channel: socket.socket) -> None:
    with contextlib.suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            _say(channel, Ended(pid=ended[0], code=os.waitstatus_to_exitcode(ended[1])))


def _say(channel: socket.socket, what: Started | Ended) -> None:
    with contextlib.suppress(ConnectionError):  # whoever is to hear it is gone
        channel.sendall(msgspec.json.encode(what) + b"\n")


if __name__ == "__main__":
    import_common()
    launch(socket.socket(fileno=os.dup(sys.stdin.fileno())))
