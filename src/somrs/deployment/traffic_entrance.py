"""The address of a simulation's traffic: where robots take part that are not simulated."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from somrs.kernel.component import Effect, Input, Notified, Received, Send
from somrs.protocol.messages.envelope import Message
from somrs.runtime.host import Host

if TYPE_CHECKING:
    from somrs.devices.simulator.server.simulation import Simulation

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
