"""The Scheduler as a program of its own: whoever else runs or not, orders are stated."""

from __future__ import annotations

from pathlib import Path

from somrs.client.client import Addresses
from somrs.deployment.programs import say_ready, until_stopped
from somrs.runtime.clock import TimeOfDay
from somrs.runtime.host import Host
from somrs.runtime.node import Node
from somrs.scheduling.component import Scheduler
from somrs.scheduling.store import FILE, BookFile

PATH = "/scheduler"


async def run_scheduler(data: Path, addresses: Addresses, host: str, port: int) -> None:
    """Keep templates and orders, and state what is due, until this process is to end."""
    data.mkdir(parents=True, exist_ok=True)
    file = BookFile(data / FILE)
    try:
        rim = Host(host, port, clock=TimeOfDay())
        await rim.start()
        say_ready("scheduler", put(rim, file, addresses).address)
        await until_stopped()
        await rim.stop()
    finally:
        file.close()


def put(rim: Host, file: BookFile, addresses: Addresses) -> Node:
    """A Scheduler with that file, at its path."""
    return rim.add(
        PATH,
        lambda address: Scheduler(address, addresses.repository, addresses.task_manager, file.load()),
        keep=file.keep,
        disk=file.disk,
    )
