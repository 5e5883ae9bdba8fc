"""What surrounds a simulation's traffic: its address, where robots take part that are not simulated, and the making of its roadmaps."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from somrs.errors import RemoteError
from somrs.kernel.component import Effect, Input, Notified, Received, Send
from somrs.protocol.messages.envelope import Message
from somrs.runtime.host import Host

if TYPE_CHECKING:
    from somrs.deployment.traffic_worker import TrafficWorker
    from somrs.devices.simulator.server.simulated_traffic import UseRoadmap
    from somrs.devices.simulator.server.simulation import Simulation
    from somrs.traffic.layout import Layout

log = logging.getLogger(__name__)

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


def serve_simulated_traffic(simulation: Simulation, runtime: Host, wake: Callable[[], None]) -> None:
    """Let robots that are not simulated take part in the traffic of a simulation. `wake`: has the simulation go on, if it is at rest."""

    def receive(message: Message) -> None:
        simulation.receive(message)
        wake()

    node = runtime.add(PATH, lambda address: TrafficEntrance(receive))
    simulation.serve_traffic(lambda message: node.feed(Notified(message)))


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

    simulation.lay_out_with(begin)
