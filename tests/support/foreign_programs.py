"""Programs of other makes, in processes of their own, made from the descriptions that the components serve."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from tests.support.paths import ROOT

PROGRAM = ROOT / "tests" / "support" / "javascript" / "participant.js"
NOT_INSTALLED = "a robot made with node-soap, because npm's soap is not in node_modules; `make javascript` installs it"
OLD_NODE = "a robot made with node-soap, because npm's soap needs node 20 or newer"


class ForeignParticipant:
    """A robot that writes a line of JSON for what the Registry has answered it, and for each message that comes."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def published(self) -> dict[str, Any]:
        """What the Registry has answered to its offers; waits for it."""
        return dict(self._line()["published"])

    def heard_until(self, last_name: str) -> list[str]:
        """The names of the messages that it has received, up to the first with this name; waits for that."""
        names: list[str] = []
        while last_name not in names:
            names.append(self._line()["name"])
        return names

    def _line(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the robot has ended"
        return dict(json.loads(line))


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


@contextmanager
def running_participant(command: Sequence[str]) -> Iterator[ForeignParticipant]:
    """Run a robot."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        yield ForeignParticipant(process)
    finally:
        process.kill()
        process.communicate()


def node_participant(configuration: Mapping[str, object]) -> list[str]:
    """The command of a robot made with node-soap, configured as `javascript/participant.js` says. Skips the test if it is not installed."""
    node = shutil.which("node")
    if node is None or not (ROOT / "node_modules" / "soap").exists():
        pytest.skip(NOT_INSTALLED)
    if int(subprocess.run([node, "--version"], capture_output=True, text=True, check=True).stdout.lstrip("v").split(".")[0]) < 20:
        pytest.skip(OLD_NODE)
    return [node, str(PROGRAM), json.dumps(configuration)]
