"""A broker for MQTT 3.1.1 (`somrs run broker`): a NATS server, for adapters whose site has no broker of its own."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

from somrs.deployment.bus_server import end_text, end_with_parent, nats_server
from somrs.deployment.programs import until_stopped
from somrs.errors import RemoteError
from somrs.limits import limits
from somrs.ports import check_free, until_listening

CONFIGURATION = "server.conf"


def earlier_port(data: Path) -> int:
    """The port at which the broker of an earlier run was; 0 if there was none."""
    try:
        port = json.loads((_folder(data) / CONFIGURATION).read_text())["mqtt"]["port"]
    except (OSError, ValueError, KeyError, TypeError):
        return 0
    return port if isinstance(port, int) else 0


def _folder(data: Path) -> Path:
    return data / "broker"


async def run_broker(data: Path, host: str, port: int) -> None:
    """Run the broker until this process is asked to stop. What is retained is in the folder `broker` of the data folder.

    Raises UsageError when there is no NATS server on this machine, or when the port is taken, and RemoteError when it ends.
    """
    check_free(host, port)
    folder = _folder(data).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    settings = {
        "host": host,
        "port": -1,  # for the protocol of NATS, which nobody uses here
        "server_name": "somrs-broker",
        "log_file": str(folder / "server.log"),
        "log_size_limit": limits().log_bytes,
        "jetstream": {"store_dir": str(folder)},
        "mqtt": {"host": host, "port": port},
    }
    (folder / CONFIGURATION).write_text(json.dumps(settings, indent=2))
    process = await asyncio.create_subprocess_exec(nats_server(), "--config", str(folder / CONFIGURATION), preexec_fn=end_with_parent)
    ending = asyncio.create_task(process.wait())
    listening = asyncio.create_task(until_listening(f"{host}:{port}"))
    try:
        await asyncio.wait({listening, ending}, return_when=asyncio.FIRST_COMPLETED)
        stopping = asyncio.create_task(until_stopped("broker", f"mqtt://{host}:{port}"))
        await asyncio.wait({stopping, ending}, return_when=asyncio.FIRST_COMPLETED)
        if not stopping.done():
            stopping.cancel()
            raise RemoteError(end_text(folder, ending.result()))
    finally:
        listening.cancel()
        if process.returncode is None:
            process.terminate()
            await process.wait()
