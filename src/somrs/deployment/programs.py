"""The programs of a system, each a process: Repository, Registry, Task Manager, and simulator or symbolic world.

Each program prints one line of JSON when it is ready. It ends at SIGTERM or SIGINT, and when its parent process has ended.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import os
import resource
import signal
import sys
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Sequence
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

import msgspec

from somrs.client.addresses import Addresses
from somrs.deployment.private_files import keep_files_private
from somrs.deployment.watchdog import Heartbeat
from somrs.errors import RemoteError, UsageError
from somrs.runtime.host import Host
from somrs.runtime.wire import REMINDER
from somrs.trust.credentials import Credentials
from somrs.worker import fork_ahead

if TYPE_CHECKING:
    from somrs.devices.simulator.server.follower import Followed
    from somrs.devices.simulator.server.server import Server
    from somrs.devices.simulator.server.simulation import Simulation
    from somrs.devices.simulator.world.kinds import WorldKind
    from somrs.ontology.files.loaded import LoadedModel

log = logging.getLogger(__name__)

T = TypeVar("T")

STOP_SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
"""SIGHUP comes when the terminal closes; `nohup` ignores it. SIGINT counts even if a shell has started this process in the background, and
ignores it."""

PARENT_CHECK = 1.0
"""Seconds between two checks that the parent process is still alive."""

YOUNG_OBJECTS = 20_000
"""Threshold of the garbage collector's youngest generation. It is high because almost all objects are values without cycles."""

OPEN_FILES = 65_536
"""How many files a program may have open, where the system allows it."""

SWITCH_TIME = 0.0005
"""The interpreter's thread switch interval, in seconds."""


FIRST_PAUSE = 0.2
"""Seconds before what has ended is started again. Each further pause is twice as long."""

MOST_PAUSE = 10.0
"""Longest such pause, in seconds."""


class Ready(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The line that a program prints when it is ready. `problems`: what does not work yet although it is ready, for people."""

    ready: str
    address: str = msgspec.field(name="at")
    problems: tuple[str, ...] = ()


async def others_ready(waiting: Awaitable[T], missing_text: Callable[[], str]) -> T:
    """Wait for what this program needs of others before it is ready, however long: they may start later, and machines may be busy.

    What is missing is said in the log. Raises RemoteError when the process that started this one has ended.
    """
    parent, reminded_at = parent_process(), time.monotonic()
    task = asyncio.ensure_future(waiting)
    try:
        while not (await asyncio.wait([task], timeout=PARENT_CHECK))[0]:
            if os.getppid() != parent:
                raise RemoteError(f"this program ends, because the process that started it has ended; {missing_text()}")
            if time.monotonic() >= reminded_at + REMINDER:
                reminded_at = time.monotonic()
                log.warning("%s", missing_text())
        return task.result()
    finally:
        task.cancel()


@cache
def parent_process() -> int:
    """The process that has started this one, with which it ends. It is asked at first while that is there: a process whose parent has ended
    has another one."""
    return os.getppid()


async def until_stopped(name: str = "", address: str = "", problems: tuple[str, ...] = ()) -> None:
    """Wait until SIGTERM, SIGINT, or the end of the parent process, which is logged.

    With `name`, print the ready line once the signal handlers are set: from then on the program ends in order.
    """
    stopped = asyncio.ensure_future(stop_signal())
    await asyncio.sleep(0)  # until the signals are handled
    parent = parent_process()
    if name:
        say_ready(name, address, problems)
    heartbeat = Heartbeat()
    while not stopped.done() and os.getppid() == parent:
        heartbeat.beat()
        await asyncio.wait([stopped], timeout=PARENT_CHECK)
    if not stopped.done():
        stopped.cancel()
        log.warning("%s ends, because the process that started it has ended", name or "this program")


async def stop_signal() -> str:
    """Wait until this process is asked to stop, and return the name of the signal. From then on it is asked in vain."""
    return await _handle_stop_signals().get()


@contextlib.contextmanager
def stop_signals() -> Iterator[asyncio.Queue[str]]:
    """The names of the signals that ask this process to stop, as they come."""
    try:
        yield _handle_stop_signals()
    finally:
        for number in STOP_SIGNALS:
            asyncio.get_running_loop().remove_signal_handler(number)


def _handle_stop_signals() -> asyncio.Queue[str]:
    received: asyncio.Queue[str] = asyncio.Queue()
    for number in STOP_SIGNALS:
        if number is not signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            asyncio.get_running_loop().add_signal_handler(number, received.put_nowait, number.name)
    return received


def say_ready(name: str, address: str, problems: tuple[str, ...] = ()) -> None:
    """Print the ready line. Whoever ends a system while it starts reads it no more, and ends this program, too."""
    line = msgspec.json.encode(Ready(ready=name, address=address, problems=problems))
    try:
        print(line.decode(), flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the interpreter writes it again when it ends


def load_site(site: Sequence[Path]) -> LoadedModel:
    """Load the files of a site. The result has a map. Raises ModelError, or UsageError when the files contain no map."""
    from somrs.ontology.files.loading import load

    loaded = load(site)
    if loaded.map is None:
        raise UsageError(f"{', '.join(map(str, site)) or 'no file was given'}: there is no map in it; `objects:` are missing")
    return loaded


def map_name(site: Sequence[Path]) -> str:
    """The name of the map of a site, by which neighbours know it; empty if the site is not given, as to a standby."""
    map = load_site(site).map if site else None
    return map.name if map is not None else ""


def speed_of(text: str) -> float | None:
    """Simulated seconds per second; None for `max`, which is as fast as the processor allows. Raises UsageError."""
    if text == "max":
        return None
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not 0 < speed < 1000:
        raise UsageError(f"a speed is `max` or a number such as 1 (real time) or 4, not {text!r}")
    return speed


async def run_simulator(
    data: Path,
    addresses: Addresses,
    host: str,
    port: int,
    speed: float | None,
    kind: WorldKind,
    repositories: Sequence[str] = (),
) -> None:
    """Run the simulator. Its world, of this kind, is built from the Repository's map, or from those of several `repositories`. Objects that
    are added to a map are added to it.

    It has the traffic of its building, in which robots that are not simulated take part at the address of traffic.
    """
    from somrs.deployment.traffic_entrance import FOREIGN_FILE, lay_out_beside, serve_simulated_traffic
    from somrs.deployment.traffic_worker import TrafficWorker
    from somrs.devices.simulator.server.follower import Followed, Follower
    from somrs.devices.simulator.server.server import Server
    from somrs.devices.simulator.server.simulated_world import SimulatedWorld

    runtime = Host(host, urlsplit(addresses.traffic or "").port or 0, bus=addresses.bus)
    await runtime.start()
    followed = Followed(SimulatedWorld(kind, f"{runtime.url}/traffic"), repositories or [addresses.repository])
    for number, repository in enumerate(followed.unread, 1):
        runtime.add("/simulator" if number == 1 else f"/simulator-{number}", partial(Follower, repository=repository, followed=followed))
    try:
        simulation = await simulated(followed)
        server = Server(
            simulation, host=host, port=port, speed=speed, is_shared=followed.is_shared, credentials=Credentials.of_environment()
        )
        serve_simulated_traffic(simulation, runtime, server.wake, data / FOREIGN_FILE)
        with TrafficWorker() as worker:
            lay_out_beside(simulation, worker, server.wake)
            await _serve_robots(server)
    finally:
        await runtime.stop()


async def simulated(followed: Followed) -> Simulation:
    """The simulation of the maps, when these have been read. However long its making takes: a large building takes a minute on a busy
    machine.

    The maps are waited for, as their systems may start later. Raises UsageError for several maps of one name.
    """
    world = followed.world
    await others_ready(world.read.wait(), lambda: f"no map came from {' and '.join(followed.unread)} yet; is the Repository running?")
    if followed.problem:
        raise UsageError(followed.problem)
    assert world.simulation is not None, "made when the maps have been read"
    return world.simulation


async def run_simulator_of_files(site: Sequence[Path], host: str, port: int, speed: float | None, kind: WorldKind) -> None:
    """Run the simulator alone, for developers of drivers: its world is built from the map in the files."""
    from somrs.devices.simulator.server.server import Server
    from somrs.devices.simulator.server.simulation import Simulation

    loaded = load_site(site)
    assert loaded.map is not None, "load_site returns a map"
    await _serve_robots(Server(Simulation(loaded.map, loaded.ontology, kind), host=host, port=port, speed=speed))


async def run_world(addresses: Addresses, host: str, port: int, speed: float | None) -> None:
    """Run the symbolic world. Its initial state is the Repository's map."""
    from somrs.client.client import Client
    from somrs.devices.symbolic.server import WorldServer
    from somrs.devices.symbolic.world import SymbolicWorld

    async with Client(addresses) as client:
        world = SymbolicWorld(await client.ontology(), await client.map())
    server = WorldServer(world, host=host, port=port, speed=speed, credentials=Credentials.of_environment())
    await server.start()
    await until_stopped("world", f"{server.host}:{server.port}")
    await server.stop()


def has_windows() -> bool:
    """Whether the libraries of the windows are installed."""
    return find_spec("nicegui") is not None


async def _serve_robots(server: Server) -> None:
    """Serve the simulated robots until this process is stopped, or the physics diverges."""
    await server.start()
    stop_waiter = asyncio.create_task(until_stopped("simulator", f"{server.host}:{server.port}"))
    running = [stop_waiter, asyncio.create_task(server.ended())]
    await asyncio.wait(running, return_when=asyncio.FIRST_COMPLETED)
    for task in running:
        task.cancel()
    await server.stop()


def _allow_open_files() -> None:
    """Let this process have more files open than is usual, as each connection is one."""
    soft_limit, hard_limit = resource.getrlimit(resource.RLIMIT_NOFILE)
    allowed = OPEN_FILES if hard_limit == resource.RLIM_INFINITY else min(OPEN_FILES, hard_limit)
    if soft_limit != resource.RLIM_INFINITY and soft_limit < allowed:
        resource.setrlimit(resource.RLIMIT_NOFILE, (allowed, hard_limit))


def run_program(main: Coroutine[Any, Any, None], *, has_worker: bool = False) -> None:
    """Run a program's coroutine, on uvloop if it is installed. With a worker, fork the process for it first. Its files are private."""
    keep_files_private()
    _allow_open_files()
    if has_worker:
        fork_ahead()
    # The thread that writes to disk needs the interpreter often, each time briefly. With the default interval it waits 5 ms each
    # time for a busy event loop, several times in a commit.
    sys.setswitchinterval(SWITCH_TIME)
    gc.set_threshold(YOUNG_OBJECTS)
    try:
        import uvloop
    except ImportError:
        asyncio.run(main)
    else:
        uvloop.run(main)
