"""What surrounds a simulation's traffic: its address, where robots take part that are not simulated, and the making of its roadmaps."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from somrs.atomic_files import write_atomically
from somrs.errors import RemoteError, SimulationError, UsageError
from somrs.kernel.component import Effect, Input, Notified, Received, Send
from somrs.protocol.messages.envelope import Message
from somrs.runtime.host import Host
from somrs.traffic.state import Position

if TYPE_CHECKING:
    from somrs.deployment.traffic_worker import TrafficWorker
    from somrs.devices.simulator.server.simulated_traffic import UseRoadmap
    from somrs.devices.simulator.server.simulation import Simulation
    from somrs.traffic.layout import Layout

log = logging.getLogger(__name__)

FOREIGN_FILE = "foreign-robots.json"
"""The file in the data folder with the positions of robots that are not simulated."""

PATH = "/traffic"
"""The path of traffic, whoever has it."""


class TrafficEntrance:
    """A component that passes messages on to the traffic of a simulation, and notices of it as messages to their recipients."""

    def __init__(self, receive: Callable[[Message], None]) -> None:
        self._receive = receive

    def handle(self, event: Input, now: float) -> list[Effect]:
        match event:
            case Received(message):
                self._receive(message)
            case Notified(Message() as message):
                return [Send(message)]
        return []


class ForeignPositions:
    """Where the robots may be that are not simulated, in a file: a simulator that is started again does not know them otherwise."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def read(self) -> dict[str, tuple[Position, ...]]:
        """Raises UsageError if the file cannot be read."""
        try:
            return _POSITIONS.decode(self._file.read_bytes())
        except FileNotFoundError:
            return {}
        except (msgspec.DecodeError, OSError) as error:
            raise UsageError(
                f"{self._file}, with the places of robots in traffic, cannot be read: {error}; make sure that no robot stands in a way, "
                "and move the file away"
            ) from None

    def store(self, positions: Mapping[str, tuple[Position, ...]]) -> None:
        """Raises SimulationError: robots must not be told what a simulator that is started again would not know."""
        try:
            write_atomically(self._file, msgspec.json.encode(positions))
        except OSError as error:
            raise SimulationError(
                f"{self._file}: the places of robots in traffic cannot be kept: {error.strerror or error}; make room on the disk, "
                "and start the simulator again"
            ) from None


_POSITIONS: msgspec.json.Decoder[dict[str, tuple[Position, ...]]] = msgspec.json.Decoder(dict[str, tuple[Position, ...]])


def serve_simulated_traffic(simulation: Simulation, runtime: Host, wake: Callable[[], None], file: Path) -> None:
    """Let robots that are not simulated take part in the traffic of a simulation. `wake`: has the simulation go on, if it is at rest.
    `file`: keeps where they may be. Raises UsageError if it cannot be read."""
    positions = ForeignPositions(file)
    stored_positions = positions.read()

    def receive(message: Message) -> None:
        simulation.shared_traffic.receive(message)
        wake()

    node = runtime.add(PATH, lambda address: TrafficEntrance(receive))
    simulation.shared_traffic.serve(lambda message: node.feed(Notified(message)), positions.store, stored_positions)


def lay_out_beside(simulation: Simulation, worker: TrafficWorker, wake: Callable[[], None]) -> None:
    """Have the roadmaps of a simulation made by the worker. `wake`: as above."""
    running: set[asyncio.Task[None]] = set()

    async def work(layout: Layout, use: UseRoadmap) -> None:
        try:
            use(await worker.lay_out(layout))
        except RemoteError as error:
            log.error("the robots keep the roadmap that they have, because the one for the changed building could not be made: %s", error)
            use(None)
        wake()

    def begin(layout: Layout, use: UseRoadmap) -> None:
        task = asyncio.create_task(work(layout, use))
        running.add(task)
        task.add_done_callback(running.discard)

    simulation.shared_traffic.layouter = begin
