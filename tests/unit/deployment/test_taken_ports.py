"""Servers that bind their ports by themselves: whoever has the port is not taken for them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

from somrs.deployment.bus_server import run_bus
from somrs.deployment.mqtt_broker import run_broker
from somrs.errors import UsageError
from somrs.ports import listen_at

SERVERS: dict[str, Callable[[Path, int], Coroutine[Any, Any, None]]] = {
    "a broker": lambda data, port: run_broker(data, "127.0.0.1", port),
    "a server of a bus": lambda data, port: run_bus(data, "127.0.0.1", port),
    "the broker of a bus": lambda data, port: run_bus(data, "127.0.0.1", 0, mqtt=f"127.0.0.1:{port}"),
}


@pytest.mark.parametrize("server", SERVERS)
def test_a_taken_port_is_named(tmp_path: Path, server: str) -> None:
    with listen_at("127.0.0.1", 0) as other:
        port = other.getsockname()[1]
        with pytest.raises(UsageError, match=r"cannot listen at 127\.0\.0\.1:\d+: Address already in use; another --port"):
            asyncio.run(SERVERS[server](tmp_path, port))
