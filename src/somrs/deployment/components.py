"""The components of a system as programs: Repository, Registry and Task Manager."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from somrs.client.addresses import Addresses, registry_name, registry_path, task_manager_path
from somrs.client.trace import Trace, trace_file
from somrs.deployment.continuation import continuing
from somrs.deployment.programs import load_site, map_name
from somrs.errors import UsageError
from somrs.runtime.bus_address import BusAddress
from somrs.runtime.host import Host
from somrs.runtime.node import Report, Watch

if TYPE_CHECKING:
    from somrs.storage.journal import Journal


async def run_repository(
    data: Path, site: Sequence[Path], host: str, port: int, bus: BusAddress | None = None, neighbours: Path | None = None
) -> None:
    """Run the Repository. It continues from its journal, or starts with the site's files when there is none.

    `neighbours`: the file of its neighbours; None: it has none.
    """
    from somrs.deployment.neighbours import read_neighbouring_maps
    from somrs.repository.component import Repository
    from somrs.repository.neighbouring import NeighboursConfigured
    from somrs.repository.state import Contents
    from somrs.storage.repository_store import repository_journal

    def create_repository(address: str) -> Repository:
        loaded = load_site(site)
        assert loaded.map is not None, "load_site returns a map"
        return Repository(address, Contents(ontology=loaded.ontology, map=loaded.map))

    map = map_name(site) if neighbours is not None else ""
    configured = NeighboursConfigured(map=map, neighbours=read_neighbouring_maps(neighbours, map) if neighbours is not None else ())
    file = data / "repository.sqlite"
    open_journal = partial(repository_journal, file)
    async with continuing(bus, "repository", file, open_journal) as continuation, Host(host, port, bus=bus) as runtime:
        node = await continuation.add(
            runtime, "/repository", create_repository, carry_out=continuation.journal.carry_out, notices=(configured,)
        )
        await continuation.serve("repository", node)


async def run_registry(data: Path, addresses: Addresses, host: str, port: int, neighbours: Path | None = None, number: int = 1) -> None:
    """Run the Service Registry with this number. Offers that were listed when its process ended remain listed until their leases expire.

    `neighbours`: the file of its neighbours; None: it has none but the other Registries of the system.
    """
    from somrs.deployment.bus import list_number
    from somrs.deployment.neighbours import read_neighbours
    from somrs.ontology.files.loading import upper
    from somrs.registry.component import SCHEMA, Registry
    from somrs.registry.neighbours import Configured, Neighbour, check_neighbours
    from somrs.registry.selection import Selection
    from somrs.storage.journal import Journal

    others = {name: address for name, address in addresses.registries.items() if name != registry_name(number)}
    everything = Selection()
    of_system = (
        Neighbour(name=name, address=address, takes=everything, gives=everything, is_of_site=True) for name, address in others.items()
    )
    configured = Configured((*of_system, *(read_neighbours(neighbours) if neighbours is not None else ())))
    path = registry_path(number)
    file = data / f"{path.strip('/')}.sqlite"
    open_journal = partial(Journal, file, SCHEMA, f"the Repository at {addresses.repository}")
    async with (
        continuing(addresses.bus, path.strip("/"), file, lambda log: open_journal(log=log)) as continuation,
        Host(host, port, bus=addresses.bus) as runtime,
    ):
        check_neighbours(configured.neighbours, f"{runtime.url}{path}")
        node = await continuation.add(
            runtime, path, lambda address: Registry(address, upper(), addresses.repository), notices=(configured,)
        )
        if addresses.bus is not None:
            await list_number(addresses.bus, registry=number)
        await continuation.serve("registry", node)


async def run_task_manager(data: Path, addresses: Addresses, host: str, port: int, number: int = 1) -> None:
    """Run the Task Manager with this number, with the planner in a separate process so that planning does not delay messages.

    It continues the tasks that were open when its process ended, at the same address.
    """
    from somrs.deployment.bus import list_number
    from somrs.deployment.world_clock import clock_follower
    from somrs.planner.model.problem import Problem
    from somrs.planner_service.process import PlannerProcess
    from somrs.planner_service.service import Planner
    from somrs.protocol.messages.records import ReadRecords
    from somrs.storage.archive import archive_file
    from somrs.storage.journal import Journal
    from somrs.task_manager.manager import SCHEMA, TaskManager

    file = archive_file(data, number)
    open_journal = partial(Journal, file, SCHEMA, f"the Repository at {addresses.repository}, the Registry at {addresses.registry}")
    path = task_manager_path(number)
    async with continuing(addresses.bus, path.strip("/"), file, lambda log: open_journal(log=log)) as continuation:
        trace = Trace(trace_file(data, number))
        runtime = await _start_runtime(continuation.journal, host, port, trace, addresses.bus)
        async with contextlib.AsyncExitStack() as stack:
            stack.callback(trace.close)
            stack.push_async_callback(runtime.stop)
            process = stack.enter_context(PlannerProcess())
            planner = Planner(process)

            async def carry_out(task: object, report: Report) -> object:
                if isinstance(task, ReadRecords):
                    return await continuation.journal.carry_out(task, report)
                assert isinstance(task, Problem), "a Task Manager requests nothing else"
                return await planner.plan(task)

            trace.coordinator = f"{runtime.url}{path}"
            node = await continuation.add(
                runtime,
                path,
                lambda address: TaskManager(address, repository=addresses.repository, registry=addresses.registries_for(path)[0]),
                carry_out=carry_out,
            )
            if addresses.bus is not None:
                await list_number(addresses.bus, task_manager=number)
            async with clock_follower(node, runtime.clock, addresses.simulator):
                await continuation.serve("task-manager", node)


async def _start_runtime(journal: Journal, host: str, port: int, watch: Watch, bus: BusAddress | None) -> Host:
    """Listen on the bus, or else at `port`, or at the port of the last run: participants know only that address."""
    last_port = urlsplit(journal.address).port or 0
    runtime = Host(host, port or last_port, watch, bus=bus)
    try:
        await runtime.start()
    except UsageError as error:
        if port or not last_port:
            raise
        if journal.open:
            explanation = f"the participants of its open tasks ({len(journal.open)}) know the Task Manager only as {journal.address}"
            raise UsageError(f"{error}; {explanation}: stop the program that listens there") from None
        runtime = Host(host, 0, watch)
        await runtime.start()
    return runtime
