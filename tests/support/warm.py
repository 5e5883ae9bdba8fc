"""Starts the programs of systems under test by forking a process that has imported all their modules. This saves five seconds of CPU for
each system; otherwise these programs are like any others."""

from __future__ import annotations

import functools
import importlib
import os
import select
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec
import setproctitle

from somrs.deployment.launcher import Ended, Launcher, LauncherProcess, Start, Started, import_common, launch
from tests.support.leftovers import WARM

PROGRAMS = (
    "somrs.api.program",
    "somrs.cli.commands",
    "somrs.deployment.system",
    "somrs.devices.simulator.server.follower",
    "somrs.devices.simulator.server.server",
    "somrs.planner_service.process",
    "somrs.registry.component",
    "somrs.scheduling.program",
    "somrs.storage.repository_store",
    "somrs.task_manager.manager",
    # Dependencies of NiceGUI; NiceGUI itself reads the environment when it is imported.
    "docutils.core",
    "fastapi",
    "fastapi.middleware.gzip",
    "fastapi.staticfiles",
    "httpx",
    "itsdangerous",
    "jinja2",
    "markdown2",
    "pygments.formatters",
    "socketio",
)
PID = struct.Struct("i")


def launcher() -> Launcher:
    """Return a new launcher for a system."""
    return Launcher(begin_launcher())


def begin_launcher(cwd: Path | None = None) -> LauncherProcess:
    parent_end, child_end = socket.socketpair()
    with child_end:
        socket.send_fds(_warm(), [os.fsencode(cwd or Path.cwd())], [child_end.fileno()])
    return LauncherProcess(parent_end, PID.unpack(_warm().recv(PID.size))[0], lambda: None)


@functools.cache
def _warm() -> socket.socket:
    parent_end, child_end = socket.socketpair()
    with child_end:
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # no threads, so that it can be forked
        subprocess.Popen([sys.executable, "-m", "tests.support.warm"], stdin=child_end.fileno(), start_new_session=True, env=environment)
    return parent_end


class Program:
    """A program that was forked from it, without an event loop."""

    def __init__(
        self, arguments: Sequence[str], log: Path, errors: Path | None = None, cwd: Path | None = None, **environment: str
    ) -> None:
        """Run `somrs` with the arguments and these environment variables, and write its output to the log; `errors`: a log for its errors
        alone."""
        self._channel = begin_launcher(cwd).channel
        request = Start(arguments=tuple(arguments), environment={**os.environ, **environment})
        log.write_bytes(b"")
        with log.open("ab") as log_file, (errors or log).open("ab") as errors_file:
            socket.send_fds(self._channel, [msgspec.json.encode(request) + b"\n"], [log_file.fileno(), errors_file.fileno()])
        self._replies = self._channel.makefile("rb")
        self.pid = msgspec.json.decode(self._replies.readline(), type=Started).pid

    def send_signal(self, signal_number: int) -> None:
        os.kill(self.pid, signal_number)

    @property
    def ended(self) -> bool:
        return bool(select.select([self._channel], [], [], 0)[0])

    def wait(self) -> int:
        """Wait until it has ended. Return its exit code, or minus the number of the signal that ended it."""
        with self._channel, self._replies:
            return msgspec.json.decode(self._replies.readline(), type=Ended).code


def main() -> None:
    setproctitle.setproctitle(WARM)
    for name in PROGRAMS:
        importlib.import_module(name)
    import_common()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nothing waits for a launcher
    with socket.socket(fileno=os.dup(sys.stdin.fileno())) as request_socket:
        while True:
            folder, files, _, _ = socket.recv_fds(request_socket, 4096, 1)
            if not files:
                return
            if (pid := os.fork()) == 0:
                request_socket.close()
                os.chdir(folder)
                launch(socket.socket(fileno=files[0]))
            os.close(files[0])
            request_socket.sendall(PID.pack(pid))


if __name__ == "__main__":
    main()
