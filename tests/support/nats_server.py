"""A NATS server for tests, which can be killed and started again with what it has stored."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sysconfig
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Self

from somrs.runtime.bus_address import BusAddress
from tests.support.free_ports import free_port
from tests.support.hang import HANG_TIME


class NatsServer:
    """A context manager. `gateway`: the URL below which the addresses of the site are. `settings`: of JetStream."""

    def __init__(self, folder: Path, gateway: str = "http://127.0.0.1:1", settings: Mapping[str, int] | None = None) -> None:
        self.port = free_port()
        self.address = BusAddress(servers=f"nats://127.0.0.1:{self.port}", site="yard", gateway=gateway)
        self._settings = folder / "nats.json"
        jetstream = {"store_dir": str(folder / "nats"), "sync_interval": "always"} | dict(settings or {})
        self._settings.write_text(
            json.dumps({"host": "127.0.0.1", "port": self.port, "log_file": str(folder / "nats.log"), "jetstream": jetstream})
        )
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self.kill()

    def start(self) -> None:
        """Start it, and wait until it can be reached."""
        program = shutil.which("nats-server", path=sysconfig.get_path("scripts"))
        assert program is not None, "the extra `bus` is installed with what the tests need"
        self._process = subprocess.Popen([program, "--config", str(self._settings)])
        deadline = time.monotonic() + HANG_TIME
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port)).close()
            except ConnectionRefusedError:
                assert self._process.poll() is None, "it has ended"
                assert time.monotonic() < deadline, "it cannot be reached"
                time.sleep(0.02)
            else:
                return

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
