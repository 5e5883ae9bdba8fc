"""An MQTT broker for tests: a NATS server, which is one."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from tests.support.free_ports import free_port
from tests.support.hang import HANG_TIME
from tests.support.nats_server import NatsServer

NO_USERS: Mapping[str, str] = MappingProxyType({})


class MqttBroker(NatsServer):
    """A context manager. It can be killed and started again with what it has stored.

    `users`: passwords by name; none: anybody may connect. `certificate`, `key`: files in PEM, with which it speaks TLS.
    """

    def __init__(self, folder: Path, users: Mapping[str, str] = NO_USERS, certificate: Path | None = None, key: Path | None = None) -> None:
        super().__init__(folder)
        self.mqtt_port = free_port()
        settings = json.loads(self._settings.read_text())
        settings["server_name"] = "broker"
        settings["mqtt"] = {"host": "127.0.0.1", "port": self.mqtt_port}
        if certificate is not None:
            settings["mqtt"]["tls"] = {"cert_file": str(certificate), "key_file": str(key)}
        if users:
            settings["authorization"] = {"users": [{"user": user, "password": password} for user, password in users.items()]}
        self._settings.write_text(json.dumps(settings))

    @property
    def url(self) -> str:
        return f"mqtt://127.0.0.1:{self.mqtt_port}"

    def start(self) -> None:
        super().start()
        deadline = time.monotonic() + HANG_TIME
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.mqtt_port)).close()
            except ConnectionRefusedError:
                assert time.monotonic() < deadline, "it cannot be reached by MQTT"
                time.sleep(0.02)
            else:
                return
