"""The Scheduler as a program, so that it runs independently of windows and clients."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from somrs.client.addresses import Addresses
from somrs.deployment.continuation import continuing
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
    file = data / FILE
    async with (
        continuing(addresses.bus, "scheduler", file, partial(orders_journal, file)) as continuation,
        Host(host, port, clock=TimeOfDay(), bus=addresses.bus) as runtime,
    ):
        located = _located(addresses)
        node = await continuation.add(runtime, PATH, lambda address: Scheduler(address, located), notices=(located,))
        await continuation.serve("scheduler", node)


def add_scheduler(runtime: Host, journal: Journal, addresses: Addresses) -> Node:
    """Add a Scheduler with this journal to the runtime, at its path."""
    located = _located(addresses)
    return runtime.add_journaled(PATH, lambda address: Scheduler(address, located), journal, notices=(located,))


def _located(addresses: Addresses) -> Located:
    """A notice, because the addresses and the time zone may have changed since the journal was written."""
    return Located(addresses.repository, addresses.task_manager, local_zone(), addresses.further_task_managers)
