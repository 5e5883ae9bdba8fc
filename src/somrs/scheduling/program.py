"""The Scheduler as a program of its own: whoever else runs or not, orders are stated."""

from __future__ import annotations

from pathlib import Path

from somrs.client.client import Addresses
from somrs.deployment.programs import until_stopped
from somrs.runtime.clock import TimeOfDay, local_zone
from somrs.runtime.host import Host
from somrs.runtime.node import Node
from somrs.scheduling.component import Scheduler
from somrs.scheduling.state import Located
from somrs.scheduling.store import FILE, orders_journal
from somrs.storage.journal import Journal

PATH = "/scheduler"


async def run_scheduler(data: Path, addresses: Addresses, host: str, port: int) -> None:
    """Keep templates and orders, and state what is due, until this process is to end."""
    data.mkdir(parents=True, exist_ok=True)
    journal = orders_journal(data / FILE)
    try:
        runtime = Host(host, port, clock=TimeOfDay())
        await runtime.start()
        await until_stopped("scheduler", add_scheduler(runtime, journal, addresses).address)
        await runtime.stop()
    finally:
        journal.close()


def add_scheduler(runtime: Host, journal: Journal, addresses: Addresses) -> Node:
    """A Scheduler with that journal, at its path."""
    located = Located(addresses.repository, addresses.task_manager, local_zone())
    # The other parts may be elsewhere since the journal was written, and so may the machine.
    return runtime.add_journaled(PATH, lambda address: Scheduler(address, located), journal, notices=(located,))
