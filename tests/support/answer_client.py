"""A client of components on virtual time: it receives answers."""

from __future__ import annotations

from typing import TypeVar

from somrs.kernel.component import Effect, Input, Received
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.runtime.virtual_time import World
from tests.support.lab import CLIENT

B = TypeVar("B")


class AnswerClient:
    """Sends requests from outside, and has the `answers` by message id."""

    def __init__(self, world: World) -> None:
        self.answers: dict[str, Body] = {}
        self._world, self._requests = world, dict[str, Message]()
        world.add(CLIENT, self)

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received) and event.message.header.relates_to:
            self.answers[event.message.header.relates_to] = event.message.body
        return []

    def send(self, address: str, body: Body) -> str:
        """Send a request, and return its id."""
        id = message_id("client", len(self._requests))
        self._requests[id] = Message(header=Header(sender=CLIENT, recipient=address, message_id=id, reply_to=CLIENT), body=body)
        self._world.send(self._requests[id])
        return id

    def repeat(self) -> None:
        """Send the requests without an answer again."""
        for id, message in self._requests.items():
            if id not in self.answers:
                self._world.send(message)

    def ask(self, address: str, body: Body, answer: type[B]) -> B:
        """Return the answer, which has to be of that type."""
        id = self.send(address, body)
        assert self._world.run(7200.0, lambda: id in self.answers), f"{address} does not answer {body}"
        received = self.answers[id]
        assert isinstance(received, answer), received
        return received
