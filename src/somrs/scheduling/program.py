"""The Scheduler as a program, so that it runs independently of windows and clients."""

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
    """Run the Scheduler until this process is asked to stop."""
    data.mkdir(parents=True, exist_ok=True)
    journal = orders_journal(data / FILE)
    try:
        runtime = Host(host, port, clock=TimeOfDay(), bus=addresses.bus)
        await runtime.start()
        node = add_scheduler(runtime, journal, addresses)
        await runtime.listening()
        await until_stopped("scheduler", node.address)
        await runtime.stop()
    finally:
        journal.close()


def add_scheduler(runtime: Host, journal: Journal, addresses: Addresses) -> Node:
    """Add a Scheduler with this journal to the runtime, at its path."""
    located = Located(addresses.repository, addresses.task_manager, local_zone())
    # The addresses and the time zone may have changed since the journal was written.
    return runtime.add_journaled(PATH, lambda address: Scheduler(address, located), journal, notices=(located,))
