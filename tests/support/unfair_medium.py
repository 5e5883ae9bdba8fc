"""Components on virtual time whose messages a test loses, doubles and reorders as it wants."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

from somrs.kernel.component import Component, Input, Received, Send, SetTimer, Started, TimerFired
from somrs.protocol.messages.envelope import Message


@dataclass
class UnfairMedium:
    """Carries messages between `components`. Messages to others go nowhere."""

    components: dict[str, Component]
    now: float = 0.0
    bag: list[Message] = field(default_factory=list)
    timers: dict[tuple[str, Hashable], float] = field(default_factory=dict)

    def feed(self, address: str, event: Input) -> None:
        for effect in self.components[address].handle(event, self.now):
            match effect:
                case Send(message) if message.header.recipient in self.components:
                    self.bag.append(message)
                case SetTimer(timer, fire_time):
                    self.timers.pop((address, timer), None)
                    if fire_time is not None:
                        self.timers[address, timer] = fire_time

    def replace(self, address: str, component: Component) -> None:
        """A component restarts."""
        self.components[address] = component
        self.feed(address, Started(address))

    def carry(self, action: str, index: int) -> None:
        """`deliver` a message, deliver it `twice`, or `lose` it."""
        if not self.bag:
            return
        message = self.bag[index % len(self.bag)]
        if action != "twice":
            self.bag.remove(message)
        if action != "lose":
            self.feed(message.header.recipient, Received(message))

    def ring(self) -> None:
        """Let time go on until the next timer fires."""
        if self.timers:
            (address, timer), fire_time = min(self.timers.items(), key=lambda item: item[1])
            del self.timers[address, timer]
            self.now = max(self.now, fire_time)
            self.feed(address, TimerFired(timer))

    def settle(self) -> None:
        """From here on the medium is fair: what is under way arrives, then time goes on."""
        for _ in range(40):
            while self.bag:
                self.carry("deliver", 0)
            self.ring()
