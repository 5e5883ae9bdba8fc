"""The programs that a system is made of, one process each: Repository, Registry, Task Manager, simulator or symbolic
world, devices.

Each prints one line of JSON when it is ready, ends at SIGTERM or SIGINT, and ends when the process that started it is gone.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import signal
import sys
from collections.abc import Coroutine, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import msgspec

from somrs.client.client import Addresses
from somrs.client.trace import Trace
from somrs.errors import RemoteError, UsageError
from somrs.runtime.host import Host
from somrs.runtime.node import Report, Watch

if TYPE_CHECKING:
    from somrs.devices.simulator.server.simulation import Simulation
    from somrs.ontology.files.loading import LoadedModel
    from somrs.storage.journal import Journal

MAP_TIME = 60.0
"""Seconds that the simulator waits for the map at its start."""

PARENT_CHECK = 1.0
"""Seconds between two looks whether the parent process is still there."""

YOUNG_OBJECTS = 20_000
"""So many objects are made before Python looks for cycles among them; almost all are values without any."""

SWITCH_TIME = 0.0005
"""Seconds after which a thread that waits for the interpreter gets it."""


class Ready(msgspec.Struct, frozen=True, kw_only=True):
    """What a program says when it is up."""

    ready: str
    address: str = msgspec.field(name="at")


async def until_stopped(name: str = "", address: str = "") -> None:
    """Return when somebody wants this process to end, or when its parent is gone. A program that has a name says that it is ready,
    and where: from then on it ends in good order when it is told to."""
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    for signal_number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(signal_number, stopped.set)
    parent = os.getppid()
    if name:
        say_ready(name, address)
    while not stopped.is_set() and os.getppid() == parent:
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stopped.wait(), PARENT_CHECK)


def say_ready(name: str, address: str) -> None:
    print(msgspec.json.encode(Ready(ready=name, address=address)).decode(), flush=True)


def load_site(site: Sequence[Path]) -> LoadedModel:
    """What is in the files of a site. Raises ModelError or UsageError; there is a map in what is returned."""
    from somrs.ontology.files.loading import load

    loaded = load(site)
    if loaded.map is None:
        raise UsageError(f"{', '.join(map(str, site)) or 'no file was given'}: there is no map in it; `objects:` are missing")
    return loaded


async def run_repository(data: Path, site: Sequence[Path], host: str, port: int) -> None:
    """The Repository. A file that is there is gone on with; otherwise the site's files are the beginning."""
    from somrs.repository.component import Repository
    from somrs.repository.state import Contents
    from somrs.storage.repository_store import repository_journal

    def create_repository(address: str) -> Repository:
        loaded = load_site(site)
        assert loaded.map is not None, "load_site sees to that"
        return Repository(address, Contents(ontology=loaded.ontology, map=loaded.map))

    data.mkdir(parents=True, exist_ok=True)
    journal = repository_journal(data / "repository.sqlite")
    try:
        runtime = Host(host, port)
        await runtime.start()
        node = runtime.add_journaled("/repository", create_repository, journal, carry_out=journal.carry_out)
        await until_stopped("repository", node.address)
        await runtime.stop()
    finally:
        journal.close()


async def run_registry(data: Path, addresses: Addresses, host: str, port: int) -> None:
    """The Service Registry. What was listed when its process ended is listed until its leases are over."""
    from somrs.ontology.files.loading import upper
    from somrs.registry.component import SCHEMA, Registry
    from somrs.storage.journal import Journal

    data.mkdir(parents=True, exist_ok=True)
    journal = Journal(data / "registry.sqlite", SCHEMA, f"the Repository at {addresses.repository}")
    try:
        runtime = Host(host, port)
        await runtime.start()
        node = runtime.add_journaled("/registry", lambda address: Registry(address, upper(), addresses.repository), journal)
        await until_stopped("registry", node.address)
        await runtime.stop()
    finally:
        journal.close()


async def run_task_manager(data: Path, addresses: Addresses, host: str, port: int) -> None:
    """The Task Manager, with the planner in a process beside it, so that planning holds nothing up. What it had under way when
    its process ended, it goes on with, at the address that it had."""
    from somrs.planner.model.problem import Problem
    from somrs.planner_service.process import PlannerProcess
    from somrs.planner_service.service import Planner
    from somrs.protocol.messages.records import ReadRecords
    from somrs.storage.archive import FILE
    from somrs.storage.journal import Journal
    from somrs.task_manager.manager import SCHEMA, TaskManager

    data.mkdir(parents=True, exist_ok=True)
    journal = Journal(data / FILE, SCHEMA, f"the Repository at {addresses.repository}, the Registry at {addresses.registry}")
    try:
        trace = Trace(data / "messages.jsonl")
        runtime = await _start_runtime(journal, host, port, trace)
        with PlannerProcess() as process:
            planner = Planner(process)

            async def carry_out(task: object, report: Report) -> object:
                if isinstance(task, ReadRecords):
                    return await journal.carry_out(task, report)
                assert isinstance(task, Problem), "a Task Manager asks for nothing else"
                return await planner.plan(task)

            trace.coordinator = f"{runtime.url}/task-manager"
            node = runtime.add_journaled(
                "/task-manager",
                lambda address: TaskManager(address, repository=addresses.repository, registry=addresses.registry),
                journal,
                carry_out=carry_out,
            )
            await until_stopped("task-manager", node.address)
            await runtime.stop()
        trace.close()
    finally:
        journal.close()


async def _start_runtime(journal: Journal, host: str, port: int, watch: Watch) -> Host:
    """Listen at the port, or where the journal's owner was reached before: participants know that address only."""
    last_port = urlsplit(journal.address).port or 0
    runtime = Host(host, port or last_port, watch)
    try:
        await runtime.start()
    except UsageError as error:
        if port or not last_port:
            raise
        if journal.open:
            explanation = f"whoever works for one of the {len(journal.open)} open tasks knows the Task Manager at {journal.address} only"
            raise UsageError(f"{error}; but {explanation}: stop what listens there") from None
        runtime = Host(host, 0, watch)
        await runtime.start()
    return runtime


def speed_of(text: str) -> float | None:
    """Simulated seconds per second; None, as fast as the processor allows, for `max`."""
    if text == "max":
        return None
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not 0 < speed < 1000:
        raise UsageError(f"a speed is `max` or a number such as 1 (real time) or 4, and not {text!r}")
    return speed


async def run_simulator(addresses: Addresses, host: str, port: int, speed: float | None) -> None:
    """The simulator. Its world is made of the map that the Repository has, and follows what is added to it."""
    from somrs.devices.simulator.server.follower import Follower

    runtime = Host(host)
    await runtime.start()
    world = Follower(f"{runtime.url}/simulator", addresses.repository)
    runtime.add("/simulator", lambda address: world)
    try:
        await asyncio.wait_for(world.read.wait(), MAP_TIME)
        assert world.simulation is not None, "it is there once the map was read"
        await _serve_robots(world.simulation, host, port, speed)
    except TimeoutError:
        raise RemoteError(f"no map came from {addresses.repository} within {MAP_TIME:.0f} s; is the Repository running?") from None
    finally:
        await runtime.stop()


async def run_simulator_of_files(site: Sequence[Path], host: str, port: int, speed: float | None) -> None:
    """The simulator alone, for whoever writes drivers: its world is made of the files' map."""
    from somrs.devices.simulator.server.simulation import Simulation

    loaded = load_site(site)
    assert loaded.map is not None, "load_site sees to that"
    await _serve_robots(Simulation(loaded.map, loaded.ontology), host, port, speed)


async def run_world(addresses: Addresses, host: str, port: int, speed: float | None) -> None:
    """The symbolic world: its truth begins with the map that the Repository has."""
    from somrs.client.client import Client
    from somrs.devices.symbolic.server import WorldServer
    from somrs.devices.symbolic.world import SymbolicWorld

    async with Client(addresses) as client:
        world = SymbolicWorld(await client.ontology(), await client.map())
    server = WorldServer(world, host=host, port=port, speed=speed)
    await server.start()
    await until_stopped("world", f"{server.host}:{server.port}")
    await server.stop()


def has_windows() -> bool:
    """Whether the libraries are installed that the windows are made with."""
    return find_spec("nicegui") is not None


async def _serve_robots(simulation: Simulation, host: str, port: int, speed: float | None) -> None:
    """Serve the world's robots until this process is to end, or the physics makes no sense any more."""
    from somrs.devices.simulator.server.server import Server

    server = Server(simulation, host=host, port=port, speed=speed)
    await server.start()
    stop_waiter = asyncio.create_task(until_stopped("simulator", f"{server.host}:{server.port}"))
    running = [stop_waiter, asyncio.create_task(server.ended())]
    await asyncio.wait(running, return_when=asyncio.FIRST_COMPLETED)
    for task in running:
        task.cancel()
    await server.stop()


def run_program(main: Coroutine[Any, Any, None]) -> None:
    """Run a program's coroutine, on the fast event loop where it is to be had."""
    # The thread that writes to disk needs the interpreter for moments only, but often; by default a busy loop makes it wait 5 ms
    # for each, and a commit takes several.
    sys.setswitchinterval(SWITCH_TIME)
    gc.set_threshold(YOUNG_OBJECTS)
    try:
        import uvloop
    except ImportError:
        asyncio.run(main)
    else:
        uvloop.run(main)
