"""Runs the bridge to ROS 2 (`bridge/`) in a process of its own, with the Python of the installed ROS."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from somrs.adapters.ros2.lines import Ready, Request, decode_report, encode_request
from somrs.adapters.ros2.session import Session
from somrs.adapters.ros2.settings import Settings
from somrs.adapters.wires import WireRecord
from somrs.errors import Mistake, WireError

log = logging.getLogger(__name__)

BRIDGE = Path(__file__).with_name("bridge")
PAUSES = (1.0, 2.0, 5.0, 10.0)
"""Seconds before the bridge is started again: after its first end, its second, and so on, until it has run."""
LONGEST_LINE = 256 * 2**20
"""A map of 10,000 by 10,000 cells fits, bytes."""


class BridgeProcess:
    """The conversation with the bridge, and its process, which is started again when it ends. `folder`: what paths of settings refer to."""

    def __init__(self, settings: Settings, folder: Path) -> None:
        self._settings, self._folder = settings, folder
        self._input: asyncio.StreamWriter | None = None
        self._record = WireRecord("ros2")
        self.session = Session(self._send, log.warning)

    @property
    def python(self) -> str:
        """The Python with which it runs."""
        return python_of(self._settings, self._folder)

    def _send(self, request: Request) -> None:
        if self._input is not None and not self._input.is_closing():
            line = encode_request(request)
            self._record.note(">", line.decode().strip())
            self._input.write(line)

    async def run(self) -> None:
        """Run the bridge until this is cancelled."""
        attempt = 0
        while True:
            try:
                attempt = 0 if await self.run_once() else attempt + 1
            except OSError as error:
                attempt += 1
                problem = f"the bridge to ROS 2 cannot be started with {self._settings.python}: {error}"
                log.error("%s", problem)
                self.session.disconnected(problem)
            await asyncio.sleep(PAUSES[min(attempt, len(PAUSES)) - 1 if attempt else 0])

    async def run_once(self) -> bool:
        """Run the bridge until it ends. Returns whether it was ready."""
        process = await asyncio.create_subprocess_exec(
            *ros_command(self._settings, self._folder, str(BRIDGE)),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=ros_environment(self._settings),
            limit=LONGEST_LINE,
            start_new_session=True,  # Ctrl-C ends this program, which closes the bridge's input
        )
        assert process.stdin is not None, "it is a pipe"
        assert process.stdout is not None, "it is a pipe"
        self._input = process.stdin
        was_ready, problem = False, "the bridge to ROS 2 has ended"
        try:
            async for line in process.stdout:
                was_ready = self._take(line) or was_ready
            code = await process.wait()
            problem = f"the bridge to ROS 2 has ended with {code}: is {self._settings.python} the Python of your ROS?"
            log.error("%s", problem)
        finally:
            self._input = None
            self.session.disconnected(problem)
            process.stdin.close()
            with contextlib.suppress(asyncio.CancelledError):
                await process.wait()
        return was_ready

    def _take(self, line: bytes) -> bool:
        """Handle a line. Returns whether it says that the bridge is ready."""
        self._record.note("<", line.decode(errors="replace").strip())
        try:
            report = decode_report(line)
        except WireError as error:
            log.warning("%s", error)
            return False
        self.session.handle(report)
        return isinstance(report, Ready)


def python_of(settings: Settings, folder: Path) -> str:
    """The Python of the installed ROS. `folder`: what paths of settings refer to."""
    return str(folder / settings.python) if "/" in settings.python else settings.python


def missing_programs(settings: Settings, folder: Path) -> Iterator[Mistake]:
    """What the bridge needs, and this computer does not have. `folder`: what paths of settings refer to."""
    python = python_of(settings, folder)
    if settings.setup is not None and not (folder / settings.setup).is_file():
        yield ("setup",), f"there is no file {folder / settings.setup}; name the one of your ROS, such as /opt/ros/jazzy/setup.bash"
    if (settings.setup is None or "/" in settings.python) and shutil.which(python) is None:
        yield ("python",), f"there is no {python}; name the Python of your ROS, or its `setup` file"


def ros_command(settings: Settings, folder: Path, *arguments: str) -> list[str]:
    """The command that runs a program with the Python of the installed ROS. `folder`: what paths of settings refer to."""
    python = python_of(settings, folder)
    if settings.setup is None:
        return [python, *arguments]
    return ["bash", "-c", 'source "$0" && exec "$@"', str(folder / settings.setup), python, *arguments]


def ros_environment(settings: Settings) -> dict[str, str]:
    """The environment of such a program."""
    environment = {**os.environ, **settings.environment}
    if settings.domain is not None:
        environment["ROS_DOMAIN_ID"] = str(settings.domain)
    if settings.discovery is not None:
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = settings.discovery
    return environment
