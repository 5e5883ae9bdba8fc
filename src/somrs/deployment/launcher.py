"""Starts the programs of a system, each a process of its own, out of one that has imported what they have in common.

That saves each program most of the CPU of its start and, as a forked process shares memory with the one that it came from, most of the
memory for code. The launcher has neither threads nor an event loop, so that it can be forked. It ends, and with it all programs, when
whoever started it is gone.

Requests come through a Unix socket, its standard input, with the file descriptors for a program's output. To standard output goes which
processes it has started, and how they have ended.
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
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import setproctitle

from somrs.errors import RemoteError

COMMON = (
    "somrs.cli.main",
    "somrs.deployment.device",
    "somrs.deployment.programs",
    "somrs.ontology.files.loading",
    "somrs.storage.journal",
    "uvloop",
)
"""What several programs import."""

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


class Launcher:
    """The launcher as whoever uses it has it: started when it is needed, and again when somebody has killed it."""

    def __init__(self) -> None:
        self._lock = asyncio.Lock()
        self._program: asyncio.subprocess.Process | None = None
        self._channel: socket.socket | None = None
        self._listening: asyncio.Task[None] | None = None
        self._stdout: asyncio.StreamReader | None = None
        self._started: asyncio.Queue[Process | None] = asyncio.Queue()
        self._running: dict[int, Process] = {}

    async def start(self, arguments: Sequence[str], log: Path, environment: Mapping[str, str]) -> Process:
        """Start `somrs` with the arguments; errors go to the log. Raises RemoteError when the launcher is killed meanwhile."""
        request = msgspec.json.encode(Start(arguments=tuple(arguments), environment=dict(environment))) + b"\n"
        async with self._lock:
            if self._listening is None or self._listening.done():
                await self._begin()
            assert self._channel is not None, "made when it begins"
            self._stdout = stdout = asyncio.StreamReader()
            read, write = os.pipe()
            await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdout), os.fdopen(read, "rb"))
            with os.fdopen(write, "wb") as output, log.open("ab") as errors, contextlib.suppress(ConnectionError):  # the queue tells
                sent = socket.send_fds(self._channel, [request], [output.fileno(), errors.fileno()])
                self._channel.sendall(request[sent:])
            process = await self._started.get()
        if process is None:
            raise RemoteError(f"somrs {' '.join(arguments)} was not started: the process that starts programs was killed")
        return process

    async def stop(self) -> None:
        """End the launcher, and all that it has started and that has not ended."""
        if self._channel is not None:
            self._channel.close()
        if self._program is not None and self._listening is not None:
            await self._program.wait()
            await self._listening

    async def _begin(self) -> None:
        self._channel, there = socket.socketpair()
        with there:
            self._program = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "somrs.deployment.launcher",
                stdin=there.fileno(),
                stdout=asyncio.subprocess.PIPE,
                start_new_session=True,
            )
        assert self._program.stdout is not None
        self._started = asyncio.Queue()
        self._listening = asyncio.create_task(self._listen(self._program.stdout, self._started))

    async def _listen(self, said: asyncio.StreamReader, started: asyncio.Queue[Process | None]) -> None:
        while line := await said.readline():
            match _ANSWERS.decode(line):
                case Started(pid=pid):
                    assert self._stdout is not None, "made before it is asked for"
                    process = self._running[pid] = Process(pid, self._stdout)
                    started.put_nowait(process)
                case Ended(pid=pid, code=code):
                    self._running.pop(pid).ended(code)
        for process in self._running.values():
            process.kill()
            process.ended(-signal.SIGKILL)
        self._running.clear()
        started.put_nowait(None)


_ANSWERS = msgspec.json.Decoder(Started | Ended)


# In the launcher


def main() -> None:
    setproctitle.setproctitle("somrs launcher")
    for name in COMMON:
        with contextlib.suppress(ImportError):  # of an extra that is not installed
            importlib.import_module(name)
    gc.collect()
    gc.freeze()  # what is there is not looked at again, and stays shared
    begun = serve(socket.socket(fileno=os.dup(sys.stdin.fileno())))
    if begun is not None:
        become(*begun)


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
                    _tell_ended()
                    continue
                text, files = _request(channel)
                if not text:
                    return None
                if (pid := os.fork()) == 0:
                    signal.set_wakeup_fd(-1)
                    return msgspec.json.decode(text, type=Start), files
                for file in files:
                    os.close(file)
                _say(Started(pid=pid))


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
    text, files, _, _ = socket.recv_fds(channel, CHUNK, 2)
    while text and not text.endswith(b"\n"):
        more = channel.recv(CHUNK)
        text = text + more if more else b""
    return text, files


def _tell_ended() -> None:
    with contextlib.suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            _say(Ended(pid=ended[0], code=os.waitstatus_to_exitcode(ended[1])))


def _say(what: Started | Ended) -> None:
    with contextlib.suppress(BrokenPipeError):  # whoever is to hear it is gone
        os.write(sys.stdout.fileno(), msgspec.json.encode(what) + b"\n")


if __name__ == "__main__":
    main()
